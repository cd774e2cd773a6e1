"""Runs on disk: opened by plain xarray, whole at any end of a run."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from morphosim import (
    Cell,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    load_fields,
    open_run,
)


def scene(**options: object) -> Scene:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=3), type=kind)
        for name, x, kind in (("a", 0.0, "soft"), ("b", 5.5, "stiff"))
    ]
    return Scene(**({"cells": cells, "numerics": Numerics(threads=1)} | options))


def written(folder: Path, every: float, until: float) -> Simulation:
    simulation = Simulation(scene())
    simulation.run(until=until, observers=[RunWriter(folder, every)])
    return simulation


def test_plain_xarray_opens_a_run(tmp_path: Path) -> None:
    simulation = written(tmp_path, 10, 20)
    with xr.open_dataset(tmp_path / "run.nc") as data:
        assert data["time"].values.tolist() == [0, 10, 20]
        assert data["cell"].values.tolist() == ["a", "b"]
        assert data["type"].values.tolist() == ["soft", "stiff"]
        last = data.isel(time=-1)
        np.testing.assert_allclose(last["volume"], simulation.volumes)
        np.testing.assert_allclose(last["centroid"], simulation.centroids)
        assert data["volume"].attrs["units"] == "um3"
        assert data["row_size"].attrs["sample_dimension"] == "sample"
        assert int(data["row_size"].sum()) == data.sizes["sample"]


@pytest.mark.parametrize(("every", "times"), [(7, [0, 8, 14, 20]), (100, [0, 20])])
def test_saves_are_at_the_first_step_that_is_due_and_at_the_end(
    tmp_path: Path, every: float, times: list[float]
) -> None:
    written(tmp_path, every, 20)
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == times


def test_fields_are_those_of_the_simulation(tmp_path: Path) -> None:
    simulation = written(tmp_path, 10, 20)
    with open_run(tmp_path) as data:
        for saved, live in zip(load_fields(data, -1), simulation.fields, strict=True):
            assert saved.name == live.name
            np.testing.assert_array_equal(saved.origin, live.origin)
            np.testing.assert_array_equal(saved.phi, live.phi)
        with pytest.raises(IndexError):
            load_fields(data, 3)


def test_a_directory_with_a_run_is_refused(tmp_path: Path) -> None:
    written(tmp_path, 10, 4)
    with pytest.raises(FileExistsError, match="already holds a run"):
        RunWriter(tmp_path, 10)


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_a_run_that_is_cut_short_keeps_its_last_state(
    tmp_path: Path, error: type[BaseException]
) -> None:
    class Stop:
        def start(self, simulation: Simulation) -> None:
            pass

        def after_step(self, simulation: Simulation) -> None:
            if simulation.time >= 6:
                raise error

        def finish(self, simulation: Simulation) -> None:
            pass

    simulation = Simulation(scene())
    with pytest.raises(error):
        simulation.run(until=20, observers=[RunWriter(tmp_path, 100), Stop()])
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == [0, 6]


def test_a_cell_that_is_removed_is_missing_from_then_on(tmp_path: Path) -> None:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=radius))
        for name, x, radius in (("small", 0.0, 3.0), ("large", 20.0, 6.0))
    ]
    # The absolute form with c = 1 cannot keep small cells (Fig. 3 of the paper).
    old = Physics(c=1.0, volume_constraint="absolute")
    simulation = Simulation(scene(cells=cells, physics=old, on_vanish="remove"))
    simulation.run(until=200, observers=[RunWriter(tmp_path, 200)])
    assert [name for _, name in simulation.removed] == ["small"]
    with open_run(tmp_path) as data:
        volume = data["volume"].values
        assert volume[0, 0] > 0
        assert np.isnan(volume[1, 0])
        assert volume[1, 1] > 0
        assert [f.name for f in load_fields(data, 1)] == ["large"]
