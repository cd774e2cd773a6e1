"""Two series measured in turn, and two sets of fields: how they compare."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Box = tuple[NDArray[np.int64], NDArray]
"""Lattice origin and field of a cell."""


def paired_ratios(before: Sequence[float], after: Sequence[float]) -> dict[str, float]:
    """Median and quartiles of after / before, pair by pair, and the medians of both.

    What slows the machine for longer than a pair takes slows both of it and leaves the ratio.
    """
    first, second = np.array(before, float), np.array(after, float)
    if first.shape != second.shape or first.size == 0:
        message = f"{first.size} and {second.size} measurements; expected as many pairs, at least 1"
        raise ValueError(message)
    low, middle, high = np.percentile(second / first, [25, 50, 75])
    return {
        "before": float(np.median(first)), "after": float(np.median(second)),
        "ratio": float(middle), "low": float(low), "high": float(high),
    }  # fmt: skip


def largest_difference(before: Mapping[str, Box], after: Mapping[str, Box]) -> float:
    """Largest |Δφ| between the fields of the same cells; a field is 0 outside of its box."""
    if before.keys() != after.keys():
        only = sorted(before.keys() ^ after.keys())
        message = f"cells {', '.join(only)} are in one set of fields only; expected the same cells"
        raise ValueError(message)
    differences = [_difference(before[name], after[name]) for name in before]
    return float(np.max(differences, initial=0.0))


def _difference(one: Box, other: Box) -> float:
    low = np.minimum(one[0], other[0])
    shape = np.maximum(*(origin + phi.shape for origin, phi in (one, other))) - low
    change = np.zeros(shape)
    for (origin, phi), sign in ((one, 1), (other, -1)):
        first = origin - low
        place = tuple(slice(a, a + n) for a, n in zip(first, phi.shape, strict=True))
        change[place] += sign * phi.astype(float)
    return float(np.abs(change).max())
