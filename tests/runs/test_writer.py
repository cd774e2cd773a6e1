"""Runs on disk: what is saved, when, and that plain xarray opens it."""

import json
import zlib
from pathlib import Path
from typing import Any

import netCDF4
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
    contact_areas,
    load_fields,
    load_scene,
    open_run,
)
from morphosim.measure.label_image import label_image
from morphosim.runs import netcdf_variables


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


def test_one_dataset_of_all_saves(tmp_path: Path) -> None:
    simulation = written(tmp_path, 10, 20)
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == [0, 10, 20]
        assert data["step"].values.tolist() == [0, 5, 10]
        assert data["cell"].values.tolist() == ["a", "b"]
        last = data.isel(time=-1)
        assert last["type"].values.tolist() == ["soft", "stiff"]
        np.testing.assert_allclose(last["volume"], simulation.volumes)
        np.testing.assert_allclose(last["centroid"], simulation.centroids, atol=1e-6)
        assert data["volume"].attrs["units"] == "um3"
        assert data["row_size"].attrs["sample_dimension"] == "sample"
        assert int(data["row_size"].sum()) == data.sizes["sample"]


def test_a_scene_or_a_run_that_exists_is_replaced_only_if_asked(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("mine")
    with pytest.raises(FileExistsError, match=r"scene\.toml exists and would be replaced"):
        RunWriter(tmp_path, 10)
    assert (tmp_path / "scene.toml").read_text() == "mine"
    writer = RunWriter(tmp_path / "late", 10)
    (tmp_path / "late" / "scene.toml").write_text("mine")  # after the writer was made
    with pytest.raises(FileExistsError, match=r"scene\.toml exists"):
        Simulation(scene()).run(until=2, observers=[writer])
    assert (tmp_path / "late" / "scene.toml").read_text() == "mine"

    for until in (20, 10):
        replaces = RunWriter(tmp_path, 10, overwrite=True)
        Simulation(scene(duration=until)).run(observers=[replaces])
        with pytest.raises(FileExistsError, match=r"already holds a run.*overwrite=True"):
            RunWriter(tmp_path, 10)
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == [0, 10]
    assert load_scene(tmp_path / "scene.toml").duration == 10


def test_plain_xarray_opens_the_fields_of_a_save(tmp_path: Path) -> None:
    written(tmp_path, 10, 20)
    saves = sorted(tmp_path.glob("save-*.nc"))
    assert [p.name for p in saves] == [f"save-00000{k}.nc" for k in range(3)]
    with open_run(tmp_path) as data, xr.open_dataset(saves[-1], group="fields") as fields:
        boxes = data["box_time"] == 2
        assert fields["row_size"].values.tolist() == data["row_size"][boxes].values.tolist()
        np.testing.assert_array_equal(fields["phi"], data["phi"][-fields.sizes["sample"] :].values)


def test_shapes_speed_and_contacts_are_saved(tmp_path: Path) -> None:
    simulation = Simulation(scene(physics=Physics(sigma=0.5)))
    before = {}

    class Look:
        def start(self, simulation: Simulation) -> None:
            pass

        def after_step(self, simulation: Simulation) -> None:
            before[simulation.time] = simulation.centroids

        def finish(self, simulation: Simulation) -> None:
            pass

    simulation.run(until=40, observers=[Look(), RunWriter(tmp_path, 40)])
    with open_run(tmp_path) as data:
        assert np.isnan(data["speed"].values[0]).all()
        moved = np.linalg.norm(before[40.0] - before[30.0], axis=1) / 10
        np.testing.assert_allclose(data["speed"].values[1], moved, atol=1e-9)
        assert float(data["rms_speed"][1]) == pytest.approx(np.sqrt(np.mean(moved**2)))
        last = data.isel(time=-1)
        (area,) = contact_areas(simulation.fields, 0.5).values()
        assert last["contact_area"].values == pytest.approx(np.array([[0, area], [area, 0]]))
        ball = 4 / 3 * np.pi * last["semi_axes"].values.prod(axis=1)
        np.testing.assert_allclose(ball, last["enclosed_volume"], rtol=0.07)
        assert (last["sphericity"] > 0.95).all()
        assert (last["sphericity"] <= 1.001).all()
        eta = last["surface_area"] ** 0.5 / last["enclosed_volume"] ** (1 / 3)
        np.testing.assert_allclose(last["irregularity"], eta)
        for k, saved in enumerate(load_fields(data, -1)):
            np.testing.assert_allclose(last["box_low"][k], saved.origin * 0.5)
            high = (saved.origin + np.array(saved.phi.shape) - 1) * 0.5
            np.testing.assert_allclose(last["box_high"][k], high)


def test_provenance_is_saved(tmp_path: Path) -> None:
    Simulation(scene(name="pair", numerics=Numerics(threads=1, seed=7))).run(
        until=2, observers=[RunWriter(tmp_path, 10)]
    )
    assert load_scene(tmp_path / "scene.toml").numerics.seed == 7
    with open_run(tmp_path) as data:
        assert data.attrs["title"] == "MorphoSim run of pair"
        assert data.attrs["seed"] == json.loads(data.attrs["numerics"])["seed"] == 7
        assert json.loads(data.attrs["physics"])["tau"] == 2.62
        assert json.loads(data.attrs["versions"])["numpy"] == np.__version__
        assert data.attrs["machine"]
        assert data.attrs["error"] == ""


@pytest.mark.parametrize(("every", "times"), [(7, [0, 8, 14, 20]), (100, [0, 20])])
def test_saves_are_at_the_first_step_that_is_due_and_at_the_end(
    tmp_path: Path, every: float, times: list[float]
) -> None:
    written(tmp_path, every, 20)
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == times


@pytest.mark.parametrize(("kept", "error"), [("exact", 0), ("packed", 6.3e-5)])
def test_fields_are_those_of_the_simulation(tmp_path: Path, kept: str, error: float) -> None:
    simulation = Simulation(scene())
    simulation.run(until=20, observers=[RunWriter(tmp_path, 10, fields=kept)])
    with open_run(tmp_path) as data:
        for saved, live in zip(load_fields(data, -1), simulation.fields, strict=True):
            assert saved.name == live.name
            assert saved.phi.dtype == np.float32
            np.testing.assert_array_equal(saved.origin, live.origin)
            np.testing.assert_allclose(saved.phi, live.phi, rtol=0, atol=error)
        with pytest.raises(IndexError):
            load_fields(data, 3)


def test_a_run_without_fields(tmp_path: Path) -> None:
    simulation = Simulation(scene())
    simulation.run(until=4, observers=[RunWriter(tmp_path, 2, fields="none")])
    with open_run(tmp_path) as data:
        assert "phi" not in data
        assert data["volume"].shape == (3, 2)
        with pytest.raises(ValueError, match="saved without"):
            load_fields(data, -1)
    assert Simulation.from_run(tmp_path).time == 4


def test_label_images_on_request(tmp_path: Path) -> None:
    simulation = Simulation(scene())
    simulation.run(until=4, observers=[RunWriter(tmp_path, 4, labels=True)])
    origin, labels = label_image(simulation.fields)
    with open_run(tmp_path) as data:
        assert data["label_time"].values.tolist() == [0, 1]
        np.testing.assert_array_equal(data["label_origin"][1], origin)
        size = int(data["label_size"][1])
        np.testing.assert_array_equal(
            data["label"][-size:].values.reshape(data["label_shape"][1].values), labels
        )


def test_options_are_checked(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="fields = 'all'"):
        RunWriter(tmp_path, 10, fields="all")


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
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=radius), type="soft")
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
        assert data["type"].values[1].tolist() == ["", "soft"]
        assert [f.name for f in load_fields(data, 1)] == ["large"]


@pytest.mark.parametrize(
    "compressor", [zlib.compress, netcdf_variables.deflate], ids=["zlib", "quickest"]
)
@pytest.mark.parametrize("threads", [1, 2])
def test_fields_are_compressed_as_the_hdf5_library_does_it(
    threads: int, compressor: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(netcdf_variables, "deflate", compressor)
    cell = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=9))
    simulation = Simulation(Scene(cells=[cell], numerics=Numerics(threads=threads)))
    simulation.run(until=0, observers=[RunWriter(tmp_path, 2)])
    save = tmp_path / "save-000000.nc"
    size = save.stat().st_size
    with netCDF4.Dataset(save, "a") as file:
        phi = file["fields"]["phi"]
        phi.set_auto_maskandscale(False)
        wanted = np.rint(simulation.fields[0].phi.ravel() * np.float32(8000))
        np.testing.assert_array_equal(phi[...], wanted)
        assert len(wanted) > 2 * netcdf_variables.CHUNK
        assert len(wanted) % netcdf_variables.CHUNK, "the last chunk is full"
        assert phi.filters() | {"zlib": True, "shuffle": True, "complevel": 1} == phi.filters()
        phi[...] = wanted[::-1]  # by the library, into the same chunks
    with open_run(save) as run:
        assert load_fields(run, 0)[0].phi[0, 0, 0] == np.float32(wanted[-1]) * np.float32(1 / 8000)
    assert size == pytest.approx(save.stat().st_size, rel=0.2)
