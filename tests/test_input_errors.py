"""Bad input fails before the first step; the message names the thing, its value and the rule."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Attraction,
    BoxWalls,
    Cell,
    Duration,
    Ellipsoid,
    EllipsoidShell,
    Field,
    FunctionWalls,
    Mask,
    MaskWalls,
    Numerics,
    Physics,
    Removal,
    Scene,
    Simulation,
    Sphere,
    Stage,
    VolumeCourse,
    built_in_scene,
    load_scene,
    relaxed,
    save_scene,
)
from morphosim.scene.file import scene_of

NAN, INF = math.nan, math.inf
CUBE = np.ones((4, 4, 4))
ORIGIN = (0.0, 0.0, 0.0)


def fails(make: Callable[[], Any], *words: str) -> None:
    """Require a ValueError or TypeError whose message has all the words."""
    with pytest.raises((ValueError, TypeError)) as caught:
        make()
    for word in words:
        assert word in str(caught.value)


def ball(name: str = "a", **options: Any) -> Cell:
    return Cell(**({"name": name, "shape": Sphere(center=ORIGIN, radius=4)} | options))


def scene(*cells: Cell, **options: Any) -> Scene:
    return Scene(**({"cells": cells or [ball()], "numerics": Numerics(threads=1)} | options))


# --- numbers and choices -----------------------------------------------------------------------

POSITIVE = {Physics: ["tau", "gamma", "c"], Numerics: ["dt", "spacing", "box_tolerance"]}
MAY_BE_NONE = ("M", "S", "start_S")
NOT_NEGATIVE = {Physics: ["M", "g", "g_e", "kappa", "sigma"], Numerics: ["S", "start_S"]}
WHOLE = ["threads", "seed"]
CHOICES = {
    "volume_constraint": (Physics, "relativ", "relative"),
    "scheme": (Numerics, "bdf", "bdf2"),
    "laplacian": (Numerics, "exakt", "exact"),
    "precision": (Numerics, "singel", "single"),
    "transform": (Numerics, "matrx", "matrix"),
}


def of_all(table: dict) -> list[tuple[type, str]]:
    return [(cls, name) for cls, names in table.items() for name in names]


NUMBERS = of_all(POSITIVE) + of_all(NOT_NEGATIVE)


def label(cls: type, name: str) -> str:
    return f"{cls.__name__.lower()}.{name}"


@pytest.mark.parametrize(("cls", "name"), of_all(POSITIVE))
@pytest.mark.parametrize("value", [0, -1, NAN, INF])
def test_a_parameter_must_be_positive(cls: type, name: str, value: float) -> None:
    fails(lambda: cls(**{name: value}), label(cls, name), repr(value), "finite and > 0")


@pytest.mark.parametrize(("cls", "name"), of_all(NOT_NEGATIVE))
@pytest.mark.parametrize("value", [-1e-9, NAN, INF, -INF])
def test_a_parameter_must_not_be_negative(cls: type, name: str, value: float) -> None:
    fails(lambda: cls(**{name: value}), label(cls, name), repr(value), "finite and >= 0")


@pytest.mark.parametrize(("cls", "name"), NUMBERS)
@pytest.mark.parametrize("value", [True, "2.0", [1.0, 2.0], 1j])
def test_a_parameter_must_be_a_number(cls: type, name: str, value: Any) -> None:
    fails(lambda: cls(**{name: value}), label(cls, name), repr(value), "not a number")


@pytest.mark.parametrize(("cls", "name"), [p for p in NUMBERS if p[1] not in MAY_BE_NONE])
def test_a_parameter_must_not_be_none(cls: type, name: str) -> None:
    fails(lambda: cls(**{name: None}), label(cls, name), "None", "not a number")


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("value", [-1, 1.0, NAN, True, "1", None])
def test_threads_and_seed_must_be_whole_numbers(name: str, value: Any) -> None:
    rule = ">= 0" if value == -1 else "whole number"
    fails(lambda: Numerics(**{name: value}), f"numerics.{name}", repr(value), rule)


@pytest.mark.parametrize("name", CHOICES)
def test_an_unknown_choice_lists_the_known_and_suggests_one(name: str) -> None:
    cls, value, meant = CHOICES[name]
    words = label(cls, name), repr(value), "allowed are", f"did you mean '{meant}'?"
    fails(lambda: cls(**{name: value}), *words)
    fails(lambda: cls(**{name: 1}), label(cls, name), "1", repr(meant))


def test_numerics_have_bounds_of_their_own() -> None:
    fails(lambda: Numerics(order=3), "numerics.order = 3", "2, 4, 6")
    fails(lambda: Numerics(box_tolerance=0.2), "numerics.box_tolerance = 0.2", "<= 0.1")


def test_too_many_threads() -> None:
    many = scene(numerics=Numerics(threads=9999))
    fails(lambda: Simulation(many), "numerics.threads = 9999", "NUMBA_NUM_THREADS")


# --- cells and scenes --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gamma", "volume"])
@pytest.mark.parametrize("value", [0, -1, NAN, INF, True, "big", [1.0]])
def test_a_cell_needs_a_positive_volume_and_tension(name: str, value: Any) -> None:
    rule = "> 0" if isinstance(value, float | int) and value is not True else "not a number"
    fails(lambda: ball(**{name: value}), f"cell 'a': {name}", repr(value), rule)


@pytest.mark.parametrize("name", ["", 3, None])
def test_a_cell_needs_a_name(name: Any) -> None:
    fails(lambda: ball(name), f"cell name = {name!r}", "not empty")


def test_the_parts_of_a_shape_are_asked_for() -> None:
    fails(lambda: ball(shape=BoxWalls(lower=(0, 0, 0), upper=(1, 1, 1))), "it has no volume")
    fails(lambda: Scene.from_points(["a"], [ORIGIN], [9.0], "box"), "confinement = 'box'")


def test_a_cell_needs_a_shape() -> None:
    fails(lambda: ball(shape="sphere"), "cell 'a': shape = 'sphere'", "not a shape")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        pytest.param("type", 3),
        pytest.param("frozen", "no"),
        pytest.param("frozen", NAN),
    ],
)
def test_a_cell_checks_kinds(name: str, value: Any) -> None:
    fails(lambda: ball(**{name: value}), f"cell 'a': {name}", repr(value))


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (lambda t: -5.0, ("cell 'a': volume at t = 0", "-5.0", "> 0")),
        (lambda t: "big", ("cell 'a': volume at t = 0", "'big'", "not a number")),
        (lambda t: None, ("cell 'a': volume at t = 0", "None", "not a number")),
    ],
)
def test_a_volume_function_is_checked_at_the_start(value: Any, words: tuple) -> None:
    fails(lambda: ball(volume=value), *words)


def test_a_volume_function_that_turns_negative_stops_the_run() -> None:
    simulation = Simulation(scene(ball(volume=lambda t: 300 - 100 * t)))
    fails(lambda: simulation.run(until=20), "cell 'a': volume at t = 4", "-100", "> 0")
    assert simulation.time == 4


@pytest.mark.parametrize(
    ("times", "volumes", "words"),
    [
        ([1, 0], [5, 6], ("volume.times = [1, 0]", "increasing")),
        ([1, 1], [5, 6], ("volume.times = [1, 1]", "increasing")),
        ([], [], ("volume.times = []", "increasing")),
        ([0, 1], [5], ("volume.volumes", "(1,)", "(2,)")),
        ([0, NAN], [5, 6], ("volume.times[1] = nan", "finite")),
        ([0, 1], [5, INF], ("volume.volumes[1] = inf", "finite")),
        ([0, 1], [5, -6], ("volume.volumes", "-6", "> 0")),
        ("now", [5], ("volume.times", "'now'", "numbers")),
    ],
)
def test_a_volume_course_is_checked(times: Any, volumes: Any, words: tuple) -> None:
    fails(lambda: VolumeCourse(times=times, volumes=volumes), *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"cells": []}, ("scene.cells is empty", "at least one")),
        ({"cells": [ball("x"), ball("y"), ball("x")]}, ("'x' occurs twice", "unique")),
        ({"duration": -1}, ("scene.duration = -1", ">= 0")),
        ({"duration": INF}, ("scene.duration = inf", "finite")),
        ({"save_every": 0}, ("scene.save_every = 0", "> 0")),
        ({"save_every": "10"}, ("scene.save_every = '10'", "not a number")),
        ({"on_vanish": "kill"}, ("scene.on_vanish = 'kill'", "'stop', 'remove', 'ignore'")),
        pytest.param({"cells": 3}, ("cells",)),
        pytest.param({"cells": ["a"]}, ("cells",)),
        pytest.param({"physics": {}}, ("physics",)),
        pytest.param({"numerics": {}}, ("numerics",)),
        pytest.param({"confinement": 3}, ("confinement",)),
        pytest.param({"name": 3}, ("name",)),
    ],
)
def test_a_scene_is_checked(options: dict, words: tuple) -> None:
    fails(lambda: scene(**options), *words)


@pytest.mark.parametrize("until", [pytest.param(v) for v in (NAN, INF, "x")])
def test_the_end_of_a_run_is_checked(until: Any) -> None:
    simulation = Simulation(scene())
    fails(lambda: simulation.run(until=until), "until", repr(until))


def test_a_built_in_scene_must_exist() -> None:
    fails(lambda: built_in_scene("celegans8"), "'celegans8'", "did you mean 'celegans-8'?")


# --- attraction --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[0, 1], [1, 0], [1, 1]], ("sigma", "(3, 2)", "(2, 2)")),
        ([[0, 1, 2]] * 3, ("sigma", "(3, 3)", "(2, 2)")),
        ([[0, 1], [1]], ("sigma", "numbers")),
        ([[0, NAN], [1, 0]], ("sigma[0, 1] = nan", "finite")),
        ([[0, 1], [-1, 0]], ("sigma[1, 0] = -1.0", ">= 0")),
    ],
)
def test_an_attraction_matrix_is_checked(matrix: list, words: tuple) -> None:
    fails(lambda: Attraction.from_matrix(["a", "b"], matrix), *words)


@pytest.mark.parametrize("value", [-1, NAN, "strong", True])
def test_each_attraction_is_checked(value: Any) -> None:
    for options, where in (
        ({"default": value}, "sigma.default"),
        ({"sisters": value}, "sigma.sisters"),
        ({"types": {("s", "t"): value}}, "sigma.types['s', 't']"),
        ({"pairs": {("a", "b"): value}}, "sigma.pairs['a', 'b']"),
    ):
        fails(lambda options=options: Attraction(**options), where, repr(value))


@pytest.mark.parametrize(
    ("sigma", "words"),
    [
        (Attraction(pairs={("ABpl", "ABqr"): 1}), ("'ABqr'", "'ABpl', 'ABpr'", "'ABpr'?")),
        (Attraction(types={("skin", "nerv"): 1}), ("'nerv'", "'nerve', 'skin'", "'nerve'?")),
    ],
)
def test_attraction_must_name_cells_and_types_of_the_scene(sigma: Any, words: tuple) -> None:
    cells = [ball("ABpl", type="skin"), ball("ABpr", type="nerve")]
    fails(lambda: scene(*cells, physics=Physics(sigma=sigma)), "sigma.", *words)


@pytest.mark.parametrize(
    "pairs",
    [
        pytest.param({"ab": 1.0}),
        pytest.param([("a", "b", 1.0)]),
    ],
)
def test_attraction_pairs_are_a_mapping_of_pairs(pairs: Any) -> None:
    fails(lambda: Attraction(pairs=pairs), "sigma.pairs")


# --- shapes and confinements -------------------------------------------------------------------

WITH_NAN = np.full((4, 4, 4), NAN)
SHAPES = {
    Sphere: {"center": ORIGIN, "radius": 4},
    Ellipsoid: {"center": ORIGIN, "semi_axes": (3, 4, 5)},
    Mask: {"mask": CUBE},
    Field: {"phi": CUBE},
    EllipsoidShell: {"center": ORIGIN, "semi_axes": (3, 4, 5)},
    BoxWalls: {"lower": ORIGIN, "upper": (3, 4, 5)},
    MaskWalls: {"inside": CUBE},
    FunctionWalls: {"function": lambda x, y, z: 0.0, "lower": ORIGIN, "upper": (3, 4, 5)},
}


@pytest.mark.parametrize(
    ("cls", "options", "words"),
    [
        (Sphere, {"center": (0, 0)}, ("shape.center", "(2,)", "(3,)")),
        (Sphere, {"center": (0, NAN, 0)}, ("shape.center[1] = nan", "finite")),
        (Sphere, {"center": "here"}, ("shape.center", "'here'", "numbers")),
        (Sphere, {"radius": 0}, ("shape.radius = 0", "> 0")),
        (Sphere, {"radius": "4"}, ("shape.radius = '4'", "not a number")),
        (Ellipsoid, {"semi_axes": (3, 0, 5)}, ("shape.semi_axes (y)", "0.0", "> 0")),
        (Ellipsoid, {"semi_axes": (3, INF, 5)}, ("semi_axes[1] = inf", "finite")),
        (Ellipsoid, {"semi_axes": 3}, ("semi_axes", "()", "(3,)")),
        (Mask, {"mask": 0 * CUBE}, ("shape.mask is empty", "no voxel")),
        (Mask, {"mask": CUBE[0]}, ("shape.mask", "(4, 4)", "three axes")),
        (Mask, {"origin": (0, 0)}, ("shape.origin", "(2,)", "(3,)")),
        (Mask, {"spacing": -0.5}, ("shape.spacing", "-0.5", "> 0")),
        (Mask, {"spacing": (1, 1, 0)}, ("shape.spacing", "0.0", "> 0")),
        (Mask, {"smoothing": -1}, ("shape.smoothing = -1", ">= 0")),
        pytest.param(Mask, {"mask": WITH_NAN}, ("shape.mask", "nan")),
        pytest.param(Mask, {"spacing": "x"}, ("shape.spacing", "'x'")),
        pytest.param(Field, {"spacing": (1, 2)}, ("shape.spacing", "(2,)")),
        (Field, {"phi": 0.4 * CUBE}, ("shape.phi", "above 0.5", "0.4")),
        (Field, {"phi": CUBE[0]}, ("shape.phi", "(4, 4)", "expected")),
        (Field, {"phi": WITH_NAN}, ("shape.phi[0, 0, 0] = nan", "finite")),
        (Field, {"spacing": NAN}, ("shape.spacing", "nan", "> 0")),
        (EllipsoidShell, {"center": (0, 0)}, ("confinement.center", "(2,)", "(3,)")),
        (EllipsoidShell, {"semi_axes": (3, -4, 5)}, ("confinement.semi_axes (y)", "-4", "> 0")),
        (EllipsoidShell, {"cut": (INF, 0, 1)}, ("confinement.cut", "half-widths > 0")),
        (EllipsoidShell, {"cut": (INF, NAN, 1)}, ("confinement.cut[1] = nan", "not finite")),
        (EllipsoidShell, {"cut": 3}, ("confinement.cut", "shape ()", "(3,)")),
        (EllipsoidShell, {"width": -1}, ("confinement.width = -1", ">= 0")),
        pytest.param(EllipsoidShell, {"cut": "flat"}, ("cut", "'flat'")),
        (BoxWalls, {"upper": (3, 0, 5)}, ("confinement.upper", "lower", "exceed")),
        (BoxWalls, {"lower": (0, -INF, 0)}, ("confinement.lower[1] = -inf", "finite")),
        (BoxWalls, {"width": NAN}, ("confinement.width = nan", "finite")),
        (MaskWalls, {"inside": 0 * CUBE}, ("confinement.inside", "0 voxels", "inside")),
        (MaskWalls, {"inside": CUBE[0]}, ("confinement.inside", "(4, 4)", "three axes")),
        (MaskWalls, {"spacing": 0.0}, ("confinement.spacing", "0.0", "> 0")),
        pytest.param(MaskWalls, {"spacing": "x"}, ("confinement.spacing", "'x'")),
        pytest.param(MaskWalls, {"inside": WITH_NAN}, ("inside", "nan")),
        (FunctionWalls, {"function": 3}, ("confinement.function = 3", "cannot be called")),
        (FunctionWalls, {"upper": (3, 4)}, ("confinement.upper", "(2,)", "(3,)")),
        pytest.param(
            FunctionWalls, {"upper": (3, -4, 5)}, ("confinement.upper", "-4")
        ),
    ],
)  # fmt: skip
def test_a_shape_or_confinement_is_checked(cls: type, options: dict, words: tuple) -> None:
    fails(lambda: cls(**(SHAPES[cls] | options)), *words)


@pytest.mark.parametrize("cls", SHAPES)
def test_the_shapes_above_are_sound_apart_from_what_is_changed(cls: type) -> None:
    cls(**SHAPES[cls])


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda x, y, z: 0 * x + 0 * y + z * NAN, ("confinement.function", "nan", "0 (inside)")),
        (
            lambda x, y, z: 0 * y + 0 * z + x**2,
            ("confinement.function", "values from 0 to ", "1 (outside)"),
        ),
        (lambda x, y, z: -1.0, ("confinement.function", "-1", "0 (inside)")),
        pytest.param(lambda x, y, z: np.zeros(7), ("confinement.function", "(7,)")),
        (
            math.hypot,
            ("confinement.function = <built-in function hypot> fails for arrays x, y, z",),
        ),
    ],
)
def test_the_values_of_a_confinement_function_are_checked(function: Any, words: tuple) -> None:
    walls = FunctionWalls(function=function, lower=(-9, -9, -9), upper=(9, 9, 9))
    fails(lambda: Simulation(scene(confinement=walls)), *words)


def test_a_confinement_function_needs_an_inside() -> None:
    walls = FunctionWalls(function=lambda x, y, z: 1.0, lower=ORIGIN, upper=(3, 4, 5))
    fails(lambda: walls.depth(*np.zeros((3, 1))), "confinement.function", "no inside")


def test_a_cell_must_start_inside_the_confinement() -> None:
    shell = EllipsoidShell(center=(30, 0, 0), semi_axes=(10, 10, 10))
    words = "cell 'a'", "100 % of its volume outside", "50 %"
    fails(lambda: Simulation(scene(confinement=shell)), *words)
    center = {"center": (19, 0, 0), "radius": 4}
    fails(lambda: Simulation(scene(ball(shape=Sphere(**center)), confinement=shell)), "cell 'a'")
    Simulation(scene(ball(shape=Sphere(**center | {"center": (22, 0, 0)})), confinement=shell))


@pytest.mark.parametrize(
    ("center", "radius", "spacing"),
    [
        ((0.25, 0.25, 0.25), 0.3, 0.5),
        pytest.param(ORIGIN, 0.1, 0.5),
        pytest.param(ORIGIN, 4.0, 50.0),
    ],
)
def test_a_cell_too_small_for_the_lattice(center: tuple, radius: float, spacing: float) -> None:
    cell = ball(shape=Sphere(center=center, radius=radius))
    numerics = Numerics(threads=1, spacing=spacing)
    fails(lambda: Simulation(scene(cell, numerics=numerics)), "cell 'a'", f"{spacing:g} µm")


def test_positions_and_volumes_of_points_are_checked() -> None:
    def make(positions: Any, volumes: Any) -> Callable[[], Scene]:
        return lambda: Scene.from_points(["a", "b"], positions, volumes)

    apart = [(0, 0, 0), (9, 0, 0)]
    fails(make([(0, 0, 0)], [9, 9]), "positions", "(1, 3)", "(2, 3)")
    fails(make(apart, [9, 9, 9]), "volumes", "(3,)", "(2,)")
    fails(make(apart, [9, -9]), "volumes[1]", "-9", "> 0")
    fails(make([(0, 0, 0), (0, 0, 0)], [9, 9]), "positions 0 and 1 coincide")


# --- scene files -------------------------------------------------------------------------------

SPHERE = 'shape = { kind = "sphere", center = [0, 0, 0], radius = 4 }\n'
CELL = '[[cells]]\nname = "a"\n' + SPHERE
POINT = '[[cells]]\nname = "a"\nvolume = 100\nshape = { kind = "point", position = [0, 0, 0] }\n'


def with_mask(value: str) -> str:
    return f'[[cells]]\nname = "a"\nshape = {{ kind = "mask", mask = {value} }}\n'


def with_function(value: str) -> str:
    bounds = "lower = [-9, -9, -9]\nupper = [9, 9, 9]\n"
    return f'[confinement]\nkind = "function"\nfunction = "{value}"\n{bounds}{CELL}'


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., Scene]:
    """Load a scene file of this text; beside it lie arrays.npz and a damaged file."""

    def from_text(text: str, **options: Any) -> Scene:
        (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
        return load_scene(tmp_path / "scene.toml", **options)

    np.savez(tmp_path / "arrays.npz", full=CUBE, empty=0 * CUBE)
    (tmp_path / "damaged.npz").write_text("no archive")
    return from_text


def test_the_scene_files_below_are_sound_apart_from_what_is_changed(load: Callable) -> None:
    for text in (CELL, POINT, with_mask('"arrays.npz:full"')):
        assert load(text).names == ["a"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duratoin = 3\n" + CELL, ("key of the scene = 'duratoin'", "'duration'?")),
        ("[physics]\ngama = 3\n" + CELL, ("key of physics = 'gama'", "'gamma'?")),
        ("[physics.sigma]\ndefalt = 3\n" + CELL, ("key of physics.sigma", "'default'?")),
        ("[numerics]\nspaceing = 3\n" + CELL, ("key of numerics", "'spacing'?")),
        ('[confinement]\nkind = "box"\nloer = 3\n' + CELL, ("key of confinement", "'lower'?")),
        (CELL + "gama = 3\n", ("key of cells[0] = 'gama'", "'gamma'?")),
        (CELL.replace("radius", "radis"), ("cell 'a': shape = 'radis'", "'radius'?")),
        (CELL + "volume = { time = [0], volumes = [9] }", ("cell 'a': volume", "'times'?")),
        (POINT.replace("position", "positoin"), ("cell 'a': shape = 'positoin'", "'position'?")),
    ],
)
def test_an_unknown_key_is_named_with_a_suggestion(load: Callable, text: str, words: tuple) -> None:
    fails(lambda: load(text), *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("scene.cells is empty",)),
        ("cells = []", ("scene.cells is empty",)),
        ("cells = [3]", ("cells[0] = 3", "table")),
        ("a = = 3", ("scene.toml is not a TOML file", "line 1")),
        (CELL + CELL, ("cell name 'a' occurs twice",)),
        ('[[cells]]\nname = "a"\n', ("cell 'a': shape = None", "kind")),
        ('[[cells]]\nname = "a"\nshape = "sphere"', ("cell 'a': shape = 'sphere'", "kind")),
        ("[[cells]]\n" + SPHERE, ("'name'",)),
        (CELL.replace(', radius = 4', ""), ("cell 'a': shape", "'radius'")),
        (CELL.replace("= 4", '= "x"'), ("cell 'a': shape", "shape.radius = 'x'", "number")),
        (CELL.replace("sphere", "spher"), ("cell 'a': shape.kind = 'spher'", "'sphere'?")),
        (CELL + 'volume = "big"', ("cell 'a'", "'big'", "not a number")),
        (POINT.replace("volume = 100\n", ""), ("cell 'a'", "needs a volume")),
        (POINT.replace("100", "-100"), ("volumes[0]", "-100", "> 0")),
        (POINT.replace("[0, 0, 0]", "[0, 0]"), ("cell 'a': shape.position", "(2,)", "(3,)")),
        ("[numerics]\ndt = true\n" + CELL, ("numerics.dt = True", "not a number")),
        ("numerics = 3\n" + CELL, ("numerics = 3", "table")),
        ("[physics]\nsigma = [1]\n" + CELL, ("physics.sigma = [1]", "not a number")),
        ('[physics.sigma]\npairs = [["a"]]\n' + CELL, ("sigma.pairs", "['a']", "[from, to, ")),
        ('[physics.sigma]\npairs = [["a", "b", 1]]\n' + CELL, ("sigma.pairs", "'b'", "known")),
        ('[physics.sigma]\nsisters = "weak"\n' + CELL, ("sigma.sisters = 'weak'", "number")),
        ("[physics.sigma]\nmatrix = [[0]]\nsisters = 1\n" + CELL, ("'sisters'", "'matrix'")),
        ("[physics.sigma]\nmatrix = [[0, 1]]\n" + CELL, ("sigma", "(1, 2)", "(1, 1)")),
        ("[confinement]\nwidth = 3\n" + CELL, ("confinement", "'width': 3", "kind")),
        ('[confinement]\nkind = "bx"\n' + CELL, ("confinement.kind = 'bx'", "'box'?")),
        ('[confinement]\nkind = "box"\nlower = [0, 0, 0]\n' + CELL, ("confinement", "'upper'")),
        (with_function("no_such_module:f"), ("confinement.function", "no_such_module:f")),
        (with_function("math:no_such"), ("confinement.function", "math:no_such")),
        (with_function("math"), ("confinement.function", "'math'", "module:name")),
        (with_function("math:pi"), ("confinement.function", "cannot be called")),
        (with_mask('"arrays.npz:ful"'), ("cell 'a': shape.mask", "'ful'", "'full'?")),
        (with_mask('"arrays.npz:empty"'), ("shape.mask is empty",)),
        pytest.param("physics = 3\n" + CELL, ("physics = 3", "table")),
        pytest.param("cells = 3", ("cells", "3")),
        pytest.param('confinement = "box"\n' + CELL, ("confinement = 'box'",)),
        pytest.param("[physics.sigma]\npairs = 3\n" + CELL, ("sigma.pairs",)),
        pytest.param("[physics.sigma]\npairs = [3]\n" + CELL, ("sigma.pairs",)),
        pytest.param(with_mask("[[[1, 0], [0]]]"), ("shape.mask",)),
        pytest.param(with_mask('"damaged.npz:x"'), ("damaged.npz",)),
        pytest.param(
            POINT.replace('name = "a"\n', ""), ("'name'",)
        ),
        pytest.param(
            CELL.replace("sphere", "poin"), ("'point'?",)
        ),
        pytest.param(
            '[confinement]\nkind = "none"\nlower = 3\n' + CELL, ("'lower'",)
        ),
        pytest.param(CELL + 'frozen = "no"', ("frozen = 'no'",)),
    ],
)  # fmt: skip
def test_a_scene_file_is_checked(load: Callable, text: str, words: tuple) -> None:
    fails(lambda: load(text), *words)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("physics.gama", 1, ("key of physics = 'gama'", "'gamma'?")),
        ("physic.gamma", 1, ("key of the scene = 'physic'", "'physics'?")),
        ("cells.7.name", "b", ("cannot set 'cells.7.name'", "no '7' in a list of 1")),
        ("numerics.dt", "fast", ("numerics.dt = 'fast'", "not a number")),
        ("cells.0.shape.center.3", 1.0, ("cannot set 'cells.0.shape.center.3'", "of 3")),
        ("cells.0.parent", "a", ("cell 'a': parent = 'a' is the cell itself",)),
        ("", 1, ("key of the scene = ''",)),
    ],
)
def test_an_override_is_checked(load: Callable, key: str, value: Any, words: tuple) -> None:
    fails(lambda: load(CELL, overrides={key: value}), *words)


def test_missing_files_are_named(load: Callable, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"scene file .*none\.toml does not exist"):
        load_scene(tmp_path / "none.toml")
    with pytest.raises(FileNotFoundError, match=r"cell 'a': shape\.mask.*none\.npz"):
        load(with_mask('"none.npz:x"'))
    with pytest.raises(FileNotFoundError, match=r"cell 'a': shape\.mask = 'yyy.* no such file"):
        load(with_mask(f'"{"y" * 300}.npz:x"'))


@pytest.mark.parametrize(
    "options",
    [
        {"cells": [ball(volume=lambda t: 100.0)]},
        {"confinement": FunctionWalls(**SHAPES[FunctionWalls])},
    ],
)
def test_a_function_without_a_name_cannot_be_saved(tmp_path: Path, options: dict) -> None:
    fails(lambda: save_scene(scene(**options), tmp_path / "scene.toml"), "function", "written")
    assert not (tmp_path / "scene.toml").exists()


# --- names, lists, and what only looks like a number --------------------------------------------

UNFIT = ["a\0", "\x1b[31mred\x1b[0m", "two\nlines", "\ud800", "\u202ea", "\u2028", "  ", "x" * 101]
FIT = ["a b", "ünïcode", "細胞", "Zelle №5", "a/b:c", "می\u200cخواهم", "x" * 100]


@pytest.mark.parametrize("name", UNFIT)
def test_names_that_act_on_a_terminal_or_cannot_be_stored_are_refused(name: str) -> None:
    for make, where in (
        (lambda: ball(name), "cell name"),
        (lambda: ball(type=name), "cell 'a': type"),
        (lambda: ball(parent=name), "cell 'a': parent"),
        (lambda: scene(name=name), "scene.name"),
    ):
        if name.strip() or where == "cell name":
            fails(make, where, "not empty" if not name.strip() else "character")
    if len(name) > 3 and "lines" not in name and name.strip() and len(name) < 101:
        fails(lambda: scene(description=name), "scene.description", "control character")


@pytest.mark.parametrize("name", FIT)
def test_names_of_any_letters_are_taken(name: str, tmp_path: Path) -> None:
    given = scene(ball(name, type=name), name=name, description=f"{name}\n\tand more")
    save_scene(given, tmp_path / "scene.toml")
    assert load_scene(tmp_path / "scene.toml").names == [name]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"description": 1}, ("scene.description = 1", "not a text")),
        ({"stages": {}}, ("scene.stages = {}", "not a list of stages")),
        ({"stages": 1}, ("scene.stages = 1", "not a list of stages")),
        ({"stages": "one"}, ("scene.stages = 'one'", "not a list of stages")),
        ({"cells": "ab"}, ("scene.cells = 'ab'", "not a list of cells")),
        ({"cells": np.array(1)}, ("scene.cells = array(1)", "not a list of cells")),
        ({"on_vanish": np.array(["stop"])}, ("scene.on_vanish = array(['stop']", "'stop'")),
        ({"save_fields": ["packed"]}, ("scene.save_fields = ['packed']", "'packed'")),
        ({"save_fields": {}}, ("scene.save_fields = {}", "'packed'")),
        ({"duration": 1e300}, ("scene.duration = 1e+300", "out of range")),
        ({"duration": 10**400}, ("scene.duration = 1000", "finite")),
        ({"duration": 10**5000}, ("scene.duration = (int too large", "finite")),
        ({"save_every": 1e-320}, ("scene.save_every = 1e-320", "out of range")),
        (
            {"duration": 1e30},
            ("scene.duration = 1e+30", "5e+29 steps of numerics.dt = 2", "three years"),
        ),
    ],
)
def test_each_value_of_a_scene_is_what_it_should_be(options: dict, words: tuple) -> None:
    fails(lambda: scene(**options), *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seed": 2**64}, ("numerics.seed = 18446744073709551616", "<= 18446744073709551615")),
        ({"seed": 10**400}, ("numerics.seed = 1000",)),
        ({"order": 2.0}, ("numerics.order = 2.0", "2, 4, 6")),
        ({"order": True}, ("numerics.order = True", "2, 4, 6")),
        ({"order": np.array([2, 4])}, ("numerics.order = array([2, 4])", "2, 4, 6")),
        ({"scheme": ["bdf2"]}, ("numerics.scheme = ['bdf2']", "'bdf2'")),
        ({"sweeps": 10**9}, ("numerics.sweeps = 1000000000", "<= 1000")),
        ({"spacing": 1e-40}, ("numerics.spacing = 1e-40", "out of range")),
    ],
)
def test_numerics_are_in_the_range_that_they_have(options: dict, words: tuple) -> None:
    fails(lambda: Numerics(**options), *words)


def test_numbers_of_numpy_are_numbers() -> None:
    numerics = Numerics(order=np.int64(4), seed=np.uint64(2**64 - 1), dt=np.float32(2))
    assert (numerics.order, numerics.seed, numerics.dt) == (4, 2**64 - 1, 2)


@pytest.mark.parametrize(
    "value",
    [
        (True, 0, 0), ["1", "2", "3"], [[1, 2, 3], [1]], [None, 0, 0], {"x": 1}, "abc", [1j, 0, 0],
        np.array([True, False, True]), np.array(["1", "2", "3"]), [1e300, 0, 0], [[[[0]]]] * 3,
    ],
)  # fmt: skip
def test_a_vector_is_of_three_numbers(value: Any) -> None:
    fails(lambda: Sphere(center=value, radius=4), "shape.center")
    fails(lambda: BoxWalls(lower=(-9, -9, -9), upper=value), "confinement.upper")


def test_a_phase_field_lies_between_0_and_1() -> None:
    phi = CUBE.copy()
    phi[1, 2, 3] = 1e300
    fails(lambda: Field(phi=phi), "shape.phi[1, 2, 3] = 1e+300")
    phi[1, 2, 3] = 5
    fails(lambda: Field(phi=phi), "shape.phi[1, 2, 3] = 5", "between 0 and 1")


@pytest.mark.parametrize("function", [lambda x, y: x, lambda: 0, lambda x, y, z, w: 0, Sphere])
def test_walls_are_a_function_of_three_arguments(function: Any) -> None:
    options = SHAPES[FunctionWalls] | {"function": function}
    fails(lambda: FunctionWalls(**options), "confinement.function", "called with 3 arguments")


def test_a_volume_is_a_function_of_one_argument() -> None:
    fails(lambda: ball(volume=lambda: 100.0), "cell 'a': volume", "called with 1 argument")


@pytest.mark.parametrize("value", [None, "celegans-8", 3])
def test_a_simulation_is_of_a_scene(value: Any) -> None:
    fails(lambda: Simulation(value), f"scene = {value!r}", "Scene")


@pytest.mark.parametrize(
    ("cell", "numerics", "words"),
    [
        ({}, {"spacing": 1e-9}, ("cell 'a'", "lattice point", "numerics.spacing = 1e-09")),
        ({}, {"spacing": 1e-5}, ("cell 'a'", "lattice points", "GB of memory", "1e-05")),
        ({"radius": 1e6}, {}, ("cell 'a'", "GB of memory", "coarser spacing, or smaller cells")),
        ({"center": (1e20, 0, 0)}, {}, ("cell 'a' reaches to lattice point 2e+20",)),
    ],
)
def test_a_lattice_must_fit_into_memory(cell: dict, numerics: dict, words: tuple) -> None:
    shape = Sphere(**({"center": ORIGIN, "radius": 4} | cell))
    given = scene(ball(shape=shape), numerics=Numerics(threads=1, **numerics))
    fails(lambda: Simulation(given), *words)


def test_voxels_around_a_mask_must_fit_into_memory() -> None:
    walls = MaskWalls(inside=CUBE, spacing=1e-5)
    fails(lambda: walls.depth(*np.zeros((3, 1))), "voxels of [1e-05, 1e-05, 1e-05] µm", "GB")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 3000 + "\n" + CELL, ("scene.toml", "brackets within brackets")),
        ("duration = " + "9" * 5000 + "\n" + CELL, ("scene.toml has a number of more digits",)),
        ("stages = 1\n" + CELL, ("stages = 1", "list of tables")),
        ("stages = [1]\n" + CELL, ("stages[0] = 1", "table")),
        ("cells = 0.5", ("cells = 0.5", "list of tables")),
        (CELL.replace('"a"', '"a\\u0000"'), ("cells[0].name", "control character")),
        ("[physics]\nsigma = { types = [[[], {}, 1]] }\n" + CELL, ("sigma.types: [[], {}, 1]",)),
        (
            '[physics]\nsigma = { pairs = [["a", "b", 1], ["a", "b", 2]] }\n' + CELL,
            ("sigma.pairs: ['a', 'b'] occurs twice",),
        ),
        (CELL.replace("radius = 4", "radius = -4"), ("cell 'a': shape.radius = -4",)),
        (
            CELL + '[[stages]]\nname = "s"\nend = { kind = "steady" }\nevents = 0.5\n',
            ("stages[0].events = 0.5", "list of tables"),
        ),
        (
            CELL + '[[stages]]\nname = "s"\nend = { kind = "steady" }\nevents = '
            '[{ kind = "removal", cells = true }]\n',
            ("stages[0].events[0]: removal: cells = True", "list of texts"),
        ),
    ],
)
def test_a_scene_file_names_what_is_wrong(load: Callable, text: str, words: tuple) -> None:
    fails(lambda: load(text), *words)


@pytest.mark.parametrize(
    "table",
    [
        {"dtype": "O", "shape": [1], "values": [1]},
        {"dtype": "f8", "shape": [10**12], "values": []},
        {"dtype": "f8", "values": []},
        {"dtype": 3, "shape": [1], "values": [1]},
        {"dtype": "f8", "shape": [1], "values": ["x"]},
        {"dtype": "u1", "shape": [1], "values": [300]},
    ],
)
def test_the_table_of_an_array_is_checked(table: dict) -> None:
    shape = {"kind": "mask", "mask": table}
    fails(lambda: scene_of({"cells": [{"name": "a", "shape": shape}]}), "cell 'a': shape.mask")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: s.divide("a", "bc", axis=(1, 0, 0)), ("daughters = 'bc'", "list of texts")),
        (lambda s: s.divide("a", ("b", "c\0"), axis=(1, 0, 0)), ("daughters[1]", "control")),
        (lambda s: s.divide(["a"], ("b", "c"), axis=(1, 0, 0)), ("cell = ['a']", "'a'")),
        (lambda s: s.divide("a", ("b", "c"), axis=(1, 0, 0), types=(1, 2)), ("type = 1",)),
        (lambda s: s.remove("a"), ("cells = 'a'", "list of texts")),
        (lambda s: s.remove([3]), ("cells[0] = 3",)),
        (lambda s: s.remove(3), ("cells = 3", "list of texts")),
        (lambda s: s.divide("a", ("b", "c"), axis=(1, 0, 0), volumes=3), ("volumes = 3", "list")),
        (lambda s: Removal(rule=lambda _: "a").apply(s), ("rule gives = 'a'", "list of texts")),
        (lambda s: Removal(rule=lambda _: None).apply(s), ("rule gives = None", "list of texts")),
        (lambda s: s.step(1.5), ("steps = 1.5", "whole number")),
        (lambda s: s.step(-1), ("steps = -1", ">= 0")),
        (lambda s: s.step(10**30), ("steps = 1000", "<= 100000000000")),
        (lambda s: s.run(until=1e30), ("until = 1e+30 takes 5e+29 steps of numerics.dt = 2",)),
        (lambda s: relaxed(s.scene, 1e30), ("time = 1e+30 takes 5e+29 steps",)),
        (
            lambda s: Simulation(replace(s.scene, stages=[Stage(name="s", end=Duration(1e30))])),
            ("stage 's': duration = 1e+30 takes 5e+29 steps",),
        ),
        (lambda s: s.change_cells("a", gamma=1.0), ("cells = 'a'", "list of texts")),
        (lambda s: s.change_cells(["a"], type=3), ("cell 'a': type = 3",)),
        (lambda s: s.change_cells(["a"], volume=True), ("volume = True",)),
    ],
)
def test_changes_of_a_simulation_are_checked(change: Callable, words: tuple) -> None:
    simulation = Simulation(scene())
    fails(lambda: change(simulation), *words)
    assert simulation.names == ["a"]


@pytest.mark.parametrize("overrides", [3, ["duration=3"], {3: 4}, {"a\0": 1}])
def test_overrides_are_values_by_key(load: Callable, overrides: Any) -> None:
    fails(lambda: load(CELL, overrides=overrides) if overrides else None)
