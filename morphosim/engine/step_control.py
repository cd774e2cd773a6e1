"""Error control: how long the next step may be, from how far the last one missed.

A step of the scheme "linearised" moves the interface from its extrapolation φ* by d, the root mean
square of u / |∇φ*|. For a step h after one of h' that is the acceleration a = 2 d / (h (h + h')).
It tells the two errors in the interface's velocity: that of backward differences, h (h + h') / 6
times the rate at which a changes, and that of the stabilisation, s k² d / τ, where k² = 0.4 c is
what -Δ is for a shift of the interface.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_table import CellTable, Column
from morphosim.kernels.linearised import MISSED, MOVED, SQUARE
from morphosim.numerics.parameters import LONGEST, PARTS, Numerics

Floats = NDArray[np.float64]

COLUMNS = (
    Column("acceleration", default=np.nan, inherits=False, optional=True),
    Column("swept", optional=True),
    Column("step_error", inherits=False, optional=True),
)
"""Of each cell's interface, root mean square: `acceleration` in the last step, µm per unit of time
squared; `swept`, what has been missed where a fast cell's neighbours sweep along it, µm. And
`step_error` of the last step, in errors that the tolerance allows.
"""
NANOMETRES = 1e-5
"""1 nm in 100 units of time, in µm per unit."""
SLOW = 0.01
"""Velocity up to which the tolerance is absolute: 1 µm in 100 units, in µm per unit."""
SWEEP = 0.03
"""Velocity of a cell from which on all that its steps miss is an error that stays, µm per unit."""
STRIDE = 15.0
"""In steps shorter than this the tolerance is one of place: that of a step of this length."""
SAFETY = 0.9
"""Steps are chosen for this share of the length that would just meet the tolerance."""
MOST_EXCESS = 2.0
"""A step whose error is this many times the tolerance is tried again, shorter."""
GROWTH, STEADY = 1.4, 1.1
"""Most by which a step is planned longer than the last was, and least: below, it stays."""
MOST_RATIO = 2.0
"""Most by which a step is longer than the last, where that was shorter than planned to meet an end:
two steps in place of three, or one of two, could not come by `GROWTH` alone."""
LEAST_SHARE = 0.2
"""Least length of a step that is tried again, in the length before."""
FARTHEST = 0.5
"""Farthest that interfaces should move in a step, in lattice spacings: the band follows by one."""
FIRST, FIRST_TOLERANCE = PARTS // 4, 20.0
"""Ticks of the first step, and of one that some cells begin without history, from this tolerance
on, nm. It is of first order, and tells no error: with the tolerance it falls as its square does."""
WHOLE = 0.25
"""Least Σ |∇φ*|² of a cell, in that of a ball of its target volume, of which no whole cell has less
than 0.6 unless it is to grow."""
PATIENCE = 100
"""Steps of one tick that may miss the tolerance, one after the other, before the run ends."""


class Verdict(NamedTuple):
    """What a tried step has shown.

    Attributes
    ----------
    error : (n,) error in the velocity of each cell's interface, µm per unit of time
    missed : (n,) how far each interface is from its extrapolation, µm
    speed, acceleration : (n,) of each cell's interface
    allowed : (n,) error allowed
    """

    error: Floats
    missed: Floats
    speed: Floats
    acceleration: Floats
    allowed: Floats

    @property
    def shares(self) -> Floats:
        """(n,) errors, in those that are allowed."""
        return self.error / self.allowed

    @property
    def excess(self) -> float:
        """Largest error, in those that are allowed."""
        return float(self.shares.max(initial=0.0))


def make_whole(changes: Floats, steepness: float, targets: Floats) -> None:
    """Give cells that vanish a share of the slope that they would have as balls.

    As clouds they have next to none: their φ may be right, and their interfaces go anywhere.

    Parameters
    ----------
    changes : (n, N_CHANGES) see `kernels.linearised`; updated
    steepness : Σ |∇φ*|² per µm² of interface
    targets : (n,) target volumes, µm³, or nan
    """
    ball = np.cbrt(36 * np.pi * targets**2)
    changes[:, SQUARE] = np.fmax(changes[:, SQUARE], WHOLE * steepness * ball)


def swept(missed: Floats, step: float, damped: float, speeds: Floats) -> Floats:
    """What the stabilisation of a step makes of what neighbours do that sweep along a cell, µm.

    Where cells come to rest, such errors heal, and what is left is the lag of the cell's place
    (`accuracy`). Where they go on past each other it stays: the more, the faster. An interface that
    is off by so much, root mean square, is that of a cell which is off by √3 times as much.

    Parameters
    ----------
    missed : (n,) see `Verdict`
    step : float
    damped : s k² / τ
    speeds : (n,) of the cells' centroids, µm per unit of time
    """
    return np.asarray(3**0.5 * damped * missed * step * np.minimum(speeds / SWEEP, 1) ** 1.5)


class StepControl:
    """Chooses the lengths of steps, in ticks.

    Parameters
    ----------
    numerics : Numerics
        With a tolerance.

    Attributes
    ----------
    first : int
        Most ticks of a step that some cells begin without history.
    planned : int
        Length of the next step.
    missed : int
        Steps of one tick, up to the last, that have missed the tolerance one after the other.
    """

    def __init__(self, numerics: Numerics) -> None:
        self._tick, self._spacing = numerics.tick, numerics.spacing
        tolerance = numerics.tolerance or 0.0
        self._allowed = tolerance * NANOMETRES
        self._first = max(int(FIRST * min(tolerance / FIRST_TOLERANCE, 1.0) ** 0.5), 1)
        self.missed = 0
        self.hold(False)
        self.planned = self.first

    def hold(self, noise: bool) -> None:
        """Keep to steps of δt where there is noise, from the first on; let them be free otherwise.

        After a shorter one, which ends at a save say, they grow to δt again as others do.
        """
        self._longest = PARTS if noise else LONGEST * PARTS
        self.first = PARTS if noise else self._first
        if noise and self.planned == self._first:
            self.planned = PARTS

    def fit(self, most: int, fresh: bool) -> int:
        """Length of the next step, of which equal ones meet the last of `most` ticks.

        `fresh` tells whether some cell begins without history.
        """
        if fresh:
            self.planned = min(self.planned, self.first)
        return -(-most // -(-most // self.planned))

    @np.errstate(invalid="ignore", over="ignore")  # what runs away is told by its survey
    def judge(self, changes: Floats, ticks: int, before: int, damped: float, cells: CellTable,
              rows: NDArray[np.int64]) -> Verdict:  # fmt: skip
        """Tell the errors of a step of so many ticks, after one of `before`.

        Parameters
        ----------
        changes : (N, N_CHANGES) see `kernels.linearised`
        damped : s k² / τ
        cells : CellTable
        rows : (n,) the cells that are stepped
        """
        step, last = ticks * self._tick, before * self._tick
        slope = np.maximum(changes[rows, SQUARE], np.finfo(float).tiny)
        missed = np.sqrt(changes[rows, MISSED] / slope)
        speed = np.sqrt(changes[rows, MOVED] / slope) / step
        acceleration = 2 * missed / (step * (step + last))
        known = cells["acceleration"][rows]
        jerk = np.abs(acceleration - np.where(np.isnan(known), acceleration, known)) / step
        error = damped * missed + step * (step + last) / 6 * jerk
        fresh = cells["fresh"][rows]
        error[fresh], acceleration[fresh] = 0.0, np.nan
        allowed = self._allowed * np.maximum(max(1.0, STRIDE / step), speed / SLOW)
        return Verdict(error, missed, speed, acceleration, allowed)

    def reach(self, verdict: Verdict, ticks: int) -> float:
        """Farthest that any interface moves in the step, in lattice spacings."""
        return float(verdict.speed.max(initial=0.0)) * ticks * self._tick / self._spacing

    def shorter(self, ticks: int, excess: float, reach: float) -> int | None:
        """Length to try instead of a step of so many ticks; None if it may be taken."""
        if ticks == 1 or (excess <= MOST_EXCESS and reach <= 2 * FARTHEST):
            return None
        share = SAFETY * min(excess**-0.5 if excess > 0 else 1.0, FARTHEST / max(reach, FARTHEST))
        self.planned = max(int(ticks * max(share, LEAST_SHARE)), 1)
        return self.planned

    def plan(self, ticks: int, excess: float, reach: float) -> None:
        """Plan the step after one of so many ticks, at most `planned`, that is taken."""
        self.missed = self.missed + 1 if excess > MOST_EXCESS else 0
        tiny = np.finfo(float).tiny
        longest = min(GROWTH * max(self.planned / ticks, 1.0), MOST_RATIO)
        share = min(SAFETY * max(excess, tiny) ** -0.5, FARTHEST / max(reach, tiny), longest)
        if 1 <= share < STEADY:
            share = 1.0
        wanted = int(np.ceil(ticks * share)) if share > 1 else int(ticks * share)
        self.planned = min(max(wanted, 1), self._longest)
