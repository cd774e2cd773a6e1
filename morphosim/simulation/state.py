"""What a simulation is at the present time: its cells, their fields and figures."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_field import CellField
from morphosim.engine.accuracy import Errors
from morphosim.measure.measurement import Measurement
from morphosim.scene.scene import Scene
from morphosim.simulation.living import LivingCells
from morphosim.simulation.rules import Rules


class State(Rules):
    """Facts of the present time; a part of `Simulation`. Arrays have a row for each living cell.

    Attributes
    ----------
    scene : Scene
    """

    scene: Scene

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.engine.steps

    @property
    def ticks(self) -> int:
        """Ticks passed: what *in silico* time is counted in, see `Numerics.tick`."""
        return self.engine.ticks

    @property
    def whole(self) -> bool:
        """Whether all cells are at the same step; false if a step has been broken off."""
        return self.engine.whole

    @property
    def dt(self) -> float:
        """Time step δt, *in silico* time."""
        return self.scene.numerics.dt

    @property
    def tick(self) -> float:
        """*In silico* time of a tick."""
        return self.scene.numerics.tick

    @property
    def S(self) -> float:
        """The stabilisation at work, at a step δt: that of the numerics, or what is chosen."""
        return self.engine.S

    @property
    def spacing(self) -> float:
        """Lattice spacing, µm."""
        return self.scene.numerics.spacing

    @property
    def threads(self) -> int:
        """Number of threads."""
        return self.engine.workers

    @property
    def cells(self) -> LivingCells:
        """The cells that are alive."""
        return LivingCells(self.engine.everyone, self._volumes, self._target)

    @property
    def names(self) -> list[str]:
        """Names of the cells that are alive."""
        return self.engine.everyone.names

    @property
    def types(self) -> list[str]:
        """Types of the cells that are alive."""
        return self.engine.everyone.types

    @property
    def parents(self) -> list[str]:
        """Names of their mothers; "" where they are not known."""
        return list(self.engine.everyone["parent"].tolist())

    @property
    def volumes(self) -> NDArray[np.float64]:
        """∫ φ of each cell, µm³."""
        return self.engine.volumes

    @property
    def core_volumes(self) -> NDArray[np.float64]:
        """Volume where φ exceeds 1/2, of each cell, µm³."""
        return self.engine.core_volumes

    @property
    def targets(self) -> NDArray[np.float64]:
        """Target volumes V(t), µm³."""
        return self._targets()

    @property
    def pressures(self) -> NDArray[np.float64]:
        """(N,) pressures p = 1 - v/V: what the relative volume constraint (Eq. 10) has, over M'."""
        return np.asarray(1 - self.volumes / self.targets)

    @property
    def face_peak(self) -> NDArray[np.float64]:
        """Certificate: largest |φ| so far at the faces of each cell's box, or edge of its band."""
        return self.engine.face_peak

    @property
    def lost_volume(self) -> NDArray[np.float64]:
        """Certificate: ∫ φ that boxes and bands have cut off each cell since the start, µm³."""
        return self.engine.lost_volume

    @property
    def fields(self) -> Sequence[CellField]:
        """The cells' fields, each made when it is asked for; valid until the next step."""
        return self.engine.fields

    @property
    def centroids(self) -> NDArray[np.float64]:
        """(N, 3) centroids ∫ r φ / ∫ φ, µm."""
        return self.engine.centroids

    @property
    def errors(self) -> Errors:
        """How far the run may be off by now, in time and in space, and the certificate of boxes."""
        return Errors.of(self.column, self.scene.numerics, self.time)

    def column(self, name: str) -> NDArray[Any]:
        """(N, …) values of a column of the cell table, such as the state of a force term."""
        return self.engine.column(name)

    def field(self, cell: str) -> CellField:
        """Field of one cell, valid until the next step."""
        return self.engine.field(self._row(cell))

    def measured(self) -> Measurement:
        """Shapes and contacts of all cells, measured on the simulation's threads."""
        return self.engine.measured()
