"""What `run --dry-run` says: the run that would be, without a step of it."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from morphosim.cli.run_facts import listing, preset_text
from morphosim.numerics.parameters import LONGEST
from morphosim.runs.directory import RunDirectory
from morphosim.runs.writer import RunWriter
from morphosim.scene import stability
from morphosim.scene.scene import Scene
from morphosim.scene.size import point_bytes
from morphosim.scene.tables import numerics_table, physics_in_file
from morphosim.simulation.simulation import Simulation


def plan_text(simulation: Simulation) -> str:
    """Lines on a simulation that has been made and could run."""
    return "\n".join(
        f"{key + ':':13}{text}" for key, text in (*_scene(simulation), *_course(simulation))
    )


def _scene(simulation: Simulation) -> Iterator[tuple[str, str]]:
    scene = simulation.scene
    yield "scene", scene.name + (f": {scene.description}" if scene.description else "")
    frozen = int(np.sum(simulation.engine.everyone["frozen"]))
    cells = f"{len(simulation.names)}" + (f", {frozen} of them frozen" if frozen else "")
    kinds = sorted({kind for kind in simulation.types if kind})
    yield "cells", cells + (f", of types {', '.join(kinds)}" if kinds else "")
    yield "physics", listing(physics_in_file(simulation.physics))
    walls = "none" if scene.confinement is None else type(scene.confinement).__name__
    yield "confinement", walls
    S = simulation.engine.S
    yield "numerics", preset_text(numerics_table(scene.numerics), S)
    yield "threads", str(simulation.threads)
    yield "stability", _stability(scene, S)


def _stability(scene: Scene, S: float) -> str:
    """What is expected of the scheme with this S, and what may go wrong."""
    numerics = scene.numerics
    if numerics.scheme == "euler":
        limit = f"dt = {numerics.dt:g}, at most {stability.largest_euler_step(scene):.3g}"
        expected = "is expected to be stable"
    else:
        limit = f"S = {S:.3g}, at least {stability.least_S(scene):.3g}"
        expected = "is expected to be needed"
        if numerics.S is None:
            limit = "S" if numerics.tolerance is not None else f"S = {S:.3g}"
            expected = "is chosen, and anew when physics or cells change"
    return "; ".join([f"{limit} {expected}", *stability.concerns(scene, S)])


def _course(simulation: Simulation) -> Iterator[tuple[str, str]]:
    scene = simulation.scene
    numerics, end = scene.numerics, scene.latest_end
    ticks = max(numerics.ticks_to(end) - simulation.ticks, 0)
    most = "at most " if scene.end is None else ""
    lengths = f"{most}{ticks} of dt = {numerics.dt:g}"
    if numerics.tolerance is not None:
        longest = LONGEST * numerics.dt
        lengths = f"as many as the tolerance takes, of {numerics.tick:g} to {longest:g} each"
    yield "steps", f"{lengths}, from t = {simulation.time:g} to {end:g}"
    for number, stage in enumerate(scene.stages, 1):
        events, rules = (
            ", ".join(type(event).__name__ for event in group)
            for group in (stage.events, stage.rules)
        )
        happens = f"{events}; " if events else ""
        happens += f"every {stage.rules_every:g} {rules}; " if rules else ""
        limit = "" if stage.limit is None else f", or after {stage.limit:g}"
        yield f"stage {number}", f"{stage.name}: {happens}until {_end(stage.end)}{limit}"
    yield from _output(simulation, end, ticks, most)


def _output(simulation: Simulation, end: float, ticks: int, most: str) -> Iterator[tuple[str, str]]:
    """Saves, disk and memory."""
    scene = simulation.scene
    due = np.floor(end / scene.save_every + 1e-9) - np.floor(simulation.time / scene.save_every)
    count = max(min(int(due), ticks), 0) + 1 + len(scene.stages)
    save, state = _sizes(simulation)
    interval = max(scene.save_every, scene.numerics.tick)
    yield "saves", f"{most or 'about '}{count}, every {interval:g}"
    memory, now, then = simulation.engine.nbytes, len(simulation.names), scene.most_cells
    if then <= now:
        yield "disk", f"about {_size(count * save + 2 * state)} ({_size(save)} a save)"
        yield "memory", f"{_size(memory)} at the start, besides Python and its libraries"
        return
    more = then / now
    disk = f"{_size(save)} a save at the start, {_size(more * save)} at {then} cells"
    yield "disk", f"at most {_size(more * (count * save + 2 * state))} ({disk})"
    points = float(simulation.engine.pool.sizes().mean())
    own = points * point_bytes(scene.numerics) + simulation.engine.everyone.nbytes / now
    later = f"about {_size(memory + own * (then - now))} at {then} cells"
    yield "memory", f"{_size(memory)} at the start, {later}, besides Python and its libraries"


def _end(end: object) -> str:
    """An end in words."""
    name = getattr(type(end), "__name__", "")
    try:
        values = listing(asdict(end))  # type: ignore[call-overload]
    except TypeError:  # of a user's own
        return name
    return f"{name} ({values})" if values else name


def _sizes(simulation: Simulation) -> tuple[int, int]:
    """Bytes of a save, and of the state to go on from: the present ones, as written."""
    scene = simulation.scene
    with TemporaryDirectory(prefix="morphosim-") as folder:
        files = RunDirectory(Path(folder))
        writer = RunWriter.of(scene, folder)
        writer.start(simulation)
        writer.finish(simulation)
        states = sum(file.stat().st_size for file in files.path.glob("restart-*.npz"))
        return files.saves[-1].stat().st_size, states


def _size(count: float) -> str:
    """Bytes in words."""
    for unit in ("kB", "MB", "GB"):
        count /= 1000
        if count < 1000 or unit == "GB":
            return f"{count:.3g} {unit}"
    raise AssertionError
