"""Contacts of the early *C. elegans* embryo that simulations are compared with.

They stand in for Fig. S1 of the paper, which is not available: `SOURCES.md` says what from.
"""

import csv
import io
from importlib.resources import files

from morphosim import _validate

CONTACT_STAGES = (4, 6, 7, 8)
"""Numbers of cells for which `celegans_contacts` has a table."""
AREA_STAGES = (2, 3, 4, 6)
"""Numbers of cells for which `celegans_contact_areas` has areas."""


def celegans_contacts(stage: int) -> dict[tuple[str, str], str]:
    """Which cells touch at a stage of the *C. elegans* embryo.

    Parameters
    ----------
    stage
        Number of cells: 4, 6, 7 or 8.

    Returns
    -------
    dict
        Each pair of cells, with "contact" (all sources say so), "noncontact" (none does) or
        "uncertain" (they disagree, so that neither outcome is a failure).

    Raises
    ------
    ValueError
        There is no table of this stage.
    """
    _validate.choice("stage", stage, CONTACT_STAGES)
    return _of_stage(stage, "celegans_contacts.csv", "status")


def celegans_contact_areas(stage: int = 4) -> dict[tuple[str, str], float]:
    """Contact areas, µm², that were measured in *C. elegans* embryos.

    Parameters
    ----------
    stage
        Number of cells: 4 (all five contacts, mean of two embryos), 2, 3 or 6 (means over the
        frames of one embryo; of 6 cells, four contacts of EMS).

    Raises
    ------
    ValueError
        There are no areas of this stage.
    """
    _validate.choice("stage", stage, AREA_STAGES)
    found = _of_stage(stage, "celegans_contact_areas.csv", "area_um2")
    return {pair: float(area) for pair, area in found.items()}


def _of_stage(stage: int, table: str, column: str) -> dict[tuple[str, str], str]:
    """A column of a table, by pairs of cells of a stage."""
    text = (files("morphosim.importers.lineage") / table).read_text(encoding="utf-8")
    rows = csv.DictReader(io.StringIO(text))
    return {(row["cell1"], row["cell2"]): row[column] for row in rows if row["stage"] == str(stage)}
