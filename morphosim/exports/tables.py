"""Tables of a run as CSV: `cells.csv`, `contacts.csv` and `times.csv`."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from morphosim.accessor import MorphoAccessor
from morphosim.progress import Tell
from morphosim.runs.views import cell_columns, contacts

TABLES = ("cells", "contacts", "times")


def write(run: xr.Dataset, directory: Path, saves: Sequence[int], tell: Tell) -> list[Path]:
    """Write the tables save by save.

    A row of `cells` is a cell that is there at a time, with all that the run has per time and cell
    and its mother; of `contacts` a pair of cells that touch; of `times` a save.
    """
    import pandas as pd

    contacts(run, saves[0])  # says what the run lacks before there is any file
    paths = [directory / f"{name}.csv" for name in TABLES]
    with ExitStack() as stack:
        files = [
            stack.enter_context(path.open("w", encoding="utf-8", newline="")) for path in paths
        ]
        for done, save in enumerate(saves, 1):
            tables = (cell_columns(run, save), _contacts(run, save), _times(run, save))
            for file, columns in zip(files, tables, strict=True):
                pd.DataFrame(columns).to_csv(file, header=done == 1, index=False)
            tell(done, len(saves))
    return paths


def _contacts(run: xr.Dataset, save: int) -> dict[str, Any]:
    """Columns of the pairs of cells that touch at a save, each pair once."""
    time = float(run["time"].values[save])
    pairs = list(MorphoAccessor(run).contact_graph(time).edges(data="area"))
    first, second, areas = zip(*pairs, strict=True) if pairs else ((), (), ())
    return {
        "time": np.full(len(pairs), time),
        "cell": list(first),
        "neighbour": list(second),
        "area": list(areas),
    }


def _times(run: xr.Dataset, save: int) -> dict[str, Any]:
    """Columns of one save: all that the run has per time."""
    names = (*run.data_vars, *(run.coords.keys() - run.dims))
    of_time = {str(n): run[n] for n in names if run[n].dims == ("time",)}
    return {
        "time": [run["time"].values[save]],
        **{name: [data.values[save]] for name, data in of_time.items()},
    }
