"""The folder that the application was started in: it reads and writes nothing outside of it."""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from morphosim._files import PARTIAL, is_file, replacing, toml_table
from morphosim.runs.directory import RunDirectory

DEEPEST = 4
"""Folders are searched down to this depth."""
MOST_FOLDERS = 20_000
"""So many folders are looked at, at most."""
UPLOADS = "imports"
"""Folder of files that come from the browser."""
MASKS, TABLES = (".mat",), (".xls", ".xlsx", ".csv")
IMAGES = (".tif", ".tiff", ".npy", ".npz", ".nc")
SCENES = (".toml",)
ARRAYS = ".npz"
"""Ending of the file of a scene's arrays, beside it."""
LARGEST_UPLOAD = 4 * 2**30
"""Largest file that is taken from the browser, bytes."""
UPLOAD_SUFFIXES = (*MASKS, *IMAGES, *TABLES, *SCENES)


@dataclass(frozen=True, slots=True)
class Store:
    """Files and runs below a folder, by their names relative to it.

    Raises
    ------
    FileNotFoundError
        The folder does not exist.
    """

    root: Path

    def __post_init__(self) -> None:
        if not Path(self.root).is_dir():
            message = f"folder {self.root} does not exist"
            raise FileNotFoundError(message)
        object.__setattr__(self, "root", Path(self.root).resolve())

    def path(self, name: str) -> Path:
        """Path of a name, with links followed.

        Raises
        ------
        ValueError
            The name is empty or leads out of the folder, by "..", as a whole path or by a link.
        """
        if not name.strip() or "\0" in name:
            message = f"name = {name!r} is not allowed; give the name of a file or folder"
            raise ValueError(message)
        place = (self.root / name.strip()).resolve()
        if not place.is_relative_to(self.root) or place == self.root:
            message = f"{name!r} leads out of the folder {self.root}; choose a name below it"
            raise ValueError(message)
        return place

    def run(self, name: str) -> Path:
        """Path of a run, directory or packed file.

        Raises
        ------
        FileNotFoundError
            There is none.
        ValueError
            It, or one of its files, is outside of the folder.
        """
        place = self.path(name)
        files = RunDirectory(place)
        if not place.is_file() and not files.saves:
            message = f"there is no run {name!r} below {self.root}; choose one of the list"
            raise FileNotFoundError(message)
        for file in place.iterdir() if place.is_dir() else ():
            self.path(self.name(file))
        self._check_files(_scene_table(files.scene), place)
        return place

    def scene(self, name: str) -> Path:
        """Path of a scene file.

        Raises
        ------
        FileNotFoundError
            There is none.
        ValueError
            It is not TOML; or it, or a file of arrays that it names, is outside of the folder.
        """
        place = self.path(name)
        self._check_files(toml_table(place, "scene file"), place.parent)
        return place

    def _check_files(self, table: dict[str, Any], folder: Path) -> None:
        """Raise ValueError if a scene in a folder names a file that is outside of the root.

        Files of code are another matter, see `_import_path.refusing`.
        """
        for text in _texts(table):
            file = folder / text.partition(":")[0]
            if file.suffix != ".py" and is_file(file):
                self.path(str(file))

    def new_scene(self, name: str) -> Path:
        """Path of a scene file to come; its ending ".toml" may be left out.

        Raises
        ------
        FileExistsError
            There is a file of this name, or one of the scene's arrays.
        ValueError
            See `path`; or the scene would not be among those that are listed.
        """
        name = name.strip()
        place = self._listed(name if name.lower().endswith(SCENES) or not name else f"{name}.toml")
        for file in (place, place.with_suffix(ARRAYS)):
            if file.exists():
                message = f"{self.name(file)!r} exists; give the scene another name"
                raise FileExistsError(message)
        return place

    def new_run(self, name: str) -> Path:
        """Path of a run to come.

        Raises
        ------
        FileExistsError
            There is a run, or a file, of this name.
        ValueError
            See `path`; or the run would not be among those that are listed.
        """
        place = self._listed(name)
        if place.exists() and (not place.is_dir() or any(place.iterdir())):
            message = f"{name!r} exists and is not empty; give another name, or resume that run"
            raise FileExistsError(message)
        return place

    def _listed(self, name: str) -> Path:
        """Path of a name at which a file or folder will be found."""
        place = self.path(name)
        parts = place.relative_to(self.root).parts
        if len(parts) > DEEPEST or any(part.startswith(".") for part in parts):
            message = (
                f"{name!r} would not be listed; take a name of at most {DEEPEST} folders, of which "
                "none begins with a dot"
            )
            raise ValueError(message)
        return place

    def free(self, name: str, *endings: str) -> Path:
        """Path of a file or folder to write: `name`, or name-2, name-3, … if there is one.

        Or one that is being written, or one with another of the `endings`. After a `name` that is
        name-2 itself comes name-3.
        """
        first = place = self.path(name)
        numbered = re.fullmatch(r"(.+)-\d+", first.stem)
        if numbered:
            before = first.with_name(numbered[1] + first.suffix)
            first = before if _is_taken(before, endings) else first
        count = 1
        while _is_taken(place, endings):
            count += 1
            place = first.with_name(f"{first.stem}-{count}{first.suffix}")
        return place

    def free_name(self, name: str) -> str:
        """`name` as long as a run could have it, otherwise one like it."""
        try:
            return self.name(self.new_run(name))
        except FileExistsError:
            return self.name(self.free(name))
        except ValueError:
            return name

    @contextmanager
    def receiving(
        self, name: str, beside: str = ""
    ) -> Iterator[tuple[str, Callable[[bytes], None]]]:
        """Name below the folder of a file that comes from the browser, and what takes its parts.

        Parameters
        ----------
        name : of the file
        beside : name below the folder of a scene file that has come with it and names it, or ""

        Raises
        ------
        ValueError
            It is not a file that the application can read, or larger than `LARGEST_UPLOAD`.
        """
        place = self._place(name, beside)
        place.parent.mkdir(parents=True, exist_ok=True)
        received = 0
        with replacing(place) as partial, partial.open("wb") as file:

            def write(part: bytes) -> None:
                nonlocal received
                received += len(part)
                if received > LARGEST_UPLOAD:
                    message = f"file {name!r} is larger than {LARGEST_UPLOAD / 2**30:g} GiB, the "
                    message += f"most that a browser may send; copy it into {self.root} instead"
                    raise ValueError(message)
                file.write(part)

            yield self.name(place), write

    def _place(self, name: str, beside: str) -> Path:
        """Path of a file to come from the browser; a scene gets a folder of its own.

        None is named as a save of a run: its folder would be taken for a run.
        """
        plain = Path(name.replace("\\", "/")).name
        plain = f"sent-{plain}" if _is_save(plain) else plain
        if Path(plain).suffix.lower() not in UPLOAD_SUFFIXES:
            message = f"file {name!r} has an ending that is not known; allowed are "
            raise ValueError(message + ", ".join(UPLOAD_SUFFIXES))
        if beside:
            folder = self.path(beside).parent
            allowed = Path(plain).suffix.lower() == ARRAYS and not (folder / plain).exists()
            if not allowed or not folder.is_relative_to(self.root / UPLOADS):
                message = f"file {name!r} cannot be put beside {beside!r}; choose a scene file and "
                message += f"its arrays ({ARRAYS}) anew"
                raise ValueError(message)
            return folder / plain
        if Path(plain).suffix.lower() in SCENES:
            return self.free(f"{UPLOADS}/{Path(plain).stem}") / plain
        return self.free(f"{UPLOADS}/{plain}")

    def name(self, path: Path) -> str:
        """Name of a path below the folder."""
        return path.relative_to(self.root).as_posix()

    def files(self, kinds: Mapping[str, tuple[str, ...]]) -> dict[str, list[str]]:
        """Names of all files of each kind, which have one of its endings, outside of runs."""
        found: dict[str, list[str]] = {kind: [] for kind in kinds}
        for folder, names in self._folders():
            if any(map(_is_save, names)):
                continue
            for kind, suffixes in kinds.items():
                chosen = [folder / name for name in names if name.lower().endswith(suffixes)]
                found[kind] += [self.name(path) for path in chosen if not path.is_symlink()]
        return {kind: sorted(names) for kind, names in found.items()}

    def runs(self) -> list[str]:
        """Names of all runs, the one last written to first."""
        found: dict[str, float] = {}
        for folder, names in self._folders():
            saves = [name for name in names if _is_save(name)]
            if saves and folder != self.root:
                last = folder / max(saves)
                if not last.is_symlink():
                    found[self.name(folder)] = last.stat().st_mtime
        return sorted(found, key=lambda name: (-found[name], name))

    def _folders(self) -> Iterator[tuple[Path, list[str]]]:
        """All folders with the names of their files; links to folders, and hidden folders, not."""
        for count, (folder, inner, names) in enumerate(os.walk(self.root)):
            if count == MOST_FOLDERS:
                return
            depth = len(Path(folder).relative_to(self.root).parts)
            inner[:] = sorted(n for n in inner if not n.startswith(".")) if depth < DEEPEST else []
            yield Path(folder), names


def _scene_table(path: Path) -> dict[str, Any]:
    """Table of the scene of a run; nothing if it is not there or damaged: then it names no file."""
    try:
        return toml_table(path, "scene file")
    except (FileNotFoundError, ValueError):
        return {}


def _texts(value: Any) -> Iterator[str]:
    """All texts in a table, at whatever depth."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts(item)


def _is_taken(place: Path, endings: Iterable[str]) -> bool:
    """Whether there is a file or folder, one that is being written, or one with other endings."""
    others = [place.with_suffix(ending) for ending in endings]
    return any(path.exists() for path in (place, place.with_name(place.name + PARTIAL), *others))


def _is_save(name: str) -> bool:
    return name.startswith("save-") and name.endswith(".nc")
