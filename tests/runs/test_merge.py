"""One Dataset of all saves, of cells that come and go, read lazily, packed into one file."""

import pickle
import shutil
from contextlib import suppress
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
    label_image,
    load_fields,
    open_run,
    pack,
    provenance,
)
from morphosim.errors import DamageWarning
from morphosim.runs import lazy_concat as lazy
from morphosim.runs import merge, netcdf_variables, save_file, saved_fields
from morphosim.runs.saved_fields import each_field
from morphosim.runs.schema import CONTACT_MATRIX

from ..helpers import adopt_save


def simulation(names: str = "abc", **options: object) -> Simulation:
    cells = [
        Cell(name=name, shape=Sphere(center=(5.5 * k, 0, 0), radius=3), parent="m" + name)
        for k, name in enumerate(names)
    ]
    return Simulation(
        Scene(cells=cells, numerics=Numerics(threads=1), physics=Physics(sigma=0.5), **options)
    )


@pytest.fixture
def changing(tmp_path: Path) -> Path:
    """Run whose first cell goes and whose last is new, as after a division."""
    folder = tmp_path / "run"
    simulation("abc").run(until=0, observers=[RunWriter(folder, 2, labels=True)])
    simulation("bcd").run(until=0, observers=[RunWriter(tmp_path / "later", 2, labels=True)])
    later = folder / "save-000001.nc"
    adopt_save(tmp_path / "later" / "save-000000.nc", later, 2.0, 1)
    return folder


def test_cells_that_come_and_go(changing: Path) -> None:
    with open_run(changing) as data:
        assert data["cell"].values.tolist() == list("abcd")
        assert data["parent"].values.tolist() == ["ma", "mb", "mc", "md"]
        alive = np.isfinite(data["volume"].values)
        assert alive.tolist() == [[True, True, True, False], [False, True, True, True]]
        x = data["centroid"].sel(axis="x").values
        np.testing.assert_allclose(x[1, 1:], [0, 5.5, 11], atol=1e-3)
        areas = data["contact_area"]
        assert float(areas.sel(time=0, cell="a", neighbour="b")) > 0
        assert np.isnan(areas.sel(time=2, cell="a", neighbour="b"))
        assert float(areas.sel(time=2, cell="c", neighbour="d")) > 0
        assert [f.name for f in load_fields(data, 0)] == list("abc")
        assert [f.name for f in load_fields(data, 1)] == list("bcd")
        assert [f.name for f in load_fields(data, 1, ["d", "b"])] == ["b", "d"]
        first = int(data["label_size"][0])
        assert set(np.unique(data["label"][:first].values)) == {0, 1, 2, 3}
        assert set(np.unique(data["label"][first:].values)) == {0, 2, 3, 4}


def test_saves_that_a_run_has_gone_back_behind_do_not_count(tmp_path: Path) -> None:
    simulation().run(until=6, observers=[RunWriter(tmp_path, 2)])
    with netCDF4.Dataset(tmp_path / "save-000003.nc", "a") as file:
        file["time"][:], file["step"][:] = 2.0, 1
    with pytest.warns(
        DamageWarning, match=r"save-00000[12]\.nc is not of an earlier time than .*3"
    ):
        data = open_run(tmp_path)
    with data:
        assert data["step"].values.tolist() == [0, 1]
        assert data["box_time"].values.tolist() == [0, 0, 0, 1, 1, 1]


def test_plain_xarray_joins_cells_that_come_and_go(changing: Path) -> None:
    saves = [xr.open_dataset(path) for path in sorted(changing.glob("save-*.nc"))]
    plain = xr.concat(
        saves, "time", join="outer", data_vars="all", coords="minimal", compat="override"
    )
    with open_run(changing) as data:
        np.testing.assert_array_equal(plain["volume"].sel(cell=data["cell"]), data["volume"])


def test_contacts_are_a_list_beyond_many_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dense = tmp_path / "dense"
    simulation().run(until=2, observers=[RunWriter(dense, 2)])
    monkeypatch.setattr(save_file, "MOST_DENSE_CELLS", 2)
    simulation().run(until=2, observers=[RunWriter(tmp_path / "list", 2)])
    with open_run(dense) as data:
        areas = data["contact_area"].values
    with open_run(tmp_path / "list") as data:
        assert "contact_area" not in data
        rows = [data[f"contact_{k}"].values for k in ("time", "cell", "neighbour")]
        assert rows[0].tolist() == [0, 0, 1, 1]
        np.testing.assert_array_equal(data["contact_pair_area"], areas[tuple(rows)])
    # A run of both kinds gives the list.
    adopt_save(tmp_path / "list" / "save-000001.nc", dense / "save-000002.nc", 4.0, 2)
    with open_run(dense) as data:
        assert data["contact_time"].values.tolist() == [0, 0, 1, 1, 2, 2]
        np.testing.assert_array_equal(
            data["contact_pair_area"][:4], areas[tuple(row[:4] for row in rows)]
        )


def test_contacts_of_long_runs_are_a_list(changing: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_run(changing) as data:
        areas = data["contact_area"].values
    monkeypatch.setattr(merge, "MOST_IN_MATRIX", areas.size - 1)
    with open_run(changing) as data:
        assert "contact_area" not in data
        rows = [data[f"contact_{k}"].values for k in ("time", "cell", "neighbour")]
        assert (rows[1] < rows[2]).all()
        np.testing.assert_array_equal(data["contact_pair_area"], areas[tuple(rows)])
        assert len(rows[0]) == np.count_nonzero(np.nan_to_num(areas)) // 2


def test_a_packed_run_is_read_time_by_time(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "packed.nc", "w") as file:
        created = netcdf_variables.create(
            file, "contact_area", CONTACT_MATRIX["contact_area"], (400, 300, 300), "f4"
        )
        assert created.chunking() == [1, 300, 300]


def test_fields_are_read_when_they_are_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation().run(until=6, observers=[RunWriter(tmp_path, 2)])
    reads = []
    read = lazy.Segment.read
    with open_run(tmp_path) as data:
        monkeypatch.setattr(
            lazy.Segment, "read",
            lambda self, part: reads.append((self.path.name, part)) or read(self, part),
        )  # fmt: skip
        load_fields(data, 2)
        assert [name for name, _ in reads] == ["save-000002.nc"]
        reads.clear()
        load_fields(data, 1, ["b"])
        ((name, part),) = reads
        assert name == "save-000001.nc"
        assert part.stop - part.start == int(data["row_size"][4])
        reads.clear()
        everything = data["phi"].values
        assert len(reads) == 4
        for key in (slice(5, 3000, 7), slice(None, None, -1000), 17, slice(9, 9)):
            np.testing.assert_array_equal(data["phi"][key].values, everything[key])


@pytest.mark.parametrize("kept", ["packed", "exact", "none"])
def test_a_packed_run_is_the_same_dataset(tmp_path: Path, kept: str) -> None:
    folder, file = tmp_path / "run", tmp_path / "run.nc"
    simulation().run(until=4, observers=[RunWriter(folder, 2, fields=kept, labels=True)])
    told = []
    pack(folder, file, lambda *progress: told.append(progress))
    with open_run(folder) as data, xr.open_dataset(file) as plain, open_run(file) as packed:
        assert set(plain.variables) == set(data.variables)
        for name in data.variables:
            xr.testing.assert_identical(data[name].variable, plain[name].variable)
        for name, value in data.attrs.items():
            assert plain.attrs[name] == value
        assert plain.attrs["scene_toml"] == (folder / "scene.toml").read_text()
        if kept != "none":
            np.testing.assert_array_equal(
                load_fields(packed, 1)[2].phi, load_fields(data, 1)[2].phi
            )
    assert told[-1][0] == told[-1][1] > told[0][0]
    assert [p.name for p in tmp_path.iterdir() if "partial" in p.name] == []


def test_packing_runs_of_changing_cells(changing: Path, tmp_path: Path) -> None:
    pack(changing, tmp_path / "run.nc")
    with open_run(changing) as data, open_run(tmp_path / "run.nc") as packed:
        for name in data.variables:
            xr.testing.assert_identical(data[name].variable, packed[name].variable)


def test_saves_of_an_earlier_version_are_read(tmp_path: Path) -> None:
    """Without some variables, and with texts of variable length, as the first version had them."""
    folder, file = tmp_path / "run", tmp_path / "run.nc"
    simulation().run(until=2, observers=[RunWriter(folder, 2, fields="exact")])
    first = folder / "save-000000.nc"
    lacks = ["aggregate", "n_aggregates", "roundness", "events"]
    table = xr.load_dataset(first).drop_vars(lacks)
    fields = xr.load_dataset(first, group="fields")
    for name, variable in table.variables.items():
        if variable.dtype.kind in "OU":
            table[name] = variable.astype(object)
            table[name].encoding = {}
    table.to_netcdf(first)
    fields.to_netcdf(first, mode="a", group="fields")
    with netCDF4.Dataset(first) as old:
        assert old["type"].dtype is str
    pack(folder, file)
    for place in (folder, file):
        with open_run(place) as data:
            assert data["cell"].values.tolist() == list("abc")
            assert data["parent"].values.tolist() == ["ma", "mb", "mc"]
            assert data["volume"].attrs == {"units": "um3", "long_name": "volume, integral of phi"}
            assert np.isnan(data["aggregate"].values).all(axis=1).tolist() == [True, False]
            np.testing.assert_array_equal(data["n_aggregates"], [np.nan, 1])
            assert data["events"].values.tolist() == ["", ""]
            assert [field.name for field in load_fields(data, 0)] == list("abc")


def test_packing_does_not_overwrite(changing: Path, tmp_path: Path) -> None:
    (tmp_path / "run.nc").write_text("mine")
    with pytest.raises(FileExistsError, match="exists"):
        pack(changing, tmp_path / "run.nc")
    assert (tmp_path / "run.nc").read_text() == "mine"


def foreign_file(path: Path) -> None:
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", 1)
        file.createVariable("time", "f8", ("time",))[:] = 3.0


def half_file(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-2000])


@pytest.mark.parametrize(
    "damage",
    [lambda path: path.write_bytes(b"no netCDF"), lambda path: path.write_bytes(b""), half_file,
     foreign_file],
    ids=["other", "empty", "cut", "foreign"],
)  # fmt: skip
def test_a_damaged_save_is_named_and_the_others_open(damage: Any, tmp_path: Path) -> None:
    simulation().run(until=4, observers=[RunWriter(tmp_path, 2)])
    damage(tmp_path / "save-000001.nc")
    with pytest.warns(DamageWarning, match=r"save-000001\.nc .*; it is left out") as told:
        run = open_run(tmp_path)
    assert [warning.filename for warning in told] == [__file__]
    with run:
        assert run["time"].values.tolist() == [0, 4]
        assert [field.name for field in load_fields(run, 1)] == list("abc")
    for path in tmp_path.glob("save-*.nc"):
        damage(path)
    with pytest.raises(ValueError, match=r"save-000000\.nc") as caught:
        open_run(tmp_path)
    assert "\n" not in str(caught.value)
    (tmp_path / "save-000000.nc").rename(tmp_path / "packed.nc")
    with pytest.raises(ValueError, match=r"packed\.nc") as caught:
        open_run(tmp_path / "packed.nc")
    assert "\n" not in str(caught.value)


def test_fields_that_are_damaged_are_named_when_they_are_read(tmp_path: Path) -> None:
    simulation().run(until=2, observers=[RunWriter(tmp_path, 2)])
    save = tmp_path / "save-000000.nc"
    content = save.read_bytes()
    for place in range(len(content) - 64, 0, -512):  # a chunk of phi is somewhere
        save.write_bytes(content[:place] + bytes(64) + content[place + 64 :])
        with suppress(OSError), netCDF4.Dataset(save) as file:
            try:
                file["fields"]["phi"][...]
            except RuntimeError:
                break
    with open_run(tmp_path) as run:
        assert len(load_fields(run, 1)) == 3
        with pytest.raises(ValueError, match=r"save-000000\.nc cannot be read"):
            load_fields(run, 0)


def test_saves_of_another_run_and_copies_are_left_out(tmp_path: Path) -> None:
    simulation().run(until=4, observers=[RunWriter(tmp_path / "a", 2)])
    simulation("xyz").run(until=4, observers=[RunWriter(tmp_path / "b", 2)])
    shutil.copy(tmp_path / "b" / "save-000001.nc", tmp_path / "a" / "save-000001.nc")
    shutil.copy(tmp_path / "b" / "save-000002.nc", tmp_path / "a" / "save-copy.nc")
    with pytest.warns(DamageWarning, match=r"save-000001\.nc is of another run than the other"):
        run = open_run(tmp_path / "a")
    with run:
        assert run["time"].values.tolist() == [0, 4]
        assert run["cell"].values.tolist() == list("abc")


def eager_and_lazy(path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[xr.Dataset, xr.Dataset]:
    """A run opened as a small one, and as one of many cells and saves."""
    whole = open_run(path).load()
    monkeypatch.setattr(lazy, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(merge, "MOST_HELD", 1)
    return whole, open_run(path)


def test_large_variables_are_read_when_used_to_the_same_values(
    changing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, run = eager_and_lazy(changing, monkeypatch)
    assert not run["volume"].variable._in_memory
    assert not run["contact_area"].variable._in_memory
    assert run.identical(whole)
    for part in ({"time": -1}, {"time": [1, 0], "cell": [3, 1]}, {"time": slice(0, 0)}):
        assert run.isel(part).identical(whole.isel(part))
    axes = {"time": 1, "cell": slice(1, 3), "axis": [2, 0]}
    assert run["centroid"].isel(axes).identical(whole["centroid"].isel(axes))
    assert pickle.loads(pickle.dumps(run)).identical(whole)


def test_a_save_that_is_gone_is_named_when_it_is_used(
    changing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, run = eager_and_lazy(changing, monkeypatch)
    (changing / "save-000001.nc").unlink()
    assert np.isfinite(run["volume"][0].values).sum() == 3
    with pytest.raises((OSError, ValueError), match=r"save-000001\.nc"):
        run["volume"].load()


def test_values_beyond_memory_are_told_before_they_are_read(
    changing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, run = eager_and_lazy(changing, monkeypatch)
    monkeypatch.setattr(provenance, "memory", lambda: 100.0)
    with pytest.raises(ValueError, match=r"shape \(2, 4, 3\) would take .* select times first"):
        run["centroid"].load()
    with pytest.raises(ValueError, match=r"fields of the 3 cells would take .* cells = "):
        load_fields(run, -1)
    with pytest.raises(ValueError, match=r"label image of .* points would take .* GB"):
        label_image(simulation("a").fields)
    with pytest.raises(ValueError, match=r"values of all \d+ would take .* of one save"):
        run["phi"].load()
    with pytest.raises(ValueError, match=r"fields of 4 cells on .* select cells, or a plane"):
        run.morpho.full().load()


def test_fields_are_read_in_pieces_to_the_same_values(
    changing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(changing)
    whole = load_fields(run, -1)
    points = [field.phi.size for field in whole]
    for most in (1, points[0] + 1, sum(points[:2]), sum(points)):
        monkeypatch.setattr(saved_fields, "MOST_READ", most)
        for field, same in zip(each_field(run, -1), whole, strict=True):
            assert field.name == same.name
            np.testing.assert_array_equal(field.phi, same.phi)
            np.testing.assert_array_equal(field.origin, same.origin)


def test_opening_holds_no_table_of_all_saves(
    changing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One save more costs what it says of itself, and none of its numbers."""
    _, run = eager_and_lazy(changing, monkeypatch)
    numbers = [v for v in run.data_vars.values() if v.dims[:2] == ("time", "cell")]
    assert all(not v.variable._in_memory for v in numbers if v.dtype.kind == "f")
    assert not any("volume" in merge.Save.read(path).table for path in changing.glob("*.nc"))
