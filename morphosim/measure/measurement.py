"""What is measured of all cells at once: volumes, shapes, surfaces and contacts."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.cell_field import CellField
from morphosim.kernels.layout import Boxes, Shares
from morphosim.kernels.moments import N_MOMENTS, Fields, moments
from morphosim.kernels.surfaces import surfaces
from morphosim.measure.contacts import (
    SURFACE_LEVEL,
    Prepared,
    pack,
    pair_areas,
    placed,
    prepare,
    shared_out,
)
from morphosim.measure.surfaces import SURFACE
from morphosim.measure.variable import PER_CELL, measured
from morphosim.period import Period

Real = NDArray[np.float64]
MATRIX = np.array([[8, 11, 12], [11, 9, 13], [12, 13, 10]])
"""Places of the second moments among the moments of the kernel."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """Measures of N cells and of the P pairs of them that are in contact.

    What takes a pass over the fields is measured already, so that they may change; what follows
    from it is computed when it is first asked for.

    The semi-axes and principal axes are those of the ellipsoid with the same second moments as the
    region where φ exceeds 1/2, its edge smoothed from 3/8 to 5/8. A cell whose φ is nowhere above
    1/2 has surface and enclosed volume 0 and NaN for what is a ratio of these; one nowhere above
    3/8 has NaN for its axes, one without volume for its centroid.

    Attributes
    ----------
    spacing : float
        Lattice step, µm.
    origin : (N, 3) int64
        Lattice position of the first point of each box; in periodic space where it would be had it
        not been carried back.
    moments : (N, N_MOMENTS) float64
        Sums of the kernel `moments`, in lattice steps.
    surfaces : (2, N) float64
        Area (µm²) of the surface φ = 1/2 of each cell, and the volume (µm³) inside it.
    contact_surface : (N,) float64
        Area of the surface on which contacts are measured, µm².
    touched : (N,) float64
        That part of it which touches any other cell, µm².
    contacts : (P, 2) int64
        Pairs i < j, sorted.
    contact_area : (P,) float64
        Their contact areas, µm²; see `contacts`.
    """

    spacing: float
    origin: NDArray[np.int64]
    moments: Real
    surfaces: Real
    contact_surface: Real
    touched: Real
    contacts: NDArray[np.int64]
    contact_area: Real

    __repr__ = short_repr

    @cached_property
    def volume(self) -> Real:
        """(N,) ∫ φ, µm³."""
        return np.asarray(self.moments[:, 0] * self.spacing**3)

    @cached_property
    def centroid(self) -> Real:
        """(N, 3) ∫ r φ / ∫ φ, µm."""
        return _centroids(self.origin, self.moments, self.spacing)

    @measured(dims=PER_CELL, units="um3", text="volume enclosed by the surface phi = 1/2")
    def enclosed_volume(self) -> Real:
        """(N,) volume V inside the surface φ = 1/2, µm³."""
        return np.asarray(self.surfaces[1])

    @measured(dims=PER_CELL, units="um2", text="area of the surface phi = 1/2")
    def surface_area(self) -> Real:
        """(N,) area of the surface φ = 1/2, µm²."""
        return np.asarray(self.surfaces[0])

    @measured(
        dims=PER_CELL, units="1",
        text="surface of a ball of the enclosed volume over the surface area",
    )  # fmt: skip
    def sphericity(self) -> Real:
        """(N,) π^(1/3) (6 V)^(2/3) / area: 1 for a ball, less for all else."""
        with np.errstate(invalid="ignore"):
            ball = np.pi ** (1 / 3) * (6 * self.enclosed_volume) ** (2 / 3)
            return np.asarray(ball / self.surface_area)

    @measured(
        dims=PER_CELL, units="1",
        text="surface area^(1/2) / enclosed volume^(1/3) (eta of Fig. S4)",
    )  # fmt: skip
    def irregularity(self) -> Real:
        """(N,) area^(1/2) / V^(1/3), η of Fig. S4: 2.20 for a ball, more for all else."""
        with np.errstate(invalid="ignore"):
            return np.asarray(np.sqrt(self.surface_area) / np.cbrt(self.enclosed_volume))

    @measured(
        dims=PER_CELL, units="1", text="share of the cell's surface that touches no other cell"
    )
    def exposed_fraction(self) -> Real:
        """(N,) share of the surface on which contacts are measured that touches no other cell."""
        with np.errstate(invalid="ignore"):
            return np.maximum(1 - self.touched / self.contact_surface, 0)

    @measured(
        dims=(*PER_CELL, "principal"), units="um",
        text="semi-axes of the ellipsoid of equal second moments",
    )  # fmt: skip
    def semi_axes(self) -> Real:
        """(N, 3) semi-axes from the longest to the shortest, µm."""
        return self._ellipsoids[0]

    @measured(
        dims=(*PER_CELL, "principal", "axis"), units="1", text="unit vectors along the semi-axes"
    )
    def principal_axes(self) -> Real:
        """(N, 3, 3) directions of the semi-axes as rows; the largest component is positive."""
        return self._ellipsoids[1]

    @cached_property
    def _ellipsoids(self) -> tuple[Real, Real]:
        return _ellipsoids(self.moments, self.spacing)


def measure(
    phi: NDArray[np.floating], boxes: Boxes, spacing: float, *, period: Period | None = None,
    path: NDArray[np.int64] | None = None,
) -> Measurement:  # fmt: skip
    """Measure all cells, on as many threads as Numba is set to use.

    Parameters
    ----------
    phi : 1-D array
        Pool of all fields, float32 or float64.
    boxes : Boxes
        Where they lie; what of a row is not in the band is taken to be 0.
    spacing : float
        Lattice step, µm.
    period : Period, optional
        After which space repeats: cells then touch images of others too.
    path : (N, 3) int64, optional
        Origins by which centroids are told, if not those of the boxes.

    Raises
    ------
    ValueError
        `spacing` is not positive.
    """
    _validate.number("spacing", spacing, above=0)
    prepared = prepare(phi, boxes, period)
    pairs, contact_area, touched = pair_areas(prepared, spacing)
    return Measurement(
        spacing=spacing,
        origin=np.array(boxes.origin if path is None else path),  # the pool's own will change
        moments=_moments(prepared.shares, prepared.fields)[: prepared.cells],
        surfaces=_surfaces(prepared, SURFACE, spacing),
        contact_surface=_surfaces(prepared, SURFACE_LEVEL, spacing)[0],
        touched=touched,
        contacts=pairs,
        contact_area=contact_area,
    )


def centroids(
    phi: NDArray[np.floating], boxes: Boxes, spacing: float, path: NDArray[np.int64] | None = None
) -> Real:
    """Centroids alone, (N, 3) µm; parameters as for `measure`."""
    found = _moments(shared_out(boxes.shape), placed(phi, boxes))
    return _centroids(boxes.origin if path is None else path, found, spacing)


def centroids_and_axes(fields: Sequence[CellField], spacing: float) -> tuple[Real, Real]:
    """Centroids (N, 3) in µm, and principal axes (N, 3, 3) as rows, alone; see `Measurement`."""
    phi, boxes = pack(fields)
    found = _moments(shared_out(boxes.shape), placed(phi, boxes))
    return _centroids(boxes.origin, found, spacing), _ellipsoids(found, spacing)[1]


def measure_fields(fields: Sequence[CellField], spacing: float) -> Measurement:
    """Measure fields, for instance those that a run has kept; see `measure`."""
    return measure(*pack(fields), spacing)


def _surfaces(prepared: Prepared, level: float, spacing: float) -> Real:
    """(2, N) areas of the surfaces φ = `level` in µm², and volumes inside them in µm³."""
    found = np.zeros((prepared.cells, 2))
    surfaces(prepared.shares, prepared.fields, level, prepared.work, found)
    return np.stack([found[:, 0] * spacing**2, found[:, 1] * spacing**3])


def _moments(shares: Shares, fields: Fields) -> Real:
    found = np.zeros((len(fields.start), N_MOMENTS))
    moments(shares, fields, found)
    return found


def _centroids(origin: NDArray[np.int64], found: Real, spacing: float) -> Real:
    return np.asarray((origin + _mean(found[:, :4])) * spacing)


def _ellipsoids(found: Real, spacing: float) -> tuple[Real, Real]:
    """Semi-axes and principal axes."""
    centre, points = _mean(found[:, 4:8]), _or_nan(found[:, 4])
    covariance = found[:, MATRIX] / points[:, None, None] - centre[:, :, None] * centre[:, None, :]
    semi_axes, principal_axes = _axes(covariance)
    return semi_axes * spacing, principal_axes


def _mean(sums: Real) -> Real:
    """(N, 3) means of (N, 4) sums of a weight and of it times x, y, z."""
    return np.asarray(sums[:, 1:] / _or_nan(sums[:, 0])[:, None])


def _or_nan(weight: Real) -> Real:
    return np.where(weight > 0, weight, np.nan)


def _axes(covariance: Real) -> tuple[Real, Real]:
    """Semi-axes and directions of the solid ellipsoids of these covariances; NaN gives NaN."""
    known = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    values, vectors = np.linalg.eigh(np.where(known[:, None, None], covariance, 0))
    semi_axes = np.sqrt(5 * np.maximum(values[:, ::-1], 0))
    axes = vectors.swapaxes(1, 2)[:, ::-1]
    largest = np.abs(axes).argmax(axis=2)[:, :, None]
    axes = axes * np.sign(np.take_along_axis(axes, largest, axis=2))
    semi_axes[~known], axes[~known] = np.nan, np.nan
    return semi_axes, axes
