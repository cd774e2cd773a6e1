"""How long steps become under error control."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from morphosim import Cell, Column, Numerics, Physics, Scene, Simulation, Sphere
from morphosim.cell_table import CellTable
from morphosim.engine.step_control import COLUMNS, PATIENCE, StepControl, Verdict, make_whole
from morphosim.errors import ToleranceError
from morphosim.kernels.linearised import SLOPE
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


def test_equal_steps_meet_an_end_none_longer_than_planned() -> None:
    control = StepControl(Numerics(tolerance=10.0))
    for planned in (1, 7, 64, 1000):
        for most in (1, 2, 63, 64, 65, 200, 1023, 10**9):
            left, taken = most, []
            while left and len(taken) < 5:
                control.planned = planned
                taken.append(control.fit(left, fresh=False))
                left -= taken[-1]
            assert max(taken) <= planned
            if not left:
                assert len(taken) == -(-most // planned), "no more than needed"
                assert max(taken) - min(taken) <= 1


def test_steps_without_history_are_short() -> None:
    for tolerance, first in ((1000.0, 16), (20.0, 16), (5.0, 8), (0.001, 1)):
        control = StepControl(Numerics(tolerance=tolerance))
        assert control.fit(10**6, fresh=True) == control.first == first
        control.planned = 500
        assert control.fit(10**6, fresh=False) == 500
        assert control.fit(10**6, fresh=True) == first


@pytest.mark.parametrize("excess", [0.0, 1.0, 2.0, 2.5, 1e3, np.inf])
@pytest.mark.parametrize("reach", [0.0, 1.0, 1.2, 50.0, np.inf])
@pytest.mark.parametrize("ticks", [1, 2, 10, 1000])
def test_what_is_tried_again_is_shorter_and_not_by_too_much(
    ticks: int, excess: float, reach: float
) -> None:
    control = StepControl(Numerics(tolerance=10.0))
    control.planned = ticks
    shorter = control.shorter(ticks, excess, reach)
    if ticks == 1 or (excess <= 2 and reach <= 1):
        assert shorter is None
        assert control.planned == ticks
    else:
        assert shorter is not None
        assert max(1, int(0.2 * ticks)) <= shorter <= max(1, int(0.64 * ticks)) < ticks
        assert control.planned == shorter


def test_the_length_goes_with_the_root_of_the_error_and_with_the_way() -> None:
    """The error of a step goes with its square, the way in proportion."""
    control = StepControl(Numerics(tolerance=10.0))
    assert control.shorter(1000, 9.0, 0.0) == int(0.9 / 3 * 1000)
    assert control.shorter(1000, 0.0, 1.25) == int(0.9 * 0.4 * 1000)
    for ticks, excess, reach, after in (
        (100, 1.0, 0.0, 90),  # just met
        (100, 4.0, 0.0, 45),
        (100, 0.0, 1.0, 50),  # half a lattice spacing
        (100, 0.75, 0.0, 100),  # a little longer would do: no change
        (100, 0.5, 0.0, 128),
        (100, 0.0, 0.0, 140),
        (1, 0.0, 0.0, 2),
        (1, 100.0, 0.0, 1),
        (1000, 0.0, 0.0, LONGEST * PARTS),
        (1, np.inf, np.inf, 1),
    ):
        control.planned = ticks
        control.plan(ticks, excess, reach)
        assert control.planned == after, (ticks, excess, reach)


def test_only_steps_that_cannot_be_shorter_count_as_missed() -> None:
    control = StepControl(Numerics(tolerance=10.0))
    for expected in (1, 2, 3):
        control.plan(1, 2.5, 0.0)
        assert control.missed == expected
    control.plan(1, 1.9, 0.0)
    assert control.missed == 0


# --- what a step has shown -----------------------------------------------------------------------


def judged(control: StepControl, changes: list[list[float]], ticks: int, **columns: Any) -> Verdict:
    """Of two cells, after a step of 32 ticks."""
    table = CellTable((*COLUMNS, Column("fresh", bool)))
    table.add({"name": ["a", "b"]} | columns, ["", ""])
    return control.judge(np.array(changes), ticks, 32, 0.01, table, np.arange(2))


def test_speed_and_acceleration_are_those_of_an_interface() -> None:
    """One that moves as x = v t + a t²/2 misses its extrapolation by a h (h + h') / 2."""
    numerics = Numerics(tolerance=10.0, dt=64.0)  # ticks of 1
    h, before, v, a, slope = 20.0, 32.0, 0.003, 1e-5, 7.0
    missed, moved = a * h * (h + before) / 2, v * h
    changes = [[slope * missed**2, slope * moved**2, slope], [0.0, 0.0, 0.0]]
    verdict = judged(StepControl(numerics), changes, 20, acceleration=[a, 0.0])
    np.testing.assert_allclose(verdict.speed, [v, 0])
    np.testing.assert_allclose(verdict.acceleration, [a, 0])
    np.testing.assert_allclose(verdict.error, [0.01 * missed, 0], err_msg="of stabilisation alone")
    np.testing.assert_allclose(verdict.allowed, 10 * 1e-5)
    assert verdict.excess == pytest.approx(0.01 * missed / 1e-4)
    other = judged(StepControl(numerics), changes, 20, acceleration=[3 * a, np.nan])
    of_differences = h * (h + before) / 6 * 2 * a / h
    np.testing.assert_allclose(other.error, [0.01 * missed + of_differences, 0])


def test_what_is_allowed_goes_with_the_way_and_in_short_steps_with_their_number() -> None:
    still, fast = [0.0, 0.0, 1.0], [0.0, (0.05 * 20) ** 2, 1.0]
    verdict = judged(StepControl(Numerics(tolerance=10.0, dt=64.0)), [still, fast], 20)
    np.testing.assert_allclose(verdict.allowed, [1e-4, 5e-4])  # 10 nm per 100; 10 per mille
    verdict = judged(StepControl(Numerics(tolerance=10.0, dt=6.4)), [still, still], 20)
    np.testing.assert_allclose(verdict.allowed, 1e-4 * 15 / 2)


def test_a_cell_without_history_tells_no_error() -> None:
    changes = [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    verdict = judged(StepControl(Numerics(tolerance=10.0)), changes, 16, fresh=[True, False])
    assert verdict.error[0] == 0
    assert verdict.error[1] > 0
    assert np.isnan(verdict.acceleration[0])


def test_a_cloud_has_a_quarter_of_the_slope_of_a_ball() -> None:
    radius, steepness = 4.0, 2.5
    ball = steepness * 4 * np.pi * radius**2
    changes = np.array([[1.0, 2.0, slope] for slope in (0.0, 0.9 * ball, 1e-3, 0.0)])
    targets = 4 / 3 * np.pi * np.array([radius, radius, radius / 2, np.nan]) ** 3
    make_whole(changes, steepness, targets)
    np.testing.assert_allclose(changes[:, SLOPE], ball * np.array([0.25, 0.9, 0.0625, 0.0]))
    np.testing.assert_array_equal(changes[:, :2], [[1.0, 2.0]] * 4)


# --- tolerances that cannot be met ---------------------------------------------------------------


def test_a_run_whose_tolerance_is_below_rounding_ends_and_says_so() -> None:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=2.5))
        for name, x in (("left", 0), ("right", 5.1))
    ]
    numerics = Numerics(tolerance=1e-7, threads=1)
    scene = Scene(cells=cells, physics=Physics(sigma=0.4), numerics=numerics, duration=1e4)
    simulation = Simulation(scene)
    with pytest.raises(ToleranceError, match=r"1e-07 is not met .* most, by a factor of") as caught:
        simulation.run()
    errors = simulation.engine.cells["step_error"]
    assert caught.value.cell == simulation.names[int(np.argmax(errors))]
    assert errors.max() > 2
    assert PATIENCE <= simulation.steps < PATIENCE + 20
    assert caught.value.time == simulation.time < 10
