"""What a fit has on disk, so that it goes on where it was stopped."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._files import replacing, write_text
from morphosim.cell_field import CellField
from morphosim.inference.search import State
from morphosim.inference.trial import Start
from morphosim.runs.directory import locked_directory
from morphosim.sweeps.store import differences

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Store:
    """Where the files of a fit lie."""

    path: Path

    @property
    def plan(self) -> Path:
        """What is fitted, as JSON."""
        return self.path / "fit.json"

    @property
    def result(self) -> Path:
        """The Dataset of the answer."""
        return self.path / "fit.nc"

    @property
    def run(self) -> Path:
        """Directory of the best run."""
        return self.path / "run"

    @property
    def picture(self) -> Path:
        """The page of pictures."""
        return self.path / "fit.png"

    def locked(self) -> Any:
        """Lock on the directory; see `locked_directory`."""
        return locked_directory(self.path)

    def begin(self, description: Mapping[str, Any]) -> None:
        """Make this the directory of a fit, or check that it is.

        Raises
        ------
        ValueError
            The directory is that of another fit; the message says what differs.
        FileExistsError
            It holds something else.
        """
        if self.plan.exists():
            had = json.loads(self.plan.read_text(encoding="utf-8"))
            for key, before, now in differences(had, json.loads(json.dumps(dict(description)))):
                message = (
                    f"{self.path} holds another fit: {key} is {_brief(before)} there and "
                    f"{_brief(now)} here; take another directory, or the same fit"
                )
                raise ValueError(message)
            return
        for file in self.path.iterdir():
            if file.name != "lock":
                message = f"{self.path} holds {file.name!r} and no fit; take another directory"
                raise FileExistsError(message)
        write_text(self.plan, json.dumps(dict(description), indent=1) + "\n")

    def save(self, state: State, runs: int, seconds: float) -> None:
        """Keep how far the search has come, whole or not at all."""
        arrays: Arrays = {
            "vector": state.vector, "offsets": state.offsets, "slopes": state.slopes,
            "history": np.array(state.history),
            "numbers": np.array(
                [state.round, state.change, state.time, state.given, runs, seconds]
            ),
        }  # fmt: skip
        for k, start in enumerate(state.starts):
            arrays |= _start_arrays(k, start) if start is not None else {}
        self._write(self._round(state.round), arrays)
        if state.round > 1:
            self._round(state.round - 1).unlink(missing_ok=True)

    def _round(self, number: int) -> Path:
        return self.path / f"round-{number:02d}.npz"

    def load(self, names: Sequence[str], frames: int) -> tuple[State, int, float] | None:
        """The last state, with the number of runs and seconds that it has taken; or None."""
        files = sorted(self.path.glob("round-[0-9]*.npz"))
        if not files:
            return None
        with np.load(files[-1]) as found:
            arrays = dict(found)
        number, change, time, given, runs, seconds = arrays["numbers"].tolist()
        state = State(
            round=int(number), vector=arrays["vector"], time=time, given=bool(given),
            starts=[_start_of(k, arrays, names) for k in range(frames)],
            offsets=arrays["offsets"], slopes=arrays["slopes"], change=change,
            history=list(arrays["history"]),
        )  # fmt: skip
        return state, int(runs), seconds

    def _write(self, path: Path, arrays: Arrays) -> None:
        with replacing(path) as partial, partial.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    def save_replicate(self, number: int, off: NDArray[np.float64]) -> None:
        """Keep what a replicate is off by."""
        self._write(self.path / f"replicate-{number:03d}.npz", {"off": off})

    def replicates(self) -> dict[int, NDArray[np.float64]]:
        """What replicates are off by, by number."""
        found = {}
        for path in self.path.glob("replicate-[0-9]*.npz"):
            with np.load(path) as arrays:
                found[int(path.stem.partition("-")[2])] = arrays["off"]
        return found


def _brief(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _start_arrays(k: int, start: Start) -> Arrays:
    arrays: Arrays = {
        f"{k}/targets": start.targets, f"{k}/missed": start.missed,
        f"{k}/missed_volume": start.missed_volume,
    }  # fmt: skip
    for i, field in enumerate(start.fields):
        arrays |= {f"{k}/phi{i}": field.phi, f"{k}/origin{i}": field.origin}
    return arrays


def _start_of(k: int, arrays: Arrays, names: Sequence[str]) -> Start | None:
    if f"{k}/targets" not in arrays:
        return None
    fields = [
        CellField(name, arrays[f"{k}/origin{i}"], arrays[f"{k}/phi{i}"])
        for i, name in enumerate(names)
    ]
    return Start(
        fields, arrays[f"{k}/targets"], arrays[f"{k}/missed"], arrays[f"{k}/missed_volume"]
    )
