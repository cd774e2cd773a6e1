"""The synNotch scenes: assembly, self-repair and dissociation (paper §3.2, Table 2, Fig. 6).

Types are named by their colours in Fig. 6: R(ed), G(reen) and B(lue).
"""

from collections.abc import Mapping
from typing import Any

from morphosim.geometry.confinement import BoxWalls
from morphosim.numerics.parameters import Numerics
from morphosim.physics.attraction import Attraction
from morphosim.physics.parameters import Physics
from morphosim.scene.ends import Duration
from morphosim.scene.events import Differentiation, Removal
from morphosim.scene.random_packing import packed_cells
from morphosim.scene.scene import Scene
from morphosim.scene.stages import Stage

RADIUS = 5.0
"""R of the cells at the start, µm."""
HALF = 32.0
"""Half of the side of the cubic domain, µm; the paper's is 128 points at 0.5 µm."""
LOWER, UPPER = (-HALF, -HALF, -HALF), (HALF, HALF, HALF)
KAPPA = 5**0.5 / 10
TIME_STEP = 1.25
DURATION = 50000.0
"""*In silico* time of an assembly, a repair or a dissociation."""
MARKING = 40000.0
"""*In silico* time by which red cells that touch a green one are marked blue (Fig. 6, row 1)."""

ASYMMETRIC = Attraction(types={
    ("R", "R"): 0.9, ("G", "G"): 0.9, ("R", "G"): 0.5,
})  # fmt: skip
THREE = Attraction(types=dict(ASYMMETRIC.types) | {
    ("B", "B"): 0.9, ("B", "R"): 0.9, ("B", "G"): 0.5,
})  # fmt: skip
"""`ASYMMETRIC` with cells of type B, whose mechanics are those of type R."""
SYMMETRIC = Attraction(types={
    ("G", "G"): 0.9, ("B", "B"): 0.3, ("G", "B"): 0.5,
})  # fmt: skip


def asymmetric_3(seed: int = 0, **options: Any) -> Scene:
    """80 R and 40 G sort into two caps; R that touch G become B (Fig. 6, row 1)."""
    mark = Differentiation(of="R", touching="G", into="B")
    early = 100.0  # so that what is saved at `MARKING` shows the marks
    stages = [
        Stage(name="assembly", end=Duration(MARKING - early)),
        Stage(name="marking", end=Duration(DURATION - MARKING + early), rules=[mark]),
    ]
    return _scene(
        "asymmetric-3", "80 R and 40 G cells sort into two caps; R that touch G become B",
        {"R": 80, "G": 40}, THREE, seed, stages, **options,
    )  # fmt: skip


def asymmetric_2(seed: int = 0, **options: Any) -> Scene:
    """62 R and 62 G, each kind adhesive to itself, sort into two caps (Fig. 6, row 2)."""
    return _scene(
        "asymmetric-2", "62 R and 62 G cells sort into two caps",
        {"R": 62, "G": 62}, ASYMMETRIC, seed, [_assembly()], **options,
    )  # fmt: skip


def symmetric(seed: int = 0, **options: Any) -> Scene:
    """50 adhesive G become a core in 75 less adhesive B (Fig. 6, row 3)."""
    return _symmetric("symmetric", "50 G cells become a core in 75 B cells", seed, [], **options)


def repair(seed: int = 0, **options: Any) -> Scene:
    """Assembly of `symmetric`, of which a half is cut off; the rest rounds up (Fig. 6, row 4)."""
    cut = Removal(below={"z": 0.0}, isolated=True)
    stage = Stage(name="repair", end=Duration(DURATION), events=[cut])
    return _symmetric(
        "repair", "The half of a symmetric aggregate that is left rounds up", seed, [stage],
        **options,
    )  # fmt: skip


def dissociation(seed: int = 0, **options: Any) -> Scene:
    """Assembly of `symmetric`, which then loses all adhesion (Fig. 6, row 5)."""
    stage = Stage(
        name="dissociation", end=Duration(DURATION), physics={"sigma": Attraction(default=0.0)}
    )
    return _symmetric(
        "dissociation", "A symmetric aggregate loses its adhesion and falls apart", seed, [stage],
        **options,
    )  # fmt: skip


SCENES = {
    "synnotch-asymmetric-3": asymmetric_3,
    "synnotch-asymmetric-2": asymmetric_2,
    "synnotch-symmetric": symmetric,
    "synnotch-repair": repair,
    "synnotch-dissociation": dissociation,
}
"""Functions of a seed, which is that of the places at the start and of the motion."""


def _assembly() -> Stage:
    return Stage(name="assembly", end=Duration(DURATION))


def _symmetric(name: str, description: str, seed: int, later: list[Stage], **options: Any) -> Scene:
    counts = {"G": 50, "B": 75}
    return _scene(name, description, counts, SYMMETRIC, seed, [_assembly(), *later], **options)


def _scene(
    name: str, description: str, counts: Mapping[str, int], sigma: Attraction, seed: int,
    stages: list[Stage], **options: Any,
) -> Scene:  # fmt: skip
    length = sum(stage.end.time for stage in stages if isinstance(stage.end, Duration))
    values: dict[str, Any] = {
        "cells": packed_cells(counts, RADIUS, LOWER, UPPER, seed),
        "physics": Physics(sigma=sigma, kappa=KAPPA),
        "numerics": Numerics(solver="band", dt=TIME_STEP, seed=seed),
        "confinement": BoxWalls(lower=LOWER, upper=UPPER),
        "stages": stages,
        "duration": length,
        "save_every": 500.0,
        "name": f"synnotch-{name}",
        "description": description,
    }
    return Scene(**(values | options))
