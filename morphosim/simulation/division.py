"""Division: a plane cuts the field of a cell in two, within the mother's box."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.cell_field import CellField, centroid
from morphosim.geometry.phase_field import check_resolved, profile

Floats = NDArray[np.float64]
ACCURACY = 1e-9
"""The plane lies within this many µm of where the daughters have their exact share."""
SATURATED = 20.0
"""tanh is 1 to double precision from here on."""


def divided(
    field: CellField,
    spacing: float,
    axis: ArrayLike,
    fraction: float,
    names: Sequence[str],
    scale: float,
) -> tuple[CellField, CellField]:
    """Two daughters, φ (1 ± tanh(scale · d)) / 2 of their mother's field φ.

    d is the distance to the plane normal to the axis at which the first daughter has its share.
    At every point the daughters' sum is φ, to one rounding of its type.

    Parameters
    ----------
    field : CellField
        The mother. It is left as it is.
    spacing : float
        Lattice spacing h, µm.
    axis : (3,)
        Direction from daughter 2 to daughter 1, of any length but 0.
    fraction : float
        Share of daughter 1 in the mother's volume, V1 / (V1 + V2) with V = ∫ φ.
    names : two names, of daughter 1 and of daughter 2
    scale : float
        √(c/2) in 1/µm, `Physics.interface_scale`: new surfaces have the equilibrium profile.

    Returns
    -------
    first, second : CellField
        With the mother's origin, shape of box and type of numbers.

    Raises
    ------
    ValueError
        The axis has no direction, the fraction is not between 0 and 1, the names are not two
        different ones, the mother is below 1/2 everywhere, or a daughter would be too small for
        the lattice: above 1/2 at fewer than `phase_field.LEAST_POINTS` points.

    Examples
    --------
    >>> import numpy as np
    >>> mother = CellField("P0", np.zeros(3, int), np.ones((20, 10, 10)))
    >>> first, second = divided(mother, 0.5, (-1, 0, 0), 0.75, ("AB", "P1"), 1.0)
    >>> first.name, round(float(first.phi.sum()))
    ('AB', 1500)
    """
    where = f"division of cell {field.name!r}"
    direction = direction_of(where, axis)
    _validate.number(f"{where}: spacing", spacing, above=0)
    _validate.number(f"{where}: scale", scale, above=0)
    checked_fraction(where, fraction)
    _check_names(where, names)
    phi = np.asarray(field.phi)
    if not (phi > 0.5).any():
        message = f"{where}: its field is below 0.5 everywhere; there is no cell to divide"
        raise ValueError(message)
    height = _height(field, spacing, direction)
    depth = height - _plane(phi, height, fraction, scale)
    part = (phi * profile(depth, scale)).astype(phi.dtype)
    first = CellField(names[0], field.origin.copy(), part)
    second = CellField(names[1], field.origin.copy(), phi - part)
    for daughter in (first, second):
        check_resolved(
            daughter.phi, spacing, f"{where}: the field of daughter {daughter.name!r}",
            "take a fraction nearer to 1/2, a finer spacing, or divide a larger cell",
        )  # fmt: skip
    return first, second


def checked_fraction(where: str, fraction: float) -> float:
    """The fraction, which is between 0 and 1."""
    value = _validate.number(f"{where}: fraction", fraction, above=0)
    if value >= 1:
        message = f"{where}: fraction = {fraction!r} is not allowed: it must be < 1"
        raise ValueError(message)
    return value


def direction_of(where: str, axis: ArrayLike) -> Floats:
    """The axis at length 1."""
    vector = _validate.vector(f"{where}: axis", axis)
    length = np.linalg.norm(vector)
    if length == 0:
        message = f"{where}: axis = {vector.tolist()} has no direction; give one that is not zero"
        raise ValueError(message)
    return np.asarray(vector / length)


def _check_names(where: str, names: Sequence[str]) -> None:
    """Raise unless there are two names that differ."""
    if isinstance(names, str) or len(names) != 2 or not all(names):
        message = f"{where}: names = {names!r}; expected the names of two daughters"
        raise ValueError(message)
    for name in names:
        _validate.text(f"{where}: name of a daughter", name)
    _validate.unique(f"{where}: name", names)


def _height(field: CellField, spacing: float, direction: Floats) -> Floats:
    """Distance of each point from the plane through the centroid, positive along the axis, µm."""
    start = field.origin * spacing - centroid(field, spacing)
    x, y, z = (
        (a + spacing * np.arange(n)) * u
        for a, n, u in zip(start, np.shape(field.phi), direction, strict=True)
    )
    return np.asarray(x[:, None, None] + y[None, :, None] + z[None, None, :])


def _plane(phi: NDArray[np.floating], height: Floats, fraction: float, scale: float) -> float:
    """Height, µm, of the plane above which `fraction` of ∫ φ lies."""
    from scipy.optimize import brentq

    present = phi != 0
    weight, height = phi[present].astype(np.float64), height[present]
    whole = weight.sum()

    def excess(plane: float) -> float:
        # no dot product: its sum depends on the number of threads
        return float((weight * profile(height - plane, scale)).sum() / whole - fraction)

    beyond = SATURATED / scale
    return float(brentq(excess, height.min() - beyond, height.max() + beyond, xtol=ACCURACY))
