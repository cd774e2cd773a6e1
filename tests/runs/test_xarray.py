"""A run is an xarray Dataset: what users do with one works, whatever happens to cells."""

import copy
import pickle
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from morphosim import (
    Cell,
    Division,
    Duration,
    Numerics,
    Removal,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    open_run,
)
from morphosim.measure.variable import Variable
from morphosim.runs.netcdf_variables import write_texts
from morphosim.runs.pack import pack
from morphosim.sweeps.figures import make_figures
from morphosim.sweeps.members import measured

PARENTS = {"P0": "", "Z": "", "B": "P0", "A": "P0", "Aa": "A", "Ap": "A"}
LINE = {"combine": "nested", "concat_dim": "time", "join": "outer"}
"""How `docs/runs.md` says that plain xarray opens saves."""


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run in which two cells divide and one is removed."""
    place = tmp_path_factory.mktemp("run")
    cells = [
        Cell(name="P0", shape=Sphere(center=(0, 0, 0), radius=3.5), type="germ"),
        Cell(name="Z", shape=Sphere(center=(9, 0, 0), radius=3), type="soma"),
    ]
    first = Division(cell="P0", daughters=("B", "A"), axis=(0, 1, 0), types=("germ", "soma"))
    second = Division(cell="A", daughters=("Aa", "Ap"), axis=(0, 0, 1))
    stages = [
        Stage(name="one", end=Duration(4)),
        Stage(name="two", end=Duration(4), events=[first]),
        Stage(name="three", end=Duration(4), events=[Removal(cells=["Z"])]),
        Stage(name="four", end=Duration(4), events=[second]),
    ]
    scene = Scene(
        cells=cells, stages=stages, numerics=Numerics(threads=1), save_every=2, save_labels=True
    )
    Simulation(scene).run(observers=[RunWriter.of(scene, place)])
    return place


@pytest.fixture(scope="module")
def packed(directory: Path) -> Path:
    pack(directory, directory / "packed.nc")
    return directory / "packed.nc"


@pytest.fixture(params=["directory", "packed"])
def run(request: pytest.FixtureRequest) -> Iterator[xr.Dataset]:
    with open_run(request.getfixturevalue(request.param)) as data:
        yield data


def check_plain(plain: xr.Dataset, run: xr.Dataset) -> None:
    """Compare what plain xarray opens with `open_run`, but for fields."""
    own = {"box", "sample", "image", "voxel"}
    names = {name for name in run.variables if not own & set(run[name].dims)}
    assert set(plain.variables) == names
    assert set(plain.sizes) == {"time", "cell", "neighbour", "axis", "principal"}
    for name in names - {"cell", "neighbour", "parent"}:
        expected, found = run[name], plain[name]
        found = found.sel({dim: run[dim] for dim in ("cell", "neighbour") if dim in found.dims})
        assert found.dims == expected.dims, name
        if expected.dtype.kind in "OU":  # xarray has no number where there is no text
            found = found.fillna("")
        np.testing.assert_array_equal(found.values, expected.values, err_msg=name)
    mothers = plain["parent"].sel(cell=run["cell"])
    for name, mother in run["parent"].to_series().items():
        there = mothers.sel(cell=name).dropna("time").values
        assert set(there) == {mother} == {PARENTS[str(name)]}


def test_plain_xarray_opens_the_saves_by_one_line(directory: Path) -> None:
    pytest.importorskip("dask")
    with xr.open_mfdataset(f"{directory}/save-*.nc", **LINE) as plain, open_run(directory) as run:
        assert run["cell"].values.tolist() == list(PARENTS)
        check_plain(plain, run)


@pytest.mark.parametrize("data_vars", ["minimal", "all"])
def test_plain_xarray_joins_the_saves_however_it_is_told(directory: Path, data_vars: str) -> None:
    saves = [xr.open_dataset(path) for path in sorted(directory.glob("save-*.nc"))]
    with open_run(directory) as run:
        check_plain(xr.concat(saves, "time", join="outer", data_vars=data_vars), run)
    for save in saves:
        save.close()


def test_saves_of_earlier_versions_open(directory: Path, tmp_path: Path) -> None:
    before = Variable(("cell",), str, None, "name of the mother cell")
    for number, path in enumerate(sorted(directory.glob("save-*.nc"))):
        old = tmp_path / path.name
        old.write_bytes(path.read_bytes())
        if number % 2:  # an old run that has been gone on with has saves of both kinds
            continue
        with netCDF4.Dataset(old, "a") as file:
            file.renameVariable("parent", "unused")
            mothers = [PARENTS[str(name)] for name in file["cell"][:]]
            write_texts(file, "parent", before, np.array(mothers))
    with open_run(directory) as run, open_run(tmp_path) as found:
        xr.testing.assert_identical(found.drop_vars("unused").load(), run.load())


def test_a_plain_opener_has_the_coordinates_of_a_packed_run(packed: Path) -> None:
    with xr.open_dataset(packed) as plain, open_run(packed) as run:
        assert set(plain.coords) == set(run.coords)


def least(step: Callable[[xr.Dataset], object], run: xr.Dataset) -> int:
    """Most bytes that a step takes."""
    step(run)  # what it imports is not counted
    tracemalloc.start()
    try:
        step(run)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


STEPS: dict[str, Callable[[xr.Dataset], object]] = {
    "where": lambda run: run.where(run["volume"] > 100),
    "where drop": lambda run: run.where(run["time"] > 4, drop=True),
    "arithmetic": lambda run: 2 * run - run.isel(time=0),
    "mean over cells": lambda run: run.mean("cell"),
    "by type": lambda run: run.groupby("type").mean(),
    "by stage": lambda run: run.groupby("stage").mean(),
    "by bins of time": lambda run: run.groupby_bins("time", [-1, 4, 8, 20]).max(),
    "rolling": lambda run: run.rolling(time=2).mean(),
    "interpolate": lambda run: run.interp(time=[1.0, 3.0]),
    "fill": lambda run: run.fillna(0),
    "join in time": lambda run: xr.concat(
        [run, run.assign_coords(time=run["time"] + 100)], "time"
    ),
    "copy": lambda run: run.copy(),
    "deep copy": copy.deepcopy,
    "pickle": lambda run: pickle.loads(pickle.dumps(run)),
}  # fmt: skip


@pytest.mark.parametrize("name", STEPS)
def test_what_users_do_leaves_fields_alone(name: str, run: xr.Dataset) -> None:
    assert least(STEPS[name], run) < run["phi"].nbytes


def test_groups_of_types_are_those_of_the_cells(run: xr.Dataset) -> None:
    volume = run["volume"].groupby("type").mean()
    for kind in ("germ", "soma"):
        expected = run["volume"].values[run["type"].values == kind].mean()
        assert float(volume.sel(type=kind)) == pytest.approx(expected)
        assert float(run.groupby("type").mean()["volume"].sel(type=kind)) == pytest.approx(expected)
    last = run.isel(time=-1).groupby("type").count()["volume"]
    assert {str(k): int(v) for k, v in last.to_series().items() if k} == {"germ": 1, "soma": 2}
    stages = run["volume"].sum("cell").groupby("stage").count()
    assert stages.sel(stage=["one", "two", "three", "four"]).values.tolist() == [2, 2, 2, 2]


def test_where_keeps_what_it_keeps(run: xr.Dataset) -> None:
    large = run.where(run["volume"] > 100)
    np.testing.assert_array_equal(np.isfinite(large["volume"]), (run["volume"] > 100).values)
    assert large["phi"].dims == ("sample",)
    assert large["centroid"].dims == ("time", "cell", "axis")
    late = run.where(run["time"] > 8, drop=True)
    assert late["time"].values.tolist() == [10, 12, 14, 16]


def test_a_run_goes_to_one_file_and_back(run: xr.Dataset, tmp_path: Path) -> None:
    run.to_netcdf(tmp_path / "run.nc")  # warnings are errors
    with xr.open_dataset(tmp_path / "run.nc") as found:
        xr.testing.assert_equal(found.load(), run.load())
        assert set(found.coords) == set(run.coords)
        found.to_netcdf(tmp_path / "again.nc")
    with open_run(tmp_path / "again.nc") as found:
        np.testing.assert_array_equal(found.morpho.phi("B", 8), run.morpho.phi("B", 8))
        np.testing.assert_array_equal(found.morpho.labels(8), run.morpho.labels(8))


def test_two_runs_join_by_their_tables(directory: Path, tmp_path: Path) -> None:
    cell = Cell(name="Z", shape=Sphere(center=(0, 0, 0), radius=3))
    Simulation(Scene(cells=[cell], numerics=Numerics(threads=1))).run(
        until=4, observers=[RunWriter(tmp_path, 2)]
    )
    with open_run(directory) as one, open_run(tmp_path) as other:
        both = xr.concat(
            [one.morpho.table, other.morpho.table], "run", join="outer", coords="minimal",
            compat="override",
        )  # fmt: skip
        assert not {"box", "sample", "image", "voxel"} & set(both.dims)
        for k, single in enumerate((one, other)):
            expected = single["volume"].sel(cell="Z").values
            found = both["volume"].sel(run=k, cell="Z", time=single["time"]).values
            np.testing.assert_array_equal(found, expected)


def test_a_data_frame_has_a_row_for_each_cell_that_is_there(run: xr.Dataset) -> None:
    rows = run.morpho.to_dataframe()
    living = np.isfinite(run["volume"].values)
    assert len(rows) == living.sum()
    assert rows["volume"].tolist() == run["volume"].values[living].tolist()
    assert rows["type"].tolist() == run["type"].values[living].tolist()
    assert rows["centroid_z"].tolist() == run["centroid"].values[..., 2][living].tolist()
    assert rows.set_index("cell")["parent"].to_dict() == PARENTS
    assert run[["volume", "centroid"]].to_dataframe().shape[0] == living.size * 3


def test_the_accessor_says_what_the_run_is(run: xr.Dataset) -> None:
    text, page = repr(run.morpho), run.morpho._repr_html_()
    for fact in ("'scene'", "9 saves, t = 0 to 16", "6 cells, 3 of them at the end", "fields"):
        assert fact in text
    for word in ("neighbours", "plot", "to_dataframe"):
        assert word in text
        assert f"<code>.{word}</code>" in page
    assert "3 of them at the end" in page
    living = run["cell"].values[np.isfinite(run["volume"].values[-1])]
    rows = [f'>{name}</td><td style="text-align: left">' for name in living]
    assert len(rows) == page.count("</td></tr>") == sum(row in page for row in rows)
    assert len(text) < 500
    hostile = run.assign_attrs(scene="<script>", error="a < b")
    assert "<script>" not in hostile.morpho._repr_html_()
    for part in (run.isel(time=0), run.isel(time=[]), run.sel(cell=["Z"]), xr.Dataset()):
        assert repr(part.morpho).startswith("Run")


def test_a_scan_takes_values_of_the_end_and_of_all_times_together(directory: Path) -> None:
    table = measured(directory, make_figures(["volume", "sphericity(time)", "type"]))
    assert set(table.coords) == {"time", "cell"}
    assert table["volume"].dropna("cell")["cell"].values.tolist() == ["Aa", "Ap", "B"]
    assert table["type"].sel(cell="B").item() == "germ"
    assert table.sizes == {"time": 9, "cell": 6}


def test_variables_of_a_run_are_plotted(run: xr.Dataset) -> None:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    lines = run["volume"].plot.line(x="time", ax=figure.subplots())
    assert len(lines) == 6


def test_one_save_opens_as_a_run_of_one_time(directory: Path) -> None:
    with open_run(directory) as run, open_run(directory / "save-000003.nc") as save:
        time = float(save["time"][0])
        assert save["time"].values.tolist() == [float(run["time"][3])]
        for cell in save["cell"].values.tolist():
            np.testing.assert_array_equal(save.morpho.phi(cell), run.morpho.phi(cell, time))


@pytest.mark.parametrize("name", ["scene.toml", "restart-*.npz"])
def test_a_file_of_a_run_that_is_no_run_is_called_that(name: str, directory: Path) -> None:
    path = max(directory.glob(name))
    with pytest.raises(ValueError, match=f"{path.name} is no netCDF file; give the directory"):
        open_run(path)
