"""`ds.morpho`: what it gives is what the simulation had, and no more is read than asked for."""

import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from morphosim import Cell, Numerics, RunWriter, Scene, Simulation, Sphere, open_run
from morphosim.accessor import MorphoAccessor
from morphosim.measure.label_image import label_image
from morphosim.measure.surfaces import cell_surface
from morphosim.runs.pack import pack

from .run_by_hand import NAMES, H, Run, Save, images_only, make_run, simulated, with_contact_list


@pytest.fixture(scope="module")
def saves() -> list[Save]:
    return simulated()


@pytest.fixture
def run(saves: list[Save]) -> Run:
    return make_run(saves)


def morpho(run: Run) -> MorphoAccessor:
    accessor = run.data.morpho
    assert isinstance(accessor, MorphoAccessor)
    return accessor


def test_phi_is_the_field_in_its_place(run: Run) -> None:
    phi = morpho(run).phi("b", time=10)
    field = run.saves[1].fields["b"]
    np.testing.assert_array_equal(phi.values, field.phi)
    assert phi.dims == ("x", "y", "z")
    for axis, first, n in zip("xyz", field.origin, field.phi.shape, strict=True):
        np.testing.assert_allclose(phi[axis], (first + np.arange(n)) * H)
        assert phi[axis].attrs["units"] == "um"
    assert (phi.attrs["units"], phi.attrs["long_name"]) == ("1", "phase field")
    assert (float(phi["time"]), str(phi["cell"].values)) == (10, "b")
    # Its mean position is the centroid that the simulation had.
    mean = [float((phi * phi[axis]).sum() / phi.sum()) for axis in "xyz"]
    np.testing.assert_allclose(mean, run.saves[1].values["centroid"]["b"], atol=1e-4)


@pytest.mark.parametrize(("time", "taken"), [(None, 3), (0, 0), (4.9, 0), (5.1, 1), (28, 3)])
def test_time_is_the_nearest_save(run: Run, time: float | None, taken: int) -> None:
    assert morpho(run).save_number(time) == taken
    assert float(morpho(run).phi("a", time)["time"]) == run.saves[taken].time


@pytest.mark.parametrize("time", [30, 999])
def test_a_time_far_from_all_saves_is_told(run: Run, time: float) -> None:
    told = rf"^time = {time}: the run has no save near it; it has saves at t = 0, 10, 20, 26$"
    for asked in (morpho(run).save_number, morpho(run).labels, morpho(run).full):
        with pytest.raises(ValueError, match=told):
            asked(time)


def test_one_field_is_read_at_a_time(run: Run) -> None:
    full = morpho(run).full(time=20)
    assert repr(full)
    assert run.reads == []
    plane = full.sel(cell="b1").sel(z=-4, method="nearest")
    assert run.reads == []
    values = plane.values
    assert len(run.reads) == 1
    # Of 7 boxes up to t = 20, "b1" is the sixth.
    sizes = run.data["row_size"].values
    assert (run.reads[0].start, run.reads[0].stop) == (sizes[:5].sum(), sizes[:6].sum())
    assert values.max() > 0.9
    morpho(run).phi("a")
    morpho(run).surface("a")
    assert len(run.reads) == 3


def test_boxes_beside_the_chosen_points_are_not_read(run: Run) -> None:
    full = morpho(run).full(time=20)
    left = full.sel(x=slice(None, -6)).values
    assert len(run.reads) == 1
    assert left.shape == (4, 2, *full.shape[2:])


def test_full_is_every_field_on_one_lattice(run: Run) -> None:
    full = morpho(run).full(time=20)
    assert full.dims == ("cell", "x", "y", "z")
    assert full["cell"].values.tolist() == NAMES
    expected = xr.concat(
        [
            morpho(run).phi(name, 20).reindex(x=full["x"], y=full["y"], z=full["z"], fill_value=0)
            for name in ("a", "b1", "b2")
        ],
        "cell",
    )
    np.testing.assert_array_equal(full.sel(cell=["a", "b1", "b2"]).values, expected.values)
    assert not full.sel(cell="b").values.any()
    for axis in "xyz":
        ends = [float(v) for n in ("a", "b1", "b2") for v in morpho(run).phi(n, 20)[axis][[0, -1]]]
        assert (float(full[axis][0]), float(full[axis][-1])) == (min(ends), max(ends))


@pytest.mark.parametrize(
    "key",
    [
        {"cell": 0, "x": 3},
        {"cell": [2, 0, 0], "y": slice(20, 4, -3)},
        {"x": [30, 2, 30], "z": -5},
        {"cell": slice(0, 0)},
        {"cell": 2, "x": 25, "y": 14, "z": 13},
        {"x": xr.DataArray([9, 30], dims="p"), "z": xr.DataArray([13, 14], dims="p")},
    ],
)
def test_lazy_selection_is_that_of_the_loaded_array(run: Run, key: dict) -> None:
    full = morpho(run).full(time=20)
    np.testing.assert_array_equal(full.isel(key).values, full.load().isel(key).values)


def test_labels_count_the_cells_of_the_run(run: Run) -> None:
    labels = morpho(run).labels(time=20)
    save = run.saves[2]
    origin, image = label_image(list(save.fields.values()))
    assert (labels.dtype, labels.dims) == (np.int32, ("x", "y", "z"))
    assert [float(labels[axis][0]) for axis in "xyz"] == (origin * H).tolist()
    for place, name in enumerate(save.fields, 1):
        np.testing.assert_array_equal(labels.values == NAMES.index(name) + 1, image == place)
        centre = dict(zip("xyz", save.values["centroid"][name], strict=True))
        assert int(labels.sel(centre, method="nearest")) == NAMES.index(name) + 1
    assert not (labels == NAMES.index("b") + 1).any()


def test_label_images_of_the_run_are_used(run: Run) -> None:
    stored = images_only(run).morpho
    for save in run.saves:
        xr.testing.assert_identical(stored.labels(save.time), morpho(run).labels(save.time))
    with pytest.raises(ValueError, match="no fields"):
        stored.phi("a")


def test_surface_is_that_of_the_field(run: Run) -> None:
    surface = morpho(run).surface("b1", time=20)
    expected = cell_surface(run.saves[2].fields["b1"], H)
    np.testing.assert_array_equal(surface.vertices, expected.vertices)
    np.testing.assert_array_equal(surface.faces, expected.faces)
    assert surface.name == "b1"
    assert morpho(run).surface("b1", time=20, level=0.3).volume > surface.volume


@pytest.mark.parametrize("form", [lambda data: data, with_contact_list], ids=["matrix", "list"])
def test_contact_graph_has_the_areas_of_the_simulation(
    run: Run, form: Callable[[xr.Dataset], xr.Dataset]
) -> None:
    accessor = form(run.data).morpho
    for save in run.saves:
        graph = accessor.contact_graph(save.time)
        assert graph.graph["time"] == save.time
        assert set(graph) == set(save.fields)
        for name, node in graph.nodes.items():
            assert node["type"] == save.types[name]
            assert node["volume"] == pytest.approx(save.values["volume"][name])
            np.testing.assert_allclose(node["centroid"], save.values["centroid"][name])
        areas = {frozenset(pair): area for pair, area in save.contacts.items()}
        assert {frozenset(pair) for pair in graph.edges} == set(areas)
        for a, b, area in graph.edges(data="area"):
            assert area == pytest.approx(areas[frozenset((a, b))], rel=1e-6)
    assert [set(edge) for edge in accessor.contact_graph(20, least_area=11).edges] == [{"a", "b1"}]
    assert accessor.neighbours("b1", time=20) == ["a", "b2"]
    assert accessor.neighbours("b2") == ["b1"]


def test_lineage(run: Run) -> None:
    tree = morpho(run).lineage()
    assert set(tree.edges) == {("b", "b1"), ("b", "b2")}
    assert tree.nodes["a"] == {"first": 0, "last": 26, "type": "stiff"}
    assert tree.nodes["b"] == {"first": 0, "last": 10, "type": "stiff"}
    assert tree.nodes["b2"] == {"first": 20, "last": 26, "type": ""}


def test_a_mother_that_is_in_no_save_is_in_the_lineage(run: Run) -> None:
    parent = ("cell", np.array(["grandmother", "", "b", "b"], object))
    tree = run.data.assign(parent=parent).morpho.lineage()
    assert list(tree.predecessors("a")) == ["grandmother"]
    assert np.isnan(tree.nodes["grandmother"]["first"])


def test_trajectory(run: Run) -> None:
    motion = morpho(run).trajectory()
    a = [save.values["centroid"]["a"] for save in run.saves]
    np.testing.assert_array_equal(motion["position"].sel(cell="a"), a)
    steps = [float(np.linalg.norm(q - p)) for p, q in pairwise(a)]
    lapses = np.diff([save.time for save in run.saves])
    np.testing.assert_allclose(motion["path_length"].sel(cell="a"), np.cumsum([0, *steps]))
    np.testing.assert_allclose(motion["mean_speed"].sel(cell="a")[1:], steps / lapses)
    away = np.linalg.norm(np.subtract(a, a[0]), axis=1)
    np.testing.assert_allclose(motion["displacement"].sel(cell="a"), away)
    assert motion["displacement"].attrs["units"] == "um"


def test_the_trajectory_of_a_cell_begins_with_it(run: Run) -> None:
    motion = morpho(run).trajectory("b2")
    there = [save.values["centroid"]["b2"] for save in run.saves[2:]]
    step = float(np.linalg.norm(there[1] - there[0]))
    nan = [np.nan, np.nan]
    np.testing.assert_allclose(motion["displacement"], [*nan, 0, step])
    np.testing.assert_allclose(motion["path_length"], [*nan, 0, step])
    np.testing.assert_allclose(motion["mean_speed"], [*nan, np.nan, step / 6])
    assert motion["position"].dims == ("time", "axis")
    xr.testing.assert_equal(motion, morpho(run).trajectory().sel(cell="b2"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: m.phi("b3"), "cell = 'b3' is not in the run; near names are .*'b2'.*4 cells"),
        (lambda m: m.surface("XYZ"), "'XYZ' is not in the run; it has 'a', 'b', 'b1', 'b2'"),
        (lambda m: m.phi("b"), "'b' is not there at t = 26: it lives from t = 0 to t = 10"),
        (lambda m: m.neighbours("b1", 1), "not there at t = 0: it lives from t = 20 to t = 26"),
        (lambda m: m.trajectory("c"), "cell = 'c' is not in the run"),
        (lambda m: m.surface("a", level=0), "level = 0 is not allowed"),
        (lambda m: m.labels(float("nan")), "time = nan is not allowed"),
        (lambda m: m.contact_graph(least_area=-1), "least_area = -1 is not allowed"),
    ],
)
def test_errors_name_what_is_wrong(
    run: Run, call: Callable[[MorphoAccessor], object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        call(morpho(run))


@pytest.mark.parametrize(
    ("missing", "call"),
    [
        ("type", lambda m: m.contact_graph()),
        ("contact_area", lambda m: m.neighbours("a")),
        ("parent", lambda m: m.lineage()),
        ("centroid", lambda m: m.trajectory()),
        ("volume", lambda m: m.phi("a")),
        ("box_origin", lambda m: m.full()),
        ("box_low", lambda m: m.full()),
        ("phi", lambda m: m.labels()),
    ],
)
def test_a_variable_that_is_missing_is_named(
    run: Run, missing: str, call: Callable[[MorphoAccessor], object]
) -> None:
    with pytest.raises(ValueError, match=f"'{missing}'"):
        call(run.data.drop_vars(missing).morpho)


@pytest.mark.parametrize(
    "select",
    [
        lambda data: data.isel(time=slice(1, 3)),
        lambda data: data.isel(time=slice(None, None, -1)),
        lambda data: data.isel(cell=[0, 2, 3]),
        lambda data: data.isel(cell=[2, 1, 0, 3]),
        lambda data: data.isel(time=-1),
    ],
    ids=["times", "reversed", "fewer cells", "order of cells", "one time"],
)
def test_fields_of_a_selection_are_refused_and_not_confused(
    run: Run, select: Callable[[xr.Dataset], xr.Dataset]
) -> None:
    selected = select(run.data)
    for call in (lambda m: m.phi("a"), MorphoAccessor.full, MorphoAccessor.labels):
        with pytest.raises(ValueError, match="the whole run"):
            call(selected.morpho)


def test_tables_of_a_selection_work(run: Run) -> None:
    part = run.data.isel(time=[0, 2]).sel(cell=["a", "b2"])
    assert set(part.morpho.contact_graph(20)) == {"a", "b2"}
    assert part.morpho.contact_graph(20).number_of_edges() == 0
    assert part.morpho.neighbours("b2") == ["b1"]
    assert part.morpho.trajectory("a").sizes["time"] == 2
    with pytest.raises(ValueError, match="the whole run"):
        with_contact_list(run.data).isel(time=[0, 2]).morpho.contact_graph()
    with pytest.raises(ValueError, match="the whole run"):
        with_contact_list(run.data).isel(cell=[0, 1]).morpho.contact_graph(0)


def test_a_run_on_disk_has_the_accessor(tmp_path: Path) -> None:
    ball = Sphere(center=(0, 0, 0), radius=3)
    cells = [Cell(name="a", shape=ball), Cell(name="b", shape=Sphere(center=(5, 0, 0), radius=3))]
    simulation = Simulation(Scene(cells=cells, numerics=Numerics(threads=1)))
    simulation.run(until=4, observers=[RunWriter(tmp_path / "run", 2)])
    pack(tmp_path / "run", tmp_path / "run.nc")
    for place in (tmp_path / "run", tmp_path / "run.nc"):
        with open_run(place) as data:
            for field in simulation.fields:
                np.testing.assert_allclose(data.morpho.phi(field.name), field.phi, atol=7e-5)
            assert data.morpho.full().sel(cell="b").sum() > 500
            assert data.morpho.neighbours("a", time=2) == ["b"]
            assert set(data.morpho.lineage()) == {"a", "b"}
            assert data.morpho.trajectory("b")["path_length"][-1] > 0


def test_import_brings_no_heavy_packages() -> None:
    heavy = "{'skimage', 'scipy', 'numba', 'networkx', 'pyvista', 'tifffile'}"
    modules = "sys, morphosim.exports.export, morphosim.accessor"
    code = f"import {modules}; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "set()"
