"""Steps D and E of Supplementary Note 1 as a scan: σ_S × σ_W against the contact areas.

Run as `python examples/sweep_attraction.py RUN DIR` on a run of `celegans-1-to-8`; the scan lies in
DIR and goes on there when it is stopped. σ_S holds between all cells, σ_W between EMS and P2.
"""

import sys

import xarray as xr
from _four_cells import FOUR, differences, four_cells

from morphosim import Axis, sweep

STRONG = [0.1, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5]
WEAK = [0.0, 0.3, 0.6, 0.9, 1.2]


def scan(run: str, directory: str) -> xr.Dataset:
    """Differences of the contact areas for all pairs of values."""
    axes = {
        "sigma_S": Axis(values=STRONG, sets="physics.sigma.default"),
        "sigma_W": Axis(
            values=WEAK, sets={"physics.sigma.pairs": [["EMS", "P2", "{value}"]]}
        ),
    }  # fmt: skip
    return sweep(four_cells(run), axes, figures={"off": differences}, directory=directory)


def main(run: str, directory: str) -> None:
    """Scan and tell the best fits."""
    off = abs(scan(run, directory)["off"])
    for name, pairs in (("four areas", FOUR), ("all five", off["pair"].values.tolist())):
        fit = off.sel(pair=pairs).mean("pair")
        best = fit.isel(fit.argmin(["sigma_S", "sigma_W"]))
        print(f"\nmean |difference| of {name}, %")
        print((100 * fit).round(1).to_pandas())
        print(f"least at sigma_S = {best['sigma_S']:.1f}, sigma_W = {best['sigma_W']:.1f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
