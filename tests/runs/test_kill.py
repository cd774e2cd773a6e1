"""Runs that are killed: whatever the moment, the directory opens and goes on to the same end."""

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from morphosim import (
    Cell,
    Numerics,
    Physics,
    RunWriter,
    SaveError,
    Scene,
    Simulation,
    Sphere,
    open_run,
)
from morphosim.runs.checkpoint import Checkpoint
from morphosim.runs.directory import RunDirectory
from morphosim.scene.file import save_scene

KILLED_AT = """
import os, signal, sys
from morphosim.cli import main
left = int(sys.argv.pop(1))
def counted(call):
    def wrapper(*arguments, **options):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return call(*arguments, **options)
    return wrapper
os.fsync, os.replace, os.rename = map(counted, (os.fsync, os.replace, os.rename))
main()
"""
"""Command line that kills itself at the n-th time that it puts something on disk."""


def scene() -> Scene:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=3))
        for name, x in zip("ab", (0, 5.5), strict=True)
    ]
    return Scene(
        cells=cells, duration=24.0, save_every=4.0, numerics=Numerics(threads=1),
        physics=Physics(sigma=0.5, kappa=0.2),
    )  # fmt: skip


def final_state(folder: Path) -> Checkpoint:
    files = RunDirectory(folder)
    return Checkpoint.read(files.restart(files.last))


def call(*words: object) -> int:
    done = subprocess.run(
        [sys.executable, "-c", KILLED_AT, *map(str, words)], capture_output=True, check=False
    )
    assert b"error" not in done.stderr, done.stderr.decode()
    return done.returncode


def test_killed_at_every_write_a_run_opens_and_goes_on(tmp_path: Path) -> None:
    Simulation(scene()).run(observers=[RunWriter(tmp_path / "whole", 4)])
    wanted = final_state(tmp_path / "whole")
    save_scene(scene(), tmp_path / "scene.toml")
    folder, seen = tmp_path / "parts", 0
    words = ["run", tmp_path / "scene.toml", "-o", folder]
    kills = 0
    for kills in range(100):
        code = call(1 + kills % 9, *words)
        words = ["run", "--resume", folder] if (folder / "scene.toml").exists() else words
        saves = RunDirectory(folder).saves
        assert len(saves) >= seen, "a save was lost"
        seen = len(saves)
        if seen:
            with open_run(folder) as data:
                assert data["time"].values.tolist() == [4.0 * k for k in range(seen)]
        if code == 0:
            break
        assert code == -signal.SIGKILL
    assert code == 0
    assert kills > 10
    found = final_state(folder)
    for name, values in wanted.arrays.items():
        np.testing.assert_array_equal(values, found.arrays[name], err_msg=name)


def test_a_full_disk_is_told_and_loses_nothing(tmp_path: Path) -> None:
    simulation = Simulation(scene())
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    class Fill:
        def start(self, simulation: Simulation) -> None:
            pass

        def after_step(self, simulation: Simulation) -> None:
            if simulation.time == 6:
                resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 14, before[1]))

        def finish(self, simulation: Simulation) -> None:
            pass

    try:
        with pytest.raises(SaveError, match=r"cannot save t = 8 .* All 2 saves before are whole"):
            simulation.run(observers=[Fill(), RunWriter(tmp_path, 4)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.glob("*.partial"))
    again = Simulation.from_run(tmp_path)
    assert again.time == 4
    again.run(observers=[RunWriter(tmp_path, 4, resume=True)])
    with open_run(tmp_path) as data:
        assert data["time"].values.tolist() == [4.0 * k for k in range(7)]


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a folder nobody can write to")
def test_a_directory_that_cannot_be_written_to() -> None:
    with pytest.raises(SaveError, match="cannot make the directory /proc/run"):
        RunWriter("/proc/run", 4)
