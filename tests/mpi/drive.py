"""What the tests of `morphosim.mpi` run: `mpirun -n N python drive.py FOLDER`.

Without mpirun, and with `--alone`, the same by `Simulation`. Results are files in FOLDER.
"""

import json
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from morphosim import (
    Apoptosis,
    Attraction,
    Cell,
    CellChange,
    Column,
    ContractileRing,
    Differentiation,
    Division,
    Duration,
    EllipsoidShell,
    Growth,
    Numerics,
    Physics,
    Polarity,
    Proliferation,
    QuasiSteady,
    Removal,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    Term,
    VolumeCourse,
)
from morphosim.bench import packed_points
from morphosim.errors import SimulationError
from morphosim.mpi.communicator import StoppedError
from morphosim.mpi.distributed_simulation import DistributedSimulation, RootObserver

COMM = MPI.COMM_WORLD
ALONE = "--alone" in sys.argv
KIND = Simulation if ALONE else DistributedSimulation
RADIUS = 4.0


def cells(count: int, **values: Any) -> list[Cell]:
    """Packed balls, every third of them of type B, and some of another surface tension."""
    return [
        Cell(
            name=f"c{k}", shape=Sphere(center=point, radius=RADIUS), type="AAB"[k % 3],
            gamma=0.3 if k == 5 else None, **values,
        )
        for k, point in enumerate(packed_points(count, RADIUS))
    ]  # fmt: skip


STICKY = Physics(sigma=0.3, kappa=0.05)
"""What most scenes have, so that their step is compiled once."""


RING = ContractileRing(strength=12.0)


def numerics(**values: Any) -> Numerics:
    """Iterations in single precision, unless told otherwise."""
    chosen = {"dt": 1.0, "precision": "single", "solver": "band", "threads": 1}
    return Numerics(**(chosen | values))


def moving() -> Scene:
    """Cells that move by noise and attract by types and in one pair, and of which one grows."""
    sigma = Attraction(types={("A", "A"): 0.5, ("B", "B"): 0.2}, pairs={("c0", "c1"): 0.9})
    first, *others = cells(12)
    growing = replace(first, volume=VolumeCourse(times=[0, 50], volumes=[250, 350]))
    return Scene(
        cells=[growing, *others], physics=Physics(sigma=sigma, kappa=0.5),
        numerics=numerics(seed=3, precision="double", solver="dct"),
    )  # fmt: skip


def staged() -> Scene:
    """Divisions, one of which takes time, a removal, differentiation, and an end in the past."""
    middle = packed_points(12, RADIUS).mean(axis=0)
    shell = EllipsoidShell(center=middle, semi_axes=(16, 16, 16))
    pairs = {("c0", "c1"): 0.9}
    sigma = Attraction(types={("A", "A"): 0.5, ("A", "B"): 0.3}, sisters=0.8, pairs=pairs)
    divide = Division(cell="c2", daughters=("c2a", "c2p"), axis=(1, 0, 0), fraction=0.4)
    slowly = Division(cell="c5", daughters=("c5a", "c5p"), axis=(0, 1, 1), over=30.0)
    first = Stage(name="first", end=Duration(6), events=[divide])
    second = Stage(
        name="second", end=QuasiSteady(), limit=60,
        physics={
            "sigma": Attraction(default=0.6, pairs=pairs), "terms": [Turning(), Ageing(), RING]
        },
        events=[
            slowly,
            Removal(cells=["c3"], above={"z": 20.0}),
            Differentiation(of="A", touching="B", into="C"),
            CellChange(cells=["c0"], values={"frozen": True}),
        ],
    )  # fmt: skip
    return Scene(
        cells=cells(12), physics=Physics(sigma=sigma, terms=[Turning(), RING]), confinement=shell,
        numerics=numerics(dt=2.0),
        stages=[first, second], duration=80, save_every=20, save_fields="exact",
    )  # fmt: skip


def controlled() -> Scene:
    """Steps by a tolerance: a division, a cell that grows, and a term with state of its own."""
    divide = Division(cell="c2", daughters=("c2a", "c2p"), axis=(1, 0, 0), fraction=0.4)
    stages = [
        Stage(name="first", end=Duration(12)),
        Stage(name="second", end=Duration(25), events=[divide], physics={"sigma": 0.5}),
    ]
    first, *others = cells(8)
    growing = replace(first, volume=VolumeCourse(times=[0, 50], volumes=[268, 350]))
    return Scene(
        cells=[growing, *others], physics=Physics(sigma=0.3, terms=[Turning()]), stages=stages,
        numerics=numerics(dt=2.0, tolerance=20.0),
    )  # fmt: skip


def growing() -> Scene:
    """Polar cells that divide, several at a time, grow and die by rules of all kinds."""
    rules = [
        Proliferation(volume=290.0, spread=0.15, axis="long", into={"B": ("A", "B")}),
        Proliferation(rate=5e-3, axis="outward", neighbours=6, types=["A"]),
        Apoptosis(rate=8e-3, over=8.0),
        Growth(doubling_time=60.0, spread=0.2, pressure=0.4),
    ]
    life = Stage(name="life", end=Duration(30), rules=rules, rules_every=5.0)
    polarity = Polarity(
        alpha=0.1, diffusion=0.02, align={"velocity": 0.1, "neighbours": 0.2, "contacts": -0.1},
        where="free", daughters="opposite", look_every=3.0,
    )  # fmt: skip
    return Scene(
        cells=cells(8), physics=replace(STICKY, terms=[polarity]), stages=[life],
        numerics=numerics(seed=2),
    )  # fmt: skip


def vanishing(**values: Any) -> Scene:
    """A cell too small to last."""
    small = Cell(name="small", shape=Sphere(center=(30, 0, 0), radius=1.6), volume=0.1)
    return Scene(
        cells=[*cells(5), small], physics=replace(STICKY, M=0.0),
        numerics=numerics(), duration=60, **values,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Turning(Term):
    """Cells of type A swim along directions that turn, each as fast as its id says."""

    columns = (
        Column("heading", shape=(3,)),
        Column("turns", inherits=False),
        Column("swims", saved=False),
        Column("course", object, default="straight"),
        Column("density"),
    )

    def start(self, cells: Any, numerics: Any) -> None:
        """Head along x."""
        cells["heading"][:] = (1.0, 0.0, 0.0)

    def prepare(self, cells: Any, numerics: Any) -> None:
        """Find who swims."""
        cells["swims"][:] = [kind == "A" for kind in cells.types]

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        """Swim and turn."""
        forces.drift[:] += 0.1 * cells["swims"][:, None] * cells["heading"]
        angle = 0.05 * (1 + cells["id"] % 3)
        x, y = cells["heading"][:, 0].copy(), cells["heading"][:, 1].copy()
        cells["heading"][:, 0] = x * np.cos(angle) - y * np.sin(angle)
        cells["heading"][:, 1] = x * np.sin(angle) + y * np.cos(angle)
        cells["turns"][:] += 1
        cells["course"][cells["turns"] > 5] = "turned far"
        with np.errstate(divide="raise"):
            cells["density"][:] = 1 / step.volumes


@dataclass(frozen=True, kw_only=True)
class Ageing(Term):
    """Cells grow old from the stage on that brings this."""

    columns = (Column("age"),)

    def start(self, cells: Any, numerics: Any) -> None:
        """Begin with an age, by the first cell that there is, so that there must be one."""
        cells["age"][:] = 10 + 0 * cells["id"][0]

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        """Grow old."""
        cells["age"][:] += step.dt


def write(folder: Path, name: str, simulation: Simulation) -> None:
    """All that tells how a simulation has ended: arrays, and what is said of the cells."""
    engine = simulation.engine
    arrays = engine.contents() | {
        "centroids": simulation.centroids, "volumes": simulation.volumes,
        "face_peak": engine.face_peak, "lost_volume": engine.lost_volume,
    }  # fmt: skip
    facts = [
        simulation.names, simulation.types, simulation.events, simulation.removed,
        simulation.time, simulation.error,
    ]  # fmt: skip
    if "heading" in arrays:
        arrays["swims"] = simulation.column("swims")
        arrays["courses"] = simulation.column("course").astype(str)
        assert simulation.column("course").dtype == object
    with suppress(ValueError):
        simulation.column("unknown")
        raise AssertionError
    if COMM.rank == 0:
        np.savez(folder / f"{name}.npz", **arrays)
        (folder / f"{name}.json").write_text(json.dumps(facts))


def advanced(scene: Scene, advance: Callable[[Simulation], Any], rebalance: int = 256) -> (
    Simulation
):  # fmt: skip
    simulation = KIND(scene)
    if isinstance(simulation, DistributedSimulation):
        simulation.engine.rebalance = rebalance
    with suppress(SimulationError):
        advance(simulation)
    return simulation


def saved(folder: Path) -> None:
    """A run that is broken off and gone on with."""
    scene = staged()
    simulation = KIND(scene)
    simulation.run(until=30, observers=[_output(folder, scene)])
    COMM.barrier()
    simulation = KIND.from_run(folder)
    simulation.run(observers=[_output(folder, scene, resume=True)])


def _output(folder: Path, scene: Scene, resume: bool = False) -> Any:
    def make() -> list[RunWriter]:
        return [RunWriter(folder, scene.save_every, fields=scene.save_fields, resume=resume)]

    return make()[0] if ALONE else RootObserver(make)


class Fails:
    """Observer that fails."""

    def start(self, simulation: Simulation) -> None: ...
    def finish(self, simulation: Simulation) -> None: ...
    def after_step(self, simulation: Simulation) -> None:
        if simulation.engine.steps == 3:
            message = "no room"
            raise OSError(message)


def stopped() -> list[Any]:
    """What each rank raises where rank 0 fails, and after how many steps."""
    simulation = DistributedSimulation(moving())
    try:
        simulation.run(until=9, observers=[RootObserver(lambda: [Fails()])])
    except (OSError, StoppedError) as error:
        return [type(error).__name__, str(error), simulation.engine.steps]
    return []


def interrupted() -> list[Any]:
    """Whether each rank is told of an interruption, and after how many steps."""
    simulation = DistributedSimulation(moving())
    observer = RootObserver(list, lambda: simulation.engine.steps == 2)
    try:
        simulation.run(until=9, observers=[observer])
    except KeyboardInterrupt:
        return [simulation.engine.steps]
    return []


def halted(by: int) -> list[Any]:
    """Why each rank ends a run that one of them stops, and after how many steps."""
    simulation = DistributedSimulation(moving())

    def watch(simulation: Simulation) -> None:
        if COMM.rank == by and simulation.engine.steps == 2:
            simulation.stop(f"by rank {by}")

    simulation.run(until=9, observers=[RootObserver(lambda: [watch]) if by == 0 else watch])
    return [simulation.stopped, simulation.engine.steps, simulation.events[-1][1]]


def main() -> None:
    folder = Path(sys.argv[1])

    def steps(simulation: Simulation) -> None:
        simulation.step(12)
        simulation.remove(["c3"])
        simulation.step(6)

    moved = advanced(moving(), steps, rebalance=4)
    write(folder, "moving", moved)
    write(folder, "staged", advanced(staged(), lambda s: s.run()))
    write(folder, "controlled", advanced(controlled(), lambda s: s.run()))
    write(folder, "growing", advanced(growing(), lambda s: s.run(), rebalance=8))
    remove = vanishing(on_vanish="remove")
    write(folder, "vanishing", advanced(remove, lambda s: s.run(until=40)))
    write(folder, "stopping", advanced(vanishing(), lambda s: s.run(until=40)))
    saved(folder / "run")
    if isinstance(moved, DistributedSimulation):
        local, traffic = moved.engine.local, moved.engine.traffic
        told = {
            "own": int(local.own.sum()), "held": len(local), "sent": traffic.fields,
            "stopped": stopped(), "interrupted": interrupted(),
            "halted": [halted(by) for by in (0, COMM.size - 1)],
        }  # fmt: skip
        everyone = COMM.gather(told)
        if COMM.rank == 0:
            (folder / "ranks.json").write_text(json.dumps(everyone))


if __name__ == "__main__":
    main()
