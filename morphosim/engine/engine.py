"""The engine: the state of all cells and the step that advances it."""

import heapq
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, NamedTuple

import numba
import numpy as np
import scipy.linalg.cython_blas  # noqa: F401  (the BLAS that Numba calls; loaded to be limited)
from numba import get_num_threads, set_num_threads
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from morphosim.cell_field import CellField
from morphosim.engine.box_pool import BoxPool, morton_order
from morphosim.engine.column_sums import Background, ColumnCover
from morphosim.engine.solvers.cosine_transforms import (
    BoxTransform,
    CosineTables,
    FFTWTransform,
    SciPyTransform,
)
from morphosim.geometry.confinement import Confinement
from morphosim.kernels import step as kernels
from morphosim.kernels.boxes import BAD, CORE, EDGE, FACE, N_SURVEYED, TOTAL
from morphosim.kernels.columns import accumulate
from morphosim.kernels.frames import frame_sizes
from morphosim.kernels.helmholtz import COLUMNS
from morphosim.kernels.layout import CellTerms, Limits, Scheme, Stencil
from morphosim.kernels.noise import normal_vectors
from morphosim.kernels.pairs import accumulate_pairs
from morphosim.kernels.stencils import COEFFICIENTS, LAPLACIAN_COEFFICIENTS
from morphosim.numerics.chebyshev import MORE_WITHOUT_HISTORY, largest_eigenvalue, sweep_roots
from morphosim.numerics.parameters import Numerics
from morphosim.numerics.schemes import coefficients
from morphosim.physics.confinement_repulsion import wall_repulsion
from morphosim.physics.interactions import Interactions
from morphosim.physics.parameters import Physics

RUNAWAY = 4.0
"""|φ| beyond this counts as divergence; sound fields stay between about -0.2 and 1.5."""
SHRINK_INTERVAL = 32
"""Steps between two looks for boxes that have become too large."""
MANY = 32
"""From so many cells per thread on, each thread takes a region of space: what neighbours share
stays in its cache. With fewer, balance counts more."""
DTYPES = {"single": np.float32, "double": np.float64}


class Society(NamedTuple):
    """What a step of some cells must know of all, so that it is the same wherever it is taken."""

    gamma: NDArray[np.float64]
    """Surface tensions: their mean is the walls', the stiffest cell sets the number of sweeps."""
    types: Sequence[str]
    """Types: their sums run apart where not all attract alike."""


class Engine:
    """State of a number of cells, and its advance in time.

    Parameters
    ----------
    physics, numerics, confinement
        See `Scene`.
    names, types : of the N cells
    gamma : (N,) surface tensions
    frozen : (N,) bool, cells that act on others and are not stepped
    fields : per cell, lattice origin and start field
    parents : names of the N cells' mothers, "" where there is none

    Attributes
    ----------
    pool : BoxPool
        The fields.
    steps : int
        Steps taken.
    fresh : bool
        Whether the next step has no history and is of first order.
    whole : bool
        Whether all cells are at the same step: false within a step, and for good if something
        breaks one off.
    face_peak : (N,) float64
        Certificate: largest |φ| seen on the faces of each cell's box, and on the edge of the band
        where the solver works on that alone.
    """

    def __init__(
        self,
        physics: Physics,
        numerics: Numerics,
        confinement: Confinement | None,
        names: Sequence[str],
        types: Sequence[str],
        gamma: NDArray[np.float64],
        frozen: NDArray[np.bool_],
        fields: Iterable[tuple[NDArray[np.int64], NDArray[np.floating]]],
        parents: Sequence[str] | None = None,
    ) -> None:
        self.physics, self.numerics, self.confinement = physics, numerics, confinement
        self.dtype = np.dtype(DTYPES[numerics.precision])
        self.workers = _checked_threads(numerics.worker_count)
        self.names, self.types = list(names), list(types)
        self.parents = [""] * len(self.names) if parents is None else list(parents)
        self.gamma, self.frozen = np.asarray(gamma, float), np.asarray(frozen, bool)
        self.ids = np.arange(len(self.names), dtype=np.uint64)
        self._next_id = len(self.names)
        self.steps = 0
        self.fresh = True
        self.whole = True
        self._real = self.dtype.type
        self._limits = Limits(*(self._real(v) for v in (numerics.box_tolerance, RUNAWAY, 0.5)))
        self._band_only = numerics.solver == "band" or numerics.scheme == "euler"
        self.pool = self._make_pool()
        self.pool.add(fields)
        self.pool.lost[:] = 0  # what is cut from start fields is no loss of the run
        self.face_peak = self.pool.surveys[:, EDGE].copy()
        self._stencil = _make_stencil(numerics.order, numerics.spacing, self.dtype)
        self._cosines = CosineTables(
            numerics.spacing, numerics.laplacian, numerics.order, self.dtype
        )
        self._libraries = [
            None if self._band_only else _make_library(numerics.transform, self.dtype)
            for _ in range(self.workers)
        ]  # one per thread: an FFTW plan must not be shared
        self._work = np.zeros((self.workers, kernels.N_FRAMES, 0), self.dtype)
        self._found = np.zeros((self.workers, 0, 2), np.int32)
        self._measured = np.zeros((self.workers, N_SURVEYED))
        self._pair_potential: NDArray[np.floating] | None = None
        self._rhs: NDArray[np.floating] | None = None
        self._controller = ThreadpoolController()
        self._relist()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def society(self) -> Society:
        """What a step must know of all cells of the simulation: here, of those of this engine."""
        return Society(self.gamma, self.types)

    @property
    def volumes(self) -> NDArray[np.float64]:
        """∫ φ of each cell, µm³."""
        return np.asarray(self.pool.surveys[:, TOTAL] * self.numerics.spacing**3)

    @property
    def core_volumes(self) -> NDArray[np.float64]:
        """Volume where φ exceeds 1/2, of each cell, µm³."""
        return np.asarray(self.pool.surveys[:, CORE] * self.numerics.spacing**3)

    @property
    def lost_volume(self) -> NDArray[np.float64]:
        """Certificate: ∫ φ that boxes and bands have cut off each cell since the start, µm³."""
        return np.asarray(self.pool.lost * self.numerics.spacing**3)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays that grow with the cells, but for short lists of columns."""
        columns = self._cover.nbytes if self._coupled else 0
        extra = sum(a.nbytes for a in (self._pair_potential, self._rhs) if a is not None)
        return self.pool.nbytes + columns + extra + self._work.nbytes

    @contextmanager
    def limited_threads(self) -> Iterator[None]:
        """Numba on `workers` threads, BLAS on one per thread of ours."""
        before = get_num_threads()
        set_num_threads(self.workers)
        try:
            with self._controller.limit(limits=1, user_api="blas"):
                yield
        finally:
            set_num_threads(before)

    def step(self, targets: NDArray[np.float64]) -> None:
        """Advance all cells by δt; `targets` (N,) are the volumes V(t) in µm³.

        Call it within `limited_threads`.
        """
        self.whole = False
        self._accumulate()
        self._fill_terms(targets)
        self._advance()
        self.fresh = False
        self.steps += 1
        np.maximum(self.face_peak, self.pool.surveys[:, EDGE], out=self.face_peak)
        self._refit()
        self.whole = True

    def contents(self) -> dict[str, NDArray]:
        """Copies of all arrays that the next step depends on; see `restore`."""
        return self.pool.contents() | {
            "ids": self.ids.copy(), "face_peak": self.face_peak.copy(),
            "next_id": np.array(self._next_id),
        }  # fmt: skip

    def restore(self, contents: Mapping[str, NDArray], steps: int, fresh: bool) -> None:
        """Go back to what `contents` gave, of an engine of the same cells, physics and numerics.

        From there on all steps are the same to the last bit, on the same kind of machine.
        """
        self.pool.restore(contents)
        self.ids, self.face_peak = np.array(contents["ids"]), np.array(contents["face_peak"])
        self._next_id = int(contents["next_id"])
        self.steps, self.fresh = steps, fresh
        self._relist()

    def diverged(self) -> NDArray[np.int64]:
        """Cells whose last step was refused: not finite, or beyond `RUNAWAY`."""
        return np.flatnonzero(self.pool.surveys[:, BAD] > 0)

    def vanished(self) -> NDArray[np.int64]:
        """Cells that are below 1/2 everywhere."""
        return np.flatnonzero(self.pool.surveys[:, CORE] == 0)

    def remove(self, i: int) -> None:
        """Take cell i out; the others keep their history."""
        self._drop(i)
        self._relist()

    def divide(
        self, i: int, names: tuple[str, str], types: tuple[str, str], halves: Sequence[CellField]
    ) -> None:
        """Replace cell i by two, which come last; the next step is of first order."""
        mother, gamma, frozen = self.names[i], self.gamma[i], self.frozen[i]
        self._drop(i)
        self.pool.add((half.origin, half.phi) for half in halves)
        self.names += names
        self.types += types
        self.parents += [mother, mother]
        self.gamma = np.append(self.gamma, [gamma, gamma])
        self.frozen = np.append(self.frozen, [frozen, frozen])
        self.ids = np.append(self.ids, np.arange(2, dtype=np.uint64) + np.uint64(self._next_id))
        self.face_peak = np.append(self.face_peak, self.pool.surveys[-2:, EDGE])
        self._next_id += 2
        self.restart()

    def describe(
        self, physics: Physics, types: Sequence[str], gamma: NDArray[np.float64],
        frozen: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        """Take other parameters; they hold from `refresh`, `restart` or `restore` on."""
        self.physics, self.types = physics, list(types)
        self.gamma, self.frozen = np.asarray(gamma, float), np.asarray(frozen, bool)

    def refresh(self) -> None:
        """Let hold what `describe` has said; the cells keep their history."""
        self._relist()

    def restart(self) -> None:
        """Forget the history: the next step is of first order (Eq. 8)."""
        self.fresh = True
        if self.pool.history is not None:
            self.pool.history[:] = 0
        self._relist()

    def _drop(self, i: int) -> None:
        self.pool.remove(i)
        del self.names[i], self.types[i], self.parents[i]
        for name in ("gamma", "frozen", "ids", "face_peak"):
            setattr(self, name, np.delete(getattr(self, name), i))

    def _make_pool(self) -> BoxPool:
        return BoxPool(self.dtype, self._limits, self.numerics.scheme == "bdf2", self._band_only)

    def _relist(self) -> None:
        """Set up all that depends on which cells there are."""
        self._set_terms()
        physics, numerics, society = self.physics, self.numerics, self.society
        walls = self.confinement is not None and physics.g_e > 0
        acts = physics.g > 0 or self._interactions.attracts
        self._coupled = walls or (len(society.gamma) > 1 and acts)
        tension = float(society.gamma.mean())
        background = (
            Background(
                wall_repulsion(self.confinement, physics.g_e, tension, numerics),
                numerics.spacing,
                self.dtype,
            )
            if walls and self.confinement is not None
            else None
        )
        self._cover = ColumnCover(self.dtype, self.workers, self._interactions.n_fields, background)
        self._relayout()

    def _set_terms(self) -> None:
        """Set up what each cell has of its own, and what pairs of cells have."""
        physics, n = self.physics, len(self)
        self._interactions = Interactions(
            physics.attraction, physics.g, self.names, self.types, self.dtype, self.parents,
            self.society.types,
        )  # fmt: skip
        kappa = np.array([physics.motility(kind) for kind in self.types])
        self._drift_scale = (-np.sqrt(self.numerics.dt) * kappa)[:, None]
        self._terms = CellTerms(
            gamma=self.gamma.astype(self.dtype),
            well=(4 * self.gamma * physics.c).astype(self.dtype),
            pressure=np.zeros(n, self.dtype),
            drift=np.zeros((n, 3), self.dtype) if kappa.any() else None,
            sweeps=np.zeros((n, 0), self.dtype),
        )
        self._normals = np.zeros((n, 3))
        self._weights: tuple[float, NDArray[np.floating]] | None = None

    def _relayout(self) -> None:
        """Set up all that depends on where boxes are and how large."""
        if not self._band_only:
            self._cosines.require(self.pool.shape)
        self._share_out()
        self._reserve()
        if self._coupled:
            self._cover.update(self.pool.origin, self.pool.shape)

    def _share_out(self) -> None:
        """Give each thread a list of cells of about the same work."""
        stepped = np.flatnonzero(~self.frozen)
        cost = self.pool.sizes()[stepped].astype(float)
        if not self._band_only:
            cost *= 200.0 + self.pool.shape[stepped].sum(axis=1)  # transforms grow with the axes
        if len(stepped) < MANY * self.workers:
            lists = _largest_first(cost, self.workers)
        else:
            along = morton_order(self.pool.origin[stepped])
            load = np.cumsum(cost[along])
            ends = np.searchsorted(load, load[-1] * np.arange(1, self.workers) / self.workers)
            lists = np.split(along, ends)
        self._order = stepped[np.concatenate(lists)]
        self._bounds = np.cumsum([0] + [len(cells) for cells in lists]).astype(np.int64)

    def _reserve(self) -> None:
        """Work space for the largest box, and pools that only some scenes need."""
        shape = self.pool.shape
        frames = frame_sizes(shape)
        size, planes = max(frames.max(), COLUMNS * shape.max()), shape[:, 0].max()
        if self._work.shape[2] < size:
            self._work = _aligned_zeros((self.workers, kernels.N_FRAMES, size), self.dtype)
        if self._found.shape[1] < planes:
            self._found = np.zeros((self.workers, planes, 2), np.int32)
        pairs = self._interactions.pairs
        if pairs is not None:
            sizes = np.where(np.diff(pairs.start) > 0, frames, 0)
            pairs.frame_start[:] = np.where(sizes > 0, np.cumsum(sizes) - sizes, -1)
            self._pair_potential = self._resized(self._pair_potential, int(sizes.sum()))
        if self._libraries[0] is not None:
            self._rhs = self._resized(self._rhs, len(self.pool.phi))

    def _resized(self, pool: NDArray[np.floating] | None, length: int) -> NDArray[np.floating]:
        """A pool of this length: the one given, if it fits."""
        if pool is not None and len(pool) == length:
            return pool
        return np.zeros(length, self.dtype)

    def _accumulate(self) -> None:
        """Sums over cells of the present state."""
        if not self._coupled:
            return
        phi, boxes = self.pool.phi, self.pool.boxes
        accumulate(
            self._cover.lists, phi, boxes, self._interactions.interaction, self._cover.columns
        )
        if self._interactions.pairs is not None:
            accumulate_pairs(
                self._bounds, self._order, self._interactions.pairs, phi, boxes,
                self._pair_potential,
            )  # fmt: skip

    def _fill_terms(self, targets: NDArray[np.float64]) -> None:
        """Volume pressure (Eq. 2, 10) and motility drift (Eq. S3) of this step."""
        physics = self.physics
        if physics.volume_constraint == "relative":
            self._terms.pressure[:] = physics.volume_strength * (1 - self.volumes / targets)
        else:
            self._terms.pressure[:] = physics.volume_strength * (targets - self.volumes)
        if self._terms.drift is not None:
            normal_vectors(
                np.uint64(self.numerics.seed), np.uint64(self.steps), self.ids, self._normals
            )
            np.multiply(
                self._normals, self._drift_scale, out=self._terms.drift, casting="same_kind"
            )

    def _advance(self) -> None:
        """Force, implicit solve and survey of all cells that are stepped."""
        numbers = coefficients(self.numerics, self.physics.tau, self.fresh)
        scheme = Scheme(**{name: self._real(value) for name, value in numbers.items()})
        if self._libraries[0] is not None:
            self._advance_with_library(scheme)
        elif self._band_only:
            terms = self._terms._replace(sweeps=self._sweeps(numbers["lhs"]))
            kernels.step_band(
                *self._acting(terms), self._work, self._found, self._measured, self._stencil,
                scheme, self._limits, self.pool.surveys, self.pool.lost, *self._uses(),
            )  # fmt: skip
        else:
            kernels.step_transform(
                *self._acting(self._terms), self._work, self._found, self._measured,
                self._stencil, scheme, self._cosines.arrays, self._limits, self.pool.surveys,
                *self._uses(),
            )  # fmt: skip

    def _acting(self, terms: CellTerms) -> tuple[Any, ...]:
        """What all step kernels begin with: cells, fields, and what acts on them."""
        pairs = self._interactions.pairs
        return (
            self._bounds, self._order, self.pool.phi, self.pool.history, self.pool.boxes, terms,
            self._interactions.interaction, self._cover.columns if self._coupled else None,
            None if pairs is None else pairs.frame_start,
            None if pairs is None else self._pair_potential,
        )  # fmt: skip

    def _sweeps(self, lhs: float) -> NDArray[np.floating]:
        """(N, sweeps) weights of the sweeps of this step."""
        if self._weights is None or self._weights[0] != lhs:
            self._weights = lhs, self._make_sweeps(lhs)
        return self._weights[1]

    def _make_sweeps(self, lhs: float) -> NDArray[np.floating]:
        numerics = self.numerics
        if numerics.scheme == "euler":
            return np.full((len(self), 1), numerics.dt / self.physics.tau, self.dtype)
        extrapolates = numerics.scheme == "bdf2" and not self.fresh
        top = largest_eigenvalue(numerics.order, numerics.spacing)
        sweeps = numerics.sweeps + (0 if extrapolates else MORE_WITHOUT_HISTORY)
        tensions = np.unique(self.society.gamma)
        index = np.searchsorted(tensions, self.gamma)
        while True:
            roots = [
                sweep_roots(lhs, gamma * self.physics.c, gamma * top, sweeps)
                for gamma in tensions.tolist()
            ]
            if max(map(len, roots)) == sweeps:
                return (1 / np.array(roots))[index].astype(self.dtype)
            sweeps = max(map(len, roots))

    def _uses(self) -> tuple[bool | None, bool | None]:
        """Whether there is repulsion, and attraction; None compiles the branch away."""
        repulsion = True if self._coupled else None
        psi = True if self._coupled and self._interactions.attracts else None
        return repulsion, psi

    def _advance_with_library(self, scheme: Scheme) -> None:
        """As `_advance`, with the cosine transforms of a library, box by box."""
        boxes, pool = self.pool.boxes, self.pool
        kernels.prepare_all(
            *self._acting(self._terms), self._work, self._stencil, scheme, self._limits.half,
            self._rhs, *self._uses(),
        )  # fmt: skip
        with ThreadPoolExecutor(self.workers) as threads:
            lists = [self._order[a:b] for a, b in zip(self._bounds, self._bounds[1:], strict=False)]
            tasks = [
                threads.submit(self._solve, cells, scheme, library)
                for cells, library in zip(lists, self._libraries, strict=True)
            ]
            for task in tasks:
                task.result()
        kernels.accept_all(
            self._bounds, self._order, pool.phi, self._rhs, boxes, self._limits, self._found,
            self._measured, pool.surveys,
        )  # fmt: skip

    def _solve(
        self, cells: NDArray[np.int64], scheme: Scheme, library: BoxTransform | None
    ) -> None:
        """Implicit solve of some cells in the pool `_rhs`."""
        assert library is not None
        for i in cells.tolist():
            rhs = self.pool.box(i, self._rhs)
            spectrum = library.forward(rhs)
            spectrum /= scheme.lhs + self._symbol(i)
            rhs[:] = library.inverse(spectrum)

    def _symbol(self, i: int) -> NDArray[np.floating]:
        """γ (λx + λy + λz) of cell i's box."""
        x, y, z = (self._cosines.symbol(int(n)) for n in self.pool.shape[i])
        return np.asarray(
            self._terms.gamma[i] * (x[:, None, None] + y[None, :, None] + z[None, None, :])
        )

    def _refit(self) -> None:
        """Move and resize boxes whose band has come to a face, and now and then too large ones."""
        if self.steps % SHRINK_INTERVAL == 0:
            cells = self._order
        else:
            touching = self.pool.surveys[:, FACE] > self._limits.tolerance
            cells = np.flatnonzero(touching & ~self.frozen)
        if len(cells) and len(self.pool.refit(cells)):
            self._relayout()


def _largest_first(cost: NDArray[np.float64], workers: int) -> list[NDArray[np.int64]]:
    """Items shared out, the largest first, each to whom has least."""
    lists: list[list[int]] = [[] for _ in range(workers)]
    loads = [(0.0, w) for w in range(workers)]
    for i in np.argsort(-cost, kind="stable").tolist():
        load, worker = heapq.heappop(loads)
        lists[worker].append(i)
        heapq.heappush(loads, (load + cost[i], worker))
    return [np.array(items, np.int64) for items in lists]


def _aligned_zeros(shape: tuple[int, ...], dtype: np.dtype) -> NDArray[np.floating]:
    """Zeros that begin on a cache line."""
    line = 64 // dtype.itemsize
    values = np.zeros(int(np.prod(shape)) + line, dtype)
    skip = -values.ctypes.data % 64 // dtype.itemsize
    return values[skip : skip + int(np.prod(shape))].reshape(shape)


def _checked_threads(threads: int) -> int:
    if threads > numba.config.NUMBA_NUM_THREADS:
        message = (
            f"numerics.threads = {threads} is more than the {numba.config.NUMBA_NUM_THREADS} that "
            "Numba was started with; take fewer, or set NUMBA_NUM_THREADS before the start"
        )
        raise ValueError(message)
    return threads


def _make_stencil(order: int, spacing: float, dtype: np.dtype) -> Stencil:
    first = [dtype.type(w / spacing) for w in COEFFICIENTS[order]]
    second = [dtype.type(w / spacing**2) for w in LAPLACIAN_COEFFICIENTS[order]]
    absent = [None] * (3 - order // 2)
    return Stencil(*first, *absent, *second, *absent)


def _make_library(transform: str, dtype: np.dtype) -> BoxTransform | None:
    if transform == "pyfftw":
        return FFTWTransform(dtype)
    return SciPyTransform() if transform == "scipy" else None
