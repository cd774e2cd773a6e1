"""What saves say of themselves; which saves of a directory are whole, and of its run."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from morphosim._files import guarded
from morphosim.runs.directory import RunDirectory

COMPARED = 9
"""So many of the last saves tell which run a directory holds: a run may have thousands."""


@dataclass(frozen=True, slots=True, eq=False)
class SaveFacts:
    """What a save says besides its variables.

    Attributes
    ----------
    step : steps taken
    time : *in silico* time
    run_id : see `Identity`; "" in saves of version 0.1
    error : why the run has ended there; "" if it can go on
    cells : names of the cells
    low : (N, 3) first corners of their boxes, µm
    centroid : (N, 3), µm
    """

    step: int
    time: float
    run_id: str
    error: str
    cells: list[str]
    low: NDArray[np.float64]
    centroid: NDArray[np.float64]

    @classmethod
    def read(cls, path: Path) -> "SaveFacts":
        """Read them; ValueError that names the file if it is damaged or no save."""
        return guarded(path, lambda: cls._read(path))

    @classmethod
    def _read(cls, path: Path) -> "SaveFacts":
        import netCDF4

        with netCDF4.Dataset(path) as file:
            file.set_auto_mask(False)
            attributes = {name: file.getncattr(name) for name in file.ncattrs()}
            return cls(
                step=int(file["step"][0]),
                time=float(file["time"][0]),
                run_id=str(attributes.get("run_id", "")),
                error=str(attributes["error"]),
                cells=[str(name) for name in file["cell"][...]],
                low=np.array(file["box_low"][0]),
                centroid=np.array(file["centroid"][0]),
            )


def whole_saves(files: RunDirectory) -> Iterator[tuple[int, SaveFacts]]:
    """Numbers of a run's saves and what they say, from the last one down, each read when asked for.

    Those that are damaged, or of another run than most of the last ones, are left out; readers of
    the run (`reader.read_run`) warn of these.
    """
    asked = ((number, facts_of(files.save(number))) for number in reversed(files.saved))
    whole = ((number, facts) for number, facts in asked if facts is not None)
    last = list(islice(whole, COMPARED))
    ours = most_common(facts.run_id for _, facts in last)
    return (found for found in chain(last, whole) if found[1].run_id == ours)


def facts_of(path: Path) -> SaveFacts | None:
    """What a save says; None if it is not there, or damaged."""
    try:
        return SaveFacts.read(path)
    except ValueError:
        return None


def most_common(ids: Iterable[str]) -> str:
    """The id that most saves of a directory have: that of its run; "" for no saves."""
    counts = Counter(ids)
    return max(counts, key=lambda run_id: counts[run_id], default="")
