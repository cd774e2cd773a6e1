"""Trials: cells that start as they are seen, run with tensions and attractions that are tried."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from morphosim.cell_field import CellField
from morphosim.geometry.shapes import Field
from morphosim.importers.labels.label_image import LabelImage
from morphosim.inference.observation import (
    Surfaces,
    closed,
    has_gaps,
    label_depth,
    photographed,
    surfaces_of,
)
from morphosim.inference.offsets import Patches, offsets
from morphosim.inference.unknowns import Unknowns
from morphosim.inference.warping import Displacement, moved
from morphosim.scene.scene import Scene
from morphosim.simulation.simulation import Simulation

Floats = NDArray[np.float64]
INTERVAL = 10.0
"""*In silico* time between two corrections of the target volumes."""
CORRECTION = 0.7
"""Share of what is missing by which targets are corrected at once."""
BEYOND = 4.0
"""Start fields reach so far beyond the surface, µm."""
SETTLING = 20.0
"""*In silico* time in which profiles of contacts settle, before fields are moved back."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What one image shows.

    Attributes
    ----------
    time : float, *in silico*
    image : LabelImage
        With labels from 1 to N, gaps of contacts closed.
    gaps : bool
        Whether there were such gaps.
    surfaces : Surfaces
    patches : Patches
    """

    time: float
    image: LabelImage
    gaps: bool
    surfaces: Surfaces
    patches: Patches

    @classmethod
    def of(
        cls, time: float, image: LabelImage, names: Sequence[str], patches: Patches | None = None
    ) -> "Frame":
        """The surfaces of an image, and their patches, if not those of another image."""
        gaps = has_gaps(image)
        image = closed(image) if gaps else image
        surfaces = surfaces_of(image, names)
        patches = Patches.of(surfaces) if patches is None else patches
        return cls(time, image, gaps, surfaces, patches)

    def like(self, fields: Sequence[CellField], spacing: float) -> LabelImage:
        """Image of fields on the same voxels, contacts closed alike."""
        image = photographed(fields, spacing, self.image)
        return closed(image) if self.gaps else image


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Fields whose surfaces lie where an image shows them, with profiles at rest.

    Attributes
    ----------
    fields : of all cells
    targets : (N,) target volumes, µm³
    missed : (K,) µm
        Offset that voxels of this size seem to show of these very fields, by patch.
    missed_volume : (N,) µm³
        The same of volumes.
    """

    fields: list[CellField]
    targets: Floats
    missed: Floats
    missed_volume: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """What all trials share.

    Attributes
    ----------
    scene : Scene
        Cells in the order of the labels; their shapes are not used.
    unknowns : Unknowns
    time : float
        *In silico* time that a single image is run for.
    """

    scene: Scene
    unknowns: Unknowns
    time: float

    @property
    def spacing(self) -> float:
        """Of the lattice, µm."""
        return self.scene.numerics.spacing

    @property
    def holds_volumes(self) -> bool:
        """Whether targets follow from the sizes that are seen; not where M' is asked for."""
        return all(unknown.kind != "M" for unknown in self.unknowns.each)

    def simulation(
        self, fields: Sequence[CellField], targets: Floats, vector: Floats
    ) -> Simulation:
        """Cells that start from fields, with what is tried."""
        gammas, physics = self.unknowns.applied(vector)
        h = self.spacing
        cells = [
            replace(
                cell, shape=Field(phi=f.phi, origin=f.origin * h, spacing=h), volume=float(v),
                gamma=float(g), frozen=False,
            )
            for cell, f, v, g in zip(self.scene.cells, fields, targets, gammas, strict=True)
        ]  # fmt: skip
        return Simulation(replace(self.scene, cells=cells, physics=physics))

    def run(
        self, frame: Frame, start: Start, vector: Floats, time: float, end: Start | None = None
    ) -> tuple[Simulation, Floats]:
        """Run from a start, and tell how far surfaces are then from those of a frame.

        Targets are corrected so that cells keep the sizes that the frame shows; or they go over to
        those of an `end`.
        """
        simulation = self.simulation(start.fields, start.targets, vector)
        targets, numerics = simulation.engine.cells["target"], simulation.scene.numerics
        count = max(round(time / INTERVAL), 1)
        for k in range(1, count + 1):
            if end is not None:
                targets[:] = start.targets + (end.targets - start.targets) * (k - 0.5) / count
            simulation.step_to(numerics.ticks_to(time * k / count))
            if end is None and self.holds_volumes and k < count:
                offset = offsets(frame.surfaces, simulation.fields, self.spacing)
                excess = frame.surfaces.volume_off(offset) - start.missed_volume
                targets -= CORRECTION * excess
        return simulation, offsets(frame.surfaces, simulation.fields, self.spacing)

    def begun(self, frame: Frame, vector: Floats) -> Start:
        """Start from an image alone: profiles are those of free cells, and not yet at rest."""
        scale, h = self.scene.physics.interface_scale, self.spacing
        fields = [
            _field(frame.image, k, cell.name, scale, h) for k, cell in enumerate(self.scene.cells)
        ]
        sizes = [float(f.phi.sum(dtype=np.float64)) * h**3 for f in fields]
        held = sizes if self.holds_volumes else [c.target_volume(0.0) for c in self.scene.cells]
        count = len(fields)
        start = Start(fields, np.array(held), np.zeros(len(frame.patches.area)), np.zeros(count))
        return self.settled(frame, start, vector, corrected=False)

    def settled(
        self, frame: Frame, start: Start, vector: Floats, *, corrected: bool = True
    ) -> Start:
        """Start whose profiles have come to rest, with surfaces moved back to where they are seen.

        Voxels show a flat surface up to half a voxel from where it is. So surfaces are not moved to
        where the image seems to show them, but by what an image of the fields, on the same voxels,
        differs from it (`corrected`).
        """
        simulation, offset = self.run(frame, start, vector, SETTLING)
        fields, back = list(simulation.fields), [Displacement.along(frame.surfaces, offset)]
        if corrected:
            seen, missed = self._photographed(frame, fields)
            back.append(Displacement.along(seen, -missed))
        fields = moved(fields, self.spacing, back)
        seen, missed = self._photographed(frame, fields)
        return Start(
            fields, simulation.engine.cells["target"].copy(), frame.patches.mean(seen, missed),
            seen.volume_off(missed),
        )  # fmt: skip

    def _photographed(self, frame: Frame, fields: list[CellField]) -> tuple[Surfaces, Floats]:
        """Surfaces in an image of fields, and how far the fields' own are from them."""
        seen = surfaces_of(frame.like(fields, self.spacing), frame.surfaces.names)
        return seen, offsets(seen, fields, self.spacing)

    def missed(self, interval: "Interval", vector: Floats) -> Floats:
        """(K,) offsets of patches at the end of an interval, µm, less what voxels make of them."""
        frame = interval.frame
        _, offset = self.over(interval, vector)
        return frame.patches.mean(frame.surfaces, offset) - interval.start.missed

    def over(self, interval: "Interval", vector: Floats) -> tuple[Simulation, Floats]:
        """The run over an interval; of a still image for `time`."""
        if interval.before is None:
            return self.run(interval.frame, interval.start, vector, self.time)
        before, first = interval.before
        lapse = interval.frame.time - before.time
        return self.run(interval.frame, first, vector, lapse, interval.start)


@dataclass(frozen=True, slots=True, eq=False)
class Interval:
    """What one run is compared with: a frame, and the one before, or none of a still image."""

    frame: Frame
    start: Start
    before: tuple[Frame, Start] | None = None


def _field(image: LabelImage, k: int, name: str, scale: float, spacing: float) -> CellField:
    """Field of a label, by the distance from its surface."""
    depth, first = label_depth(image, k + 1, BEYOND)
    depth = depth.astype(np.float32)
    low = np.ceil(first / spacing).astype(np.int64)
    last = first + (np.array(depth.shape) - 1) * image.steps
    high = np.floor(last / spacing).astype(np.int64)
    axes = [
        (np.arange(a, b + 1) * spacing - o) / h
        for a, b, o, h in zip(low, high, first, image.steps, strict=True)
    ]
    places = np.stack(np.meshgrid(*axes, indexing="ij"))
    sampled = map_coordinates(depth, places, order=1)
    return CellField(name, low, (0.5 * (1 + np.tanh(scale * sampled))).astype(np.float32))
