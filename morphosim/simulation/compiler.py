"""A process that compiles kernels for another: see `warming`, which starts it.

It hears which stand-ins, and answers with what is to be compiled for them; then with each line the
key of what to compile comes in, and goes out again when that lies in the cache.
"""

import json
import pickle
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import BinaryIO

from morphosim.errors import SimulationError
from morphosim.scene.stand_in import StandIn
from morphosim.simulation.kernel_calls import KernelCall, recorded
from morphosim.simulation.warming import not_ahead

STEPS = 2
"""Steps in which boxes of cells that grow move, and close ranks."""


def serve() -> None:
    """Compile what is asked for, until nobody asks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all processes
    asked, answers = sys.stdin.buffer, sys.stdout
    sys.stdout = sys.stderr  # what libraries print must not come between the answers
    calls, soon = calls_of(asked)
    found = [(key, call.cost, key in soon) for key, call in calls.items()]
    print(json.dumps(found), file=answers, flush=True)
    for line in asked:
        calls[json.loads(line)].compile()
        print(line.decode().rstrip(), file=answers, flush=True)


def calls_of(file: BinaryIO) -> tuple[dict[str, KernelCall], set[str]]:
    """Kernels that stand-ins, which a file has, call, by their keys; keys of what a step calls."""
    soon: set[str] = set()
    with recorded() as calls:
        for stand_in in pickle.load(file):
            perform(stand_in, lambda: soon.update(call.key for call in calls()))
        return {call.key: call for call in calls()}, soon


def perform(stand_in: StandIn, after_a_step: Callable[[], None] = lambda: None) -> None:
    """Have cells do all that cells of a scene may: step, move, be measured, divide."""
    from morphosim.simulation.simulation import Simulation

    with not_ahead(), warnings.catch_warnings(), suppress(SimulationError):
        warnings.simplefilter("ignore")  # nobody is to act on what so small cells come to
        simulation = Simulation(stand_in.scene)
        simulation.step(1)
        after_a_step()
        simulation.step(STEPS - 1)
        simulation.step_to(simulation.ticks + 1)  # another length than was planned
        simulation.measured()
        if stand_in.ruled:
            simulation.chance("rules")
        if stand_in.daughters:
            simulation.divide(simulation.names[0], stand_in.daughters, axis=(1, 0, 0))
        for physics in stand_in.courses:
            if stand_in.daughters or physics != simulation.physics:
                simulation.engine.set_physics(physics)
                simulation.step(1)
