"""Built-in scenes, by name: files, and functions that make them of tables."""

from collections.abc import Callable, Mapping
from functools import partial
from importlib.resources import as_file, files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from morphosim import _validate
from morphosim._files import toml_table
from morphosim.library.celegans.scenes import celegans_1_to_8, celegans_1_to_102
from morphosim.library.synnotch import SCENES as RANDOM
from morphosim.numerics.parameters import LARGEST_SEED
from morphosim.scene.file import load_scene, overridden, save_scene
from morphosim.scene.scene import Scene

_FOLDER = files("morphosim.library.data")
MADE: dict[str, Callable[[], Scene]] = {
    "celegans-1-to-8": celegans_1_to_8,
    "celegans-1-to-8-strong": partial(celegans_1_to_8, weak=False),
    "celegans-1-to-102": celegans_1_to_102,
}
"""Scenes that functions make."""


def scene_names() -> list[str]:
    """Names of the built-in scenes."""
    stored = [Path(f.name).stem for f in _FOLDER.iterdir() if f.name.endswith(".toml")]
    return sorted([*stored, *MADE, *RANDOM])


def scene_description(name: str) -> str:
    """What a built-in scene is, in one line; errors as for `built_in_scene`."""
    if name in MADE or name in RANDOM:
        return built_in_scene(name).description
    _validate.choice("scene", name, scene_names())
    with as_file(_FOLDER / f"{name}.toml") as path:  # its cells need not be made
        return str(toml_table(path, "scene file")["description"])


def built_in_scene(name: str, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Built-in scene; ValueError lists the known ones if there is none of this name.

    Where a scene's start is random, "numerics.seed" among the overrides is its seed too.
    """
    _validate.choice("scene", name, scene_names())
    if name in MADE:
        scene = MADE[name]()
    elif name in RANDOM:
        seed = (overrides or {}).get("numerics.seed", 0)
        seed = _validate.integer("numerics.seed", seed, least=0, most=LARGEST_SEED)
        scene = RANDOM[name](seed)
    else:
        with as_file(_FOLDER / f"{name}.toml") as path:
            return load_scene(path, overrides)
    return overridden(scene, overrides) if overrides else scene


def scene_text(name: str) -> str:
    """Content of the scene file that says a built-in scene; errors as for `built_in_scene`."""
    scene = built_in_scene(name)
    if name not in MADE and name not in RANDOM:
        return (_FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "scene.toml"
        save_scene(scene, file)
        return file.read_text(encoding="utf-8")


def find_scene(name_or_path: str, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Scene file if the text is the path of one (or of its directory), else built-in scene."""
    path = Path(name_or_path)
    if path.is_dir():
        path = path / "scene.toml"
    if path.suffix == ".toml":
        return load_scene(path, overrides)
    return built_in_scene(name_or_path, overrides)
