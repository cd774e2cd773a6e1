"""What rules of living tissues share: their state per cell, who they act on, and chance."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.cell_table import Column
from morphosim.scene.target import Foreseen, Target

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def one_more(mothers: NDArray) -> NDArray:
    """Generation of two daughters of each of these mothers."""
    return np.repeat(mothers + 1, 2, axis=0)


GENERATION = Column("generation", np.int64, inherits=one_more, shared=True)
BORN = Column("born", inherits=False, shared=True)
DYING = Column("dying", bool, inherits=False, shared=True)
COURSE = (
    Column("grown_from", default=np.nan, shared=True),
    Column("grown_since", shared=True),
    Column("grown_until", default=np.inf, inherits=False, shared=True),
    Column("growth_rate", shared=True),
    Column("growth_slope", shared=True),
)
"""Course of the target volume: V(t) = `grown_from` exp(`growth_rate` s) + `growth_slope` s, with s
the time since `grown_since`, which ends at `grown_until`. Without a course `grown_from` is NaN.
`born` is the *in silico* time of birth; cells of the start are of generation 0 and born at 0."""


def check_types(where: str, types: Any) -> tuple[str, ...]:
    """Types that a rule acts on; () is all."""
    return _validate.labels(f"{where}: types", types, empty=True)


def check_conditions(where: str, rate: Any, age: Any, spread: Any, when: Any) -> None:
    """Raise ValueError or TypeError unless `picked` can take these values."""
    for name, value in (("rate", rate), ("age", age)):
        if value is not None:
            _validate.number(f"{where}: {name}", value, above=0)
    _validate.number(f"{where}: spread", spread, least=0, most=1)
    if when is not None:
        _validate.function(f"{where}: when", when, 1)


def rehearse_types(where: str, types: Sequence[str], rehearsal: Foreseen) -> None:
    """Raise ValueError if no cell can ever have one of these types."""
    for kind in types:
        rehearsal.check_type(f"{where}: types", kind)


def spread_out(mean: float, spread: float, normals: Floats) -> Floats:
    """Lognormal values (N,) of this mean, whose standard deviation is `spread` times that.

    Parameters
    ----------
    normals : (N,) standard normal numbers
    """
    variance = np.log1p(spread**2)
    return np.asarray(mean * np.exp(np.sqrt(variance) * normals - variance / 2))


def uniform(normals: Floats) -> Floats:
    """Numbers (N,) between 0 and 1, all alike likely, of standard normal ones (N, 2 or more)."""
    return np.asarray(np.exp(-(normals[:, 0] ** 2 + normals[:, 1] ** 2) / 2))


def picked(
    simulation: Target,
    purpose: str,
    ready: Mask,
    *,
    rate: float | None,
    age: float | None,
    spread: float,
    when: Callable[[Any], ArrayLike] | None,
) -> Mask:
    """Which of the cells that are `ready` meet all conditions that are given.

    Parameters
    ----------
    simulation : Target
    purpose : what it is for: other purposes draw other numbers
    ready : (N,) bool
    rate : chance per unit of time
    age : at least this old, each cell as old as its own share of chance says
    spread : standard deviation of that age, in its mean
    when : function of the simulation that gives (N,) bool
    """
    found = ready.copy()
    if age is not None:
        due = spread_out(age, spread, simulation.chance(f"{purpose}: age")[:, 0])
        found &= simulation.time - simulation.column("born") >= due * (1 - 1e-12)
    if when is not None:
        found &= flags(f"{purpose}: when", when(simulation), len(found))
    if rate is not None:
        drawn = uniform(simulation.chance(f"{purpose}: rate", again=True))
        exposed = np.minimum(simulation.since_rules, simulation.time - simulation.column("born"))
        found &= drawn < -np.expm1(-rate * exposed)
    return found


def flags(where: str, given: Any, count: int) -> Mask:
    """What a user's function says of each cell, (count,) bool; raise if it says something else."""
    values = np.asarray(given)
    if values.dtype != bool or values.shape != (count,):
        message = (
            f"{where} gave {_validate.brief(given, 60)}; expected an array of {count} times true "
            "or false, one for each cell"
        )
        raise ValueError(message)
    return values
