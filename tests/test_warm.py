"""What is compiled ahead is all that a run calls, and nothing is compiled twice."""

import json
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numba import typeof
from typer.testing import CliRunner

from morphosim import (
    Attraction,
    Cell,
    EllipsoidShell,
    Physics,
    Scene,
    Simulation,
    Sphere,
    Term,
    built_in_scene,
)
from morphosim._isolated import process_beside
from morphosim.cli import app
from morphosim.errors import SimulationError
from morphosim.library.built_in import scene_names
from morphosim.scene.stand_in import stand_in
from morphosim.simulation import warming
from morphosim.simulation.compilation import compilation_told
from morphosim.simulation.compiler import perform
from morphosim.simulation.kernel_calls import recorded

FEW = 3
"""Cells of a built-in scene, and stages, that are looked at."""
COARSE = 1.5
"""Spacing of the lattice, µm: as few points as plain Python, in which all this runs, gets done."""
KINDS: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in scene_names()),
    *(("celegans-8", {"numerics.preset": preset}) for preset in ("fast", "published")),
    ("celegans-8", {"numerics.solver": "band"}),
    ("celegans-8", {"numerics.scheme": "euler", "numerics.dt": 0.05}),
    ("celegans-8", {"numerics.precision": "double", "physics.kappa": 1.0}),
    ("sorting", {"period": [162.0, 162.0, 0], "numerics.spacing": 0.6}),
]


def small(scene: Scene) -> Scene:
    """A scene with its first cells and stages only, on a coarse lattice."""
    scene = scene.with_numerics(spacing=COARSE, allow_coarse=True, threads=1)
    if len(scene.cells) <= FEW:
        return replace(scene, stages=scene.stages[:FEW])
    cells = scene.cells[:FEW]
    names, types = [cell.name for cell in cells], {cell.type for cell in cells}
    return replace(scene, cells=cells, physics=scene.physics.among(names, types), stages=())


def stop_soon(simulation: Simulation) -> None:
    """End a run after two steps, which a tolerance may have made short."""
    if simulation.steps >= 2:
        simulation.stop("enough")


def run(scene: Scene, folder: Path) -> None:
    """All that happens in a run, but soon."""
    from morphosim.runs.writer import RunWriter

    with suppress(SimulationError):
        simulation = Simulation(scene)
        writer = RunWriter.of(scene, folder)
        simulation.run(until=2 * scene.numerics.dt, observers=[writer, stop_soon])
        for stage in scene.stages:
            for event in stage.events:
                event.apply(simulation)
            if stage.physics:
                simulation.change_physics(**stage.physics)
            simulation.step(2)
            simulation.measured()


def scenes() -> Iterator[tuple[str, Scene]]:
    """A scene of each kind, by all that it is."""
    for name, changes in KINDS:
        yield f"{name} {changes}", built_in_scene(name, changes)


def called(folder: Path) -> dict[str, list[str]]:
    """Of each scene the kernels, with their types, that a run calls."""
    found = {}
    for number, (name, scene) in enumerate(scenes()):
        with warming.not_ahead(), warnings.catch_warnings(), recorded() as calls:
            warnings.simplefilter("ignore")
            run(small(scene), folder / str(number))
            found[name] = [call.key for call in calls()]
    return found


def foreseen() -> dict[str, list[str]]:
    """The same of its stand-in, or of one that is said to call the same, as plain Python."""
    found, known = {}, {}
    for name, scene in scenes():
        one = stand_in(scene)
        if one.digest not in known:
            with recorded() as calls:
                perform(one)
            known[one.digest] = [call.key for call in calls()]
        found[name] = known[one.digest]
    return found


def told_by(*arguments: str) -> dict[str, list[str]]:
    """What a function of this file gives in a process of its own."""
    done = subprocess.run(
        [sys.executable, __file__, *arguments], capture_output=True, text=True,
        cwd=Path(__file__).parent,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_stand_ins_call_all_kernels_that_runs_of_built_in_scenes_call(tmp_path: Path) -> None:
    runs, known = told_by("called", str(tmp_path)), told_by("foreseen")
    assert len(runs) == len(KINDS)
    for scene, keys in runs.items():
        assert len(keys) > 8, scene
        missing = [key.partition("(")[0] for key in set(keys) - set(known[scene])]
        assert not missing, scene


BALL = Scene(cells=[Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3))])


@pytest.fixture
def done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """File that says what has been compiled; there is none yet, and two processors."""
    place = tmp_path / "compiled"
    monkeypatch.setattr(warming, "_done_file", lambda: place)
    monkeypatch.setattr(warming, "available_processors", lambda: 2)
    return place


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many stand-ins are compiled for, each time, by nobody."""
    counts: list[int] = []

    class Nobody:
        total, finished, closed = 7, True, False

        def __init__(self, stand_ins: Sequence[Any]) -> None:
            counts.append(len(stand_ins))

        def wait(self, tell: Any, soon: bool = False) -> None:
            tell(warming.WHAT, 3, 7)

        def close(self) -> None: ...

    monkeypatch.setattr(warming, "_Crew", Nobody)
    return counts


def comes(place: Path) -> bool:
    """Whether a file is there soon, which another thread writes."""
    end = time.monotonic() + 10
    while not place.exists() and time.monotonic() < end:
        time.sleep(0.01)
    return place.exists()


def test_the_first_simulation_compiles_ahead_and_says_so(done: Path, compiled: list[int]) -> None:
    texts: list[str] = []
    with compilation_told(texts.append):
        Simulation(BALL)
        Simulation(BALL)
    assert compiled == [1]
    assert comes(done)
    assert "compiling kernels, once per installation: 3 of 7" in texts


def test_a_run_begins_when_what_a_step_calls_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is compiled before anything else, and the run does not wait for the rest."""
    monkeypatch.setattr(warming, "process_beside", lambda program: process_beside(STAND_STILL))
    told: list[tuple[int, int]] = []
    with closing(warming._Crew([stand_in(BALL)])) as crew:
        crew.wait(lambda what, *counts: told.append(counts), soon=True)
        assert not crew.finished
    assert crew.closed
    assert told[-1][0] >= 2
    assert told[-1][1] == 5


def test_walls_and_pairs_need_no_step_of_their_own() -> None:
    """What they add reaches a step in arrays that it takes in any case."""
    cells = [
        Cell(name=n, shape=Sphere(center=(x, 0, 0), radius=3)) for n, x in (("a", 0), ("b", 5))
    ]
    plain = Scene(cells=cells, physics=Physics(sigma=0.5))
    pulled = Physics(sigma=Attraction(default=0.5, pairs={("a", "b"): 0.9}))
    shell = EllipsoidShell(center=(2.5, 0, 0), semi_axes=(7, 5, 5))
    types = []
    for scene in (plain, replace(plain, physics=pulled, confinement=shell)):
        coupling = Simulation(scene).engine._coupling
        types.append([typeof(given) for given in (coupling.columns, *coupling.pairs)])
    assert types[0] == types[1]


STAND_STILL = """
import json, pickle, sys, time
pickle.load(sys.stdin.buffer)
soon, later = (["a", 1, True], ["c", 2, True]), (["b", 9, False], ["d", 8, False], ["e", 7, False])
print(json.dumps([*later, *soon]), flush=True)
for line in sys.stdin:
    time.sleep(60 if json.loads(line) in "bde" else 0)
    print(flush=True)
"""
"""Program of a process that never compiles what is not needed soon."""


def test_processes_compile_all_that_a_scene_calls() -> None:
    told: list[tuple[str, int, int]] = []
    count = warming._compile([stand_in(BALL)], lambda *what: told.append(what))
    assert count > 8
    assert told[-1] == (warming.WHAT, count, count)


def test_the_command_says_what_it_has_compiled(done: Path, compiled: list[int]) -> None:
    def said(*arguments: str) -> str:
        return CliRunner().invoke(app, ["warm", *arguments], catch_exceptions=False).stdout.strip()

    assert said("celegans-8", "--preset", "fast") == "7 kernels are compiled"
    assert said("celegans-8-strong", "--preset", "fast") == "all kernels are compiled already"
    assert said("--quiet", "celegans-8", "--set", "numerics.solver=band") == ""
    assert compiled == [1, 1]
    with pytest.raises(ValueError, match="scene = 'embryo' is not known"):
        said("embryo")


def test_one_processor_or_a_process_of_a_scan_compiles_nothing_ahead(
    done: Path, compiled: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    with warming.not_ahead():
        Simulation(BALL)
    monkeypatch.setattr(warming, "available_processors", lambda: 1)
    Simulation(BALL)
    assert compiled == []


def test_warm_compiles_for_each_kind_of_scene_once(done: Path, compiled: list[int]) -> None:
    again = replace(BALL, name="again", duration=7.0)
    noisy = BALL.with_physics(kappa=0.1, gamma=0.3)
    assert warming.warm([BALL, again, noisy], lambda *told: None) == 7
    assert warming.warm([again, noisy.with_physics(kappa=0.2)], lambda *told: None) == 0
    assert warming.warm([BALL.with_numerics(solver="band")], lambda *told: None) == 7
    assert compiled == [2, 1]


def test_processes_that_start_together_compile_once(tmp_path: Path) -> None:
    """What the first one is at, the others wait for: one of them runs processes beside it."""
    order: list[str] = []
    place = tmp_path / "compiled"
    with warming._locked(place):
        waiting = threading.Thread(target=lambda: _wait(place, order))
        waiting.start()
        waiting.join(0.2)
        order.append("compiled")
    waiting.join()
    assert order == ["compiled", "found"]


def _wait(place: Path, order: list[str]) -> None:
    with warming._locked(place):
        order.append("found")


def test_what_only_this_process_knows_is_told_by_warm_and_left_to_the_run(done: Path) -> None:
    class Own(Term):
        """A force of a script."""

    scene = BALL.with_physics(terms=[Own()])
    with pytest.raises(ValueError, match="another process does not find what a scene has"):
        warming.warm([scene], lambda *told: None)
    Simulation(scene)
    assert not done.exists()


def test_a_process_that_dies_is_told_by_warm_and_left_to_the_run(
    done: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warming, "SERVE", "import os; os.abort()")
    with pytest.raises(OSError, match="a process that compiles kernels has died"):
        warming.warm([BALL], lambda *told: None)
    Simulation(BALL)
    assert comes(done)  # so that the next one does not try again


if __name__ == "__main__":
    found = foreseen() if sys.argv[1] == "foreseen" else called(Path(sys.argv[2]))
    print(json.dumps(found))
