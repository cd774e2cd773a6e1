"""Runs whose steps follow from a tolerance: saves, going on, threads, stages, noise."""

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphosim import (
    Cell,
    Column,
    Division,
    Duration,
    Numerics,
    Physics,
    QuasiSteady,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    Stage,
    Term,
    VolumeCourse,
    open_run,
    save_scene,
)
from morphosim.kernels.noise import normal_vectors

END, EVERY = 60.0, 20.0


@dataclass(frozen=True, kw_only=True)
class Clock(Term):
    """Counts steps and time of each cell, and pushes cells in turn."""

    columns = (Column("age"), Column("count", int))

    def update(self, cells: Any, step: Any, forces: Any) -> None:
        """Count, and push."""
        cells["age"][:] += step.dt
        cells["count"][:] += 1
        forces.drift[:, 0] += 0.05 * np.sin(cells["age"] / 7)


def scene(**options: Any) -> Scene:
    """Cells that meet, one of which grows."""
    growing = VolumeCourse(times=(0, END), volumes=(268, 330))
    cells = [
        Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=4)),
        Cell(name="b", shape=Sphere(center=(7.5, 0, 0), radius=4), volume=growing),
    ]
    values = {
        "cells": cells, "physics": Physics(sigma=0.4), "duration": END, "save_every": EVERY,
        "numerics": Numerics(tolerance=20.0, threads=1),
    }  # fmt: skip
    return Scene(**(values | options))


def state(simulation: Simulation) -> dict[str, np.ndarray]:
    """All that the next step depends on."""
    return dict(simulation.checkpoint().arrays)


def assert_same(one: Simulation, other: Simulation) -> None:
    """Compare states to the bit."""
    assert (one.time, one.ticks, one.steps, one.stage) == (
        other.time, other.ticks, other.steps, other.stage,
    )  # fmt: skip
    mine, others = state(one), state(other)
    assert mine.keys() == others.keys()
    for name, values in mine.items():
        np.testing.assert_array_equal(values, others[name], err_msg=name)


def ran(chosen: Scene, folder: Path, *observers: Any, until: float | None = None) -> Simulation:
    simulation = Simulation(chosen)
    simulation.run(until=until, observers=[RunWriter.of(chosen, folder), *observers])
    return simulation


def resumed(folder: Path) -> Simulation:
    simulation = Simulation.from_run(folder)
    simulation.run(observers=[RunWriter.of(simulation.scene, folder, resume=True)])
    return simulation


def lengths(chosen: Scene) -> np.ndarray:
    """Lengths of the steps of a run, in ticks."""
    ticks = [0]
    Simulation(chosen).run(observers=[lambda s: ticks.append(s.ticks)])
    return np.diff(ticks)


def test_steps_grow_and_saves_are_met_exactly(tmp_path: Path) -> None:
    steps: list[int] = []
    simulation = ran(scene(), tmp_path, lambda s: steps.append(s.ticks))
    taken = np.diff([0, *steps])
    assert taken[0] < 64 < taken.max()
    assert simulation.steps < END / 2
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [0, 20, 40, 60]
        assert run["step"].values[-1] == simulation.steps == len(steps)


def test_a_stopped_run_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    whole = ran(scene(), tmp_path / "whole")

    def stop(simulation: Simulation) -> None:
        if simulation.time > 25:
            simulation.stop("enough")

    half = ran(scene(), tmp_path / "parts", stop)
    assert 25 < half.time < 40
    assert_same(resumed(tmp_path / "parts"), whole)


def test_a_killed_run_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    whole = ran(scene(), tmp_path / "whole")
    chosen = scene()
    save_scene(chosen, tmp_path / "scene.toml")
    kill = (
        "import os, signal, sys; from morphosim import *; scene = load_scene(sys.argv[1])\n"
        "def die(s):\n    if s.time > 45: os.kill(os.getpid(), signal.SIGKILL)\n"
        "Simulation(scene).run(observers=[RunWriter.of(scene, sys.argv[2]), die])"
    )
    command = [sys.executable, "-c", kill, tmp_path / "scene.toml", tmp_path / "parts"]
    assert subprocess.run(command, check=False).returncode < 0
    assert_same(resumed(tmp_path / "parts"), whole)


def test_two_parts_are_one_run_where_they_meet_at_a_save(tmp_path: Path) -> None:
    whole = ran(scene(), tmp_path / "whole")
    parts = ran(scene(), tmp_path / "parts", until=40)
    parts.run(observers=[RunWriter.of(parts.scene, tmp_path / "parts", resume=True)])
    assert_same(parts, whole)


def test_the_number_of_threads_does_not_matter() -> None:
    one, two = (
        Simulation(scene(numerics=Numerics(tolerance=20.0, threads=threads))) for threads in (1, 2)
    )
    for simulation in (one, two):
        simulation.run()
    assert_same(one, two)


def staged(**options: Any) -> Scene:
    cells = [Cell(name="m", shape=Sphere(center=(0, 0, 0), radius=5))]
    division = Division(cell="m", daughters=("a", "b"), axis=(1, 0, 0))
    stages = [
        Stage(name="one", end=Duration(15)),
        Stage(name="two", end=QuasiSteady(), limit=80.0, events=[division]),
        Stage(name="three", end=Duration(20), physics={"sigma": 0.3}),
    ]
    return scene(cells=cells, stages=stages, duration=500.0, **options)


def test_stages_end_at_their_times_and_go_on_to_the_same_bits(tmp_path: Path) -> None:
    whole = ran(staged(), tmp_path / "whole")
    with open_run(tmp_path / "whole") as run:
        times, stages = run["time"].values, run["stage"].values.astype(str)
    ends = [times[stages == name][-1] for name in ("one", "two", "three")]
    assert ends[0] == 15
    assert (ends[1] - 15) % 10 == 0
    assert whole.time == ends[2] == ends[1] + 20

    def stop(simulation: Simulation) -> None:
        if simulation.stage == "two" and simulation.time > 28:
            simulation.stop("enough")

    half = ran(staged(), tmp_path / "parts", stop)
    assert half.stage == "two"
    assert_same(resumed(tmp_path / "parts"), whole)


def test_steps_shrink_where_a_cell_divides() -> None:
    simulation = Simulation(staged())
    taken: dict[str, list[int]] = {"one": [], "two": [], "three": []}
    before = [0]

    def note(now: Simulation) -> None:
        taken[now.stage].append(now.ticks - before[0])
        before[0] = now.ticks

    simulation.run(observers=[note])
    assert taken["two"][0] < 0.5 * max(taken["one"])


def test_a_term_has_its_state_advanced_once_a_step() -> None:
    simulation = Simulation(
        scene(
            physics=Physics(sigma=0.4, terms=[Clock()]),
            numerics=Numerics(tolerance=2.0, dt=4.0, threads=1),
        )
    )
    simulation.run()
    np.testing.assert_allclose(simulation.column("age"), simulation.time, rtol=1e-12)
    assert simulation.column("count").tolist() == [simulation.steps] * 2


def test_target_volumes_are_those_of_the_end_of_each_step() -> None:
    asked: list[float] = []

    def volume(time: float) -> float:
        asked.append(time)
        return 268.0 + time

    first, second = scene().cells
    simulation = Simulation(scene(cells=[first, replace(second, volume=volume)]))
    for _ in range(5):
        simulation.step()
        assert asked[-1] == simulation.time
        assert simulation.engine.everyone["target"][1] == 268 + simulation.time


def test_noise_moves_cells_as_theory_says_whatever_the_times_of_saves() -> None:
    # Mean square displacement along an axis: (κ δt/τ)² t; here for the very vectors drawn.
    dt, kappa, every = 2.0, 0.3, 5.0
    cells = [
        Cell(name=f"c{k}", shape=Sphere(center=(12.0 * (k % 4), 12.0 * (k // 4), 0), radius=3))
        for k in range(12)
    ]
    numerics = Numerics(dt=dt, tolerance=20.0, threads=1, seed=5)
    chosen = scene(cells=cells, physics=Physics(kappa=kappa), numerics=numerics, duration=60.0)

    class Waits:
        def start(self, simulation: Simulation) -> None: ...

        def next_time(self, simulation: Simulation) -> float:
            return every * (simulation.time // every + 1)

        def after_step(self, simulation: Simulation) -> None: ...

        def finish(self, simulation: Simulation) -> None: ...

    ticks = [0]
    simulation = Simulation(chosen)
    begin, tau = simulation.centroids, chosen.physics.tau
    simulation.run(observers=[Waits(), lambda s: ticks.append(s.ticks)])
    taken = np.diff(ticks)
    assert taken.max() <= 64 > taken.min()
    drawn, ids = np.zeros((len(cells), 3)), simulation.column("id")
    expected = np.zeros((len(cells), 3))
    for tick, length in zip(ticks, taken.tolist(), strict=False):
        normal_vectors(np.uint64(5), np.uint64(tick), ids, drawn)
        expected += kappa * dt / tau * np.sqrt(length * numerics.tick) * drawn
    moved = simulation.centroids - begin
    variance = (kappa * dt / tau) ** 2 * simulation.time
    assert np.sqrt(((moved - expected) ** 2).mean() / variance) < 0.15
    assert (moved**2).mean() == pytest.approx(variance, rel=0.5)
