"""Parameters of terms in files and states: arrays, functions, None, what follows, what fails."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import (
    Cell,
    Duration,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    Steady,
    Term,
    load_scene,
    open_run,
    save_scene,
)
from morphosim.scene.fingerprint import settings
from morphosim.scene.tables import physics_of, physics_table


@dataclass(frozen=True, kw_only=True, eq=False)
class Wind(Term):
    """Blows along a vector."""

    direction: NDArray = field(default_factory=lambda: np.array([0.1, 0.0, 0.0]))

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        forces.drift[:] -= 0.5 * self.direction


@dataclass(frozen=True, kw_only=True)
class Derived(Term):
    """Has a value that follows from another."""

    speed: float = 0.1
    twice: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "twice", 2 * self.speed)

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        forces.drift[:, 0] -= self.twice


@dataclass(frozen=True, kw_only=True)
class Course(Term):
    """Takes a function of a module, or a number."""

    course: Callable[[float], float] | float = math.sin
    limit: float | None = None


@dataclass(frozen=True)
class Table(Term):
    """Takes what a file may not be able to say."""

    by: Any = None
    most: float | None = 5.0


class Bare(Term):
    """No dataclass."""


TERMS = [Wind(direction=np.array([0.3, 0.0, 0.1])), Derived(speed=0.3), Course(), Course(limit=3.0),
         Course(course=2.0), Table(by={"a": [1, 2.5]})]  # fmt: skip


def scene(*terms: Term, **options: Any) -> Scene:
    return Scene(**({
        "cells": [Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=4.0))],
        "physics": Physics(terms=terms), "duration": 8.0, "save_every": 4.0,
        "numerics": Numerics(threads=1, solver="band"),
    } | options))  # fmt: skip


def named(term: Term) -> dict[str, Any]:
    return {key: np.asarray(value).tolist() if isinstance(value, np.ndarray) else value
            for key, value in vars(term).items()}  # fmt: skip


def local() -> Term:
    @dataclass(frozen=True)
    class Local(Term):
        """Defined where no file can name it."""

    return Local()


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)
def test_a_term_survives_a_file_and_a_state(term: Term, tmp_path: Path) -> None:
    save_scene(scene(term), tmp_path / "s.toml")
    (read,) = load_scene(tmp_path / "s.toml").physics.terms
    state = json.loads(json.dumps(physics_table(Physics(terms=[term]))))
    (kept,) = physics_of(state, []).terms
    for found in (read, kept):
        assert type(found) is type(term)
        assert named(found) == named(term)
    assert settings(load_scene(tmp_path / "s.toml")) == settings(scene(term))


@pytest.mark.parametrize(
    "array",
    [
        np.arange(3), np.array([True, False]), np.zeros((0, 3)), np.array([np.nan, 1.0]),
        np.float32([0.1, 0.2]), np.array(["a", "bc"]), np.full((2, 2), 0.1),
    ],
)  # fmt: skip
def test_arrays_keep_their_type_and_shape(array: NDArray[Any], tmp_path: Path) -> None:
    given = scene(Wind(direction=array))
    save_scene(given, tmp_path / "s.toml")
    (read,) = load_scene(tmp_path / "s.toml").physics.terms
    state = json.loads(json.dumps(physics_table(given.physics)))
    (kept,) = physics_of(state, []).terms
    for found in (read, kept):
        assert isinstance(found, Wind)
        assert found.direction.dtype == array.dtype
        np.testing.assert_array_equal(found.direction, array)
    assert settings(load_scene(tmp_path / "s.toml")) == settings(given)
    assert settings(given) != settings(scene(Wind()))


def test_arrays_lie_beside_the_scene_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a stage too, and the file is found from elsewhere."""
    later = {"terms": [Wind(direction=np.array([0.0, 0.7, 0.0]))]}
    stages = [Stage(name="s", end=Duration(4), physics=later)]
    folder = tmp_path / "place"
    folder.mkdir()
    save_scene(scene(TERMS[0], stages=stages), folder / "s.toml")
    assert '"s.npz:' in (folder / "s.toml").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    read = load_scene(Path("place") / "s.toml")
    np.testing.assert_array_equal(read.physics.terms[0].direction, [0.3, 0, 0.1])  # type: ignore[attr-defined]
    np.testing.assert_array_equal(read.stages[0].physics["terms"][0].direction, [0, 0.7, 0])


@pytest.mark.parametrize("term", [TERMS[0], TERMS[1], TERMS[2]], ids=lambda term: term.name)
def test_a_run_with_a_term_goes_on(term: Term, tmp_path: Path) -> None:
    unbroken, broken = Simulation(scene(term)), Simulation(scene(term))
    unbroken.run()
    broken.run(until=4, observers=[RunWriter(tmp_path / "run", 4)])
    again = Simulation.from_run(tmp_path / "run")
    again.run()
    np.testing.assert_array_equal(again.centroids, unbroken.centroids)
    with open_run(tmp_path / "run") as run:
        assert "use" in json.loads(run.attrs["physics"])["terms"][0]
    branch = Simulation.from_run(tmp_path / "run", time=4)
    assert named(branch.physics.terms[0]) == named(term)


UNSAID = {
    "Local cannot be written to a scene file: define its class at the top": local(),
    "Bare cannot be written to a scene file: define its class at the top": Bare(),
    "term Table: .*lambda.* cannot be written to a scene file as by": Table(by=lambda: 1),
    "term Table: {1: 2.0} cannot be written": Table(by={1: 2.0}),
    "term Table: most = None cannot be written .* make None its default": Table(most=None),
    "term Course: <function .*<lambda>.* cannot be written": Course(course=lambda t: t),
    "term Wind: direction is an array of objects": Wind(direction=np.array([None])),
}


@pytest.mark.parametrize("error", UNSAID)
def test_what_no_file_can_say_runs_but_is_not_saved(error: str, tmp_path: Path) -> None:
    """It is told before the first step."""
    simulation = Simulation(scene(UNSAID[error]))
    for fail in (
        lambda: save_scene(simulation.scene, tmp_path / "s.toml"),
        lambda: simulation.run(observers=[RunWriter(tmp_path / "run", 4)]),
        lambda: simulation.checkpoint().write(tmp_path / "x.npz"),
    ):
        with pytest.raises(ValueError, match=error) as caught:
            fail()
        assert "\n" not in str(caught.value)
    assert simulation.steps == 0
    assert not list(tmp_path.rglob("*.toml")) + list(tmp_path.rglob("*.n*"))


def test_a_term_of_a_function_runs_and_goes_back(tmp_path: Path) -> None:
    """A stage that ends in the past returns to a state with the term itself."""
    stages = [Stage(name="one", end=Steady(), limit=40)]
    term = local()
    simulation = Simulation(scene(term))
    simulation.step()
    simulation.go_back(simulation.checkpoint())
    assert simulation.physics.terms == (term,)
    Simulation(scene(term, stages=stages)).step(2)
    later = [Stage(name="one", end=Duration(4), physics={"terms": [term]})]
    simulation = Simulation(scene(stages=later))
    with pytest.raises(ValueError, match="Local cannot be written to a scene file"):
        simulation.run(observers=[RunWriter(tmp_path / "run", 4)])
    assert simulation.steps == 0


def test_a_term_of_a_file_beside_the_scene_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "place"
    folder.mkdir()
    (folder / "own.py").write_text(
        Path(__file__).with_name("own_terms.py").read_text(encoding="utf-8"), encoding="utf-8"
    )
    save_scene(scene(), folder / "s.toml")
    text = (folder / "s.toml").read_text(encoding="utf-8")
    line = "[physics]\nterms = [{ use = 'own.py:Gravity', weight = 0.3 }]"
    (folder / "s.toml").write_text(text.replace("[physics]", line), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    read = load_scene(Path("place") / "s.toml")
    assert read.physics.terms[0].weight == 0.3  # type: ignore[attr-defined]
    save_scene(read, tmp_path / "other.toml")
    assert load_scene(tmp_path / "other.toml").physics == read.physics
