"""What is measured of all cells at once: volumes, shapes, surfaces and contacts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.kernels.moments import N_MOMENTS, Fields, moments
from morphosim.kernels.surfaces import surfaces
from morphosim.measure.contacts import (
    SURFACE_LEVEL,
    Prepared,
    pack,
    pair_areas,
    prepare,
    shared_out,
)
from morphosim.measure.surfaces import SURFACE

Real = NDArray[np.float64]
MATRIX = np.array([[8, 11, 12], [11, 9, 13], [12, 13, 10]])
"""Places of the second moments among the moments of the kernel."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """Measures of N cells and of the P pairs of them that are in contact.

    The semi-axes and principal axes are those of the ellipsoid with the same second moments as the
    region where φ exceeds 1/2, its edge smoothed from 3/8 to 5/8. A cell whose φ is nowhere above
    1/2 has surface and enclosed volume 0 and NaN for what is a ratio of these; one nowhere above
    3/8 has NaN for its axes, one without volume for its centroid.

    Attributes
    ----------
    volume : (N,) float64
        ∫ φ, µm³.
    centroid : (N, 3) float64
        ∫ r φ / ∫ φ, µm.
    semi_axes : (N, 3) float64
        From the longest to the shortest, µm.
    principal_axes : (N, 3, 3) float64
        Their directions as rows, of length 1; the largest component of each is positive.
    surface_area : (N,) float64
        Area of the surface φ = 1/2, µm².
    enclosed_volume : (N,) float64
        Volume V inside this surface, µm³.
    sphericity : (N,) float64
        π^(1/3) (6 V)^(2/3) / area: 1 for a ball, less for all else.
    irregularity : (N,) float64
        area^(1/2) / V^(1/3), η of Fig. S4: 2.20 for a ball, more for all else.
    exposed_fraction : (N,) float64
        Share of the surface on which contacts are measured that touches no other cell.
    contacts : (P, 2) int64
        Pairs i < j, sorted.
    contact_area : (P,) float64
        Their contact areas, µm²; see `contacts`.
    """

    volume: Real
    centroid: Real
    semi_axes: Real
    principal_axes: Real
    surface_area: Real
    enclosed_volume: Real
    sphericity: Real
    irregularity: Real
    exposed_fraction: Real
    contacts: NDArray[np.int64]
    contact_area: Real


def measure(
    phi: NDArray[np.floating],
    origin: NDArray[np.int64],
    shape: NDArray[np.int64],
    start: NDArray[np.int64],
    spacing: float,
) -> Measurement:
    """Measure all cells, on as many threads as Numba is set to use.

    Parameters
    ----------
    phi : 1-D array
        Pool of all fields, float32 or float64.
    origin, shape : (N, 3)
        Lattice position of each box's first point, and its points per axis.
    start : (N,)
        First index of each box in the pool; z runs fastest.
    spacing : float
        Lattice step, µm.

    Raises
    ------
    ValueError
        `spacing` is not positive.
    """
    _validate.number("spacing", spacing, above=0)
    prepared = prepare(phi, origin, shape, start)
    found = _moments(prepared.bounds, prepared.fields)
    volume, centroid = found[:, 0] * spacing**3, _centroids(prepared.fields, found, spacing)
    semi_axes, principal_axes = _ellipsoids(found, spacing)
    area, enclosed = _surfaces(prepared, SURFACE, spacing)
    with np.errstate(invalid="ignore"):
        sphericity = np.pi ** (1 / 3) * (6 * enclosed) ** (2 / 3) / area
        irregularity = np.sqrt(area) / np.cbrt(enclosed)
    pairs, contact_area, touched = pair_areas(prepared, spacing)
    whole, _ = _surfaces(prepared, SURFACE_LEVEL, spacing)
    with np.errstate(invalid="ignore"):
        exposed = np.maximum(1 - touched / whole, 0)
    return Measurement(
        volume, centroid, semi_axes, principal_axes, area, enclosed, sphericity, irregularity,
        exposed, pairs, contact_area,
    )  # fmt: skip


def centroids(
    phi: NDArray[np.floating],
    origin: NDArray[np.int64],
    shape: NDArray[np.int64],
    start: NDArray[np.int64],
    spacing: float,
) -> Real:
    """Centroids alone, (N, 3) µm; parameters as for `measure`."""
    fields = Fields(phi, origin, shape, start, np.zeros((len(start), 3, 2), np.int64))
    return _centroids(fields, _moments(shared_out(shape), fields), spacing)


def measure_fields(fields: Sequence[CellField], spacing: float) -> Measurement:
    """Measure fields, for instance those that a run has kept; see `measure`."""
    return measure(*pack(fields), spacing)


def _surfaces(prepared: Prepared, level: float, spacing: float) -> tuple[Real, Real]:
    """Surface areas and enclosed volumes of φ = `level`."""
    found = np.zeros((len(prepared.fields.start), 2))
    surfaces(prepared.bounds, prepared.fields, level, prepared.work, found)
    return found[:, 0] * spacing**2, found[:, 1] * spacing**3


def _moments(bounds: NDArray[np.int64], fields: Fields) -> Real:
    found = np.zeros((len(fields.start), N_MOMENTS))
    moments(bounds, fields, found)
    return found


def _centroids(fields: Fields, found: Real, spacing: float) -> Real:
    return np.asarray((fields.origin + _mean(found[:, :4])) * spacing)


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
