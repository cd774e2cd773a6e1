"""Fig. S4 as a scan: the irregularity η of AB and P1, and how far they are compressed, against γ.

Run as `python examples/sweep_stiffness.py DIR`; the scan lies in DIR and goes on there when it is
stopped. The egg divides in its shell and the two cells come to rest, for several surface tensions
and two strengths of the volume constraint.
"""

import sys
from dataclasses import replace

from morphosim import built_in_scene, sweep

AXES = {"physics.gamma": [0.1, 0.15, 0.25, 0.4, 0.6], "physics.M": [4.0, 8.0]}


def main(directory: str) -> None:
    """Scan and print η, and volumes relative to their targets."""
    egg = built_in_scene("celegans-1-to-8", {"numerics.preset": "fast", "numerics.S": 12.0})
    found = sweep(
        replace(egg, stages=egg.stages[:2]), AXES, directory=directory,
        figures={"eta": "irregularity", "volume": "volume", "target": "target_volume"},
    )  # fmt: skip
    print(found["eta"].to_series().unstack("cell").round(4))
    print((found["volume"] / found["target"]).mean("cell").round(3).to_pandas())


if __name__ == "__main__":
    main(sys.argv[1])
