"""What a scene pays for: ms per step with each physical term on and off.

Run as `python benchmarks/terms.py` (`--run DIR` takes the last state of a saved run of the scene
instead of its start). The 125 cells of `synnotch-symmetric`, δt = 1.25, solver `band`; all variants
run in turn in one process.
"""

from dataclasses import replace
from typing import Any

from _common import alternating_medians, arguments, report, stepper

from morphosim import Scene, Simulation, built_in_scene, load_fields, open_run

ONE_SIGMA = 0.6
"""Attraction between any two cells, of about the same strength as by type."""


def variants(scene: Scene) -> dict[str, Scene]:
    """Scenes with more and more terms, and the whole scene without one of them each."""
    bare = replace(scene, confinement=None).with_physics(g=0.0, sigma=0.0, kappa=0.0)
    g, sigma, kappa = scene.physics.g, scene.physics.sigma, scene.physics.kappa
    repelling = bare.with_physics(g=g)
    typed = repelling.with_physics(sigma=sigma)
    return {
        "tension and volume": bare,
        "+ repulsion": repelling,
        "+ noise": repelling.with_physics(kappa=kappa),
        "+ walls": replace(repelling, confinement=scene.confinement),
        "+ one attraction": repelling.with_physics(sigma=ONE_SIGMA),
        "+ attraction by type": typed,
        "+ noise by type": typed.with_physics(kappa_by_type={"G": kappa}),
        "all": scene,
        "all - walls": replace(scene, confinement=None),
        "all - noise": scene.with_physics(kappa=0.0),
        "all - types": scene.with_physics(sigma=ONE_SIGMA),
    }


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, run="", rounds=15, steps=4, threads=0)
    scene = replace(built_in_scene("synnotch-symmetric"), stages=())
    scene = scene.with_numerics(threads=options.threads)
    if options.run:
        with open_run(options.run) as run:
            scene = scene.with_fields(
                load_fields(run, run.sizes["time"] - 1), float(run.attrs["spacing_um"])
            )
    simulations = {name: Simulation(chosen) for name, chosen in variants(scene).items()}
    for simulation in simulations.values():
        simulation.step(20)
    seconds = alternating_medians(
        {name: stepper(s, options.steps) for name, s in simulations.items()}, options.rounds
    )
    whole = seconds["all"]
    rows: list[dict[str, Any]] = [
        {
            "terms": name,
            "threads": simulations[name].engine.workers,
            "ms per step": 1e3 * value / options.steps,
            "of all": value / whole,
            "MB": simulations[name].engine.nbytes / 1e6,
        }
        for name, value in seconds.items()
    ]
    report(rows, options.json)


if __name__ == "__main__":
    main()
