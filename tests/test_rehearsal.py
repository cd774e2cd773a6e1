"""What a scene says of later stages is checked before the first step."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from morphosim import (
    Attraction,
    Cell,
    CellChange,
    Differentiation,
    Division,
    Duration,
    Numerics,
    Physics,
    PhysicsChange,
    QuasiSteady,
    Removal,
    Scene,
    Simulation,
    Sphere,
    Stage,
    Steady,
    When,
    load_scene,
    save_scene,
)
from morphosim.scene import stability
from morphosim.scene.target import Foreseen, Target

from .helpers import built_in_scenes

DIVISION = Division(cell="m", daughters=("a", "b"), axis=(1, 0, 0))


def scene(*stages: Stage, **options: Any) -> Scene:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=4), type=kind)
        for name, x, kind in (("m", 0, "x"), ("n", 9, "y"))
    ]
    given = {"cells": cells, "numerics": Numerics(threads=1), "duration": 1e4} | options
    return Scene(stages=stages, **given)


def stage(name: str = "one", **options: Any) -> Stage:
    return Stage(**({"name": name, "end": Steady()} | options))


def own(**values: Any) -> Any:
    """Event of one's own that does nothing, with these attributes."""
    return type("Own", (), {"apply": lambda self, simulation: None} | values)()


def removal(*names: str) -> Removal:
    return Removal(cells=names)


def fails(make: Callable[[], Scene], *words: str) -> None:
    """Require that no simulation can be made of a scene, and why."""
    with pytest.raises((TypeError, ValueError)) as caught:
        Simulation(make())
    for word in words:
        assert word in str(caught.value)


LATER = stage("two", events=[DIVISION])
WRONG: dict[str, tuple[Callable[[], Scene], tuple[str, ...]]] = {
    "nobody is removed": (
        lambda: scene(stage(), stage("two", events=[removal("nobody")])),
        ("stage 'two': events[0]: cell = 'nobody' is not known", "'m', 'n'"),
    ),
    "a cell that has divided": (
        lambda: scene(LATER, stage("three", events=[removal("n"), removal("m")])),
        ("stage 'three': events[1]: cell 'm' is no longer there", "divides into 'a' and 'b'"),
    ),
    "a cell that comes later": (
        lambda: scene(stage(events=[CellChange(cells=["a"], values={"gamma": 0.2})]), LATER),
        ("stage 'one': events[0]: cell = 'a' is not known",),
    ),
    "all cells": (
        lambda: scene(stage(events=[removal("m", "n")])), ("all 2 cells would be removed",),
    ),
    "a daughter named as a cell that lives": (
        lambda: scene(stage(events=[Division(cell="m", daughters=("n", "b"), axis=(1, 0, 0))])),
        ("daughter 'n' of 'm': a cell has or had this name already",),
    ),
    "a daughter named as one that has been": (
        lambda: scene(LATER, stage("three", events=[
            Division(cell="a", daughters=("m", "c"), axis=(1, 0, 0))])),
        ("stage 'three'", "daughter 'm' of 'a'"),
    ),
    "a daughter too small for the lattice": (
        lambda: scene(stage(events=[
            Division(cell="m", daughters=("a", "b"), axis=(1, 0, 0), fraction=0.003)])),
        ("daughter 'a' of 'm' would get 0.804 of the at least 3.38 µm³", "fraction nearer to 1/2"),
    ),
    "a volume that is none at that time": (
        lambda: scene(
            stage(end=Duration(50)),
            stage("two", events=[
                CellChange(cells=["m"], values={"volume": lambda t: 40 - t})])),
        ("stage 'two'", "cell 'm': volume at t = 50", "-10"),
    ),
    "physics of a later stage": (
        lambda: scene(stage(), stage("two", physics={"sigma": Attraction(pairs={("m", "q"): 1})})),
        ("stage 'two': physics: cell in sigma.pairs['m', 'q'] = 'q'",),
    ),
    "physics of an event": (
        lambda: scene(stage(), stage("two", events=[
            PhysicsChange(values={"kappa_by_type": {"z": 1.0}})])),
        ("stage 'two': events[0]", "type in physics.kappa_by_type = 'z'", "'x', 'y'"),
    ),
    "a type that no cell can have": (
        lambda: scene(stage(rules=[Differentiation(of="x", touching="yy", into="z")])),
        ("stage 'one': rules[0]: differentiation: touching = 'yy'", "did you mean 'y'?"),
    ),
    "a rule that can be done once": (
        lambda: scene(stage(rules=[DIVISION])),
        ("stage 'one', as rules_every = 100 have passed: rules[0]: cell 'm' is no longer there",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_a_later_stage_does_wrong_is_told_before_the_first_step(what: str) -> None:
    make, words = WRONG[what]
    fails(make, *words)


@pytest.mark.parametrize("what", [w for w in WRONG if "time" not in w])
def test_a_scene_file_is_rehearsed_as_well(what: str, tmp_path: Path) -> None:
    make, words = WRONG[what]
    save_scene(make(), tmp_path / "scene.toml")
    fails(lambda: load_scene(tmp_path / "scene.toml"), *words)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Removal(cells=True), ("removal: cells = True is not a list of texts",)),
        (lambda: Removal(cells="mn"), ("removal: cells = 'mn' is not a list of texts",)),
        (lambda: Removal(below={"w": 1}), ("key of removal: below = 'w'",)),
        (lambda: Removal(above={"z": "top"}), ("removal: above: z = 'top' is not a number",)),
        (lambda: Removal(rule=lambda: ["m"]), ("removal: rule", "called with 1 argument")),
        (lambda: CellChange(cells=["m"], values={"gamma": -1}), ("cell 'm': gamma = -1", "> 0")),
        (lambda: CellChange(cells=["m"], values={"volume": True}), ("volume = True", "number")),
        (lambda: CellChange(cells=["m"], values={"type": "\x1b[31m"}), ("control character",)),
        (lambda: CellChange(cells=3), ("change of cells: cells = 3 is not a list",)),
        (lambda: PhysicsChange(values={"gamma": -1}), ("physics.gamma = -1",)),
        (lambda: PhysicsChange(values=3), ("change of physics = 3 is not a table",)),
        (lambda: Differentiation(of=1, touching="y", into="x"), ("differentiation: of = 1",)),
        (lambda: When(lambda: True), ("stage: condition", "called with 1 argument")),
        (lambda: stage(events=0.5), ("stage 'one': events = 0.5 is not a list of events",)),
        (lambda: stage(rules={}), ("stage 'one': rules = {} is not a list of events",)),
        (lambda: stage(physics={"gamma": "x"}), ("stage 'one': physics.gamma = 'x'",)),
        (lambda: stage(physics={"gama": 1}), ("stage 'one': key of physics = 'gama'",)),
        (lambda: stage(name="a\nb"), ("stage: name = 'a\\nb'", "control character")),
        (lambda: stage(end=Steady), ("stage 'one': end.reached",)),
        (lambda: stage(events=[type("E", (), {"apply": lambda self: None})()]),
         ("stage 'one': events[0].apply", "called with 1 argument")),
        (lambda: stage(events=[own(daughters="ab")]), ("events[0].daughters = 'ab' is not a",)),
        (lambda: stage(rules=[own(daughters=["\x1b"])]), ("rules[0].daughters[0]", "control")),
        (lambda: stage(rules=[own(makes="ab")]), ("rules[0].makes = 'ab' is not a list",)),
        (lambda: stage(events=[own(rehearse=3)]), ("events[0].rehearse = 3 cannot be called",)),
    ],
)  # fmt: skip
def test_ends_and_events_are_checked_when_they_are_made(make: Callable, words: tuple) -> None:
    with pytest.raises((TypeError, ValueError)) as caught:
        make()
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("said", "error"),
    [
        ("gamma = -1", "physics.gamma = -1 is not allowed"),
        ("gama = 1", "key of physics = 'gama'"),
        ("sigma = 'x'", "physics.sigma = 'x'"),
        ("sigma = { default = -1 }", "sigma.default = -1"),
        ("sigma = { matrix = [[0]] }", "physics.sigma.matrix is of the cells at the start"),
        ("terms = 3", "physics.terms = 3"),
    ],
)
@pytest.mark.parametrize("key", ["physics = ", "events = [{ kind = 'physics', values = "])
def test_physics_of_a_stage_say_whose_they_are(
    tmp_path: Path, key: str, said: str, error: str
) -> None:
    path = tmp_path / "scene.toml"
    save_scene(scene(), path)
    end = f"{key}{{ {said} }}{' }]' if 'events' in key else ''}"
    table = f"\n[[stages]]\nname = 'two'\nend = {{ kind = 'steady' }}\n{end}\n"
    path.write_text(path.read_text() + table)
    with pytest.raises(ValueError, match=r"^stage(s\[0\]| 'two')") as caught:
        load_scene(path)
    assert error in str(caught.value)


@pytest.mark.parametrize(
    "stages",
    [
        [stage(rules=[DIVISION], end=Duration(90.0))],
        [stage(rules=[DIVISION], limit=90.0)],
        [stage(rules=[DIVISION], rules_every=2e4)],
        [stage(rules=[CellChange(cells=["m"], values={"type": "z"})]), LATER],
        [stage(events=[Removal(below={"x": -100.0}, isolated=True)]), LATER],
        [stage(end=QuasiSteady(), events=[DIVISION, removal("a")]), stage(events=[removal("n")])],
    ],
)
def test_what_may_go_well_is_not_refused(stages: list[Stage]) -> None:
    scene(*stages).rehearsed()


def test_a_type_may_come_by_an_event_that_does_not_tell() -> None:
    marking = Differentiation(of="x", touching="new", into="z")
    scene(stage(rules=[marking, Split()], limit=50.0)).rehearsed()


def test_a_target_volume_tells_nothing_where_no_volume_is_kept() -> None:
    small = Division(cell="m", daughters=("a", "b"), axis=(1, 0, 0), fraction=0.003)
    scene(stage(events=[small]), physics=Physics(volume_constraint="none")).rehearsed()


def test_all_built_in_scenes_go_through() -> None:
    for scene in built_in_scenes():
        scene.rehearsed()


def test_a_scene_that_begins_with_a_later_stage_needs_its_cells() -> None:
    whole = scene(LATER, stage("three", events=[removal("b")]))
    whole.rehearsed()
    fails(lambda: whole.from_stage("three"), "stage 'three': events[0]: cell = 'b' is not known")


class Split:
    """An event of a user's own that tells what it does, or does not."""

    def apply(self, simulation: Target) -> None:
        simulation.divide("m", ("a", "b"), axis=(1, 0, 0))


class Foretold(Split):
    def rehearse(self, rehearsal: Foreseen) -> None:
        rehearsal.divide("m", ("a", "b"), axis=(1, 0, 0))


def test_an_event_of_ones_own_may_tell_what_it_will_do() -> None:
    for event in (Foretold(), Split()):
        scene(stage(events=[event]), stage("two", events=[removal("a")])).rehearsed()
    fails(
        lambda: scene(stage(events=[Foretold()]), stage("two", events=[removal("m")])),
        "cell 'm' is no longer there: it divides into 'a' and 'b'",
    )
    fails(
        lambda: scene(stage(events=[Foretold()]), stage("two", events=[removal("c")])),
        "cell = 'c' is not known; allowed are 'n', 'a', 'b'",
    )


def test_what_an_event_brings_is_checked_for_stability() -> None:
    soft = CellChange(cells=["m"], values={"gamma": 0.01})
    told = stability.concerns(scene(stage(events=[soft]), physics=Physics(sigma=0.5)))
    assert any("surface tension 0.01" in text for text in told)
    strong = scene(stage(events=[PhysicsChange(values={"M": 200.0})]), physics=Physics())
    strong = strong.with_numerics(S=6.0)
    assert any("numerics.S" in text for text in stability.concerns(strong))
    assert not stability.concerns(scene(stage()))
