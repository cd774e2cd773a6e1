"""The pictures of the documentation, from saved runs.

Run as `python examples/pictures.py RUNS OUT`: RUNS holds the runs `celegans-8`,
`celegans-1-to-102` and those of the five synNotch scenes by their names (`morphosim run celegans-8
-o RUNS/celegans-8` and so on); a picture is made of the last save of each that is there.
"""

import sys
from pathlib import Path

from morphosim import open_run

COLOURS = {"R": "#d55e00", "G": "#009e73", "B": "#0072b2"}
EMBRYO = {"mirror": True}
AGGREGATE = {
    "by": "type", "colours": COLOURS, "views": ["x", "z"], "names": False, "matrix": False,
    "size": (8.0, 4.6),
}  # fmt: skip
PICTURES = {
    "celegans-8": EMBRYO,
    "celegans-1-to-102": EMBRYO | {"by": "lineage"},
    **{
        f"synnotch-{name}": AGGREGATE
        for name in ("asymmetric-3", "asymmetric-2", "symmetric", "repair", "dissociation")
    },
}

runs, out = map(Path, sys.argv[1:3])
for name, options in PICTURES.items():
    if (runs / name).exists():
        with open_run(runs / name) as run:
            run.morpho.plot(path=out / f"{name}.png", **options)
        print(f"{out / name}.png")
    else:
        print(f"there is no run {runs / name}")
