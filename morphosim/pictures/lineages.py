"""Which founder each cell of a run stems from."""

import re
from typing import TYPE_CHECKING

from morphosim.runs.saved_fields import variable
from morphosim.scene.cell import ancestors

if TYPE_CHECKING:
    import xarray as xr

FOUNDERS = re.compile(r"(AB|EMS|MS|E|C|D)[a-z]*|P[0-4]|Z[23]")
"""Cells of the C. elegans embryo; the name of most begins with that of their founder."""
GERM_LINE = "P"


def founders(run: "xr.Dataset") -> dict[str, str]:
    """Founder of each cell of a run.

    In C. elegans the founder by name: AB, EMS, MS, E, C, D, or P for the germ line. In a run
    with other names, the cell without a mother that it stems from.
    """
    names = [str(name) for name in variable(run, "cell", "cell").values]
    matches = [FOUNDERS.fullmatch(name) for name in names]
    if all(matches):
        found = [match[1] or GERM_LINE for match in matches if match]
    else:
        parents = variable(run, "parent", "cell").values.astype(str)
        mothers = dict(zip(names, parents.tolist(), strict=True))
        found = [[name, *ancestors(name, mothers)][-1] for name in names]
    return dict(zip(names, found, strict=True))
