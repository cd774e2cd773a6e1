"""Names of a run directory's files, and the lock that keeps two runs out of one."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from morphosim._files import PARTIAL
from morphosim.errors import SaveError

SCENE = "scene.toml"
SHELL = "shell.npz"
INDEX = "saves.index"
LOCK = "lock"


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """Where the files of a run lie."""

    path: Path

    @property
    def scene(self) -> Path:
        """The scene file."""
        return self.path / SCENE

    @property
    def index(self) -> Path:
        """File of the tables of all saves, see `save_index`."""
        return self.path / INDEX

    @property
    def described(self) -> list[Path]:
        """Files of the scene, its arrays and the drawn shell, of those that there are."""
        files = (self.scene, self.scene.with_suffix(".npz"), self.path / SHELL)
        return [file for file in files if file.exists()]

    def save(self, number: int) -> Path:
        """File of one save."""
        return self.path / f"save-{number:06d}.nc"

    def restart(self, number: int) -> Path:
        """File of the whole state at one save."""
        return self.path / f"restart-{number:06d}.npz"

    @property
    def saves(self) -> list[Path]:
        """Files of all saves, in order."""
        return [self.save(number) for number in self.saved]

    @property
    def saved(self) -> list[int]:
        """Numbers of all saves, in order."""
        return self._numbers("save-*.nc")

    @property
    def restarts(self) -> list[int]:
        """Numbers of the saves whose whole state is kept, in order."""
        return self._numbers("restart-*.npz")

    @property
    def last(self) -> int:
        """Number of the last save; -1 if there is none."""
        return max(self.saved, default=-1)

    def _numbers(self, pattern: str) -> list[int]:
        """Numbers of the files of a kind; others that look alike, such as copies, do not count."""
        found = (re.fullmatch(r"\w+-(\d{6,})", path.stem) for path in self.path.glob(pattern))
        return sorted(int(match[1]) for match in found if match)

    @property
    def place(self) -> tuple[int, int] | None:
        """What tells this folder from another of the same name; None if it is not there."""
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def check_free(self, overwrite: bool = False) -> None:
        """Raise FileExistsError if there is a run, or a scene unless `overwrite`."""
        if self.saves:
            message = (
                f"{self.path} already holds a run; take another directory, go on with it by "
                f"morphosim run --resume {self.path}, or replace it by morphosim run SCENE -o "
                f"{self.path} --overwrite (overwrite=True)"
            )
            raise FileExistsError(message)
        if self.described and not overwrite:
            message = (
                f"{self.described[0]} exists and would be replaced; take another directory, or "
                "replace it by --overwrite (overwrite=True)"
            )
            raise FileExistsError(message)

    def clear(self) -> None:
        """Delete the run, and no file but those of runs.

        Raises
        ------
        FileExistsError
            A directory has the name of such a file; nothing is deleted then.
        """
        files = [*self.described, *self._after(-1), self.index]
        for file in files:
            if file.is_dir():
                message = f"{file} is a directory, which is not replaced; take another directory"
                raise FileExistsError(message)
        for file in files:
            file.unlink(missing_ok=True)

    def tidy(self) -> None:
        """Delete what a process that was killed has left half written."""
        for name in ("save", "restart"):
            for file in self.path.glob(f"{name}-*{PARTIAL}"):
                file.unlink(missing_ok=True)

    def keep_states(self, number: int) -> None:
        """Delete all states but that of a save and the one before it."""
        for other in self.restarts:
            if other not in (number - 1, number):
                self.restart(other).unlink(missing_ok=True)

    def drop_after(self, number: int) -> None:
        """Delete what comes after a save."""
        for path in self._after(number):
            path.unlink(missing_ok=True)

    def _after(self, number: int) -> list[Path]:
        """Saves and states that come after a save."""
        return [
            *(self.save(k) for k in self.saved if k > number),
            *(self.restart(k) for k in self.restarts if k > number),
        ]

    def locked(self) -> Any:
        """Lock on the directory, held by this process until it is released or the process ends.

        Raises
        ------
        FileExistsError
            Another process, or another writer of this one, is writing a run here.
        SaveError
            The directory cannot be written to.
        """
        from filelock import FileLock, Timeout

        lock = FileLock(self.path / LOCK, thread_local=False)
        try:
            lock.acquire(timeout=0)
        except Timeout as error:
            message = (
                f"{self.path}: another run is being written here now; wait for its end, or take "
                "another directory"
            )
            raise FileExistsError(message) from error
        except OSError as error:
            message = (
                f"cannot write to the directory {self.path}: {error.strerror or error}; take "
                "another one"
            )
            raise SaveError(message) from error
        return lock


def locked_directory(path: Path) -> Any:
    """Lock on a directory, which is made if it does not exist; see `RunDirectory.locked`.

    Raises
    ------
    SaveError
        It cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"cannot make the directory {path}: {error.strerror or error}"
        raise SaveError(message) from error
    return RunDirectory(path).locked()
