"""What a writer may ask of a simulation."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.engine.accuracy import Errors
from morphosim.measure.measurement import Measurement
from morphosim.physics.parameters import Physics
from morphosim.runs.checkpoint import Checkpoint
from morphosim.runs.identity import Identity
from morphosim.scene.scene import Scene

Floats = NDArray[np.float64]


class Observed(Protocol):
    """A simulation, as a writer sees it; arrays have a row for each of the N living cells."""

    @property
    def scene(self) -> Scene:
        """What is simulated."""

    @property
    def physics(self) -> Physics:
        """The physics that hold now."""

    @property
    def time(self) -> float:
        """*In silico* time."""

    @property
    def steps(self) -> int:
        """Steps taken."""

    @property
    def ticks(self) -> int:
        """Ticks passed: what *in silico* time is counted in, see `Numerics.tick`."""

    @property
    def S(self) -> float:
        """The stabilisation at work."""

    @property
    def whole(self) -> bool:
        """Whether all cells are at the same step; false if a step has been broken off."""

    @property
    def stage(self) -> str:
        """Name of the present stage."""

    @property
    def events(self) -> Sequence[tuple[float, str]]:
        """Time and text of what has changed the simulation between steps."""

    @property
    def error(self) -> str:
        """Why the simulation cannot go on; "" while it can."""

    @property
    def stopped(self) -> str:
        """Why the run ends before its end; "" if nobody has stopped it."""

    @property
    def identity(self) -> Identity:
        """Which run it is."""

    @property
    def finished(self) -> bool:
        """Whether the scene's duration, or the last of its stages, is over."""

    @property
    def threads(self) -> int:
        """Number of threads."""

    @property
    def names(self) -> Sequence[str]:
        """Names."""

    @property
    def types(self) -> Sequence[str]:
        """Cell types."""

    @property
    def parents(self) -> Sequence[str]:
        """Names of the mothers; "" where they are not known."""

    @property
    def fields(self) -> Sequence[CellField]:
        """Fields, valid until the next step."""

    @property
    def volumes(self) -> Floats:
        """∫ φ, µm³."""

    @property
    def targets(self) -> Floats:
        """Target volumes V(t), µm³."""

    @property
    def core_volumes(self) -> Floats:
        """Volume of the lattice points with φ > 1/2, µm³."""

    @property
    def centroids(self) -> Floats:
        """(N, 3) centroids, µm."""

    @property
    def face_peak(self) -> Floats:
        """Certificate: largest |φ| so far at the faces of each box, or the edge of the band."""

    @property
    def lost_volume(self) -> Floats:
        """Certificate: ∫ φ that boxes and bands have cut off so far, µm³."""

    @property
    def errors(self) -> Errors:
        """How far the run may be off by now."""

    def column(self, name: str) -> NDArray[Any]:
        """(N, …) values of a column of the cell table, such as the state of a force term."""

    def measured(self) -> Measurement:
        """Shapes and contacts of all cells, measured on the simulation's threads."""

    def checkpoint(self, *, lasting: bool) -> Checkpoint:
        """The whole present state, from which a run goes on bit for bit.

        Unless it is to be `lasting`, it is valid until the next step.
        """
