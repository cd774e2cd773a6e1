"""Names of a run directory's files, and the lock that keeps two runs out of one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from morphosim._files import PARTIAL
from morphosim.errors import SaveError

SCENE = "scene.toml"
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
    def scene_files(self) -> list[Path]:
        """The scene file and that of its arrays, of those that there are."""
        return [file for file in (self.scene, self.scene.with_suffix(".npz")) if file.exists()]

    def save(self, number: int) -> Path:
        """File of one save."""
        return self.path / f"save-{number:06d}.nc"

    def restart(self, number: int) -> Path:
        """File of the whole state at one save."""
        return self.path / f"restart-{number:06d}.npz"

    @property
    def saves(self) -> list[Path]:
        """Files of all saves, in order."""
        return sorted(self.path.glob("save-*.nc"))

    @property
    def last(self) -> int:
        """Number of the last save; -1 if there is none."""
        saves = self.saves
        return int(saves[-1].stem.partition("-")[2]) if saves else -1

    def check_free(self, overwrite: bool = False) -> None:
        """Raise FileExistsError if there is a run, or a scene unless `overwrite`."""
        if self.saves:
            message = (
                f"{self.path} already holds a run; take another directory, or go on with it: "
                f"morphosim run --resume {self.path}"
            )
            raise FileExistsError(message)
        if self.scene_files and not overwrite:
            message = (
                f"{self.scene_files[0]} exists and would be replaced; take another directory, or "
                "replace it by --overwrite (overwrite=True)"
            )
            raise FileExistsError(message)

    def clear(self) -> None:
        """Delete the run, from its last save down, and no file but those of runs."""
        for pattern in ("restart-*.npz", "save-*.nc"):
            for file in sorted(self.path.glob(pattern), reverse=True):
                file.unlink(missing_ok=True)
        for file in self.scene_files:
            file.unlink(missing_ok=True)

    def tidy(self) -> None:
        """Delete what a process that was killed has left half written, and old states."""
        keep = self.restart(self.last)
        for pattern in ("restart-*.npz", *(f"{name}-*{PARTIAL}" for name in ("save", "restart"))):
            for file in self.path.glob(pattern):
                if file != keep:
                    file.unlink(missing_ok=True)

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
