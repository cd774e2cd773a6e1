"""Pictures of what the benchmarks measure."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.ticker
import numpy as np
import xarray as xr
from _history import Course
from matplotlib.axes import Axes

from morphosim import Physics

mpl.use("Agg")
import matplotlib.pyplot as plt

COLORS = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#999999", "#000000",
)  # fmt: skip
"""Okabe and Ito's palette, which colour-blind readers can tell apart."""
MARKERS = "os^Dvp<>PX*hd"
BESIDE = 0.05
"""How far figures of one commit stand beside each other, in commits."""
LEAST_SPAN = 2.0
"""Ratios that a picture of the history shows at least, so that noise looks small."""
LABELS = {"reference": (-60, -24)}
"""Where the name of a preset stands beside its circle, points, if not above it."""


def pareto_picture(data: xr.Dataset, front: np.ndarray, path: Path) -> None:
    """Error against cost on the embryo, variants by knob, with the Pareto front."""
    cost = data["cost"].values
    error = data["error"].sel(place="embryo t=480", measure="centroid_rms_nm").values
    knobs = data["knob"].values.astype(str)
    figure, axes = plt.subplots(figsize=(10, 6.5), layout="constrained")
    order = np.argsort(cost[front])
    axes.plot(
        cost[front][order], error[front][order], "-", color="0.6", lw=6, alpha=0.5, zorder=1,
        solid_capstyle="round", label="Pareto front",
    )  # fmt: skip
    shown = [k for k in dict.fromkeys(knobs) if k != "preset"]
    for k, knob in enumerate(shown):
        chosen = knobs == knob
        axes.plot(
            cost[chosen], error[chosen], MARKERS[k % len(MARKERS)], ms=7, label=knob,
            color=COLORS[k % len(COLORS)], alpha=0.85, mec="white", mew=0.5,
        )  # fmt: skip
    for name in data["variant"].values[knobs == "preset"]:
        x = float(data["cost"].sel(variant=name))
        y = float(error[list(data["variant"].values).index(name)])
        axes.plot(x, y, "o", ms=17, mfc="none", mec="black", mew=2)
        axes.annotate(
            str(name),
            (x, y),
            xytext=LABELS.get(str(name), (14, 12)),
            textcoords="offset points",
            fontsize=12,
            weight="bold",
        )
    axes.set(
        xscale="log", yscale="log", xlabel="time per in silico time, relative to fixed steps",
        ylabel="centroid error of the eight-cell embryo\nat t = 480, root mean square, nm",
    )  # fmt: skip
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
    axes.grid(which="both", alpha=0.2)
    axes.legend(fontsize=9, ncols=2, loc="upper right")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def front_picture(found: Mapping[float, Sequence[Mapping[str, Any]]], path: Path) -> None:
    """Error of the embryo against time of computing, former settings and runs with a tolerance."""
    figure, all_axes = plt.subplots(
        1, len(found), figsize=(6.2 * len(found), 5.4), layout="constrained", squeeze=False
    )
    for axes, (until, rows) in zip(all_axes[0], found.items(), strict=True):
        for k, (family, members) in enumerate(_families(rows).items()):
            preset = family == "preset"
            axes.plot(
                [r["seconds"] for r in members], [r["rms"] for r in members],
                "*" if preset else MARKERS[k], ms=14 if preset else 8, label=family,
                color=COLORS[k], mec="white", mew=0.5, ls="" if preset else "-",
                lw=2.5 if family == "former" else 1.2,
            )  # fmt: skip
            for r in members:
                axes.annotate(
                    r["variant"].removeprefix(f"{family} ").partition(",")[0],
                    (r["seconds"], r["rms"]), xytext=(-6, -9) if preset else (6, 5),
                    ha="right" if preset else "left", textcoords="offset points", fontsize=8,
                    color=COLORS[k], weight="bold" if preset else "normal",
                )  # fmt: skip
        axes.margins(0.1)
        axes.set(
            xscale="log", yscale="log", xlabel=f"time of computing to t = {until:g}, s",
            ylabel="error of centroids, root mean square, nm", title=f"t = {until:g}",
        )  # fmt: skip
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(mpl.ticker.LogFormatter(minor_thresholds=(2, 0.5)))
        axes.grid(which="both", alpha=0.2)
        axes.legend(fontsize=9)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _families(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Rows of one kind: former presets, presets, and tolerances at one spacing; by their time."""
    found: dict[str, list[Mapping[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: row["seconds"]):
        kind, _, spacing = row["variant"].partition(", ")
        found.setdefault(spacing or kind.partition(" ")[0], []).append(row)
    return dict(sorted(found.items()))


def stability_picture(data: xr.Dataset, path: Path) -> None:
    """Fig. 2 and S3: smallest stable S, stretch of time and computing time over δt."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13.5, 5.2), layout="constrained")
    dt = data.dt.values
    for scheme, color in (("bdf2", COLORS[0]), ("imex1", COLORS[5])):
        for walls, marker, line in (("stepped", "o", "-"), ("resolved", "s", "--")):
            at = data.sel(scheme=scheme, walls=walls)
            label = f"{scheme}, {walls} walls"
            left.plot(dt, at.smallest_S, marker, color=color, label=label, mfc="white", ms=7)
            left.plot(dt, at.predicted_S, line, color=color, lw=1.2)
        at = data.sel(scheme=scheme, walls="stepped")
        stretch = at.stretch.values
        middle.plot(dt, stretch, "o", color=color, label=scheme, ms=7)
        slower = at.smallest_S.values * dt / Physics().tau
        theory = 1 + slower if scheme == "imex1" else np.ones(len(dt))
        middle.plot(dt, theory, "-", color=color, lw=1.2)
        right.plot(dt, stretch * 0.3 / dt, "o-", color=color, label=scheme, ms=7)
    left.plot(2.0, 12.0, "*", color="black", ms=15, label="published choice")
    left.set(xlabel="δt", ylabel="smallest stable S", title="stability (lines: predicted)")
    middle.set(xlabel="δt", ylabel="stretch of in silico time", yscale="log", yticks=(1, 2, 5, 10))
    middle.set_yticklabels(["1", "2", "5", "10"])
    middle.minorticks_off()
    middle.set_title("time runs slow (line: 1 + S δt/τ)")
    right.plot(dt, 0.3 / dt, ":", color="0.4", label="0.3 / δt")
    right.set(xlabel="δt", ylabel="steps for the same course,\nrelative to δt = 0.3, S = 0")
    right.set(yscale="log", title="computing time", yticks=(0.1, 0.2, 0.5, 1, 2))
    right.set_yticklabels(["0.1", "0.2", "0.5", "1", "2"])
    right.minorticks_off()
    for axes in (left, middle, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def limits_picture(data: xr.Dataset, path: Path) -> None:
    """How each extreme ends, and the measured limits."""
    names = [str(n) for n in data.parameter.values]
    columns = [str(p) for p in data.numerics.values]
    figure, all_axes = plt.subplots(
        len(names), 1, figsize=(9, 0.9 * len(names) + 0.6), layout="constrained"
    )
    looks = {
        "stable": ("o", COLORS[2]), "vanished": ("v", COLORS[1]), "diverged": ("X", COLORS[5]),
        "flips": ("D", COLORS[3]), "unsound": ("P", COLORS[3]), "missed": ("s", COLORS[5]),
    }  # fmt: skip
    used: dict[str, object] = {}
    extremes = zip(
        data.extreme_parameter.values, data.extreme_value.values, data.extreme_numerics.values,
        data.extreme_outcome.values, strict=True,
    )  # fmt: skip
    rows = [(str(n), float(v), str(p), str(o)) for n, v, p, o in extremes]
    for name, axes in zip(names, all_axes, strict=True):
        own = [row for row in rows if row[0] == name]
        for _, value, chosen, end in own:
            marker, color = looks[end]
            (used[end],) = axes.plot(
                value, columns.index(chosen), marker, color=color, ms=9, clip_on=False, ls=""
            )
        for k, chosen in enumerate(columns):
            limit = float(data["limit"].sel(parameter=name, numerics=chosen))
            axes.plot([limit, limit], [k - 0.45, k + 0.45], "-", color="black", lw=2)
        positive = [row[1] for row in own if row[1] > 0]
        if max(positive) / min(positive) > 50:
            axes.set_xscale("symlog" if len(positive) < len(own) else "log")
        axes.set(ylim=(-0.6, len(columns) - 0.4), yticks=range(len(columns)), yticklabels=columns)
        axes.set_ylabel(name, rotation=0, ha="right", va="center", labelpad=8, weight="bold")
        axes.grid(axis="x", alpha=0.3)
        axes.tick_params(labelsize=8)
    figure.legend(used.values(), used.keys(), loc="outside upper center", ncols=len(used))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def history_picture(courses: Sequence[Course], commits: Mapping[str, datetime], path: Path) -> None:
    """Figures over commits, relative to the first; a panel for each benchmark and what it tells."""
    panels: dict[str, list[Course]] = {}
    for course in courses:
        panels.setdefault(f"{course.what} ({course.benchmark})", []).append(course)
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure, all_axes = plt.subplots(
        rows, columns, figsize=(5.2 * columns, 4.4 * rows), layout="constrained", squeeze=False
    )
    for axes in all_axes.flat[len(panels) :]:
        axes.remove()
    for axes, (title, members) in zip(all_axes.flat, panels.items(), strict=False):
        _history_panel(axes, members, commits)
        axes.set_title(title, loc="left")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _history_panel(axes: Axes, courses: Sequence[Course], commits: Mapping[str, datetime]) -> None:
    """One panel: the median of each commit as a line, each measurement as a mark."""
    measured = {point.commit for course in courses for point in course.points}
    place = {commit: k for k, commit in enumerate(c for c in commits if c in measured)}
    for k, course in enumerate(courses):
        color, marker = COLORS[k % len(COLORS)], MARKERS[k % len(MARKERS)]
        beside = BESIDE * (k - (len(courses) - 1) / 2)
        line = {
            place[c] + beside: np.median([p.ratio for p in course.points if p.commit == c])
            for c in place
            if c in {point.commit for point in course.points}
        }
        axes.plot(list(line), list(line.values()), color=color, lw=1.5)
        for p in course.points:
            axes.errorbar(
                place[p.commit] + beside, p.ratio, [[p.ratio - p.low], [p.high - p.ratio]],
                color=color, marker=marker, ms=7, mfc="white" if p.busy else color, lw=1, capsize=2,
            )  # fmt: skip
        axes.plot([], [], color=color, marker=marker, mfc="white", label=course.label)
    axes.axhline(1, color="0.6", lw=0.8, zorder=0)
    axes.set(yscale="log", ylabel="relative to the first commit")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 1 / LEAST_SPAN), max(high, LEAST_SPAN))
    axes.set_xticks(
        list(place.values()), [f"{c[:7]}\n{commits[c]:%d %b %y}" for c in place], fontsize=7
    )
    axes.yaxis.set_major_locator(mpl.ticker.LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(mpl.ticker.NullLocator())
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
