"""How long steps become under error control."""

from itertools import pairwise

import pytest

from morphosim import Numerics
from morphosim.engine.step_control import StepControl
from morphosim.numerics.parameters import LONGEST, PARTS


def lengths(most: int, steps: int, excess: float = 0.0) -> list[int]:
    """Lengths of steps of so little error, that end at all multiples of `most` ticks."""
    control = StepControl(Numerics(tolerance=10.0))
    found, tick = [], 0
    for _ in range(steps):
        ticks = control.fit(most - tick % most, fresh=not found)
        control.plan(ticks, excess, 0.0)
        found.append(ticks)
        tick += ticks
    return found


@pytest.mark.parametrize("most", [100, 320, 1000, LONGEST * PARTS])
def test_steps_grow_to_the_distance_of_ends_that_they_must_meet(most: int) -> None:
    found = lengths(most, 60)
    assert found[-1] == most
    assert all(after <= 2 * before for before, after in pairwise(found))


def test_steps_do_not_grow_beyond_the_longest() -> None:
    found = lengths(10**9, 60)
    assert max(found) <= LONGEST * PARTS
    assert found[-1] > 0.95 * LONGEST * PARTS


def test_steps_that_just_meet_the_tolerance_stay_as_they_are() -> None:
    assert len(set(lengths(10**6, 20, excess=0.8)[5:])) == 1
