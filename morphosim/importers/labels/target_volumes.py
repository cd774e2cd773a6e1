"""Target volumes with which cells keep the size that was measured.

The volume constraint holds ∫ φ, not what the surface φ = 1/2 encloses, and it holds it only
against the pressure p on the cell: p = M' (1 - v/V) of Eq. 10, or M (V - v) of Eq. 2. Of a free
ball both are known. The tails of its interface hold π² / (2 c R²) of its volume more outside of
the surface than is missing within, and p = 2γ/R: with M' = 8 a ball of 5 µm has 10 % and 1.3 %.
Neighbours and walls cut the tails off and press, by how much depends on all of them: there the
scene is run until its cells have settled, and the targets follow.
"""

import warnings
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from morphosim.errors import SimulationError, warn
from morphosim.geometry.phase_field import ball_integral, radius_of
from morphosim.importers.labels.label_image import SegmentationWarning
from morphosim.measure.surfaces import cell_surface
from morphosim.physics.parameters import Physics
from morphosim.progress import Tell, silent
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene
from morphosim.scene.stability import StabilityWarning
from morphosim.simulation.simulation import Simulation

INTERVAL = 10.0
"""*In silico* time from one correction of the targets to the next; the interfaces settle in it."""
LEAST_ROUNDS, MOST_ROUNDS = 4, 20
CORRECTION = 0.6
"""Share of what is missing, as a power, by which targets are corrected at once: sizes follow the
targets of free cells one to one, and those of cells within walls up to twice as fast."""
SETTLED = 1e-3
"""Sizes are settled where they are off by less than this share."""


def ball_target(volume: float, gamma: float, physics: Physics) -> float:
    """Target at which a free ball of surface tension γ encloses this volume, µm³."""
    integral, strength = ball_integral(volume, physics.interface_scale), physics.volume_strength
    pressure = 2 * gamma / radius_of(volume)
    if physics.volume_constraint == "relative" and strength > 2 * pressure:
        return integral / (1 - pressure / strength)
    if physics.volume_constraint == "absolute" and strength > 0:
        return integral + pressure / strength
    return integral  # nothing, or next to nothing, holds the volume


def settled_targets(scene: Scene, enclosed: Mapping[str, float], tell: Tell = silent) -> Scene:
    """Copy of a scene whose target volumes are those at which cells enclose what is wanted.

    All cells are stepped for this, without the scene's stages.

    Parameters
    ----------
    scene : Scene
    enclosed : volume within the surface φ = 1/2, µm³, by name of the cell
        The targets of other cells stay.
    tell : callable
        Told after each correction how many are done, and how many there are at most.

    Warns
    -----
    SegmentationWarning
        The scene diverges, or a cell vanishes: the targets stay.
    """
    free = [replace(cell, frozen=False) for cell in scene.cells]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StabilityWarning)  # told when the scene is run
            simulation = Simulation(replace(scene, cells=free, stages=(), on_vanish="stop"))
        targets = _settle(simulation, enclosed, tell)
    except SimulationError as error:
        message = f"cells may not keep their sizes: the scene fails while they settle: {error}"
        warn(message, SegmentationWarning)
        return scene
    return replace(scene, cells=[_with_target(cell, targets) for cell in scene.cells])


def _settle(simulation: Simulation, enclosed: Mapping[str, float], tell: Tell) -> dict[str, float]:
    """Run until the cells enclose what is wanted; their targets."""
    numerics, targets = simulation.scene.numerics, simulation.engine.cells["target"]
    wanted = np.array([enclosed.get(name, np.nan) for name in simulation.names])
    for count in range(1, MOST_ROUNDS + 1):
        simulation.step_to(simulation.ticks + numerics.ticks_to(INTERVAL))
        sizes = [cell_surface(field, numerics.spacing).volume for field in simulation.fields]
        ratio = np.where(np.isnan(wanted), 1.0, wanted / np.maximum(sizes, 0.5 * wanted))
        targets *= ratio**CORRECTION
        settled = count >= LEAST_ROUNDS and np.abs(ratio - 1).max() < SETTLED
        tell(MOST_ROUNDS if settled else count, MOST_ROUNDS)
        if settled:
            break
    return {name: float(v) for name, v in zip(simulation.names, targets, strict=True)}


def _with_target(cell: Cell, targets: Mapping[str, float]) -> Cell:
    return replace(cell, volume=targets[cell.name])
