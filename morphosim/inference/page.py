"""A page of pictures of a fit: outlines that are seen and fitted, estimates, what is left over."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from morphosim._files import replacing
from morphosim.cell_field import CellField
from morphosim.importers.labels.label_image import LabelImage
from morphosim.inference.observation import photographed

if TYPE_CHECKING:
    import xarray as xr

SEEN, FITTED, UNTOLD = "#888888", "#c2410c", "#c9c9c9"
WIDE, LINE, LEAST = 11.0, 0.2, 3.2
"""Width of the page, height of a line of estimates, and least height of their panels, inches."""
FINER = 2
"""Fitted outlines are drawn on voxels of the image's finest step over this."""


def draw_page(
    path: Path, answer: "xr.Dataset", image: LabelImage, fields: Sequence[CellField],
    spacing: float,
) -> None:  # fmt: skip
    """Write the page as a PNG file.

    Parameters
    ----------
    path : Path
    answer : Dataset of the fit
    image : LabelImage
        The last one that was given.
    fields : at the end of the best run
    spacing : float
        Of their lattice, µm.
    """
    kinds = np.array([name.partition(" ")[0] for name in answer["unknown"].values.tolist()])
    panels = [kind for kind in ("gamma", "sigma", "M") if (kinds == kind).any()]
    most = max(int((kinds == kind).sum()) for kind in panels)
    low = max(LEAST, LINE * most + 1.0)
    figure = Figure(figsize=(WIDE, 3.6 + low), layout="constrained")
    halves = figure.subfigures(2, 1, height_ratios=[3.6, low])
    above, below = np.asarray(halves).tolist()
    _outlines(above.subplots(1, 3), image, fields, spacing)
    columns = below.subplots(1, len(panels) + 1, squeeze=False)[0]
    for axes, kind in zip(columns, panels, strict=False):
        _estimates(axes, answer.isel(unknown=np.flatnonzero(kinds == kind)), kind)
    _left_over(columns[-1], answer)
    with replacing(path) as partial:
        figure.savefig(partial, format="png", dpi=110)


def _outlines(
    axes: Sequence[Axes], image: LabelImage, fields: Sequence[CellField], spacing: float
) -> None:
    """Outlines on three planes through the middle of all cells."""
    voxel = float(image.steps.min()) / FINER
    used = np.argwhere(image.labels > 0)
    origin = np.asarray(image.origin)
    low, high = (
        used.min(axis=0) * image.steps + origin - 2,
        used.max(axis=0) * image.steps + origin + 2,
    )
    shape = np.ceil((high - low) / voxel).astype(int)
    planes = np.rint((0.5 * (low + high) - origin) / image.steps).astype(int)
    middle = origin + planes * image.steps  # of voxels
    for panel, (normal, (across, up)) in zip(
        axes, enumerate([(1, 2), (0, 2), (0, 1)]), strict=True
    ):
        flat, first = shape.copy(), low.copy()
        flat[normal], first[normal] = 1, middle[normal]
        plane = LabelImage(labels=np.zeros(flat, np.int32), spacing=voxel, origin=first)
        fitted = photographed(fields, spacing, plane).labels.take(0, axis=normal)
        seen = image.labels.take(int(planes[normal]), axis=normal)
        drawn = (
            (seen, image.steps, origin, SEEN, 2.5),
            (fitted, np.full(3, voxel), first, FITTED, 1.0),
        )
        for labels, steps, start, colour, width in drawn:
            x, y = (
                start[a] + steps[a] * np.arange(labels.shape[n]) for n, a in enumerate((across, up))
            )
            for label in range(1, int(labels.max()) + 1):
                inside = np.asarray(labels == label, float).T
                panel.contour(x, y, inside, [0.5], colors=colour, linewidths=width)
        panel.set_xlim(low[across], high[across])
        panel.set_ylim(low[up], high[up])
        panel.set_aspect("equal")
        panel.set_xlabel(f"{'xyz'[across]}, µm")
        panel.set_ylabel(f"{'xyz'[up]}, µm")
        panel.set_title(f"{'xyz'[normal]} = {middle[normal]:.1f} µm", fontsize=9)
    handles = [axes[0].plot([], [], color=c, lw=w)[0] for c, w in ((SEEN, 2.5), (FITTED, 1.0))]
    axes[0].legend(handles, ["seen", "fitted"], fontsize=8, loc="upper right")


def _estimates(axes: Axes, answer: "xr.Dataset", kind: str) -> None:
    """Estimates with their standard deviations; pale where the images do not tell them."""
    names = [name.partition(" ")[2] or name for name in answer["unknown"].values.tolist()]
    places = np.arange(len(names))
    for told, colour in ((True, "black"), (False, UNTOLD)):
        at = answer["told"].values == told
        axes.errorbar(
            answer["estimate"].values[at], places[at], xerr=answer["sd"].values[at], fmt="o",
            color=colour, markersize=4, capsize=2,
        )  # fmt: skip
    axes.set_yticks(places, names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(left=0)
    axes.grid(axis="x", alpha=0.3)
    axes.set_xlabel({"gamma": "surface tension γ", "sigma": "attraction σ", "M": "M'"}[kind])


def _left_over(axes: Axes, answer: "xr.Dataset") -> None:
    """Map of what is left over, seen along z."""
    residual = answer["residual"].values
    most = max(float(np.quantile(np.abs(residual), 0.98)), 1e-3)
    order = np.argsort(np.abs(residual))
    x, y = (answer["position"].sel(axis=a).values[order] for a in "xy")
    points = axes.scatter(x, y, c=residual[order], s=8, cmap="RdBu_r", vmin=-most, vmax=most)
    axes.set_aspect("equal")
    axes.set_xlabel("x, µm")
    axes.set_ylabel("y, µm")
    axes.set_title("fitted surface lies farther out by", fontsize=9)
    axes.figure.colorbar(points, ax=axes, label="µm", shrink=0.8)
