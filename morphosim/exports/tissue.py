"""Figures of a tissue as CSV: growth, pair correlation, neighbours, profiles and clones."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import xarray as xr

from morphosim.accessor import MorphoAccessor
from morphosim.progress import Tell

PROFILES = ("volume", "pressure", "age")
"""Variables whose profiles against the radius are written, where the run has them."""


def write(run: xr.Dataset, directory: Path, saves: Sequence[int], tell: Tell) -> list[Path]:
    """Write a table for each figure, in which each save has its rows."""
    morpho, times = MorphoAccessor(run), run["time"].values[list(saves)]
    tables = {
        "growth": lambda: _rows(morpho.growth().sel(time=times)),
        "pair_correlation": lambda: _rows(morpho.pair_correlation(times)),
        "neighbours": lambda: pd.concat(
            [
                _rows(morpho.neighbour_distribution(times, inner=inner)).assign(inner=inner)
                for inner in (False, True)
            ]
        ),
        "profiles": lambda: pd.concat(
            [
                _rows(morpho.profile(name, times)).assign(variable=name)
                for name in PROFILES if name in run
            ]
        ),
        "clones": lambda: _rows(morpho.clones(times).drop_dims("cell")),
    }  # fmt: skip
    paths = []
    for done, (name, table) in enumerate(tables.items(), 1):
        paths.append(directory / f"{name}.csv")
        table().to_csv(paths[-1], index=False)
        tell(done, len(tables))
    return paths


def _rows(figure: xr.Dataset) -> pd.DataFrame:
    """Table of a figure, a row for each place along its coordinates."""
    return figure.to_dataframe().reset_index()
