"""Output, further cases: CF attributes, writers used wrongly, ends by errors of other kinds."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Cell,
    CellVanishedError,
    DivergenceError,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    load_fields,
    open_run,
)
from morphosim.runs import writer

from ..helpers import EXPECTED_TO_FAIL


def ball(name: str = "a", x: float = 0.0, **options: Any) -> Cell:
    return Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=3), **options)


def start(*cells: Cell, physics: dict | None = None, **options: Any) -> Simulation:
    model = Physics(**(physics or {}))
    numerics = {"threads": 1} | options.pop("numerics", {})
    return Simulation(
        Scene(cells=cells or [ball()], physics=model, numerics=Numerics(**numerics), **options)
    )


def times(folder: Path) -> list[float]:
    with open_run(folder) as data:
        return data["time"].values.tolist()


def test_ragged_fields_follow_cf(tmp_path: Path) -> None:
    simulation = start(ball(), ball("b", 5.5))
    simulation.run(until=4, observers=[RunWriter(tmp_path, 2)])
    with open_run(tmp_path) as data:
        assert data.attrs["Conventions"].startswith("CF-1.")
        assert data.attrs["spacing_um"] == 0.5
        assert data["box_time"].attrs["instance_dimension"] == "time"
        assert data["box_cell"].attrs["instance_dimension"] == "cell"
        assert data["box_time"].values.tolist() == [0, 0, 1, 1, 2, 2]
        assert data["box_cell"].values.tolist() == [0, 1] * 3
        assert data["phi"].dtype == np.float32
        np.testing.assert_array_equal(data["box_shape"].prod("axis"), data["row_size"])
        for name in data.variables:
            assert data[name].attrs["long_name"], name
        for name in set(data.data_vars) - {"type", "parent", "stage", "events"}:
            assert data[name].attrs["units"], name


def test_saved_numbers_are_those_of_the_saved_fields(tmp_path: Path) -> None:
    simulation = start(ball("a", volume=lambda t: 140 + t))
    simulation.run(until=6, observers=[RunWriter(tmp_path, 2, fields="exact")])
    with open_run(tmp_path) as data:
        for k, time in enumerate([0, 2, 4, 6]):
            (saved,) = load_fields(data, k)
            found = {name: float(data[name][k, 0]) for name in ("volume", "core_volume")}
            assert found["volume"] == pytest.approx(saved.phi.sum(dtype=float) / 8, rel=1e-6)
            assert found["core_volume"] == (saved.phi > 0.5).sum() / 8
            assert float(data["target_volume"][k, 0]) == 140 + time
        with pytest.raises(IndexError, match="index = 4: the run has no such save; it has 4"):
            load_fields(data, 4)


def test_saves_are_not_lost_to_rounding(tmp_path: Path) -> None:
    # 3 steps of 0.3 are 0.8999999999999999.
    start(numerics={"dt": 0.3}).run(until=2.7, observers=[RunWriter(tmp_path, 0.9)])
    np.testing.assert_allclose(times(tmp_path), [0, 0.9, 1.8, 2.7])


def test_a_run_that_is_not_stepped_is_saved_once(tmp_path: Path) -> None:
    start().run(until=0, observers=[RunWriter(tmp_path, 2)])
    assert times(tmp_path) == [0]


def test_a_run_may_start_late(tmp_path: Path) -> None:
    simulation = start()
    simulation.step(3)
    simulation.run(until=12, observers=[RunWriter(tmp_path, 4)])
    assert times(tmp_path) == [6, 8, 12]


def test_double_precision_is_kept(tmp_path: Path) -> None:
    simulation = start(numerics={"precision": "double"})
    simulation.run(until=0, observers=[RunWriter(tmp_path, 2, fields="exact")])
    with open_run(tmp_path) as data:
        np.testing.assert_array_equal(load_fields(data, 0)[0].phi, simulation.fields[0].phi)
        assert data["phi"].dtype == np.float64


def test_a_directory_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(OSError, match="file"):
            RunWriter(path, 2)


def test_a_directory_without_a_run(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="holds no run"):
        open_run(tmp_path)


@EXPECTED_TO_FAIL
def test_a_divergence_leaves_finite_fields(tmp_path: Path) -> None:
    simulation = start(physics={"M": 1e6}, numerics={"S": 6.0})
    with pytest.raises(DivergenceError):
        simulation.run(until=300, observers=[RunWriter(tmp_path, 100, fields="exact")])
    with open_run(tmp_path) as data:
        (last,) = load_fields(data, -1)
        np.testing.assert_array_equal(last.phi, simulation.fields[0].phi)
        assert float(data["volume"][-1, 0]) == pytest.approx(last.phi.sum(dtype=float) / 8)


def test_a_vanished_cell_leaves_its_last_field(tmp_path: Path) -> None:
    simulation = start(physics={"c": 1.0, "volume_constraint": "absolute"})
    with pytest.raises(CellVanishedError):
        simulation.run(until=200, observers=[RunWriter(tmp_path, 1000)])
    assert times(tmp_path) == [0, simulation.time]


def test_the_last_cell_vanishing_leaves_a_readable_file(tmp_path: Path) -> None:
    physics = {"c": 1.0, "volume_constraint": "absolute"}
    simulation = start(physics=physics, on_vanish="remove")
    with pytest.raises(CellVanishedError):
        simulation.run(until=200, observers=[RunWriter(tmp_path, 1000)])
    assert times(tmp_path) == [0, simulation.time]


def test_a_volume_that_turns_negative_leaves_the_last_state(tmp_path: Path) -> None:
    simulation = start(ball(volume=lambda t: 110 - 20 * t))
    observer = RunWriter(tmp_path, 100)
    with pytest.raises(ValueError, match="volume at t = 6"):
        simulation.run(until=30, observers=[observer])
    assert times(tmp_path) == [0, 6]
    with observer.files.locked():  # nothing holds the directory any more
        pass


def test_an_interrupted_save_is_made_up_for_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, calls = writer.write_save, []

    def interrupted(*arguments: Any) -> None:
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        write(*arguments)

    monkeypatch.setattr(writer, "write_save", interrupted)
    simulation = start()
    with pytest.raises(KeyboardInterrupt):
        simulation.run(until=30, observers=[RunWriter(tmp_path, 4, fields="exact")])
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == [0, 4]
        (last,) = load_fields(data, -1)
    np.testing.assert_array_equal(last.phi, simulation.fields[0].phi)


def test_a_writer_does_not_overwrite_its_own_first_run(tmp_path: Path) -> None:
    simulation, writer = start(), RunWriter(tmp_path, 4)
    simulation.run(until=8, observers=[writer])
    with pytest.raises(FileExistsError):
        simulation.run(until=16, observers=[writer])
    assert times(tmp_path) == [0, 4, 8]


def test_a_writer_does_not_overwrite_the_run_of_another(tmp_path: Path) -> None:
    first, second = RunWriter(tmp_path, 4), RunWriter(tmp_path, 4)
    start().run(until=8, observers=[first])
    with pytest.raises(FileExistsError):
        start().run(until=0, observers=[second])
    assert times(tmp_path) == [0, 4, 8]


@pytest.mark.parametrize("every", [0, -1, np.nan, "x", True])
def test_the_time_between_saves_is_checked(tmp_path: Path, every: Any) -> None:
    with pytest.raises((ValueError, TypeError), match="every"):
        RunWriter(tmp_path, every)
