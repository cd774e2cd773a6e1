"""What a scan keeps, the check that a directory is its own, and the Dataset of it all."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from morphosim import save_scene
from morphosim.sweeps.result import assembled
from morphosim.sweeps.store import Store

from .scenes import pair, plan


def staged(path: Path, **options: object) -> Store:
    path.mkdir()
    save_scene(pair(**options), path / "scene.toml")
    return Store(path)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Directory of a scan."""
    (tmp_path / "scan").mkdir()
    store = Store(tmp_path / "scan")
    store.begin({"axes": {"physics.gamma": [0.2]}, "keep": "runs"}, staged(tmp_path / "staged"))
    return store


@pytest.mark.parametrize(
    ("description", "expected"),
    [
        ({"axes": {"physics.gamma": [0.3]}, "keep": "runs"}, "axes: physics.gamma is [0.2] there"),
        ({"axes": {"physics.gamma": [0.2], "x": [1]}, "keep": "runs"}, "axes: x is absent there"),
        ({"axes": {"physics.gamma": [0.2]}, "keep": "figures"}, "keep is runs there and figures"),
    ],
)
def test_a_directory_of_another_scan_is_refused(
    store: Store, tmp_path: Path, description: dict, expected: str
) -> None:
    with pytest.raises(ValueError, match="holds another scan") as caught:
        store.begin(description, Store(tmp_path / "staged"))
    assert expected in str(caught.value)


def test_a_directory_of_another_scene_is_refused(store: Store, tmp_path: Path) -> None:
    description = json.loads(store.plan.read_text())
    store.begin(description, Store(tmp_path / "staged"))
    with pytest.raises(ValueError, match=r"another scene: 'duration = 20.0' there"):
        store.begin(description, staged(tmp_path / "other", duration=30.0))


def test_a_directory_of_something_else_is_refused(tmp_path: Path) -> None:
    other = staged(tmp_path / "staged")
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "thesis.tex").touch()
    with pytest.raises(FileExistsError, match=r"'thesis\.tex' and no scan"):
        Store(tmp_path / "scan").begin({}, other)
    assert [p.name for p in (tmp_path / "scan").iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("name", ["scene.toml", "scene.npz"])
def test_a_scene_of_ones_own_is_not_replaced_but_that_of_a_scan_just_begun(
    name: str, tmp_path: Path
) -> None:
    other = staged(tmp_path / "staged")
    file = tmp_path / "scan" / name
    file.parent.mkdir()
    file.write_text("mine")
    with pytest.raises(FileExistsError, match=f"'{name}' and no scan"):
        Store(tmp_path / "scan").begin({}, other)
    assert file.read_text() == "mine"
    file.unlink()
    (tmp_path / "scan" / "scene.toml").write_bytes(other.scene.read_bytes())  # killed there
    Store(tmp_path / "scan").begin({}, other)
    assert Store(tmp_path / "scan").plan.exists()


def table(cells: list[str], values: list[float], times: list[float]) -> xr.Dataset:
    return xr.Dataset(
        {
            "volume": ("cell", values, {"units": "um3"}),
            "kind": ("cell", np.array(["E"] * len(cells), dtype=object)),
            "count": len(cells),
            "speed": ("time", np.arange(len(times), dtype=float)),
        },
        {"cell": cells, "time": times},
    )


def test_results_come_together_on_the_labels_of_all(store: Store) -> None:
    facts = {"warning": "", "seconds": 2.0}
    store.write(0, table(["b", "a"], [1, 2], [0, 4]), error="", **facts)
    store.write(1, table(["b", "c"], [3, 4], [0, 2]), error="", **facts)
    store.write(2, None, error="diverged", **facts)
    made = plan({"physics.gamma": [0.2, 0.3], "numerics.dt": [1.0, 2.0]})
    result = assembled(store, made, {3: "KilledWorker"})
    assert result["cell"].values.tolist() == ["b", "a", "c"]
    assert result["time"].values.tolist() == [0, 2, 4]
    nan = np.nan
    np.testing.assert_array_equal(
        result["volume"], [[[1, 2, nan], [3, nan, 4]], [[nan] * 3, [nan] * 3]]
    )
    np.testing.assert_array_equal(result["speed"][0], [[0, nan, 1], [0, 1, nan]])
    np.testing.assert_array_equal(result["count"], [[2, 2], [nan, nan]])
    assert result["kind"].values[0].tolist() == [["E", "E", ""], ["E", "", "E"]]
    assert result["error"].values.tolist() == [["", ""], ["diverged", "KilledWorker"]]
    assert np.isnan(result["seconds"].values[1, 1])
    assert result["volume"].attrs["units"] == "um3"
    assert store.failed() == {2}
    store.forget(2)
    again = assembled(store, made, {})
    assert again["error"].sel({"physics.gamma": 0.3, "numerics.dt": 1}).item() == "not run yet"


def test_a_scan_that_failed_altogether_has_its_errors(store: Store) -> None:
    store.write(0, None, error="diverged", warning="", seconds=1.0)
    result = assembled(store, plan({"physics.gamma": [0.2]}), {})
    assert result["error"].values.tolist() == ["diverged"]


def test_a_figure_that_changes_shape_is_named(store: Store) -> None:
    for k in (0, 1):
        array = xr.Dataset({"odd": ("side", np.zeros(2 + k))})
        store.write(k, array, error="", warning="", seconds=1.0)
    with pytest.raises(ValueError, match="figure 'odd' differs in shape"):
        assembled(store, plan({"physics.gamma": [0.2, 0.3]}), {})
