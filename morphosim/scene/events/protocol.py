"""What an event is: what changes a simulation between two steps."""

from typing import Protocol

from morphosim.scene.target import Target


class Event(Protocol):
    """Something that happens between two steps.

    Where it has `columns`, these are state that it keeps per cell (`Column`, known to every rank:
    `shared`), which all simulations of the scene have; `Simulation.column` gives their values.
    Where it has `makes`, these are cell types that it may bring about; attraction and motility by
    type may name them. Where it has `daughters`, these are names of cells that it may bring about;
    attraction by pair may name them.

    Where it has `rehearse(rehearsal)`, this is called before the first step, and does to what is
    foreseen (`rehearsal.Rehearsal`) what `apply` will do to the simulation: divide, remove, change
    cells or physics. What is not allowed is told then, here and in all later stages. After an event
    without it less is known: any name of a cell may be right.
    """

    def apply(self, simulation: Target) -> None:
        """Change the simulation."""
