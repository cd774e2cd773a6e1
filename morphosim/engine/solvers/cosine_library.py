"""The implicit step by the cosine transforms of a library, FFTW or SciPy, box by box."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from morphosim.engine.solvers.cosine_transforms import (
    BoxTransform,
    CosineTables,
    FFTWTransform,
    SciPyTransform,
    transform_cost,
)
from morphosim.engine.solvers.solver import FixedSteps, MostOfAll, StepState
from morphosim.kernels.step import accept_all, prepare_all
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics

Integers = NDArray[np.int64]


class LibrarySolver(FixedSteps):
    """See `Solver`."""

    on_band = False

    def __init__(self, numerics: Numerics, dtype: np.dtype, threads: int) -> None:
        self.tables = CosineTables(numerics, dtype)
        self._libraries = [
            _make_library(numerics.transform, dtype) for _ in range(threads)
        ]  # one per thread: an FFTW plan must not be shared
        self._rhs = np.zeros(0, dtype)

    @property
    def nbytes(self) -> int:
        """See `Solver`."""
        return self._rhs.nbytes

    def set_up(
        self, physics: Physics, tensions: NDArray[np.float64], present: NDArray[np.float64],
        explicit_rate: float,
    ) -> None:  # fmt: skip
        """See `Solver`."""

    def lay_out(self, shape: NDArray[np.int64]) -> None:
        """See `Solver`."""
        self.tables.require(shape)

    def cost(self, shape: Integers) -> NDArray[np.float64]:
        """See `Solver`."""
        return transform_cost(shape)

    def advance(self, state: StepState, most_of_all: MostOfAll) -> None:
        """See `Solver`."""
        pool, schedule, workspace = state.pool, state.schedule, state.workspace
        if len(self._rhs) != len(pool.phi):
            self._rhs = np.zeros(len(pool.phi), self._rhs.dtype)
        prepare_all(
            *state.acting(), state.stencil, state.later, state.first, state.limits.half, self._rhs,
            *state.coupling.uses,
        )  # fmt: skip
        with ThreadPoolExecutor(len(self._libraries)) as threads:
            tasks = [
                threads.submit(self._solve, cells, state, library)
                for cells, library in zip(schedule.lists(), self._libraries, strict=True)
            ]
            for task in tasks:
                task.result()
        accept_all(
            schedule.shares, schedule.order, pool.phi, self._rhs, pool.boxes, state.limits,
            workspace.room, pool.surveys,
        )  # fmt: skip

    def _solve(self, cells: Integers, state: StepState, library: BoxTransform) -> None:
        """Implicit solve of some cells in the pool `_rhs`."""
        for i in cells.tolist():
            scheme = state.first if state.terms.fresh[i] else state.later
            rhs = state.pool.box(i, self._rhs)
            spectrum = library.forward(rhs)
            x, y, z = (self.tables.symbol(int(n)) for n in state.pool.shape[i])
            spectrum /= scheme.lhs + np.asarray(
                state.terms.gamma[i] * (x[:, None, None] + y[None, :, None] + z[None, None, :])
            )
            rhs[:] = library.inverse(spectrum)


def _make_library(transform: str, dtype: np.dtype) -> BoxTransform:
    return FFTWTransform(dtype) if transform == "pyfftw" else SciPyTransform()
