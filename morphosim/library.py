"""Built-in scenes, by name."""

from collections.abc import Mapping
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from morphosim import _validate
from morphosim.scene import Scene
from morphosim.scenefile import load_scene

_FOLDER = files("morphosim.scenes")


def scene_names() -> list[str]:
    """Names of the built-in scenes."""
    return sorted(Path(f.name).stem for f in _FOLDER.iterdir() if f.name.endswith(".toml"))


def built_in_scene(name: str, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Built-in scene; ValueError lists the known ones if there is none of this name."""
    _validate.choice("scene", name, scene_names())
    with as_file(_FOLDER / f"{name}.toml") as path:
        return load_scene(path, overrides)


def find_scene(name_or_path: str, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Scene file if the text is the path of one (or of its directory), else built-in scene."""
    path = Path(name_or_path)
    if path.is_dir():
        path = path / "scene.toml"
    if path.suffix == ".toml":
        return load_scene(path, overrides)
    return built_in_scene(name_or_path, overrides)
