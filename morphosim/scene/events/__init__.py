"""Events and rules: what changes a simulation between two steps.

An event is any object with `apply(simulation)`; a rule is an event that a stage applies again and
again. Those here act through `Simulation.divide`, `remove`, `change_cells` and `change_physics`, as
events of your own do; those of tissues that live through `grow`, `divide_cells` and `die`, and look
at all cells at once. Another one is a file here and a row of `EVENTS`; scene files, errors and
fingerprints know it by that.
"""

from morphosim.scene.events.apoptosis import Apoptosis
from morphosim.scene.events.changes import CellChange, PhysicsChange
from morphosim.scene.events.differentiation import Differentiation
from morphosim.scene.events.division import Division
from morphosim.scene.events.growth import Growth
from morphosim.scene.events.proliferation import Proliferation
from morphosim.scene.events.protocol import Event
from morphosim.scene.events.removal import Removal

EVENTS: dict[str, type] = {
    "division": Division,
    "removal": Removal,
    "differentiation": Differentiation,
    "cells": CellChange,
    "physics": PhysicsChange,
    "growth": Growth,
    "proliferation": Proliferation,
    "apoptosis": Apoptosis,
}
"""Classes by the `kind` that a scene file names them by."""

__all__ = [
    "EVENTS",
    "Apoptosis",
    "CellChange",
    "Differentiation",
    "Division",
    "Event",
    "Growth",
    "PhysicsChange",
    "Proliferation",
    "Removal",
]
