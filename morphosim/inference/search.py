"""The search: fields settle in what is seen, all unknowns are varied, and improved; again."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from morphosim.errors import SimulationError
from morphosim.inference.estimate import Misfit
from morphosim.inference.offsets import FARTHEST
from morphosim.inference.pool import Pool
from morphosim.inference.trial import Frame, Interval, Model, Start

Floats = NDArray[np.float64]
TIMES = (80.0, 40.0)
"""*In silico* time that a single image is run for: where cells are at rest, and where they are not.
The longer, the more follows from an unknown, but also from what moves cells."""
RESTLESS = 0.03
"""Cells are not at rest where what a run leaves over is alike over `estimate.REACH` with more than
this, µm, in round `LOOK`."""
LOOK = 3
LEAST_ROUNDS, MOST_ROUNDS = 4, 8
SETTLINGS = 2
"""How often fields settle and are moved back in each round."""
LARGEST = 0.5
"""An unknown changes by no more in a round, in the units of the vector."""
INSIDE = 1e-6
"""A search begins so far within its bounds."""
EVALUATIONS = 2
"""Evaluations of the sum of squares in a round: another improvement begins with settled fields."""
CLOSE, SURE = 0.02, 0.3
"""Rounds end when no unknown has changed by more than the first, or this share of its
uncertainty."""


@dataclass(frozen=True, kw_only=True)
class State:
    """How far a search has come.

    Attributes
    ----------
    round : int
        Rounds done.
    vector : (n,) the unknowns
    starts : of each frame
    time : float
        *In silico* time that a single image is run for.
    given : bool
        Whether this time is to stay.
    offsets : (K,) and slopes (K, n)
        At the vector, µm.
    change : float
        Largest change of the last round, over what ends the search.
    history : list of vectors
    """

    round: int
    vector: Floats
    starts: Sequence[Start | None]
    time: float
    given: bool
    offsets: Floats = field(default_factory=lambda: np.zeros(0))
    slopes: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    change: float = np.inf
    history: Sequence[Floats] = ()

    @property
    def done(self) -> bool:
        """Whether the search has come to its end."""
        return (self.round >= LEAST_ROUNDS and self.change <= 1) or self.round >= MOST_ROUNDS


@dataclass(frozen=True, kw_only=True)
class Search:
    """What is searched, and by whom."""

    model: Model
    frames: Sequence[Frame]
    misfit: Misfit
    pool: Pool

    def advanced(self, state: State) -> State:
        """State after another round."""
        state = self.settled(state)
        state = self.varied(state)
        vector = self._improved(state)
        covariance, (_, smooth) = self.misfit.covariance(state.offsets, state.slopes)
        ends = np.maximum(CLOSE, SURE * np.sqrt(np.diag(covariance)))
        change = float((np.abs(vector - state.vector) / ends).max())
        restless = state.round == LOOK and not state.given and smooth > RESTLESS
        return replace(
            state, round=state.round + 1, vector=vector, history=[*state.history, vector],
            time=TIMES[1] if restless else state.time, change=np.inf if restless else change,
        )  # fmt: skip

    def timed(self, state: State) -> Model:
        """The model, with the time of a state."""
        return replace(self.model, time=state.time)

    def settled(self, state: State) -> State:
        """State whose fields have settled with its unknowns."""
        items = [(k, state.starts[k], state.vector) for k in range(len(self.frames))]
        starts = self.pool.map(_settled, (self.model, self.frames), items)
        return replace(state, starts=starts)

    def varied(self, state: State) -> State:
        """State with offsets and slopes."""
        steps = self.model.unknowns.steps
        offsets, *changed = self._missed(state, [state.vector, *(state.vector + np.diag(steps))])
        changes = [(other - offsets) / h for other, h in zip(changed, steps, strict=True)]
        return replace(state, offsets=offsets, slopes=np.stack(changes, axis=1))

    def _improved(self, state: State) -> Floats:
        """The vector after a step of Levenberg and Marquardt's, within its bounds."""
        from scipy.optimize import least_squares

        def rows(vector: Floats) -> Floats:
            if np.array_equal(vector, state.vector):
                offsets = state.offsets
            else:
                (offsets,) = self._missed(state, [vector])
            return self.misfit.rows(offsets, vector)

        low = np.maximum(self.model.unknowns.lowest, state.vector - LARGEST)
        slopes = self.misfit.slopes(state.slopes)

        def derivative(_: Floats) -> Floats:
            return slopes

        found = least_squares(
            rows, np.maximum(state.vector, low + INSIDE), jac=derivative,
            bounds=(low, state.vector + LARGEST), max_nfev=EVALUATIONS,
        )  # fmt: skip
        return np.asarray(found.x)

    def _missed(self, state: State, vectors: Sequence[Floats]) -> list[Floats]:
        """Offsets (K,) of all frames after runs, for each vector."""
        intervals = intervals_of(self.frames, state.starts)
        count = len(intervals)
        items = [(k, vector) for vector in vectors for k in range(count)]
        found = self.pool.map(_missed, (self.timed(state), intervals), items)
        return [np.concatenate(found[k : k + count]) for k in range(0, len(found), count)]


def intervals_of(frames: Sequence[Frame], starts: Sequence[Start | None]) -> list[Interval]:
    """What runs are compared with: a still image with itself, else each image but the first."""
    pairs = [(frame, start) for frame, start in zip(frames, starts, strict=True) if start]
    if len(pairs) == 1:
        return [Interval(*pairs[0])]
    return [Interval(*after, before=before) for before, after in pairwise(pairs)]


def _settled(
    shared: tuple[Model, Sequence[Frame]], item: tuple[int, Start | None, Floats]
) -> Start:
    (model, frames), (k, start, vector) = shared, item
    start = model.begun(frames[k], vector) if start is None else start
    for _ in range(SETTLINGS):
        start = model.settled(frames[k], start, vector)
    return start


def _missed(shared: tuple[Model, Sequence[Interval]], item: tuple[int, Floats]) -> Floats:
    """Offsets; as large as can be where the cells do not stand what is tried."""
    (model, intervals), (k, vector) = shared, item
    try:
        return model.missed(intervals[k], vector)
    except SimulationError:
        return np.full(len(intervals[k].frame.patches.area), FARTHEST)
