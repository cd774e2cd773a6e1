"""A simulation at one time, whole: all that its next step depends on besides the scene."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from morphosim._files import guarded, replacing
from morphosim._parts import pieces
from morphosim._shown import short_repr
from morphosim.numerics.parameters import Numerics
from morphosim.physics.term import Term
from morphosim.provenance import versions
from morphosim.runs.identity import Identity
from morphosim.runs.npz import ENDING, read_array, stored_array, write_array
from morphosim.scene.term_tables import term_table

FORMAT = 4
"""Version of the file; others are refused. Version 0.1 of the package wrote 1."""
FACTS, BACK, DIGEST = "facts", "back:", "digest"
NEEDED = ("name", "shape", "room", "points", "low", "high", "phi")
"""Arrays that every state has."""
FIELDS = ("phi", "history")
"""Arrays of all fields, cell after cell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """State of a simulation.

    Attributes
    ----------
    physics : what a scene file says of the physics that hold
    steps : steps taken
    ticks : ticks passed; in states of version 0.2 not said, and as many as steps
    stage : name of the stage
    removed : (time, name) of cells that were taken out
    settings : what the scene says that must stay the same, see `fingerprint.settings`
    arrays : what `Engine.contents` gives: the columns of the cell table, and the fields, which in
        what `read` gives stay in the file until they are used
    volumes : target volumes that are functions, by name of the cell: what a scene file says of a
        `VolumeCourse`, or None for another function, which is the scene's to say
    dividing : divisions under way, by name of the cell: see `Furrow.table`
    used : names that other cells had before, or are to have
    progress : how far the stages are, see `StageRunner.facts`; None without stages
    back : state that the present stage may end with
    identity : which run it is of
    error : why the simulation cannot go on; "" while it can
    explicit_rate : see `Engine`: what S has been chosen for
    """

    physics: Mapping[str, Any]
    steps: int
    ticks: int
    stage: str
    removed: tuple[tuple[float, str], ...]
    settings: Mapping[str, Any]
    arrays: Mapping[str, Any]
    volumes: Mapping[str, Mapping[str, Any] | None] = field(default_factory=dict)
    dividing: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    used: tuple[str, ...] = ()
    progress: Mapping[str, Any] | None = None
    back: "Checkpoint | None" = None
    identity: Identity = field(default_factory=Identity)
    error: str = ""
    explicit_rate: float = 0.0

    __repr__ = short_repr

    @property
    def time(self) -> float:
        """*In silico* time."""
        return self.ticks * Numerics(**self.settings["numerics"]).tick

    @property
    def names(self) -> list[str]:
        """Names of the cells."""
        return [str(name) for name in self.arrays["name"]]

    def write(self, path: Path) -> None:
        """Write to an .npz file, which appears whole or not at all.

        Raises
        ------
        ValueError
            The physics have a term that no file can say.
        """
        arrays = self._packed("")
        with replacing(path) as partial, ZipFile(partial, "w") as archive:
            for name, values in arrays.items():
                write_array(archive, name, values)
            archive.writestr(DIGEST, _digest(archive))

    def _packed(self, prefix: str) -> dict[str, Any]:
        """Arrays of a file, with this before their names."""
        facts = {f.name: getattr(self, f.name) for f in fields(self)}
        del facts["arrays"], facts["back"]
        facts |= {"format": FORMAT, "version": versions()["morphosim"]}
        facts["identity"] = asdict(self.identity)
        arrays = {prefix + name: value for name, value in self.arrays.items()}
        arrays[prefix + FACTS] = np.array(json.dumps(facts, default=_refused))
        return arrays | (self.back._packed(prefix + BACK) if self.back else {})

    @classmethod
    def read(cls, path: Path) -> "Checkpoint":
        """Read what `write` wrote.

        Raises
        ------
        ValueError
            It is damaged, has been changed since, or is of another version.
        """
        arrays, is_as_written = guarded(path, lambda: _arrays(path))
        facts = guarded(path, lambda: dict(json.loads(str(arrays[FACTS]))))
        if facts.get("format") != FORMAT:
            here, there = versions()["morphosim"], facts.get("version", "0.1.0")
            message = (
                f"{path} was written by version {there} of morphosim, this is {here} with states "
                f"of format {FORMAT}; go on with that version, or start a new run from the fields: "
                f"morphosim run SCENE --from {path.parent} -o NEW"
            )
            raise ValueError(message)
        if not is_as_written:
            message = f"{path} has been changed since it was written: it does not fit its digest"
            raise ValueError(message)
        state = guarded(path, lambda: cls._unpacked(arrays))
        state._check(path)
        return state

    def _check(self, path: Path) -> None:
        """Raise ValueError if no simulation can be at this state."""
        lacking = [name for name in NEEDED if name not in self.arrays]
        if lacking:
            message = f"{path}: the saved state has no array {lacking[0]!r}"
            raise ValueError(message)
        count, shape = len(self.names), self.arrays["shape"]
        if len(set(self.names)) != count or shape.shape != (count, 3):
            message = f"{path}: the saved state has {count} names for {len(shape)} boxes of cells"
            raise ValueError(message)
        if not self._fits(shape):
            message = f"{path}: the fields of the saved state do not fit the boxes of its cells"
            raise ValueError(message)
        bad = [
            name for name in FIELDS
            if name in self.arrays
            and not all(np.isfinite(piece).all() for piece in pieces(self.arrays[name]))
        ]  # fmt: skip
        if bad:
            message = f"{path}: {bad[0]} of the saved state is not finite"
            raise ValueError(message)
        for what, count in (("step", self.steps), ("tick", self.ticks)):
            if not isinstance(count, int) or count < 0:
                message = f"{path}: the saved state is at {what} {count!r}; expected a count"
                raise ValueError(message)
        if self.back is not None:
            self.back._check(path)

    def _fits(self, shape: NDArray[np.int64]) -> bool:
        """Whether there are as many values of the fields as the bands, or boxes, say."""
        low, high, points = (self.arrays[name] for name in ("low", "high", "points"))
        rows, total = shape[:, :2].prod(axis=1), points.sum()
        if not len(low) == len(high) == rows.sum() or points.shape != rows.shape:
            return False
        spans = np.add.reduceat(high - low, np.cumsum(rows) - rows, dtype=np.int64)
        inside = (low >= 0).all() and (low <= high).all()
        inside &= (high <= np.repeat(shape[:, 2], rows)).all()
        whole = np.array_equal(points, shape.prod(axis=1)) or np.array_equal(points, spans)
        return bool(
            inside and whole and (points <= self.arrays["room"]).all()
            and all(self.arrays[n].shape == (total,) for n in FIELDS if n in self.arrays)
        )  # fmt: skip

    @classmethod
    def _unpacked(cls, arrays: dict[str, Any]) -> "Checkpoint":
        facts = json.loads(str(arrays.pop(FACTS)))
        del facts["format"], facts["version"]
        facts["removed"] = tuple((time, name) for time, name in facts["removed"])
        facts["used"] = tuple(facts["used"])
        facts.setdefault("ticks", facts["steps"])
        facts["identity"] = Identity(**facts["identity"])
        inner = {
            name.removeprefix(BACK): arrays.pop(name)
            for name in list(arrays) if name.startswith(BACK)
        }  # fmt: skip
        back = cls._unpacked(inner) if inner else None
        return cls(**facts, arrays=arrays, back=back)


def _refused(item: Any) -> Any:
    """Raise ValueError that says why no file can hold a thing."""
    if isinstance(item, Term):
        return term_table(item)  # raises: it would be a table already
    message = f"{item!r} of type {type(item).__name__} cannot be written to a checkpoint"
    raise ValueError(message)


def _arrays(path: Path) -> tuple[dict[str, Any], bool]:
    """Arrays of a file, and whether they are those that were written.

    The fields are checked, and stay in the file; those to go back to do not, as they may be held
    longer than the file is there.
    """
    with ZipFile(path) as archive:
        members = archive.namelist()
        said = archive.read(DIGEST).decode() if DIGEST in members else ""
        is_as_written = said == _digest(archive)
        names = [name.removesuffix(ENDING) for name in members if name != DIGEST]
        arrays = {
            name: (stored_array if name in FIELDS else read_array)(archive, name) for name in names
        }
    return arrays, is_as_written


def _digest(archive: ZipFile) -> str:
    """Text that is another one if any array is: of the checksums that a zip file has of each."""
    parts = [part for part in archive.infolist() if part.filename != DIGEST]
    said = sorted((part.filename, part.file_size, part.CRC) for part in parts)
    return sha256(repr(said).encode()).hexdigest()
