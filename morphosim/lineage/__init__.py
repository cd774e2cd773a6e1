"""Lineages: who divides when, along which axis and into which volumes."""

from morphosim.lineage.contacts import CONTACT_STAGES, contact_areas, contacts
from morphosim.lineage.table import read_lineage
from morphosim.lineage.tree import DivisionGroup, Lineage, LineageCell, Split

__all__ = [
    "CONTACT_STAGES",
    "DivisionGroup",
    "Lineage",
    "LineageCell",
    "Split",
    "contact_areas",
    "contacts",
    "read_lineage",
]
