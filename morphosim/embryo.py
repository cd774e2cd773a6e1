"""Scenes of embryos from lineage tables: a division group after the other (paper §3.1, Note 1)."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

from morphosim.attraction import Attraction
from morphosim.confinement import Confinement
from morphosim.events import Division
from morphosim.lineage import Lineage, read_lineage
from morphosim.matlab import EGGSHELL
from morphosim.numerics import Numerics
from morphosim.scene import Scene
from morphosim.stages import Duration, End, QuasiSteady, Stage, Steady

SIGMA_STRONG, SIGMA_WEAK = 0.5, 0.0
"""Attraction that the paper infers (Note 1.4)."""
LIMIT = 10000.0
"""*In silico* time after which a stage up to 8 cells ends, steady or not."""
EQUILIBRIUM_LIMIT = 1000.0
"""*In silico* time after which a stage beyond 8 cells ends, in equilibrium or not."""
LATER = Attraction(default=SIGMA_STRONG, sisters=SIGMA_WEAK)
"""Attraction from six cells on: weak between sisters, else strong."""
CENTER = (30.0, 20.0, 15.0)


def divisions(
    lineage: Lineage, mothers: Sequence[str], measured: Collection[str] = ()
) -> list[Division]:
    """Divisions of cells as a lineage table says them; `measured` take the axis of nuclei."""
    splits = [
        (mother, lineage.division(mother, "measured" if mother in measured else "table"))
        for mother in mothers
    ]
    return [
        Division(
            cell=mother, daughters=split.daughters, axis=split.axis.tolist(),
            fraction=split.fraction,
            volumes=(lineage.volume(split.daughters[0]), lineage.volume(split.daughters[1])),
        )
        for mother, split in splits
    ]  # fmt: skip


def embryo(
    lineage: Lineage,
    confinement: Confinement,
    center: Sequence[float],
    *,
    groups: int | None = None,
    stages: Sequence[Stage] = (),
    attraction: Attraction | None = None,
    end: End | None = None,
    limit: float | None = EQUILIBRIUM_LIMIT,
    measured: Collection[str] = (),
    **options: Any,
) -> Scene:
    """Scene that follows a lineage from its first cell, one stage per division group.

    Parameters
    ----------
    lineage : Lineage
        With one cell to start from; it fills the confinement at its volume.
    confinement : Confinement
    center : (3,) a point deep inside of the confinement, µm
    groups : int, optional
        Number of division groups; by default all.
    stages : sequence of Stage
        Come first; groups that divide in them are left out of the rest. By default one stage of
        the first cell alone.
    attraction : Attraction, optional
        Of the other stages; by default the paper's, weak between sisters and else strong.
    end, limit : of the other stages; by default `Steady` or a time of 1000
    measured : names of cells
        Whose axis of division is that of measured nuclei, see `Lineage.division`.
    **options
        Other fields of `Scene`.
    """
    (root,) = lineage.roots
    first = Stage(name="1-cell", end=end or Steady(), limit=limit)
    plan = list(stages) or [first]
    divided = {e.cell for stage in plan for e in stage.events if isinstance(e, Division)}
    plan += [
        Stage(
            name=f"{group.cells_after}-cell", end=end or Steady(), limit=limit,
            physics={"sigma": attraction or LATER},
            events=divisions(lineage, group.mothers, measured),
        )
        for group in lineage.groups()[:groups] if not divided.issuperset(group.mothers)
    ]  # fmt: skip
    return Scene.from_points(
        [root], [center], [lineage.volume(root)], confinement, stages=plan,
        **({"duration": 1e6, "save_every": 500.0} | options),
    )  # fmt: skip


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
    return embryo(
        lineage, EGGSHELL, CENTER, groups=0, stages=first_eight(lineage, weak, measured),
        **(named | options),
    )  # fmt: skip


def celegans_1_to_102(measured: Collection[str] = (), **options: Any) -> Scene:
    """C. elegans in its eggshell from one to 102 cells, in 24 division groups (paper §3.1)."""
    lineage = read_lineage()
    named: dict[str, Any] = {
        "name": "celegans-1-to-102",
        "description": "C. elegans from one to 102 cells in 24 division groups",
        "numerics": Numerics.preset("fast", dt=1.5),
    }
    early = first_eight(lineage, True, measured)
    early[-1] = replace(early[-1], end=Steady(), limit=EQUILIBRIUM_LIMIT)
    return embryo(lineage, EGGSHELL, CENTER, stages=early, measured=measured, **(named | options))
