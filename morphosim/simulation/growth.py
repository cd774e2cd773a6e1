"""Target volumes that follow rules: courses in columns of the cell table, filled in as vectors.

V(t) = `grown_from` exp(`growth_rate` s) + `growth_slope` s, with s = min(t, `grown_until`) -
`grown_since`; see `scene.events.living`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.cell_table import CellTable

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


def has_courses(cells: CellTable) -> bool:
    """Whether target volumes may follow rules."""
    return "grown_from" in cells


def fill(targets: Floats, cells: CellTable, time: float) -> None:
    """Set those of the target volumes (N,) of all cells that follow a course.

    Raises
    ------
    ValueError
        A cell has grown beyond all numbers.
    """
    if not has_courses(cells):
        return
    rows = np.flatnonzero(~np.isnan(cells["grown_from"]))
    with np.errstate(over="ignore"):
        targets[rows] = found = volumes_at(cells, rows, time)
    if not (found < _validate.LARGEST).all():
        name = cells["name"][rows[int(np.argmax(found))]]
        message = (
            f"cell {name!r}: volume at t = {time:g} is {found.max():.3g} µm³ by its growth; take a "
            "smaller rate, a limit, or a rule by which it divides"
        )
        raise ValueError(message)


def volumes_at(cells: CellTable, rows: Rows, time: float) -> Floats:
    """V(t) of cells that follow a course, µm³."""
    lapse = np.minimum(time, cells["grown_until"][rows]) - cells["grown_since"][rows]
    grown = cells["grown_from"][rows] * np.exp(cells["growth_rate"][rows] * lapse)
    return np.asarray(grown + cells["growth_slope"][rows] * lapse)


def last_volumes(cells: CellTable) -> Floats:
    """What the target volumes that come to an end will be then, µm³."""
    if not has_courses(cells):
        return np.zeros(0)
    ends = ~np.isnan(cells["grown_from"]) & np.isfinite(cells["grown_until"])
    return volumes_at(cells, np.flatnonzero(ends), np.inf)


def follow(
    cells: CellTable, rows: Rows, volumes: Floats, time: float, *, rate: ArrayLike = 0.0,
    slope: ArrayLike = 0.0, until: ArrayLike = np.inf,
) -> None:  # fmt: skip
    """Give cells a course from these volumes and this time on."""
    values: Mapping[str, Any] = {
        "grown_from": volumes, "grown_since": time, "grown_until": until, "growth_rate": rate,
        "growth_slope": slope,
    }  # fmt: skip
    for name, value in values.items():
        cells[name][rows] = value


def forget(cells: CellTable, rows: Rows) -> None:
    """Leave the target volumes of cells as they are stated."""
    if has_courses(cells):
        cells["grown_from"][rows] = np.nan


def stop(cells: CellTable, time: float, rows: Rows | None = None) -> None:
    """Let cells, by default all, grow no more; those that die go on."""
    if not has_courses(cells):
        return
    growing = (cells["growth_rate"] != 0) | (cells["growth_slope"] != 0)
    growing &= ~np.isnan(cells["grown_from"]) & ~cells["dying"]
    if rows is not None:
        growing &= np.isin(np.arange(len(cells)), rows)
    which = np.flatnonzero(growing)
    follow(cells, which, volumes_at(cells, which, time), time)


def change(
    cells: CellTable, rows: Rows, targets: Floats, rates: Floats, law: str, limit: float,
    time: float,
) -> None:  # fmt: skip
    """Let target volumes (N,) grow at rates (N,) from now on; who does so already goes on."""
    growing = "growth_rate" if law == "exponential" else "growth_slope"
    other = "growth_slope" if law == "exponential" else "growth_rate"
    wanted = np.where(targets < limit, rates, 0.0)[rows]
    same = (cells[growing][rows] == wanted) & (cells[other][rows] == 0)
    same &= ~np.isnan(cells["grown_from"][rows])
    ends = (wanted > 0) & np.isfinite(limit)  # which daughters that go on so do not know of
    same &= np.isfinite(cells["grown_until"][rows]) == ends
    at_limit = time >= cells["grown_until"][rows]  # and stays there, to the last bit
    chosen = rows[~(same | at_limit)]
    fresh = wanted[~(same | at_limit)]
    until = end_of(law, targets[chosen], fresh, limit, time)
    follow(cells, chosen, targets[chosen], time, until=until)
    cells[growing][chosen] = fresh


def inherited(
    cells: CellTable, rows: Rows, kinds: Sequence[str], targets: Sequence[Any], time: float
) -> dict[str, Any]:
    """Columns of the daughters' courses: they go on at their mother's rate unless of another type.

    Parameters
    ----------
    rows : (n,) of the mothers
    kinds, targets : (2 n,) of the daughters; targets may be functions of time
    """
    if not has_courses(cells):
        return {}
    own = np.repeat([cells.kinds[k] for k in cells["kind"][rows].tolist()], 2)
    alike = own == np.array(kinds)
    stated = np.array([callable(target) for target in targets])
    follows = ~np.repeat(np.isnan(cells["grown_from"][rows]), 2) & ~stated
    volumes = np.array([np.nan if callable(target) else target for target in targets], float)
    return {
        "grown_from": np.where(follows, volumes, np.nan),
        "grown_since": time,
        "growth_rate": np.where(alike, np.repeat(cells["growth_rate"][rows], 2), 0.0),
        "growth_slope": np.where(alike, np.repeat(cells["growth_slope"][rows], 2), 0.0),
    }


def end_of(law: str, volumes: Floats, rates: Floats, limit: float, time: float) -> Floats:
    """When V comes to its limit; infinite where it does not grow or has none."""
    if not np.isfinite(limit):
        return np.full(len(volumes), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.log(limit / volumes) if law == "exponential" else limit - volumes
        return np.where(rates > 0, time + way / rates, np.inf)


def require(cells: CellTable, what: str) -> None:
    """Raise ValueError unless cells have what rules of growth and death keep of them."""
    _validate.choice(
        f"{what}: state of the cells that it needs (from a rule such as Growth or Apoptosis in a "
        "stage of the scene, or an event with its columns)", "grown_from", cells.columns,
    )  # fmt: skip
