"""Scenes of embryos from lineage tables: a division group after the other (paper §3.1, Note 1)."""

from collections.abc import Collection, Sequence
from typing import Any

from morphosim.geometry.confinement import Confinement
from morphosim.importers.lineage import Lineage
from morphosim.physics.attraction import Attraction
from morphosim.scene.ends import End, Steady
from morphosim.scene.events import Division
from morphosim.scene.scene import Scene
from morphosim.scene.stages import Stage

SIGMA_STRONG, SIGMA_WEAK = 0.5, 0.0
"""Attraction that the paper infers (Note 1.4)."""
EQUILIBRIUM_LIMIT = 1000.0
"""*In silico* time after which a stage beyond 8 cells ends, in equilibrium or not."""
LATER = Attraction(default=SIGMA_STRONG, sisters=SIGMA_WEAK)
"""Attraction from six cells on: weak between sisters, else strong."""


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


def lineage_scene(
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
