"""What `info` says of a run."""

import json
from collections.abc import Iterator
from dataclasses import asdict, fields
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from morphosim.engine.accuracy import error_text
from morphosim.numerics.parameters import PRESETS, Numerics
from morphosim.progress import duration_text
from morphosim.runs.directory import RunDirectory

if TYPE_CHECKING:
    import xarray as xr

MOST_LISTED = 200
"""Cells that are listed one by one."""
ANY_PRESET = ("threads", "seed")
"""Numerics that are of no preset."""


def run_facts(data: "xr.Dataset", place: Path) -> str:
    """Lines on a run: what made it, how far it is, and the cells that live at its last save.

    Parameters
    ----------
    data : Dataset of `open_run`
    place : path of the run
    """
    return "\n".join([*_head(data, place), *_cells(data)])


def _head(data: "xr.Dataset", place: Path) -> Iterator[str]:
    attrs, times = data.attrs, data["time"].values
    yield f"{attrs['title']}; {attrs['source']}"
    if "physics" in attrs:
        yield f"physics: {listing(json.loads(attrs['physics']))}"
    if "numerics" in attrs:
        yield f"numerics: {preset_text(json.loads(attrs['numerics']), attrs.get('S'))}"
    if "from_run" in attrs:
        yield f"started from {attrs['from_run']} at its t = {attrs['from_time']:g}"
    yield f"{len(times)} saves, t = {times[0]:g} to {times[-1]:g}{_written(place)}"
    stage = str(data["stage"].values[-1]) if "stage" in data else ""
    if stage:
        yield f"stage: {stage}"
    yield _end(attrs, float(times[-1]), place)
    if "time_error" in data:  # not in runs of before 0.2
        last = data.isel(time=-1)
        parts = (last[name].values for name in ("time_error", "space_error", "face_peak"))
        yield f"error: {error_text(*(part[np.isfinite(part)] for part in parts))}"


def _end(attrs: dict[str, Any], time: float, place: Path) -> str:
    """How a run has ended, who has stopped it, or that it can go on."""
    if attrs["error"]:
        return f"ended by an error: {attrs['error']}"
    if attrs.get("finished", time >= attrs["duration"] - 1e-9):  # of old runs, by their time
        return "finished"
    why = attrs.get("stopped", "")  # runs of 0.2 do not say
    ended = f"stopped at t = {time:g}: {why}" if why else "is not at its end"
    if place.is_dir() and any(place.glob("restart-*.npz")):
        return f"{ended}{'. Go on with' * bool(why)}: morphosim run --resume {place}"
    return f"{ended}; it cannot go on, as the state to go on from is not here"


def _written(place: Path) -> str:
    """Wall time from the first save to the last; "" for a packed run, which does not know it."""
    saves = RunDirectory(place).saves if place.is_dir() else []
    if not saves:
        return ""
    first, last = (file.stat().st_mtime for file in (saves[0], saves[-1]))
    begin = datetime.fromtimestamp(first).strftime("%Y-%m-%d %H:%M")
    return f"; written from {begin} on in {duration_text(max(last - first, 0))}"


def listing(table: dict[str, Any]) -> str:
    """Keys and values of a table in one line, those of tables in it too."""
    words = []
    for key, value in table.items():
        if isinstance(value, dict):
            value = f"({listing(value)})"
        elif isinstance(value, float):
            value = f"{value:g}"
        elif value is None:
            value = "none"
        words.append(f"{key} {value}")
    return ", ".join(words)


def preset_text(numerics: dict[str, Any], S: float | None = None) -> str:
    """The preset, or the defaults, that are nearest, how numerics differ, and the S chosen."""
    known = {f.name: None for f in fields(Numerics) if f.default is None}  # tables leave it out
    said = {key: v for key, v in (known | numerics).items() if key not in ANY_PRESET}
    found = []
    candidates = {"defaults": Numerics()} | {name: Numerics.preset(name) for name in PRESETS}
    for name, candidate in candidates.items():
        preset = asdict(candidate)
        other = {key: value for key, value in said.items() if preset.get(key) != value}
        found.append((name, other))
    name, other = min(found, key=lambda pair: len(pair[1]))
    is_chosen = S is not None and said["S"] is None and said["tolerance"] is None
    chosen = f"; S = {S:.3g} (chosen)" if is_chosen else ""
    return (f"{name}, with {listing(other)}" if other else name) + chosen


def _cells(data: "xr.Dataset") -> Iterator[str]:
    """A line for each cell that lives at the last save."""
    last = data.isel(time=-1)
    volumes, centroids = last["volume"].values, last["centroid"].values
    alive = np.flatnonzero(np.isfinite(volumes))
    gone = len(volumes) - len(alive)
    cells = "1 cell" if len(alive) == 1 else f"{len(alive)} cells"
    yield cells + (f"; {gone} that were there before have divided or are gone" if gone else "")
    yield f"{'cell':10} {'type':8} {'volume um3':>11}   centroid um"
    names, kinds = data["cell"].values, last["type"].values
    for k in alive[:MOST_LISTED].tolist():
        name, kind = str(names[k]), str(kinds[k]) or "-"
        x, y, z = centroids[k]
        yield f"{name:10} {kind:8} {volumes[k]:11.1f}   {x:.3f} {y:.3f} {z:.3f}"
    if len(alive) > MOST_LISTED:
        yield f"... and {len(alive) - MOST_LISTED} more: see morphosim export --to csv"
