"""Start and end of synNotch runs, in figures: one line per run and time.

Run as `python benchmarks/synnotch.py RUN...`, directories of finished runs of the synNotch scenes,
with several seeds for the spread: `morphosim run synnotch-symmetric --set numerics.seed=1 -o RUN`.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from _common import report

from morphosim import open_run


def means(save: xr.Dataset, name: str) -> str:
    """Mean of a variable per type, over cells of the largest aggregate."""
    inside = save["aggregate"] == 0
    kinds = [k for k in "RGB" if (save["type"] == k).any()]
    values = {k: float(save[name].where(inside & (save["type"] == k)).mean()) for k in kinds}
    return " ".join(f"{kind} {value:.3g}" for kind, value in values.items())


def like_contacts(run: xr.Dataset, index: int) -> float:
    """Share of the contacts between cells of the same type at the start.

    Other than `sorting_index` it does not see the marks of `synnotch-asymmetric-3`.
    """
    touch = run["contact_area"].isel(time=index).values > 0
    kinds = run["type"].isel(time=0).values
    like = kinds[:, None] == kinds[None, :]
    return float(np.count_nonzero(touch & like) / np.count_nonzero(touch))


def line(run: xr.Dataset, name: str, index: int) -> dict[str, Any]:
    """Figures of one save."""
    save = run.isel(time=index)
    kinds = [str(kind) for kind in save["type"].values if kind]
    return {
        "run": name,
        "seed": int(run.attrs["seed"]),
        "h": float(run.attrs["spacing_um"]),
        "time": float(save["time"]),
        "cells": " ".join(f"{kinds.count(k)} {k}" for k in "RGB" if k in kinds),
        "like contacts": like_contacts(run, index),
        "radius, um": means(save, "radial_position"),
        "exposed": means(save, "exposed_fraction"),
        "aggregates": int(save["n_aggregates"]),
        "single": int(save["single_cells"]),
        "largest": int(save["largest_aggregate"]),
        "gyration, um": float(save["radius_of_gyration"]),
        "roundness": float(save["roundness"]),
        "sphericity": float(save["aggregate_sphericity"]),
    }


def main() -> None:
    """Read and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--json", type=Path, help="write the result to this file")
    options = parser.parse_args()
    rows = []
    for path in options.runs:
        with open_run(path) as run:
            there = run["volume"].notnull().sum("cell").values
            first = int(there[0] > there[1])  # what a cut leaves
            rows += [line(run, path.name, first), line(run, path.name, -1)]
    report(rows, options.json)


if __name__ == "__main__":
    main()
