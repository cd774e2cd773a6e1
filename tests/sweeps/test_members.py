"""One member: its result, its errors, and going on from its last save."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from morphosim import RunWriter, Simulation, save_scene
from morphosim.sweeps import members
from morphosim.sweeps.axes import Member
from morphosim.sweeps.store import Store

from ..helpers import EXPECTED_TO_FAIL
from .scenes import length, pair, task


def flawed(run: xr.Dataset) -> xr.DataArray:
    """Figure with an attribute that netCDF cannot hold."""
    return xr.DataArray(1.0, attrs={"is": True})


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Directory with the scene of a scan."""
    save_scene(pair(), tmp_path / "scene.toml")
    return Store(tmp_path)


def test_a_member_gives_what_its_simulation_gives(store: Store) -> None:
    assert task(store.path)(Member(3, {"physics.gamma": 0.4})) == ""
    simulation = Simulation(pair().with_physics(gamma=0.4))
    simulation.run()
    result = store.read(3)
    np.testing.assert_array_equal(result["volume"], simulation.volumes)
    assert result["cell"].values.tolist() == ["left", "right"]
    assert result["end_time"] == 20
    assert result.attrs["seconds"] > 0
    assert store.finished() == {3}
    assert not store.run(3).exists()


def test_a_function_has_the_fields_and_runs_stay_on_request(store: Store) -> None:
    assert task(store.path, [length], keep_runs=True)(Member(0, {})) == ""
    assert 10 <= store.read(0)["length"].sel(side="y") <= 13
    assert len(list(store.run(0).glob("save-*.nc"))) == 3


def test_members_take_their_steps_by_their_tolerances(store: Store) -> None:
    steps = []
    for k, tolerance in enumerate((5.0, 100.0)):
        assert task(store.path, ["step"])(Member(k, {"numerics.tolerance": tolerance})) == ""
        steps.append(int(store.read(k)["step"]))
    assert steps[0] > steps[1]


@EXPECTED_TO_FAIL
def test_a_member_that_diverges_has_its_error(store: Store) -> None:
    values = {"numerics.dt": 10.0, "numerics.S": 0.0, "duration": 5000.0}
    assert "diverged" in task(store.path)(Member(0, values))
    result = store.read(0)
    assert "diverged" in result.attrs["error"]
    assert "numerics.S" in result.attrs["warning"]
    assert not result.data_vars
    assert not store.run(0).exists()
    assert store.failed() == {0}


def test_a_figure_that_no_file_can_hold_is_the_members_error(store: Store) -> None:
    error = task(store.path, [flawed])(Member(0, {}))
    assert error.startswith("TypeError")
    assert store.read(0).attrs["error"] == error
    assert store.failed() == {0}


def test_a_full_disk_is_no_result(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(members, "measured", full)
    assert "No space left" in task(store.path)(Member(0, {}))
    assert store.finished() == set()
    assert store.run(0).exists()


def test_a_member_under_way_goes_on_from_its_last_save(store: Store) -> None:
    whole, parts = Member(0, {}), Member(1, {})
    task(store.path)(whole)
    first = Simulation(pair())
    first.run(until=10, observers=[RunWriter(store.run(1), every=10)])
    saved = store.run(1) / "save-000000.nc"
    before = saved.stat().st_mtime_ns
    task(store.path, keep_runs=True)(parts)
    assert saved.stat().st_mtime_ns == before
    np.testing.assert_array_equal(store.read(1)["volume"], store.read(0)["volume"])


def test_a_member_whose_state_is_lost_starts_again(store: Store) -> None:
    Simulation(pair()).run(until=10, observers=[RunWriter(store.run(0), every=10)])
    for state in store.run(0).glob("restart-*.npz"):
        state.unlink()
    assert task(store.path)(Member(0, {})) == ""
    assert store.read(0)["end_time"] == 20
