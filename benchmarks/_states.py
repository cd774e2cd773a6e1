"""States of a scene, and how far one is from another."""

import pickle
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from morphosim import Scene, Simulation, contact_areas
from morphosim.cell_field import CellField, centroid
from morphosim.measure.contacts import SURFACE_LEVEL
from morphosim.measure.surfaces import cell_surface

SPLINE = 3
MARGIN = 1.0
"""µm between the start fields and the faces of the full grid."""
CONTACT_AREA = 5.0
"""µm²; a contact map that does not depend on the lattice, as counting voxels would."""


@dataclass(frozen=True)
class State:
    """Fields of all cells at one time, and what is measured of them."""

    time: float
    spacing: float
    fields: list[CellField]
    centroids: np.ndarray
    volumes: np.ndarray
    surfaces: np.ndarray
    contacts: dict[tuple[str, str], float]

    @property
    def touching(self) -> set[tuple[str, str]]:
        """Pairs that meet over more than CONTACT_AREA."""
        return {pair for pair, area in self.contacts.items() if area > CONTACT_AREA}


def state(time: float, spacing: float, fields: Sequence[CellField]) -> State:
    """Measure fields (copies are kept)."""
    kept = [CellField(f.name, f.origin.copy(), f.phi.copy()) for f in fields]
    return State(
        time=time,
        spacing=spacing,
        fields=kept,
        centroids=np.array([centroid(f, spacing) for f in kept]),
        volumes=np.array([f.phi.sum(dtype=np.float64) * spacing**3 for f in kept]),
        surfaces=np.array([cell_surface(f, spacing, SURFACE_LEVEL).area for f in kept]),
        contacts=contact_areas(kept, spacing),
    )


def states(simulation: Simulation, times: Sequence[float]) -> list[State]:
    """Run a simulation and measure it at these times."""
    result = []
    for time in times:
        simulation.run(until=time)
        result.append(state(simulation.time, simulation.scene.numerics.spacing, simulation.fields))
    return result


def full_grid_states(
    scene: Scene, times: Sequence[float], spacing: float, dt: float
) -> list[State]:
    """The paper's scheme on one full grid with Fourier derivatives, for scenes in open space."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from tests.reference import full_grid as fg

    start = Simulation(scene.with_numerics(spacing=spacing, box_tolerance=1e-5, precision="double"))
    pad = round(MARGIN / spacing)
    low = np.min([f.origin for f in start.fields], axis=0) - pad
    high = np.max([f.origin + f.phi.shape for f in start.fields], axis=0) + pad
    phi = np.zeros((len(start.cells), *(high - low)))
    for k, f in enumerate(start.fields):
        first = f.origin - low
        phi[(k, *map(slice, first, first + f.phi.shape))] = f.phi
    sigma = scene.physics.attraction.matrix(scene.names, scene.types, scene.parents)
    model = fg.Model(h=spacing, sigma=sigma if len(phi) > 1 else None, targets=start.targets)
    wanted = {round(time / dt): time for time in times}
    result = []

    def keep(step: int, fields: np.ndarray) -> None:
        if step in wanted:
            boxes = [CellField(n, low, f) for n, f in zip(scene.names, fields, strict=True)]
            result.append(state(wanted[step], spacing, boxes))

    fg.run(phi, model, dt, n_steps=max(wanted), on_step=keep)
    return result


def fields_of(simulation: Simulation) -> list[CellField]:
    """Copies of the fields, which last beyond the next step."""
    return [CellField(f.name, f.origin.copy(), f.phi.copy()) for f in simulation.fields]


def difference(first: Sequence[CellField], second: Sequence[CellField]) -> float:
    """Σ ∫ |Δφ| over the cells of two states on one lattice, in lattice points."""
    total = 0.0
    for one, other in zip(first, second, strict=True):
        low = np.minimum(one.origin, other.origin)
        high = np.maximum(one.origin + one.phi.shape, other.origin + other.phi.shape)
        whole = np.zeros(high - low)
        for sign, field in ((1, one), (-1, other)):
            place = zip(field.origin - low, field.phi.shape, strict=True)
            whole[tuple(slice(o, o + n) for o, n in place)] += sign * field.phi
        total += float(np.abs(whole).sum())
    return total


def errors(found: State, converged: State) -> dict[str, float]:
    """Distances between two states of the same cells at the same time."""
    shift = np.linalg.norm(found.centroids - converged.centroids, axis=1)
    pairs = found.contacts.keys() | converged.contacts.keys()
    areas = [abs(found.contacts.get(p, 0.0) - converged.contacts.get(p, 0.0)) for p in pairs]
    peak, share = _field_differences(found, converged)
    return {
        "centroid_rms_nm": 1e3 * float(np.sqrt((shift**2).mean())),
        "centroid_max_nm": 1e3 * float(shift.max()),
        "volume_max": float(np.abs(found.volumes / converged.volumes - 1).max()),
        "surface_max": float(np.abs(found.surfaces / converged.surfaces - 1).max()),
        "contact_max_um2": max(areas, default=0.0),
        "field_max": peak,
        "field_share": share,
        "contacts_equal": float(found.touching == converged.touching),
    }


def _field_differences(found: State, converged: State) -> tuple[float, float]:
    """Largest |Δφ|, and largest ∫ |Δφ| / V of any cell; the converged field is interpolated."""
    peaks, shares = [], []
    for mine, true, volume in zip(found.fields, converged.fields, converged.volumes, strict=True):
        axes = [np.arange(n) + o for n, o in zip(mine.phi.shape, mine.origin, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij")) * (found.spacing / converged.spacing)
        filtered = spline_filter(true.phi.astype(np.float64), order=SPLINE, mode="mirror")
        expected = map_coordinates(
            filtered, points - true.origin.reshape(3, 1, 1, 1),
            order=SPLINE, prefilter=False, mode="constant", cval=0.0,
        )  # fmt: skip
        difference = np.abs(mine.phi - expected)
        peaks.append(difference.max())
        shares.append(difference.sum() * found.spacing**3 / volume)
    return float(max(peaks)), float(max(shares))


def cached(path: Path, make: Callable[[], Any]) -> Any:
    """What `make` gives, kept in a file of our own from one run to the next."""
    if not path.exists():
        result = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(pickle.dumps(result))
    return pickle.loads(path.read_bytes())
