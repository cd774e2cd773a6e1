"""Who reads what is malformed: each reader damages a sound input, and reads it."""

import os
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from morphosim import Scene, Simulation
from tests.malformed import mutations
from tests.malformed.inputs import scene_tables
from tests.malformed.mutations import Random

MOST_POINTS = 2e6
"""Scenes with more lattice points are read, checked, and not made."""


@dataclass(frozen=True)
class Reader:
    """One way in.

    Attributes
    ----------
    damage : writes a malformed input into a folder of its own, beside the sound ones, and gives
        what reads it
    """

    damage: Callable[[Path, Path, Random], Callable[[], object]]


def command(*words: object) -> Callable[[], object]:
    """Call the command line with these words, in this process."""
    return lambda: _commands()([str(word) for word in words], standalone_mode=False)


@cache
def _commands() -> Any:
    import typer

    from morphosim.cli import app

    return typer.main.get_command(app)


def begun(scene: Scene) -> None:
    """All that is done with a scene before its first step; a small one is laid on its lattice."""
    points = 1.0
    for cell in scene.cells:
        low, high = cell.shape.bounds()
        points += float(np.prod((high - low) / scene.numerics.spacing + 20))
    if points < MOST_POINTS:
        Simulation(scene)
    else:
        scene.rehearsed()


def _scene_file(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    import tomli_w

    from morphosim import load_scene

    table = scene_tables()[random.integers(3)]
    path = folder / "scene.toml"
    if random.random() < 0.6:
        table = mutations.damaged_tree(table, random)
        try:
            path.write_bytes(tomli_w.dumps(table).encode("utf-8"))
        except (TypeError, ValueError, RecursionError):  # no file can say it
            path.write_bytes(str(table).encode("utf-8", "replace"))
    else:
        path.write_bytes(mutations.damaged_text(tomli_w.dumps(table).encode(), random))
    return lambda: begun(load_scene(path))


def _scene_dict(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    from morphosim.scene.file import scene_of

    table = mutations.damaged_tree(scene_tables()[random.integers(3)], random)
    return lambda: begun(scene_of(table))


def _scene_object(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    """Another value for a field of any of the classes that a scene is made of."""
    import dataclasses

    from morphosim.scene.file import scene_of

    scene = scene_of(scene_tables()[random.integers(3)])
    parts: list[Any] = [scene, scene.physics, scene.physics.attraction, scene.numerics]
    parts += [scene.confinement, *scene.cells, *(cell.shape for cell in scene.cells), *scene.stages]
    parts += [e for s in scene.stages for e in (*s.events, *s.rules, s.end)]
    part = parts[random.integers(len(parts))]
    field = str(random.choice([f.name for f in dataclasses.fields(part) if f.init]))
    value: Any = mutations.odd_value(random)
    if random.random() < 0.3:
        arrays = [np.array(1.0), np.array([1.0, 2.0]), np.array(["a"]), np.float32(2), np.int8(3)]
        others = [*arrays, b"bytes", None, lambda: 1, object(), {1}, range(3), iter([1]), 1j]
        value = others[random.integers(len(others))]
    return lambda: _again(scene, part, dataclasses.replace(part, **{field: value}))


def _again(scene: Scene, part: Any, other: Any) -> None:
    """Make the scene with another part."""
    import dataclasses

    if part is scene:
        return begun(other)
    if part is scene.physics or part is scene.physics.attraction:
        physics = (
            other if part is scene.physics else dataclasses.replace(scene.physics, sigma=other)
        )
        return begun(dataclasses.replace(scene, physics=physics))
    if part is scene.numerics:
        return begun(dataclasses.replace(scene, numerics=other))
    if part is scene.confinement:
        return begun(dataclasses.replace(scene, confinement=other))
    cells = [other if c is part else c for c in scene.cells]
    cells = [dataclasses.replace(c, shape=other) if c.shape is part else c for c in cells]
    stages = [other if s is part else _other_stage(s, part, other) for s in scene.stages]
    return begun(dataclasses.replace(scene, cells=cells, stages=stages))


def _other_stage(stage: Any, part: Any, other: Any) -> Any:
    import dataclasses

    events = [other if e is part else e for e in stage.events]
    rules = [other if e is part else e for e in stage.rules]
    end = other if stage.end is part else stage.end
    return dataclasses.replace(stage, events=events, rules=rules, end=end)


def _overrides(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    from morphosim import load_scene
    from morphosim.cli.compute import _overrides

    keys = [key for table in scene_tables() for key in _dotted(table)]
    key = str(random.choice(keys))
    if random.random() < 0.3:
        key = mutations.damaged_text(key.encode(), random).decode("utf-8", "replace")
    value = mutations.odd_value(random)
    text = str(value).lower() if isinstance(value, bool) else str(value)
    if random.random() < 0.3:
        text = mutations.damaged_text(text.encode() or b"1", random).decode("utf-8", "replace")
    path = sound / str(random.choice(["staged.toml", "p.toml", "e.toml"]))
    return lambda: begun(load_scene(path, _overrides([f"{key}={text}"])))


def _dotted(tree: Any, above: str = "") -> Any:
    entries = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in entries:
        yield f"{above}{key}"
        if isinstance(value, dict | list):
            yield from _dotted(value, f"{above}{key}.")


def _copied(name: str, damage: Callable[[bytes, Random], bytes]) -> Callable[..., Path]:
    """Write a damaged copy of a sound file."""

    def copy(sound: Path, folder: Path, random: Random) -> Path:
        path = folder / name
        path.write_bytes(damage((sound / name).read_bytes(), random))
        return path

    return copy


def _cell_table(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    table = _copied("cells.csv", mutations.damaged_table)(sound, folder, random)
    return command("import-labels", sound / "labels.npy", "--spacing", 0.5, 0.5, 0.5, "--table",
                   table, "-o", folder / "out")  # fmt: skip


def _lineage(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    table = _copied("lineage.csv", mutations.damaged_table)(sound, folder, random)
    return command("import-lineage", table, "--shell", 8, 8, 8, "-o", folder / "out")


def _labels(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    name = ("labels.tif", "labels.npy", "labels.npz", "labels.nc")[random.integers(4)]
    path = _copied(name, mutations.damaged_bytes)(sound, folder, random)
    return command("import-labels", path, "--spacing", 0.5, 0.5, 0.5, "-o", folder / "out")


def _matlab(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    masks, table = sound / "masks.mat", sound / "names.csv"
    if random.random() < 0.7:
        masks = _copied("masks.mat", mutations.damaged_bytes)(sound, folder, random)
    else:
        table = _copied("names.csv", mutations.damaged_table)(sound, folder, random)
    return command("import-matlab", masks, "--table", table, "-o", folder / "out")


def _sweep_file(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    import tomli_w

    data = (sound / "sweep.toml").read_bytes()
    if random.random() < 0.6:
        table = mutations.damaged_tree(tomllib.loads(data.decode()), random)
        try:
            data = tomli_w.dumps(table).encode()
        except (TypeError, ValueError):
            data = str(table).encode("utf-8", "replace")
    else:
        data = mutations.damaged_text(data, random)
    path = folder / "sweep.toml"
    path.write_bytes(data)
    (folder / "staged.toml").write_bytes((sound / "staged.toml").read_bytes())
    return lambda: _planned(path)


def _planned(path: Path) -> None:
    """All that is checked of a sweep file before its first member."""
    from morphosim.sweeps.figures import make_figures
    from morphosim.sweeps.run import _checked
    from morphosim.sweeps.sweepfile import read_sweep

    before = list(sys.path)
    try:
        settings = read_sweep(path)
        figures = make_figures(settings.pop("figures", ("volume",)))
        settings.pop("keep", None)
        choices = {"replicates": 1, "samples": None, "sampling": "sobol", "sample_seed": 0}
        chosen = choices | {k: v for k, v in settings.items() if k in choices}
        _checked(settings["scene"], settings["axes"], figures, settings["overrides"], **chosen)
    finally:
        sys.path[:] = before


def _run(sound: Path, folder: Path, random: Random) -> Callable[[], object]:
    """A run one of whose files is damaged."""
    import shutil

    place = folder / "run"
    shutil.copytree(sound / "run", place)
    files = sorted(p for p in place.iterdir() if p.name != "lock")
    path = files[random.integers(len(files))]
    damage = mutations.damaged_text if path.suffix == ".toml" else mutations.damaged_bytes
    path.write_bytes(damage(path.read_bytes(), random))
    words = (
        ("info", place), ("contacts", place), ("export", place, "--to", "csv"),
        ("run", "--resume", place),
        ("run", sound / "whole.toml", "--from", place, "-o", folder / "new", "--until", 2),
    )[random.integers(5)]  # fmt: skip
    return command(*words)


READERS: dict[str, Reader] = {
    "scene file": Reader(_scene_file),
    "scene table": Reader(_scene_dict),
    "scene objects": Reader(_scene_object),
    "--set": Reader(_overrides),
    "cell table": Reader(_cell_table),
    "lineage table": Reader(_lineage),
    "label image": Reader(_labels),
    "matlab": Reader(_matlab),
    "sweep file": Reader(_sweep_file),
    "run": Reader(_run),
}


def case(reader: str, number: int, sound: Path, folder: Path) -> Callable[[], object]:
    """What reads the malformed input of this number; the same number gives the same input."""
    os.makedirs(folder, exist_ok=True)
    random = np.random.default_rng([number, sorted(READERS).index(reader)])
    return READERS[reader].damage(sound, folder, random)
