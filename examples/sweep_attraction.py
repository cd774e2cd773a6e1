"""Steps D and E of Supplementary Note 1 as a scan: σ_S × σ_W against the contact areas.

Run as `python examples/sweep_attraction.py RUN DIR` on a run of `celegans-1-to-8`; the scan lies in
DIR and goes on there when it is stopped. σ_S holds between all cells, σ_W between EMS and P2.

Areas are taken in two ways, of the surface and as microscopy measures them, and are judged in two:
by their absolute difference to the experiment, as the Note does, and by how far they lie from a
line through the origin, which leaves the scale open.
"""

import sys

import xarray as xr
from _four_cells import (
    FIVE,
    FOUR,
    four_cells,
    mean_difference,
    proportion,
    surface_areas,
    voxel_areas,
)

from morphosim import Axis, sweep

STRONG = [0.1, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5]
WEAK = [0.0, 0.2, 0.4, 0.8]
AREAS = {"surface": surface_areas, "voxels": voxel_areas}


def scan(run: str, directory: str) -> xr.Dataset:
    """Contact areas for all pairs of values."""
    axes = {
        "sigma_S": Axis(values=STRONG, sets="physics.sigma.default"),
        "sigma_W": Axis(
            values=WEAK, sets={"physics.sigma.pairs": [["EMS", "P2", "{value}"]]}
        ),
    }  # fmt: skip
    return sweep(four_cells(run), axes, figures=AREAS, directory=directory)


def tell(title: str, misfit: xr.DataArray) -> None:
    """Print a misfit for all values, and where it is least."""
    best = misfit.isel(misfit.argmin(["sigma_S", "sigma_W"]))
    print(f"\n{title}, %")
    print((100 * misfit).round(1).to_pandas())
    print(f"least at sigma_S = {best['sigma_S']:.1f}, sigma_W = {best['sigma_W']:.1f}")


def main(run: str, directory: str) -> None:
    """Scan and tell the best fits."""
    found = scan(run, directory)
    for kind in AREAS:
        for name, pairs in (("four areas", FOUR), ("all five", FIVE)):
            areas = found[kind].sel(pair=pairs)
            tell(f"{kind}: mean |difference| of {name}", mean_difference(areas))
            tell(
                f"{kind}: mean |difference| of {name} from a line", proportion(areas)["difference"]
            )
    print("\nslope and correlation of all five voxel areas")
    for name in ("slope", "correlation"):
        print(proportion(found["voxels"])[name].round(2).to_pandas())


if __name__ == "__main__":
    main(*sys.argv[1:])
