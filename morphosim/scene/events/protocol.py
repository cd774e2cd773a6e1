"""What an event is: what changes a simulation between two steps."""

from typing import Protocol

from morphosim.scene.target import Target


class Event(Protocol):
    """Something that happens between two steps.

    Where it has `makes`, these are cell types that it may bring about; attraction and motility by
    type may name them. Where it has `daughters`, these are names of cells that it may bring about;
    attraction by pair may name them.
    """

    def apply(self, simulation: Target) -> None:
        """Change the simulation."""
