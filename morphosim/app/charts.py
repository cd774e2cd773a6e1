"""Figures of a run for the page: of one cell over time, and who touches whom."""

import io
from base64 import b64encode
from typing import TYPE_CHECKING, Any

import numpy as np

from morphosim.runs.views import contacts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Of Okabe and Ito, for the colour-blind; the darkest first."""


def history(run: "xr.Dataset", cell: str) -> str:
    """Volume, surface, sphericity and contacts of a cell over time, as an image address."""
    figure, axes = _figure(2, 2, (7.6, 5.0))
    one = run.sel(cell=cell)
    times = run["time"].values
    _line(axes[0, 0], times, one["volume"], "volume, µm³", "volume")
    axes[0, 0].plot(times, one["target_volume"], "--", color=COLOURS[1], label="target")
    axes[0, 0].legend(frameon=False)
    _line(axes[0, 1], times, one["surface_area"], "surface, µm²")
    _line(axes[1, 0], times, one["sphericity"], "sphericity")
    _contact_lines(axes[1, 1], run, cell)
    for axis in axes[1]:
        axis.set_xlabel("in silico time")
    return _address(figure)


def contact_matrix(run: "xr.Dataset", save: int) -> str:
    """Contact areas of the cells that are there at a save, as an image address."""
    from matplotlib.figure import Figure

    from morphosim.pictures import matrix

    shown = matrix.contact_matrix(run, save)
    figure = Figure(room := matrix.block_room(shown))
    matrix.draw_matrix(figure, (0, 0, *room), shown)
    return _address(figure)


def figures(run: "xr.Dataset", save: int, cell: str) -> list[dict[str, str]]:
    """What is known of a cell at a save: rows of name and text; none if it is not there."""
    at = run.isel(time=save).sel(cell=cell)
    volume, target = float(at["volume"]), float(at["target_volume"])
    if not np.isfinite(volume):
        return []
    touching = sorted(_neighbours(run, save, cell).items(), key=lambda item: -item[1])
    rows = {
        "type": str(at["type"].item()) or "–",
        "volume": f"{volume:.1f} µm³ ({100 * (volume / target - 1):+.1f} % of target)",
        "target volume": f"{target:.1f} µm³",
        "surface": f"{float(at['surface_area']):.1f} µm²",
        "sphericity": f"{float(at['sphericity']):.3f}",
        "centroid": " ".join(f"{x:.2f}" for x in at["centroid"].values) + " µm",
        "touches": ", ".join(f"{name} {area:.0f} µm²" for name, area in touching) or "no cell",
    }
    return [{"name": name, "text": text} for name, text in rows.items()]


def _neighbours(run: "xr.Dataset", save: int, cell: str) -> dict[str, float]:
    return {b if a == cell else a: area for a, b, area in contacts(run, save) if cell in (a, b)}


def _contact_lines(axis: "Axes", run: "xr.Dataset", cell: str) -> None:
    """Contact areas with the neighbours of the largest contacts."""
    saves = [_neighbours(run, save, cell) for save in range(run.sizes["time"])]
    largest: dict[str, float] = {}
    for areas in saves:
        for name, area in areas.items():
            largest[name] = max(area, largest.get(name, 0.0))
    there = np.isfinite(run["volume"].sel(cell=cell).values)
    chosen = sorted(largest, key=lambda name: -largest[name])[: len(COLOURS)]
    for name, colour in zip(chosen, COLOURS, strict=False):
        values = np.where(there, [areas.get(name, 0.0) for areas in saves], np.nan)
        _line(axis, run["time"].values, values, "", name, colour)
    axis.set_title("contact areas, µm²", loc="left", fontsize=10)
    axis.set_ylim(0, 1.4 * max(largest.values(), default=1.0))  # room for the names above
    if chosen:
        axis.legend(frameon=False, fontsize=7.5, ncols=3, loc="upper left", columnspacing=1.0)


def _line(
    axis: "Axes", times: Any, values: Any, title: str, label: str = "", colour: str = COLOURS[0]
) -> None:
    marker = "o" if len(times) < 40 else ""
    axis.plot(times, values, marker=marker, markersize=3, color=colour, label=label or None)
    axis.set_title(title, loc="left", fontsize=10)


def _figure(rows: int, columns: int, size: tuple[float, float]) -> tuple["Figure", Any]:
    from matplotlib.figure import Figure

    figure = Figure(size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=9)
    return figure, axes


def _address(figure: "Figure") -> str:
    """Figure as the address of an SVG image."""
    file = io.BytesIO()
    figure.savefig(file, format="svg", bbox_inches="tight", pad_inches=0.05)
    return "data:image/svg+xml;base64," + b64encode(file.getvalue()).decode()
