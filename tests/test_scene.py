"""Scenes: files that say the same as the classes, built-in scenes, partitions, attraction."""

from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from morphosim import (
    Attraction,
    BoxWalls,
    Cell,
    Ellipsoid,
    EllipsoidShell,
    Field,
    FunctionWalls,
    Mask,
    MaskWalls,
    Numerics,
    Physics,
    Scene,
    Simulation,
    Sphere,
    VolumeCourse,
    built_in_scene,
    load_scene,
    save_scene,
    scene_names,
)
from morphosim.cell_table import CellTable
from morphosim.engine.interactions import Interactions
from morphosim.geometry.phase_field import lattice_field

from .helpers import SMALL

H = 0.5


def ball(name: str = "a", x: float = 0.0, **options: Any) -> Cell:
    return Cell(**({"name": name, "shape": Sphere(center=(x, 0, 0), radius=4)} | options))


def same(a: Any, b: Any) -> bool:
    """Whether two scenes, or parts of scenes, say the same."""
    if is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)
        )
    if isinstance(a, tuple | list) and a and is_dataclass(a[0]):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray | tuple | list):
        return bool(np.array_equal(np.asarray(a), np.asarray(b)))
    return bool(a == b)


def round_trip(scene: Scene, folder: Path) -> Scene:
    save_scene(scene, folder / "scene.toml")
    return load_scene(folder / "scene.toml")


def with_volumes(scene: Scene) -> Scene:
    """Scene whose cells state their volumes, as a file does."""
    return replace(
        scene,
        cells=[
            c if callable(c.volume) else replace(c, volume=c.target_volume(0)) for c in scene.cells
        ],
    )


def random(*shape: int, seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).random(shape)


# --- scene files -------------------------------------------------------------------------------

PARTITION = Scene.from_points(["p", "q"], [(50, 0, 0), (56, 0, 0)], [300, 200])
CELLS = [
    ball("plain"),
    ball("full", x=1 / 3, type="skin", gamma=0.3, frozen=True, parent="AB", volume=250.0),
    ball("grows", volume=VolumeCourse(times=[0, 10.5], volumes=[268, 1 / 3])),
    Cell(name="egg", shape=Ellipsoid(center=(1, 2, 3), semi_axes=(4, 5, 6)), type="nerve"),
    Cell(name="seg", shape=Mask(mask=random(5, 6, 7) > 0.5, origin=(1, 2, 3), smoothing=1.5)),
    Cell(name="flat: 1/2", shape=Mask(mask=random(4, 4, 4, seed=1) > 0.5, spacing=(1, 2, 3))),
    Cell(name="raw", shape=Field(phi=random(5, 4, 3), origin=(0.25, 0, 0), spacing=0.4)),
    Cell(name="ünïcode", shape=Sphere(center=np.array([1.0, 2.0, 3.0]), radius=np.float64(2))),
]
ATTRACTION = Attraction(
    default=0.1,
    sisters=0.05,
    types={("skin", "nerve"): 0.5, ("nerve", "skin"): 0.25, ("skin", "skin"): 1.0},
    pairs={("egg", "seg"): 0.0, ("seg", "egg"): 0.7, ("raw", "plain"): 1 / 3},
)


def test_a_file_says_the_same_as_a_scene_with_all_shapes_and_options(tmp_path: Path) -> None:
    scene = Scene(
        cells=CELLS,
        physics=Physics(
            tau=2.5, gamma=0.3, c=1.5, volume_constraint="absolute", M=0.01, g=1, g_e=9,
            sigma=ATTRACTION, kappa=0.2,
        ),
        numerics=Numerics(
            dt=0.1, S=3, scheme="imex1", start_S=1.5, spacing=0.4, order=4, laplacian="stencil",
            box_tolerance=1e-4, precision="double", transform="scipy", threads=1, seed=7,
        ),
        duration=12.5, save_every=0.3, on_vanish="remove", name="all", description='a "quoted" é',
    )  # fmt: skip
    loaded = round_trip(scene, tmp_path)
    assert same(with_volumes(scene), loaded)
    assert not same(replace(loaded, cells=loaded.cells[:-1]), scene)
    assert not same(loaded.with_numerics(seed=8), scene)


def test_defaults_and_points_survive_a_file(tmp_path: Path) -> None:
    loaded = round_trip(PARTITION, tmp_path)
    assert same(with_volumes(PARTITION), loaded)
    assert loaded.numerics == Numerics()
    assert loaded.physics == Physics()


def test_a_file_saved_again_is_the_same_file(tmp_path: Path) -> None:
    save_scene(replace(PARTITION, cells=[*PARTITION.cells, *CELLS]), tmp_path / "one.toml")
    (tmp_path / "two").mkdir()
    save_scene(load_scene(tmp_path / "one.toml"), tmp_path / "two" / "one.toml")
    one, two = (tmp_path / p / "one.toml" for p in (".", "two"))
    assert one.read_text(encoding="utf-8") == two.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "confinement",
    [
        None,
        EllipsoidShell(center=(1, 2, 3), semi_axes=(9, 8, 7), cut=(np.inf, 5, 1 / 3), width=0.5),
        BoxWalls(lower=(-5, -6, -7), upper=(8, 9, 10), width=0.2),
        MaskWalls(inside=random(5, 6, 7) > 0.5, origin=(1, 2, 3), spacing=(0.5, 1, 2)),
    ],
)
def test_a_confinement_survives_a_file(tmp_path: Path, confinement: Any) -> None:
    scene = Scene(cells=[ball(volume=100.0)], confinement=confinement)
    assert same(scene, round_trip(scene, tmp_path))


def test_a_function_is_written_as_module_and_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "walls_of_a_test.py").write_text("def slope(x, y, z):\n    return (x > 3) * 0.5\n")
    monkeypatch.syspath_prepend(tmp_path)
    from walls_of_a_test import slope  # type: ignore[import-not-found]

    walls = FunctionWalls(function=slope, lower=(-5, -5, -5), upper=(5, 5, 5))
    scene = Scene(cells=[ball(volume=100.0)], confinement=walls)
    loaded = round_trip(scene, tmp_path)
    assert "walls_of_a_test:slope" in (tmp_path / "scene.toml").read_text()
    assert same(scene, loaded)
    assert loaded.confinement.field(np.array([4.0]), 0.0, 0.0) == 0.5


def test_arrays_lie_beside_the_file_and_move_with_it(tmp_path: Path) -> None:
    save_scene(Scene(cells=CELLS), tmp_path / "tissue.toml")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tissue.npz", "tissue.toml"]
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for name in ("tissue.toml", "tissue.npz"):
        (tmp_path / name).rename(moved / name)
    assert load_scene(moved / "tissue.toml").names == [cell.name for cell in CELLS]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("walls"),
        pytest.param("file"),
        pytest.param("allow_pickle"),
        "scene",
        "a/b:c",
    ],
)
def test_any_name_of_a_cell_can_be_saved(tmp_path: Path, name: str) -> None:
    cell = Cell(name=name, shape=Mask(mask=random(4, 4, 4) > 0.5), volume=100.0)
    scene = Scene(cells=[cell], confinement=MaskWalls(inside=np.ones((9, 9, 9))))
    assert same(scene, round_trip(scene, tmp_path))


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"duration": np.int64(50)}),
        pytest.param({"cells": [ball(gamma=np.float32(0.5))]}),
        pytest.param(
            {"physics": Physics(sigma=Attraction(default=np.float32(0.5)))},
        ),
        {"physics": Physics(gamma=np.float32(0.5), sigma=np.float64(0.5))},
    ],
)
def test_numbers_of_numpy_can_be_saved(tmp_path: Path, options: dict) -> None:
    scene = Scene(**({"cells": [ball()]} | options))
    assert same(with_volumes(scene), round_trip(scene, tmp_path))


def test_a_cell_of_a_partition_may_grow(tmp_path: Path) -> None:
    course = VolumeCourse(times=[0, 10], volumes=[300, 400])
    cells = [replace(PARTITION.cells[0], volume=course), PARTITION.cells[1]]
    loaded = round_trip(replace(PARTITION, cells=cells), tmp_path)
    assert loaded.cells[0].target_volume(5) == 350


def test_the_shape_of_a_cell_of_a_partition_does_not_depend_on_its_target(tmp_path: Path) -> None:
    cells = [replace(PARTITION.cells[0], volume=500.0), PARTITION.cells[1]]
    loaded = round_trip(replace(PARTITION, cells=cells), tmp_path)
    assert loaded.cells[0].shape.volume == 300


def test_a_matrix_in_a_file_is_in_the_order_of_the_cells(tmp_path: Path) -> None:
    sphere = 'shape = { kind = "sphere", center = [0, 0, 0], radius = 4 }'
    cells = "".join(f'[[cells]]\nname = "{name}"\n{sphere}\n' for name in "xyz")
    matrix = [[0, 1, 2], [3, 0, 4], [5, 6, 0]]
    (tmp_path / "s.toml").write_text(f"[physics.sigma]\nmatrix = {matrix}\n{cells}")
    found = load_scene(tmp_path / "s.toml").physics.attraction.matrix(["z", "x", "y"])
    np.testing.assert_array_equal(found, [[0, 5, 6], [2, 0, 1], [4, 3, 0]])


# --- overrides and built-in scenes -------------------------------------------------------------


def test_overrides_replace_and_add_values(tmp_path: Path) -> None:
    save_scene(Scene(cells=[ball()], duration=50), tmp_path / "s.toml")
    changes = {
        "physics.gamma": 0.5,
        "physics.sigma.default": 0.25,
        "numerics.dt": 0.5,
        "duration": 7,
        "confinement": {"kind": "box", "lower": [-9, -9, -9], "upper": [9, 9, 9]},
        "confinement.width": 0.5,
        "cells.0.shape.center.1": 2.5,
    }
    scene = load_scene(tmp_path / "s.toml", changes)
    assert (scene.physics.gamma, scene.numerics.dt, scene.duration) == (0.5, 0.5, 7)
    assert scene.physics.attraction.default == 0.25
    assert scene.confinement.width == 0.5
    assert scene.cells[0].shape.center[1] == 2.5
    assert load_scene(tmp_path / "s.toml").duration == 50


def test_a_scene_file_names_the_scene_if_it_does_not_itself(tmp_path: Path) -> None:
    shape = 'shape = { kind = "sphere", center = [0, 0, 0], radius = 4 }'
    (tmp_path / "my.toml").write_text(f'[[cells]]\nname = "a"\n{shape}\n')
    assert load_scene(tmp_path / "my.toml").name == "my"


def test_built_in_scenes_load_under_their_names() -> None:
    assert {"celegans-8", "celegans-8-strong", "single-cell"} < set(scene_names())
    for name in scene_names():
        scene = built_in_scene(name)
        assert scene.name == name
        assert scene.description
    assert built_in_scene("single-cell", {"numerics.dt": 0.5}).numerics.dt == 0.5


@pytest.mark.parametrize("name", scene_names())
def test_overrides_of_a_built_in_scene_are_those_of_its_file(name: str, tmp_path: Path) -> None:
    small = SMALL.get(name, {})
    save_scene(built_in_scene(name, small), tmp_path / "scene.toml")
    for overrides in (
        {"duration": 7, "physics.gamma": 0.3, "numerics.dt": 0.5, "numerics.order": 4},
        {"numerics.preset": "draft", "physics.sigma": {"default": 0.25}},
        {"confinement": {"kind": "box", "lower": [-90] * 3, "upper": [90] * 3}, "name": "x"},
    ):
        if name == "blastoderm" and "confinement" in overrides:
            continue  # its cells are made for its walls
        wanted = load_scene(tmp_path / "scene.toml", overrides)
        assert same(with_volumes(built_in_scene(name, small | overrides)), wanted)
    with pytest.raises(ValueError, match="key of physics = 'gama'"):
        built_in_scene(name, {"physics.gama": 1})


def test_built_in_embryos_differ_in_one_attraction() -> None:
    weak, strong = built_in_scene("celegans-8"), built_in_scene("celegans-8-strong")
    a, b = (s.physics.attraction.matrix(s.names) for s in (weak, strong))
    i, j = weak.names.index("ABpl"), weak.names.index("E")
    assert sorted(zip(*(k.tolist() for k in np.nonzero(a != b)), strict=True)) == sorted(
        [(i, j), (j, i)]
    )
    assert (a[i, j], b[i, j]) == (0, 0.5)
    assert same(replace(strong, physics=weak.physics, name="", description=""),
                replace(weak, name="", description=""))  # fmt: skip


def test_copies_with_changes_leave_the_rest() -> None:
    scene = Scene(cells=[ball()], physics=Physics(c=3), numerics=Numerics(seed=5))
    changed = scene.with_numerics(dt=0.5).with_physics(gamma=0.5)
    assert (changed.numerics.dt, changed.numerics.seed) == (0.5, 5)
    assert (changed.physics.gamma, changed.physics.c) == (0.5, 3)
    assert (scene.numerics.dt, scene.physics.gamma) == (2.0, 0.25)


def test_a_changed_volume_constraint_has_its_own_default() -> None:
    changed = Scene(cells=[ball()]).with_physics(volume_constraint="absolute")
    assert changed.physics == Physics(volume_constraint="absolute")
    assert Physics(volume_constraint="none", M=5.0).volume_strength == 0


@pytest.mark.parametrize(("time", "volume"), [(-5, 10), (0, 10), (2.5, 15), (10, 30), (99, 30)])
def test_a_volume_course_is_linear_between_and_constant_beyond(time: float, volume: float) -> None:
    course = VolumeCourse(times=[0, 10], volumes=[10, 30])
    assert course(time) == volume
    assert ball(volume=course).target_volume(time) == volume


# --- partitions --------------------------------------------------------------------------------


def start_fields(scene: Scene) -> NDArray[np.float64]:
    """Start fields on one grid that holds them all, (N, nx, ny, nz)."""
    scale, spacing = scene.physics.interface_scale, scene.numerics.spacing
    laid = [lattice_field(cell.shape, cell.name, scale, spacing) for cell in scene.cells]
    low = np.min([origin for origin, _ in laid], axis=0)
    high = np.max([origin + phi.shape for origin, phi in laid], axis=0)
    grid = np.zeros((len(laid), *(high - low)))
    for full, (origin, phi) in zip(grid, laid, strict=True):
        first = origin - low
        full[tuple(slice(a, a + n) for a, n in zip(first, phi.shape, strict=True))] = phi
    return grid


def points_in(confinement: Any, volumes: ArrayLike) -> Scene:
    points = [(-4, 0, 0.5), (4, 1, 0), (0, -5, 0)]
    return Scene.from_points(["a", "b", "c"], points, volumes, confinement)


def largest_product(phi: NDArray[np.float64]) -> float:
    """Largest φ_i φ_j of two cells; 1/4 where both are 1/2, as on a face they share."""
    return float(max((phi[i] * phi[j]).max() for i in range(len(phi)) for j in range(i)))


WALLS = {
    "none": None,
    "shell": EllipsoidShell(center=(0, 0, 0), semi_axes=(12, 9, 8), cut=(np.inf, np.inf, 6)),
    "box": BoxWalls(lower=(-9, -8.5, -6), upper=(9, 8, 6)),
    "mask": MaskWalls(inside=np.ones((37, 34, 25)), origin=(-9, -8.5, -6)),
    "function": FunctionWalls(
        function=lambda x, y, z: (x**2 + y**2 + z**2 > 100) * 1.0,
        lower=(-10, -10, -10),
        upper=(10, 10, 10),
    ),
}


@pytest.mark.parametrize("kind", WALLS)
def test_start_fields_of_points_have_their_volumes_and_hardly_overlap(kind: str) -> None:
    volumes = np.array([600.0, 500.0, 300.0])
    phi = start_fields(points_in(WALLS[kind], volumes))
    np.testing.assert_allclose(phi.sum(axis=(1, 2, 3)) * H**3, volumes, rtol=1e-4)
    assert phi.max(axis=(1, 2, 3)).min() > 0.98
    assert 0 < largest_product(phi) < 0.26


def test_the_eight_cell_embryo_starts_at_its_volumes() -> None:
    scene = built_in_scene("celegans-8")
    phi = start_fields(scene)
    volumes = [cell.volume for cell in scene.cells]
    np.testing.assert_allclose(phi.sum(axis=(1, 2, 3)) * H**3, volumes, rtol=1e-5)
    assert phi.max(axis=(1, 2, 3)).min() > 0.99
    assert 0 < largest_product(phi) < 0.26


# --- attraction --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("values", [(0, 1), (0, 0.5, 1, 2), None])
def test_an_attraction_matrix_comes_back(seed: int, values: tuple | None) -> None:
    rng = np.random.default_rng(seed)
    names = [f"cell {k}" for k in range(6)]
    matrix = rng.choice(values, (6, 6)) if values else rng.random((6, 6))
    np.fill_diagonal(matrix, 0)
    attraction = Attraction.from_matrix(names, matrix)
    np.testing.assert_array_equal(attraction.matrix(names), matrix)
    order = rng.permutation(6)
    shuffled = attraction.matrix([names[k] for k in order])
    np.testing.assert_array_equal(shuffled, matrix[np.ix_(order, order)])


def test_the_most_frequent_attraction_becomes_the_default() -> None:
    matrix = np.full((5, 5), 0.5)
    matrix[1, 2] = 0.0
    attraction = Attraction.from_matrix(list("abcde"), matrix)
    assert attraction.default == 0.5
    assert attraction.pairs == {("b", "c"): 0.0, ("c", "b"): 0.5}
    assert Attraction.from_matrix(["a"], [[3.0]]) == Attraction()


def test_the_most_specific_attraction_holds() -> None:
    attraction = Attraction(
        default=0.1,
        types={("s", "t"): 0.2, ("t", "t"): 0.3},
        pairs={("a", "b"): 0.4, ("b", "c"): 0.5, ("c", "b"): 0.6},
    )
    found = attraction.matrix(["a", "b", "c", "d"], ["s", "t", "t", "u"])
    expected = [
        [0.0, 0.4, 0.2, 0.1],
        [0.4, 0.0, 0.5, 0.1],
        [0.2, 0.6, 0.0, 0.1],
        [0.1, 0.1, 0.1, 0.0],
    ]
    np.testing.assert_array_equal(found, expected)


FAMILY = {
    "names": ["a", "b", "c", "d", "e"],
    "types": ["s", "s", "s", "t", "t"],
    "parents": ["P", "Q", "P", "P", ""],
}


def test_sisters_come_before_types_and_after_pairs() -> None:
    attraction = Attraction(
        default=0.1, sisters=0.4, types={("s", "s"): 0.2}, pairs={("a", "c"): 0.5, ("d", "e"): 0.6}
    )
    expected = [
        [0.0, 0.2, 0.5, 0.4, 0.1],
        [0.2, 0.0, 0.2, 0.1, 0.1],
        [0.5, 0.2, 0.0, 0.4, 0.1],
        [0.4, 0.1, 0.4, 0.0, 0.6],
        [0.1, 0.1, 0.1, 0.6, 0.0],
    ]
    np.testing.assert_array_equal(attraction.matrix(**FAMILY), expected)


def test_cells_without_a_known_parent_are_no_sisters() -> None:
    attraction = Attraction(default=0.5, sisters=0.0)
    apart = 0.5 * (1 - np.eye(2))
    for parents in (["", ""], ["P", ""], ["P", "Q"], None):
        np.testing.assert_array_equal(attraction.matrix(["a", "b"], parents=parents), apart)
    assert not attraction.matrix(["a", "b"], parents=["P", "P"]).any()


def test_the_strongest_attraction_may_be_that_of_sisters() -> None:
    assert Attraction(default=0.5, sisters=2.0, pairs={("a", "b"): 1.0}).strongest(["s"]) == 2.0
    assert Attraction(default=0.5, sisters=0.0).strongest(["s"]) == 0.5


def matrix_of(found: Interactions) -> NDArray[np.float64]:
    """What kernels take: σ by type, and the additions of single pairs."""
    _, types, pull = found.interaction
    sigma = pull[np.ix_(types, types)].astype(float)
    if found.pairs is not None:
        pulled = np.repeat(np.arange(len(types)), np.diff(found.pairs.start))
        sigma[found.pairs.cell, pulled] += found.pairs.weight
    np.fill_diagonal(sigma, 0)
    return sigma


@pytest.mark.parametrize(
    "attraction",
    [
        Attraction(default=0.5, sisters=0.0),
        Attraction(default=0.5, sisters=0.5),
        Attraction(sisters=0.3),
        Attraction(sisters=0.3, types={("s", "t"): 0.2}, pairs={("a", "c"): 0, ("c", "a"): 1}),
    ],
)
def test_kernels_get_the_attraction_of_sisters(attraction: Attraction) -> None:
    names, types, parents = FAMILY.values()
    cells = CellTable()
    cells.add({"name": names, "parent": parents}, types)
    found = Interactions(attraction, 1.6, (), cells, cells, np.float64)
    np.testing.assert_allclose(matrix_of(found), attraction.matrix(**FAMILY), atol=1e-15)
    exceptional = attraction.sisters != attraction.default
    assert (found.pairs is not None) == exceptional


def test_a_file_says_how_sisters_attract(tmp_path: Path) -> None:
    cells = "".join(
        f'[[cells]]\nname = "{name}"\nparent = "{parent}"\n'
        'shape = { kind = "sphere", center = [0, 0, 0], radius = 4 }\n'
        for name, parent in (("ABa", "AB"), ("EMS", "P1"), ("ABp", "AB"))
    )
    path = tmp_path / "s.toml"
    path.write_text(f"[physics.sigma]\ndefault = 0.5\nsisters = 0\n{cells}")
    scene = load_scene(path)
    assert scene.physics.attraction == Attraction(default=0.5, sisters=0.0)
    assert round_trip(scene, tmp_path).physics == scene.physics
    assert scene.parents == ["AB", "P1", "AB"]
    found = scene.physics.attraction.matrix(scene.names, scene.types, scene.parents)
    np.testing.assert_array_equal(found, [[0, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0]])
    assert load_scene(path, {"physics.sigma.sisters": 0.2}).physics.attraction.sisters == 0.2


def test_a_file_tells_sisters_only_if_the_scene_does(tmp_path: Path) -> None:
    save_scene(Scene(cells=[ball()]), tmp_path / "s.toml")
    assert "sisters" not in (tmp_path / "s.toml").read_text()


def three_balls(sigma: Attraction, parents: str) -> Simulation:
    """Three cells that touch, after some steps; "2" is taken out half-way."""
    centers = ((0, 0, 0), (8.3, 0.5, 0), (4, 7, 0.5))
    cells = [
        Cell(name=str(k), parent=parent, shape=Sphere(center=center, radius=4))
        for k, (center, parent) in enumerate(zip(centers, parents, strict=True))
    ]
    numerics = Numerics(solver="band", threads=1)
    simulation = Simulation(Scene(cells=cells, physics=Physics(sigma=sigma), numerics=numerics))
    simulation.step(10)
    simulation.remove(["2"])
    simulation.step(10)
    return simulation


def test_sisters_move_as_pairs_of_the_same_attraction_do() -> None:
    by_parent = three_balls(Attraction(default=0.5, sisters=0.1), "PPQ")
    by_pair = three_balls(Attraction(default=0.5, pairs={("0", "1"): 0.1}), "PPQ")
    strangers = three_balls(Attraction(default=0.5, sisters=0.1), "PRQ")
    for one, other in zip(by_parent.fields, by_pair.fields, strict=True):
        np.testing.assert_array_equal(one.phi, other.phi)
    assert np.abs(by_parent.centroids - strangers.centroids).max() > 1e-3


# --- presets -------------------------------------------------------------------------------------


def test_presets_are_numerics_with_changes() -> None:
    standard = Numerics.preset("standard", threads=1)
    assert standard == Numerics(tolerance=10.0, order="fitted", solver="band", threads=1)
    assert Numerics.preset("published", threads=1) == Numerics(S=12.0, walls="stepped", threads=1)
    with pytest.raises(ValueError, match=r"preset = 'quick' is not known; .*'draft'"):
        Numerics.preset("quick")


@pytest.mark.parametrize("changes", [{"dt": 2.0}, {"scheme": "imex1"}, {"scheme": "linearised"}])
def test_the_tolerance_of_a_preset_gives_way_to_steps_of_the_users(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    fixed = Numerics(solver="band", order="fitted", spacing=0.55, box_tolerance=3e-3, **changes)
    assert Numerics.preset("fast", **changes) == fixed
    assert Numerics.preset("fast", tolerance=5.0, dt=1.0).tolerance == 5.0
    save_scene(Scene(cells=[ball()]), tmp_path / "scene.toml")
    overrides = {f"numerics.{key}": value for key, value in changes.items()}
    assert (
        load_scene(tmp_path / "scene.toml", {"numerics.preset": "fast"} | overrides).numerics
        == fixed
    )


def test_a_preset_replaces_the_numerics_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(
        '[numerics]\npreset = "draft"\ndt = 3.0\nseed = 5\n'
        '[[cells]]\nname = "a"\nshape = { kind = "sphere", center = [0, 0, 0], radius = 4 }\n'
    )
    assert load_scene(path).numerics == Numerics.preset("draft", dt=3.0, seed=5)
    changed = load_scene(path, {"numerics.S": 9.0, "numerics.preset": "published"})
    assert changed.numerics == Numerics.preset("published", S=9.0, seed=5)
