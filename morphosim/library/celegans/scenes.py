"""C. elegans in its eggshell: the stages of the paper (§3.1, Supplementary Note 1)."""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from morphosim.geometry.eggshell import EGGSHELL
from morphosim.importers.lineage import Lineage, read_lineage
from morphosim.importers.lineage.scene import (
    EQUILIBRIUM_LIMIT,
    LATER,
    SIGMA_STRONG,
    SIGMA_WEAK,
    divisions,
    lineage_scene,
)
from morphosim.numerics.parameters import Numerics
from morphosim.physics.attraction import Attraction
from morphosim.scene.ends import Duration, QuasiSteady, Steady
from morphosim.scene.events import Division
from morphosim.scene.scene import Scene
from morphosim.scene.stages import Stage

LIMIT = 10000.0
"""*In silico* time after which a stage up to 8 cells ends, steady or not."""
CENTER = (30.0, 20.0, 15.0)


def first_eight(
    lineage: Lineage, weak: bool = True, measured: Collection[str] = (), duration: float = 15000.0
) -> list[Stage]:
    """Stages A to H of Supplementary Note 1, from one to eight cells of C. elegans.

    `weak` is the attraction between ABpl and E; with it the embryo stays three-dimensional. Without
    it it collapses into a plane some 12000 units of time after the last division.
    """
    strong = {"sigma": Attraction(default=SIGMA_STRONG)}
    motif = {("EMS", "P2"): SIGMA_WEAK}
    eight = Attraction(
        default=SIGMA_STRONG, sisters=SIGMA_WEAK, pairs={("ABpl", "E"): SIGMA_WEAK} if weak else {}
    )

    def into(*mothers: str) -> list[Division]:
        return divisions(lineage, mothers, measured)

    return [
        Stage(name="1-cell", end=Steady(), limit=LIMIT),
        Stage(name="2-cell", end=Steady(), limit=LIMIT, events=into("P0")),
        Stage(name="3-cell", end=Steady(), limit=LIMIT, events=into("AB")),
        Stage(name="4-cell, no attraction", end=Steady(), limit=LIMIT, events=into("P1")),
        Stage(name="4-cell, attraction", end=Steady(), limit=LIMIT, physics=strong),
        Stage(
            name="4-cell", end=Steady(), limit=LIMIT,
            physics={"sigma": Attraction(default=SIGMA_STRONG, pairs=motif)},
        ),
        Stage(
            name="6-cell", end=QuasiSteady(), limit=LIMIT, physics={"sigma": LATER},
            events=into("ABa", "ABp"),
        ),
        Stage(name="7-cell", end=QuasiSteady(), limit=LIMIT, events=into("EMS")),
        Stage(
            name="8-cell", end=Duration(duration), physics={"sigma": eight}, events=into("P2")
        ),
    ]  # fmt: skip


def celegans_1_to_8(weak: bool = True, measured: Collection[str] = (), **options: Any) -> Scene:
    """C. elegans in its eggshell from one to eight cells (Supplementary Note 1)."""
    lineage = read_lineage()
    kind = "weak" if weak else "strong"
    named: dict[str, Any] = {
        "name": f"celegans-1-to-8{'' if weak else '-strong'}",
        "description": f"C. elegans from one to eight cells, {kind} ABpl-E attraction",
    }
    return lineage_scene(
        lineage, EGGSHELL, CENTER, groups=0, stages=first_eight(lineage, weak, measured),
        **(named | options),
    )  # fmt: skip


def celegans_1_to_102(measured: Collection[str] = (), **options: Any) -> Scene:
    """C. elegans in its eggshell from one to 102 cells, in 24 division groups (paper §3.1)."""
    lineage = read_lineage()
    named: dict[str, Any] = {
        "name": "celegans-1-to-102",
        "description": "C. elegans from one to 102 cells in 24 division groups",
        "numerics": Numerics.preset("fast"),
    }
    early = first_eight(lineage, True, measured)
    early[-1] = replace(early[-1], end=Steady(), limit=EQUILIBRIUM_LIMIT)
    return lineage_scene(
        lineage, EGGSHELL, CENTER, stages=early, measured=measured, **(named | options)
    )
