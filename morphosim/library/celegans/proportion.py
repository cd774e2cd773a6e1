"""Whether areas are in proportion to those of an experiment: a line through the origin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Proportion:
    """The line through the origin that fits areas best, by least squares.

    Attributes
    ----------
    slope : float
        Area per area of the experiment.
    correlation : float
        Pearson's; nan where it is not defined.
    off : mapping of names to numbers
        Distance of each area from the line, relative to the line; of all areas, also those that the
        line is not fitted to.
    """

    slope: float
    correlation: float
    off: Mapping[str, float]


def proportion(
    found: Mapping[str, float], wanted: Mapping[str, float], fitted: Sequence[str] | None = None
) -> Proportion:
    """Compare areas with those of an experiment (`wanted`); the line is of those in `fitted`."""
    names = list(wanted if fitted is None else fitted)
    x, y = (np.array([areas[name] for name in names]) for areas in (wanted, found))
    slope = float(x @ y / (x @ x))
    defined = len(names) > 1 and np.ptp(x) > 0 and np.ptp(y) > 0
    return Proportion(
        slope=slope,
        correlation=float(np.corrcoef(x, y)[0, 1]) if defined else np.nan,
        off={n: found[n] / (slope * wanted[n]) - 1 if slope else np.nan for n in wanted},
    )
