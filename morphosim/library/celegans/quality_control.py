"""Quality control of Supplementary Note 1: criteria A to H for a run from one to eight cells.

Criteria are judged on the last save of each stage of `scenes.first_eight`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from morphosim.library.celegans.quality_checks import CHECKS, Check, Finding
from morphosim.library.celegans.stage_end import StageEnd

if TYPE_CHECKING:
    import xarray as xr

NEEDED = (
    ("stage", "time"), ("rms_speed", "time"), ("volume", "time", "cell"),
    ("centroid", "time", "cell", "axis"), ("box_low", "time", "cell", "axis"),
    ("contact_area", "time", "cell", "neighbour"),
)  # fmt: skip
"""Variables of a run that the criteria are measured from, with their dimensions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """One criterion of Supplementary Note 1, as a run meets it.

    Attributes
    ----------
    stage : str
        Letter of the step of the Note, A to H.
    text : str
        What is asked, and of which stage of the run.
    measured : str
    values : mapping of names to numbers
        The measured numbers: angles in degrees, areas' differences relative, lengths in µm.
    wanted : str
    passed : bool or None
        None where it is not judged; `note` says why.
    note : str
        By how much it is missed, or why it is not judged.
    """

    stage: str
    text: str
    measured: str = "-"
    values: Mapping[str, float] = field(default_factory=dict)
    wanted: str = ""
    passed: bool | None = None
    note: str = ""


def quality_control(run: "xr.Dataset") -> list[Criterion]:
    """Judge a run of `celegans-1-to-8` by criteria A to H of Supplementary Note 1.

    Parameters
    ----------
    run : Dataset of `open_run`
        With fields, and with the stages of `scenes.first_eight`. Criteria of stages that it does
        not have are not judged.

    Raises
    ------
    ValueError
        A variable is missing, the run was saved without fields, or it is a selection of a run.
    """
    from morphosim.runs.saved_fields import variable

    for name, *dims in NEEDED:
        variable(run, name, *dims)
    stages = {name: _end(run, name) for check in CHECKS for name in check.stages}
    return [_no_overflow(run), *(_judge(check, stages) for check in CHECKS)]


def _judge(check: Check, stages: Mapping[str, StageEnd]) -> Criterion:
    """Measure a check, unless the run does not have what it needs."""
    ends = [stages[name] for name in check.stages]
    finding = _obstacle(check, ends) or check.measure(*ends)
    return Criterion(
        stage=check.letter, text=f"{check.stages[-1]}: {check.text}", measured=finding.measured,
        values=finding.values, wanted=check.wanted, passed=finding.passed, note=finding.note,
    )  # fmt: skip


def _end(run: "xr.Dataset", name: str) -> StageEnd:
    return StageEnd(run, np.flatnonzero(run["stage"].values == name))


def _obstacle(check: Check, ends: Sequence[StageEnd]) -> Finding | None:
    """Why a check cannot be measured, or None."""
    for name, end in zip(check.stages, ends, strict=True):
        if not len(end.places):
            return Finding("-", {}, None, f"the run has no stage {name!r}")
        if end.run.attrs["error"] and end.places[-1] == end.run.sizes["time"] - 1:
            return Finding("-", {}, False, f"the run ended in {name!r} by an error")
        lost = end.missing(check.cells)
        if lost:
            return Finding("-", {}, False, f"not there at the end of {name!r}: {', '.join(lost)}")
    return None


def _no_overflow(run: "xr.Dataset") -> Criterion:
    """A: no error, all volumes finite, and stages of one and two cells that ended."""
    there = np.isfinite(run["box_low"].values).all(axis=2)
    bad = int((there & ~np.isfinite(run["volume"].values)).sum())
    error, last = run.attrs["error"], str(run["stage"].values[-1])
    ends = {name: _end(run, name) for name in ("1-cell", "2-cell")}
    open_ends = [n for n, e in ends.items() if len(e.places) and n == last]
    absent = [name for name, end in ends.items() if not len(end.places)]
    notes = [f"error in stage {last!r}: {error}"] if error else []
    notes += [f"{bad} volumes are not finite"] if bad else []
    notes += [f"{name!r} did not end" for name in open_ends]
    unjudged = [f"the run has no stage {name!r}" for name in absent]
    return Criterion(
        stage="A", text="all stages: no numeric overflow; 1- and 2-cell end",
        measured=f"{'an error' if error else 'no error'}, {bad} volumes not finite",
        values={"volumes_not_finite": bad}, wanted="no error, 0",
        passed=False if notes else None if absent else True, note="; ".join(notes or unjudged),
    )  # fmt: skip
