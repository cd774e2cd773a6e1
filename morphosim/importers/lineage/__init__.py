"""Lineages: who divides when, along which axis and into which volumes."""

from morphosim.importers.lineage.contacts import (
    AREA_STAGES,
    CONTACT_STAGES,
    celegans_contact_areas,
    celegans_contacts,
)
from morphosim.importers.lineage.table import read_lineage
from morphosim.importers.lineage.tree import DivisionGroup, Lineage, LineageCell, Split

__all__ = [
    "AREA_STAGES",
    "CONTACT_STAGES",
    "DivisionGroup",
    "Lineage",
    "LineageCell",
    "Split",
    "celegans_contact_areas",
    "celegans_contacts",
    "read_lineage",
]
