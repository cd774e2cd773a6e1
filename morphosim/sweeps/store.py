"""What a scan has on disk, and whether a directory is that of this scan."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from filecmp import cmp
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from morphosim._files import PARTIAL, replacing, write_text
from morphosim.runs.directory import locked_directory

if TYPE_CHECKING:
    import xarray as xr

ABSENT = "not run yet"
"""Error of a member that has no result."""


@dataclass(frozen=True, slots=True)
class Store:
    """Where the files of a scan lie."""

    path: Path

    @property
    def scene(self) -> Path:
        """Scene file that all members start from."""
        return self.path / "scene.toml"

    @property
    def plan(self) -> Path:
        """What the scan is, as JSON."""
        return self.path / "sweep.json"

    @property
    def result(self) -> Path:
        """The Dataset of all members."""
        return self.path / "sweep.nc"

    def member(self, number: int) -> Path:
        """Result of one member."""
        return self.path / "members" / f"{number:06d}.nc"

    def run(self, number: int) -> Path:
        """Directory of one member's run."""
        return self.path / "runs" / f"{number:06d}"

    def finished(self) -> set[int]:
        """Numbers of the members that have a result."""
        return {int(path.stem) for path in (self.path / "members").glob("[0-9]*.nc")}

    def failed(self) -> set[int]:
        """Numbers of the members whose result is an error."""
        return {k for k in self.finished() if self.read(k).attrs["error"]}

    def forget(self, number: int) -> None:
        """Delete a member's result and run, so that it is run again."""
        self.member(number).unlink(missing_ok=True)
        shutil.rmtree(self.run(number), ignore_errors=True)

    def write(self, number: int, table: "xr.Dataset | None", **facts: Any) -> None:
        """Write a member's result, whole or not at all; `facts` are its attributes."""
        import xarray as xr

        table = xr.Dataset() if table is None else table.drop_encoding()
        path = self.member(number)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            table.assign_attrs(facts).to_netcdf(partial, engine="netcdf4")

    def read(self, number: int) -> "xr.Dataset":
        """Read a member's result."""
        import xarray as xr

        with xr.open_dataset(self.member(number), engine="netcdf4") as table:
            return table.load()

    def begin(self, description: Mapping[str, Any], staged: "Store") -> None:
        """Make this the directory of a scan, or check that it is.

        Parameters
        ----------
        description : what tells one scan from another
        staged : where the scene file of this scan lies now

        Raises
        ------
        ValueError
            The directory is that of another scan; the message says what differs.
        FileExistsError
            It holds something else.
        """
        if self.plan.exists():
            self._check_same(json.loads(self.plan.read_text(encoding="utf-8")), description)
            self._check_scene(staged)
            for half_written in self.path.glob(f"members/*{PARTIAL}"):
                half_written.unlink(missing_ok=True)
            return
        sources = {file.name: file for file in staged.path.iterdir()}
        for file in sorted(self.path.iterdir()):  # of a scan that was killed as it began, perhaps
            same = file.name in sources and cmp(file, sources[file.name], shallow=False)
            if not (same or file.name == "lock" or file.name.endswith(PARTIAL)):
                message = f"{self.path} holds {file.name!r} and no scan; take another directory"
                raise FileExistsError(message)
        for name, source in sorted(sources.items()):
            with replacing(self.path / name) as partial:
                shutil.copyfile(source, partial)
        write_text(self.plan, json.dumps(description, indent=1) + "\n")

    def _check_same(self, had: Mapping[str, Any], has: Mapping[str, Any]) -> None:
        """Raise ValueError naming what differs from the scan of this directory."""
        has = json.loads(json.dumps(has))
        for where, before, now in differences(had, has):
            message = (
                f"{self.path} holds another scan: {where} is {before} there and {now} here; take "
                "another directory, or the same scan"
            )
            raise ValueError(message)

    def _check_scene(self, staged: "Store") -> None:
        """Raise ValueError unless the scene files say the same."""
        before, now = (s.scene.read_text(encoding="utf-8").splitlines() for s in (self, staged))
        pairs = [(a, b) for a, b in zip(before, now, strict=False) if a != b]
        same = not pairs and len(before) == len(now) and _same_arrays(self.scene, staged.scene)
        if not same:
            what = f": {pairs[0][0]!r} there, {pairs[0][1]!r} here" if pairs else ""
            message = f"{self.path} holds a scan of another scene{what}; take another directory"
            raise ValueError(message)

    def locked(self) -> Any:
        """Lock on the directory; see `locked_directory`."""
        return locked_directory(self.path)


def differences(had: Any, has: Any, where: str = "") -> Any:
    """Place, before and now of everything that differs between two tables."""
    if isinstance(had, dict) and isinstance(has, dict):
        for key in [*had, *(key for key in has if key not in had)]:
            place = f"{where}: {key}" if where else key
            yield from differences(had.get(key), has.get(key), place)
    elif had != has:
        yield where, "absent" if had is None else had, "absent" if has is None else has


def _same_arrays(one: Path, other: Path) -> bool:
    """Whether the array files beside two scene files hold the same."""
    paths = [path.with_suffix(".npz") for path in (one, other)]
    if not all(path.exists() for path in paths):
        return not any(path.exists() for path in paths)
    with np.load(paths[0]) as a, np.load(paths[1]) as b:
        return set(a.files) == set(b.files) and all(np.array_equal(a[k], b[k]) for k in a.files)
