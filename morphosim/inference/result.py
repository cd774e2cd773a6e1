"""The answer of a fit as a Dataset."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from morphosim.inference.estimate import TOLD, Misfit
from morphosim.inference.offsets import Patches
from morphosim.inference.search import State
from morphosim.inference.trial import Frame
from morphosim.inference.unknowns import SPREAD, Unknowns
from morphosim.measure.contacts import contact_areas
from morphosim.provenance import processor, versions

if TYPE_CHECKING:
    import xarray as xr

    from morphosim.cell_field import CellField

Floats = NDArray[np.float64]
SMALL_CONTACT = 10.0
"""The attraction of a contact of less than this, µm², is not told: it may be about to open or to
close, which is fast."""
GAUGE = "the mean of gamma is held: one image in time tells ratios of tensions and attractions only"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a fit has found."""

    unknowns: Unknowns
    misfit: Misfit
    frames: Sequence[Frame]
    state: State
    off: Floats
    """(R, n) by how much replicates are off."""
    facts: dict[str, Any]


def dataset(answer: Answer, final: "Sequence[CellField]", spacing: float) -> "xr.Dataset":
    """Estimates, uncertainties, what is not told, and what is left over.

    `final` are the fields at the end of the best run.
    """
    import xarray as xr

    unknowns, state = answer.unknowns, answer.state
    slopes = unknowns.slopes(state.vector)
    linear, noise = answer.misfit.covariance(state.offsets, state.slopes)
    resampled = np.sqrt((answer.off**2).mean(axis=0)) if len(answer.off) else 0 * state.vector
    both = linear + np.diag(resampled**2)
    covariance = slopes @ both @ slopes.T
    sd = np.sqrt(np.diag(covariance))
    names = [unknown.name for unknown in unknowns.each]
    told = np.sqrt(np.diag(both)) < TOLD * SPREAD
    areas = _seen_areas(answer.frames[-1])
    for k, unknown in enumerate(unknowns.each):
        if unknown.kind == "sigma" and len(unknown.cells) == 2:
            told[k] &= areas.get(unknown.cells, 0.0) >= SMALL_CONTACT
    scale = np.outer(sd, sd)
    table = xr.Dataset(
        {
            "estimate": ("unknown", unknowns.values(state.vector), {"long_name": "estimate"}),
            "sd": ("unknown", sd, {"long_name": "standard deviation, of both below"}),
            "sd_linear": (
                "unknown", np.sqrt(np.diag(slopes @ linear @ slopes.T)),
                {"long_name": "standard deviation by the slopes and what is left over"},
            ),
            "sd_resampled": (
                "unknown", np.sqrt(np.diag(slopes @ np.diag(resampled**2) @ slopes.T)),
                {"long_name": "root mean square of what replicates are off by"},
            ),
            "told": ("unknown", told, {"long_name": "whether the images tell it"}),
            "correlation": (
                ("unknown", "other"), covariance / np.where(scale > 0, scale, 1.0),
                {"long_name": "correlation of estimates"},
            ),
            "history": (
                ("round", "unknown"), np.array([unknowns.values(v) for v in state.history]),
                {"long_name": "estimates after each round"},
            ),
        },
        {"unknown": names, "other": names, "round": np.arange(1, len(state.history) + 1)},
    )  # fmt: skip
    table = table.merge(_left_over(answer)).merge(_contacts(answer, final, spacing, areas))
    table.attrs = answer.facts | {
        "title": "fit of tensions and attractions to images",
        "source": f"MorphoSim {versions()['morphosim']}",
        "machine": processor(),
        "held": GAUGE if unknowns.gauge else "",
        "time": state.time,
        "rounds": state.round,
        "noise_um": noise[0], "smooth_misfit_um": noise[1],
    }  # fmt: skip
    return table


def _left_over(answer: Answer) -> "xr.Dataset":
    """Offsets of patches, and their root mean square of each cell."""
    import xarray as xr

    names = np.array([*answer.unknowns.names, ""])
    patches, weight = Patches.joined(answer.misfit.patches), answer.misfit.weight
    off = answer.misfit.weighted(answer.state.offsets) / weight
    sums = np.zeros((2, len(names)))
    for side in (patches.cell, patches.neighbour):
        np.add.at(sums[0], side, weight**2 * off**2)
        np.add.at(sums[1], side, weight**2)
    of_cells = np.sqrt(sums[0] / np.maximum(sums[1], 1e-12))[:-1]
    return xr.Dataset(
        {
            "residual": _um("patch", off, "simulated surface lies farther out by"),
            "patch_cell": ("patch", names[patches.cell]),
            "patch_neighbour": ("patch", names[patches.neighbour]),
            "patch_area": ("patch", patches.area, {"units": "um2"}),
            "position": (("patch", "axis"), patches.centre, {"units": "um"}),
            "cell_residual": _um("cell", of_cells, "root mean square over the cell's surface"),
        },
        {"cell": list(answer.unknowns.names), "axis": list("xyz")},
    )


def _um(dimension: str, values: object, text: str, units: str = "um") -> tuple[Any, ...]:
    return dimension, values, {"units": units, "long_name": text}


def _seen_areas(frame: Frame) -> dict[tuple[int, int], float]:
    """Clear area of each contact of a frame, µm²."""
    patches = frame.patches
    areas: dict[tuple[int, int], float] = {}
    for i, j, area in zip(patches.cell, patches.neighbour, patches.area, strict=True):
        if j >= 0:
            areas[int(i), int(j)] = areas.get((int(i), int(j)), 0.0) + float(area)
    return areas


def _contacts(
    answer: Answer, final: "Sequence[CellField]", spacing: float,
    seen: dict[tuple[int, int], float],
) -> "xr.Dataset":  # fmt: skip
    """Areas of contacts in the last image and at the end of the best run, and what is left over."""
    import xarray as xr

    names = answer.unknowns.names
    simulated = contact_areas(final, spacing)
    pairs = sorted(seen)
    offsets, patches = answer.state.offsets, Patches.joined(answer.misfit.patches)
    left, ends = [], []
    for i, j in pairs:
        mine = (patches.cell == i) & (patches.neighbour == j)
        square = (
            np.average(offsets[mine] ** 2, weights=patches.area[mine]) if mine.any() else np.nan
        )
        left.append(float(np.sqrt(square)))
        pair = names[i], names[j]
        ends.append(simulated.get(pair, simulated.get(pair[::-1], 0.0)))
    seen_areas = [seen[pair] for pair in pairs]
    return xr.Dataset(
        {
            "seen_area": _um("contact", seen_areas, "area compared, in the last image", "um2"),
            "contact_area": _um("contact", ends, "area at the end of the best run", "um2"),
            "contact_residual": _um("contact", left, "root mean square over the contact"),
        },
        {"contact": [f"{names[i]}-{names[j]}" for i, j in pairs]},
    )
