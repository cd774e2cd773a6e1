"""Figures of tissues, from the Dataset of a run: growth, packing, profiles, clones."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.measure.tissue import (
    Region,
    binned,
    pair_correlation,
    periodic_pair_correlation,
    pieces,
    tissue_region,
)
from morphosim.runs.saved_fields import period_lengths, variable
from morphosim.runs.views import contact_places

Real = NDArray[np.float64]
Integers = NDArray[np.int64]

REACH = 5.0
"""Pairs of cells up to so many cells apart count by default."""
MOST_BINS = 10_000
AGAINST = {
    "radius": "distance from the centre of the cell's aggregate",
    "depth": "distance from the free surface of the tissue",
}
"""What profiles are along."""


def growth(run: xr.Dataset) -> xr.Dataset:
    """Growth curve of a run; see `MorphoAccessor.growth`."""
    volumes, targets = (
        variable(run, name, "time", "cell").values for name in ("volume", "target_volume")
    )
    total, times = np.nansum(volumes, axis=1), run["time"].values
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.gradient(np.log(total), times) if len(times) > 1 else np.full(len(times), np.nan)
    return _dataset(
        {"time": run["time"].variable},
        cells=("time", np.isfinite(volumes).sum(axis=1), "1", "number of cells"),
        volume=("time", total, "um3", "volume of all cells, integral of phi"),
        target_volume=(
            "time", np.nansum(np.where(np.isfinite(volumes), targets, 0), axis=1), "um3",
            "target volume of all cells",
        ),
        growth_rate=("time", rate, "1", "growth rate of the volume, per in silico time"),
    )  # fmt: skip


def pair_correlations(
    run: xr.Dataset, saves: Sequence[int], bins: int, furthest: float | None
) -> xr.Dataset:
    """Pair correlation of the centres of cells; see `MorphoAccessor.pair_correlation`."""
    bins = _validate.integer("bins", bins, least=1, most=MOST_BINS)
    if furthest is None:
        volumes = variable(run, "volume", "time", "cell")[saves[-1]].values
        known = volumes[np.isfinite(volumes)]
        furthest = REACH * float(np.cbrt(known.mean())) if known.size else 1.0
    edges = np.linspace(0, _validate.number("furthest", furthest, above=0), bins + 1)
    g, pairs = np.full((len(saves), bins), np.nan), np.zeros((len(saves), bins), np.int64)
    for k, save in enumerate(saves):
        region, cells = _region(run, save)
        if _repeats(run):
            points = variable(run, "centroid", "time", "cell", "axis")[save].values[cells]
            g[k], pairs[k] = periodic_pair_correlation(points, period_lengths(run), edges)
        elif region is not None:
            g[k], pairs[k] = pair_correlation(region, edges)
    return _dataset(
        _along(run, saves) | _middles("distance", edges, "distance of two centres"),
        g=(("time", "distance"), g, "1", "pair correlation of the cells' centres"),
        pairs=(("time", "distance"), pairs, "1", "number of pairs of cells"),
    )


def neighbour_distribution(
    run: xr.Dataset, saves: Sequence[int], inner: bool, least_area: float
) -> xr.Dataset:
    """Distribution of numbers of neighbours; see `MorphoAccessor.neighbour_distribution`."""
    least_area = _validate.number("least_area", least_area, least=0)
    _validate.flag("inner", inner)
    counts = [_neighbour_counts(run, save, inner, least_area) for save in saves]
    most = max((int(count.max(initial=0)) for count in counts), default=0)
    cells = np.stack([np.bincount(count, minlength=most + 1) for count in counts])
    total = np.array([len(count) for count in counts])
    with np.errstate(invalid="ignore"):
        share = cells / total[:, None]
        mean = share @ np.arange(most + 1)
    who = "cells away from the free surface" if inner else "cells"
    number = ("neighbours", np.arange(most + 1), {"units": "1", "long_name": "neighbours"})
    return _dataset(
        _along(run, saves) | {"neighbours": number},
        share=(("time", "neighbours"), share, "1", f"share of the {who}"),
        mean=("time", mean, "1", f"mean number of neighbours of {who}"),
        cells=("time", total, "1", f"number of {who}"),
    )


def profile(
    run: xr.Dataset, saves: Sequence[int], name: str, against: str, bins: int
) -> xr.Dataset:
    """Profile of a variable of cells; see `MorphoAccessor.profile`."""
    bins = _validate.integer("bins", bins, least=1, most=MOST_BINS)
    _validate.choice("against", against, AGAINST)
    numbers = [
        str(each) for each, values in run.variables.items()
        if values.dims == ("time", "cell") and values.dtype.kind in "fiu"
    ]  # fmt: skip
    _validate.choice("variable per time and cell", name, numbers)
    values = [run[name][save].values for save in saves]
    places = [_places(run, save, against) for save in saves]
    furthest = max(np.nanmax(place, initial=0) for place in places)
    edges = np.linspace(0, furthest or 1.0, bins + 1)
    found = [binned(v, p, edges) for v, p in zip(values, places, strict=True)]
    mean, spread, cells = (np.stack(part) for part in zip(*found, strict=True))
    units, text = (run[name].attrs.get(key, "") for key in ("units", "long_name"))
    dims = ("time", against)
    return _dataset(
        _along(run, saves) | _middles(against, edges, AGAINST[against]),
        mean=(dims, mean, units, f"mean of {text or name}"),
        std=(dims, spread, units, f"standard deviation of {text or name}"),
        cells=(dims, cells, "1", "number of cells"),
    )


def clones(run: xr.Dataset, saves: Sequence[int], since: int) -> xr.Dataset:
    """Which cells stem from which; see `MorphoAccessor.clones`."""
    names = variable(run, "cell", "cell").values.astype(str)
    volumes = variable(run, "volume", "time", "cell")
    first = np.flatnonzero(np.isfinite(volumes[since].values))
    clone = _clone_of(_mothers(run), first)
    sizes = np.zeros((3, len(saves), len(first)))
    for k, save in enumerate(saves):
        volume = volumes[save].values
        living = np.isfinite(volume)
        now = np.where(living, clone, -1)
        mine = now >= 0
        sizes[0, k] = np.bincount(now[mine], minlength=len(first))
        sizes[1, k] = np.bincount(now[mine], volume[mine], minlength=len(first))
        pairs, _ = contact_places(run, save)
        sizes[2, k] = pieces(len(names), pairs, now, len(first))
    dims = ("time", "clone")
    ancestor = ("clone", names[first], {"long_name": "ancestor of the clone's cells"})
    of_cell = np.where(clone >= 0, np.append(names[first], "")[clone], "")
    return _dataset(
        _along(run, saves) | {
            "clone": ancestor,
            "cell": run["cell"].variable,
            "clone_of": ("cell", of_cell, {"long_name": "clone of the cell"}),
        },
        cells=(dims, sizes[0].astype(np.int64), "1", "number of cells of the clone"),
        volume=(dims, sizes[1], "um3", "volume of the clone, integral of phi"),
        pieces=(dims, sizes[2].astype(np.int64), "1", "number of connected pieces of the clone"),
    )  # fmt: skip


def _region(run: xr.Dataset, save: int) -> tuple[Region | None, Integers]:
    """Region of the tissue at a save, and the places in `cell` of the cells that it is of."""
    centroids = variable(run, "centroid", "time", "cell", "axis")[save].values
    volumes = variable(run, "volume", "time", "cell")[save].values
    known = np.flatnonzero((volumes > 0) & np.isfinite(centroids).all(axis=1))
    if _repeats(run):
        return None, known
    lengths = np.array(period_lengths(run))
    turns = np.floor(centroids / np.where(lengths > 0, lengths, np.inf))
    return tissue_region((centroids - turns * lengths)[known], volumes[known]), known


def _repeats(run: xr.Dataset) -> bool:
    """Whether space repeats along all axes, so that a tissue has no surface."""
    return all(period_lengths(run))


def _neighbour_counts(run: xr.Dataset, save: int, inner: bool, least_area: float) -> Integers:
    """Number of neighbours of each cell, or of those away from the free surface."""
    pairs, area = contact_places(run, save)
    counts = np.bincount(pairs[area >= least_area].ravel(), minlength=run.sizes["cell"])
    if not inner or _repeats(run):
        volumes = variable(run, "volume", "time", "cell")[save].values
        return np.asarray(counts[np.isfinite(volumes)])
    region, cells = _region(run, save)
    deep = cells[:0] if region is None else cells[region.depth > region.spacing]
    return np.asarray(counts[deep])


def _places(run: xr.Dataset, save: int, against: str) -> Real:
    """(cell,) where cells are along a profile, µm; NaN where it is not known."""
    if against == "radius":
        return np.asarray(variable(run, "radial_position", "time", "cell")[save].values)
    depths = np.full(run.sizes["cell"], np.nan)
    region, cells = _region(run, save)
    if region is not None:
        depths[cells] = region.depth
    return depths


def _mothers(run: xr.Dataset) -> Integers:
    """(cell,) place of each cell's mother; -1 where she is not known.

    A mother who was in no save, as she has come and divided between two, is passed over where
    names are given by number: then half the number is her mother's.
    """
    place = {str(name): k for k, name in enumerate(variable(run, "cell", "cell").values)}
    parents = variable(run, "parent", "cell").values.astype(str)
    return np.array([place.get(_saved(parent, place), -1) for parent in parents], np.int64)


def _saved(name: str, place: Mapping[str, int]) -> str:
    """Cell of this name, or the nearest of her ancestors by number that is in the run; or ""."""
    from morphosim.scene.events.proliferation import NUMBERED

    while name not in place:
        found = NUMBERED.fullmatch(name)
        if found is None:
            return ""
        number = int(found["number"]) // 2
        name = f"{found['founder']}.{number}" if number > 1 else found["founder"]
    return name


def _clone_of(mothers: Integers, first: Integers) -> Integers:
    """(cell,) which of the cells `first` each stems from, herself included; -1 for none."""
    cells = np.arange(len(mothers))
    above = np.where(mothers < 0, cells, mothers)
    above[first] = first  # there the way up ends
    for _ in range(len(cells).bit_length()):  # each time twice as many generations
        above = above[above]
    clone = np.full(len(cells), -1)
    clone[first] = np.arange(len(first))
    return clone[above]


def _along(run: xr.Dataset, saves: Sequence[int]) -> dict[str, Any]:
    """Coordinate of these saves."""
    return {"time": run["time"].variable[list(saves)]}


def _middles(name: str, edges: Real, text: str) -> dict[str, Any]:
    """Coordinate of the middles of bins of length."""
    attributes = {"units": "um", "long_name": f"{text}, middle of the bin"}
    return {name: (name, (edges[:-1] + edges[1:]) / 2, attributes)}


def _dataset(coordinates: dict[str, Any], **variables: tuple[Any, ...]) -> xr.Dataset:
    """Dataset of variables, each with its dimensions, values, unit and meaning."""
    return xr.Dataset(
        {
            name: (dims, values, {"units": units, "long_name": text})
            for name, (dims, values, units, text) in variables.items()
        },
        coordinates,
    )
