"""How well tensions and attractions come back from label images of cells whose own are known.

`python benchmarks/inference.py [CASE ...]` with cases such as `soft:0.25`, `eight:0.5:voxel`: what
is seen (`equal`, `soft`, `four`, `eight`), the voxel in µm (or three by commas), and the error of
the segmentation (`voxel`: at surfaces one voxel in four has the label of a random face neighbour;
`smooth`: the most frequent label within a voxel). By default all that docs/fit.md tells of.
"""

import sys
import time
from dataclasses import dataclass, replace

import numpy as np

from morphosim import (
    Attraction,
    Cell,
    LabelImage,
    Numerics,
    Physics,
    Scene,
    Simulation,
    Sphere,
    built_in_scene,
    fit,
)
from morphosim.cell_field import CellField
from morphosim.inference.observation import photographed
from morphosim.inference.replicates import flipped

CASES = [
    f"{what}:{voxel}{error}"
    for what in ("equal", "soft", "four", "eight")
    for voxel in ("0.25", "0.5", "0.25,0.25,1")
    for error in ("", ":voxel", ":smooth")
]
MARGIN, FLIPPED = 4.0, 0.06


@dataclass(frozen=True)
class Known:
    """Cells whose tensions and attractions are known."""

    scene: Scene
    fields: list[CellField]


def three(third: float) -> Known:
    """Three adhering cells of R = 5 µm, σ = 0.9, γ = 0.25 and that of the third."""
    angles = 2 * np.pi * np.arange(3) / 3
    cells = [
        Cell(
            name=name, shape=Sphere(center=(5.2 * np.cos(a), 5.2 * np.sin(a), 0), radius=5), gamma=g
        )
        for name, a, g in zip("abc", angles, (0.25, 0.25, third), strict=True)
    ]
    scene = Scene(cells=cells, physics=Physics(sigma=0.9), numerics=Numerics.preset("standard"))
    return run(scene, 5000.0)


def four() -> Known:
    """The four cells ABa, ABp, EMS and P2 in the eggshell, EMS-P2 weak."""
    whole = built_in_scene("celegans-8")
    places = {"ABa": (15, 20, 15), "ABp": (30, 28, 15), "EMS": (31, 12, 15), "P2": (45, 20, 15)}
    radii = {"ABa": 11.0, "ABp": 11.0, "EMS": 10.3, "P2": 9.5}
    cells = [
        Cell(name=name, shape=Sphere(center=place, radius=radii[name]))
        for name, place in places.items()
    ]
    physics = Physics(sigma=Attraction(default=0.5, pairs={("EMS", "P2"): 0.0}))
    numerics = Numerics.preset("standard")
    return run(
        Scene(cells=cells, physics=physics, numerics=numerics, confinement=whole.confinement),
        1500.0,
    )


def eight() -> Known:
    """The eight-cell embryo, ABpl-E and sisters weak."""
    scene = built_in_scene("celegans-8")
    return run(replace(scene, numerics=Numerics.preset("standard")), 800.0)


def run(scene: Scene, until: float) -> Known:
    """The scene's cells after a time."""
    simulation = Simulation(scene)
    simulation.run(until=until)
    return Known(scene, list(simulation.fields))


def image_of(known: Known, voxel: str, error: str, seed: int = 0) -> LabelImage:
    """Label image, placed on the voxels at random."""
    random = np.random.default_rng(seed)
    steps = np.broadcast_to([float(v) for v in voxel.split(",")], (3,))
    h, fields = known.scene.numerics.spacing, known.fields
    low = np.min([f.origin for f in fields], axis=0) * h - MARGIN + random.random(3) * steps
    high = np.max([f.origin + f.phi.shape for f in fields], axis=0) * h + MARGIN
    shape = np.ceil((high - low) / steps).astype(int)
    blank = LabelImage(labels=np.zeros(shape, np.int32), spacing=steps, origin=low)
    image = photographed(fields, h, blank)
    if error == "voxel":
        return flipped(image, FLIPPED, random)
    return smoothed(image, len(fields)) if error == "smooth" else image


def smoothed(image: LabelImage, count: int) -> LabelImage:
    """Image of which each voxel has the label that prevails within a voxel or so of it."""
    from scipy.ndimage import gaussian_filter

    shares = [
        gaussian_filter((image.labels == k).astype(np.float32), 1.0) for k in range(count + 1)
    ]
    return replace(image, labels=np.argmax(shares, axis=0).astype(np.int32))


def main(*cases: str) -> None:
    """Fit each case and print how far off it is."""
    makers = {
        "equal": lambda: three(0.25),
        "soft": lambda: three(0.15),
        "four": four,
        "eight": eight,
    }
    made: dict[str, Known] = {}
    print(
        "case, seconds, runs, time: γ off (rms, most, %), σ off (rms, most), within one deviation"
    )
    for case in cases or CASES:
        what, voxel, error = (*case.split(":"), "")[:3]
        known = made.setdefault(what, makers[what]()) if what not in made else made[what]
        off = compared(known, image_of(known, voxel, error))
        print(f"{case:24s} {off}", flush=True)


def compared(known: Known, image: LabelImage) -> str:
    """Fit an image, everything asked for and nothing known but the mean tension; how far off."""
    scene, names = known.scene, [field.name for field in known.fields]
    tensions = dict(zip(scene.names, scene.tensions, strict=True))
    mean = float(np.mean(list(tensions.values())))
    sigma = scene.physics.attraction.matrix(names)
    given = replace(
        scene, physics=replace(scene.physics, sigma=Attraction(default=0.5), gamma=mean),
        cells=[replace(cell, gamma=None) for cell in scene.cells],
    )  # fmt: skip
    begun = time.perf_counter()
    found = fit(image, scene=given, names=dict(enumerate(names, start=1)), progress=False)
    took = time.perf_counter() - begun
    gammas, sigmas, within = [], [], []
    for name, value, sd, told in zip(
        found["unknown"].values.tolist(), found["estimate"].values, found["sd"].values,
        found["told"].values, strict=True,
    ):  # fmt: skip
        kind, _, of = name.partition(" ")
        true = tensions[of] if kind == "gamma" else sigma[tuple(map(names.index, of.split("-")))]
        if told:
            (gammas if kind == "gamma" else sigmas).append(
                (value - true) / (true if kind == "gamma" else 1)
            )
            within.append(abs(value - true) < sd)
    g, s = np.abs(gammas), np.abs(sigmas)
    return (
        f"{took:5.0f} s {found.attrs['runs']:4d} runs, time {found.attrs['time']:.0f}: "
        f"γ {100 * np.sqrt(np.mean(g**2)):.1f} {100 * g.max():.1f}  "
        f"σ {np.sqrt(np.mean(s**2)):.3f} {s.max():.3f}  {np.mean(within):.2f} of {len(within)}"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
