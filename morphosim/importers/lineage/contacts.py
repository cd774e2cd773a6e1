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
    return {
        (row["cell1"], row["cell2"]): row["status"]
        for row in _rows("celegans_contacts.csv")
        if row["stage"] == str(stage)
    }


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
    return {
        (row["cell1"], row["cell2"]): float(row["area_um2"])
        for row in _rows("celegans_contact_areas.csv")
        if row["stage"] == str(stage)
    }


def _rows(name: str) -> list[dict[str, str]]:
    text = (files("morphosim.importers.lineage") / name).read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))
