"""The quality-control report as text and as JSON."""

import json
import textwrap
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from morphosim.library.celegans.quality_checks import INFORMS
from morphosim.library.celegans.quality_control import Criterion

HEAD = """\
Quality control of Supplementary Note 1, at the end of each stage.
Contacts: {phi > 0.44}, dilated by one lattice step, overlap. Area of a contact: the part of the
surface phi = 0.34 where the neighbour's phi is at least 0.2, mean of both sides. Areas in
proportion: measured as microscopy does, on voxels of 0.18 um (boundary voxels x 1.2031), and
compared with a line through the origin; r is the correlation. The Note asks for equal areas, and of
four cells alone; proportion is asked here, which is what the authors' later simulation shows.
Experiment: areas are of three embryos (of four cells the mean of two), contact maps combine
simulations, nuclei and masks; both stand in for the paper's Fig. S1 (17 embryos), which is not
available."""


def report_text(criteria: Sequence[Criterion]) -> str:
    """The criteria as a table of plain text, with their definitions as a head."""
    titles = ("", "", "criterion", "measured", "wanted")
    rows = [(c.stage, _result(c), c.text, c.measured, c.wanted) for c in criteria]
    widths = [max(len(row[k]) for row in (titles, *rows)) for k in range(4)]
    lines = [HEAD, "", _row(titles, widths)]
    for criterion, row in zip(criteria, rows, strict=True):
        lines.append(_row(row, widths))
        if criterion.note != INFORMS:
            margin = " " * (widths[0] + widths[1] + 4)
            lines += [margin + line for line in textwrap.wrap(criterion.note, 100)]
    passed, failed, skipped = (
        sum(r[1] == kind for r in rows) for kind in ("passed", "FAILED", "-")
    )
    return "\n".join([*lines, "", f"{passed} passed, {failed} failed, {skipped} not judged"])


def _row(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = [f"{text:{width}}" for text, width in zip(row, widths, strict=False)]
    return "  ".join([*cells, row[4]]).rstrip()


def _result(criterion: Criterion) -> str:
    if criterion.passed is None:
        return "info" if criterion.note == INFORMS else "-"
    return "passed" if criterion.passed else "FAILED"


def to_json(criteria: Sequence[Criterion]) -> str:
    """The criteria as JSON, with the definitions; a number that is not finite is null."""
    rows = [asdict(criterion) for criterion in criteria]
    for row in rows:
        row["values"] = {
            name: float(value) if np.isfinite(value) else None
            for name, value in row["values"].items()
        }
    return json.dumps({"definitions": HEAD, "criteria": rows}, indent=2, allow_nan=False)
