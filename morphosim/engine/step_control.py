"""Error control: how long the next step may be, from how far the last one missed.

A step of the scheme "linearised" moves the interface from its extrapolation φ* by d, the root mean
square of u / |∇φ*|. For steps of h after one of h' this is the acceleration a = 2 d / (h (h + h')).
It tells the two errors in the interface's velocity: that of backward differences, h (h + h') / 6
times the change of a in time, and that of the stabilisation, s k² d / τ, where k² = 0.4 c is the
share of -Δ in a shift of the interface.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_table import CellTable
from morphosim.kernels.linearised import MISSED, MOVED, SLOPE
from morphosim.numerics.parameters import Numerics

Floats = NDArray[np.float64]

import os
SLOW = float(os.environ.get("SL","0.01"))
"""Velocity, µm per unit of time, up to which the tolerance is absolute: 1 µm in 100 units."""
import os
X0 = float(os.environ.get("X0", "15"))
SAFETY = 0.9
"""Steps are chosen for this share of the length that would just meet the tolerance."""
MOST_ERROR = 2.0
"""A step whose error is this many times the tolerance is tried again, shorter."""
GROWTH = 1.4
"""Largest next step, in those of the last."""
STEADY = 1.1
"""A step that could be longer by less than this stays as it is."""
LEAST, MOST_SHRINK = 0.2, 0.7
"""By how much a step is shortened that is tried again."""
FARTHEST = 0.5
"""Farthest that an interface may move in a step, in lattice spacings: the band follows by a row."""


@dataclass
class Verdict:
    """What a tried step has shown.

    Attributes
    ----------
    error : (N,) error in velocity of each cell, µm per unit of time
    speed : (N,) velocity of its interface, root mean square
    acceleration : (N,)
    excess : float
        Largest error of any cell, in those that are allowed.
    reach : float
        Farthest that any interface moves, in lattice spacings.
    """

    error: Floats
    speed: Floats
    acceleration: Floats
    excess: float
    reach: float


class StepControl:
    """Chooses the lengths of steps, in ticks.

    Parameters
    ----------
    numerics : Numerics
        With a tolerance.

    Attributes
    ----------
    planned : int
        Length of the next step.
    """

    def __init__(self, numerics: Numerics) -> None:
        assert numerics.tolerance is not None
        self._tick, self._spacing = numerics.tick, numerics.spacing
        self._allowed = numerics.tolerance * 1e-5
        self._first, self._longest = numerics.first_ticks, numerics.longest_ticks
        self.planned = self._first

    def begin(self) -> int:
        """Length of a step that some cells begin without history."""
        self.planned = min(self.planned, self._first)
        return self.planned

    def judge(
        self, changes: Floats, ticks: int, before: int, damped: float, cells: CellTable,
        stepped: NDArray[np.int64],
    ) -> Verdict:  # fmt: skip
        """Tell the error of a step of so many ticks, after one of `before`.

        Parameters
        ----------
        changes : (N, N_CHANGES) see `kernels.linearised`
        damped : float
            s k² / τ.
        """
        slope = np.maximum(changes[stepped, SLOPE], np.finfo(float).tiny)
        step, last = ticks * self._tick, before * self._tick
        missed = np.sqrt(changes[stepped, MISSED] / slope)
        speed = np.sqrt(changes[stepped, MOVED] / slope) / step
        acceleration = 2 * missed / (step * (step + last))
        fresh = cells["fresh"][stepped]
        known = cells["acceleration"][stepped]
        jerk = np.abs(acceleration - np.where(np.isnan(known), acceleration, known)) / step
        error = damped * missed + step * (step + last) / 6 * jerk
        error[fresh], acceleration[fresh] = 0.0, np.nan
        allowed = self._allowed * np.maximum(max(1, X0 / step), speed / SLOW)
        excess = float((error / allowed).max(initial=0.0))
        reach = float(speed.max(initial=0.0)) * step / self._spacing
        return Verdict(error, speed, acceleration, excess, reach)

    def shorter(self, ticks: int, verdict: Verdict | None) -> int:
        """Length to try instead; 0 if the step may be taken. None is a step that diverged."""
        if ticks == 1:
            return 0
        if verdict is None:
            share = LEAST
        elif verdict.excess > MOST_ERROR or verdict.reach > 2 * FARTHEST:
            share = SAFETY * min(verdict.excess**-0.5, FARTHEST / verdict.reach)
        else:
            return 0
        return max(int(ticks * min(max(share, LEAST), MOST_SHRINK)), 1)

    def plan(self, ticks: int, verdict: Verdict) -> int:
        """Plan the step after one of so many ticks that is taken."""
        tiny = 1e-6
        share = min(
            SAFETY * max(verdict.excess, tiny) ** -0.5, FARTHEST / max(verdict.reach, tiny), GROWTH
        )
        if 1 <= share < STEADY:
            share = 1.0
        wanted = int(np.ceil(ticks * share) if share > 1 else ticks * share)
        self.planned = min(max(wanted, 1), self._longest)
        return self.planned

    def fitted(self, ticks: int, most: int) -> int:
        """A length of at most so many ticks, such that equal steps meet the last of `most`."""
        return -(-most // -(-most // ticks))
