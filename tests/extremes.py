"""Scenes that are extreme by chance, and whether their runs end as the README says.

`benchmarks/stability.py --random 60` tries many; a test some.
"""

import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from morphosim import load_fields, open_run
from morphosim.bench import BY_SOLVER

STEPS = 40
Call = Callable[[list[str]], tuple[int, str]]
"""Calls the command line: exit code, and what it wrote to standard error."""


def random_scene(chance: random.Random) -> dict[str, Any]:
    """Table of a scene of two or three cells, of whose numbers some are far beyond what holds."""

    def extreme(usual: float, low: float, high: float) -> float:
        """The usual value, or one time of five another between two powers of ten."""
        return 10 ** chance.uniform(low, high) if chance.random() < 0.2 else usual

    dt = chance.choice([0.5, 1.0, 2.0, 2.0, 2.0, 8.0])
    numerics: dict[str, Any] = {"threads": 1} | chance.choice(
        [{"dt": dt} | solver for solver in BY_SOLVER.values()]
        + [{"preset": name} for name in ("draft", "fast", "standard")]
    )
    if chance.random() < 0.2:
        numerics["S"] = chance.choice([0.0, 20.0])
    physics = {
        "M": extreme(8.0, 0, 4), "g": extreme(1.6, 0, 4), "g_e": extreme(16.0, 0, 4),
        "sigma": extreme(0.5, -1, 1), "kappa": extreme(0.2, -1, 1), "gamma": extreme(0.25, -2, 1),
    }  # fmt: skip
    reach, wall = chance.uniform(4, 9), chance.uniform(2, 6)
    cells = [
        {"name": name, "volume": extreme(150.0, 0, 3),
         "shape": {"kind": "sphere", "center": [x, 0.0, 0.0], "radius": chance.uniform(2.5, 4)}}
        for name, x in zip("abc"[: chance.choice([2, 3])], (0.0, reach, 2 * reach), strict=False)
    ]  # fmt: skip
    walls = {
        "kind": "box", "lower": [-wall, -wall, -wall], "upper": [2 * reach + wall, wall, wall],
    }  # fmt: skip
    return {
        "duration": STEPS * dt, "save_every": STEPS * dt / 2, "cells": cells, "physics": physics,
        "on_vanish": chance.choice(["stop", "remove", "ignore"]), "numerics": numerics,
    } | ({"confinement": walls} if chance.random() < 0.4 else {})  # fmt: skip


def outcome(scene: dict[str, Any], folder: Path, call: Call) -> str:
    """How a run of a scene ends: finished, diverged, vanished or refused; else what is wrong."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "scene.toml").write_text(tomli_w.dumps(scene), encoding="utf-8")
    run = folder / "run"
    code, told = call(["run", str(folder / "scene.toml"), "-o", str(run), "--quiet"])
    errors = [line for line in told.splitlines() if not line.startswith("warning: ")]
    if code == 0:
        return "finished" if not errors and _is_sound(run, "") else f"WRONG: {told}"
    if len(errors) != 1 or not errors[0].startswith("error: "):
        return f"WRONG: {told}"
    if code == 2 and not list(run.glob("save-*")):
        return "refused"
    for end in ("diverged", "vanished"):
        if code == 1 and f" {end} at t = " in errors[0] and "The last state is saved" in errors[0]:
            return end if _is_sound(run, end) else f"WRONG: {told}"
    return f"WRONG, exit code {code}: {told}"


def _is_sound(directory: Path, error: str) -> bool:
    """Whether a run opens, tells its end, and holds finite fields of all cells at its last save."""
    with open_run(directory) as run:
        last = run.isel(time=-1)
        living = int((last["type"] == "").sum()) and np.isfinite(last["volume"].values)
        fields = load_fields(run, -1)
        finite = all(np.isfinite(field.phi).all() for field in fields)
        tells = (error in run.attrs["error"]) == bool(run.attrs["error"] or not error)
        return finite and len(fields) == int(np.sum(living)) and tells
