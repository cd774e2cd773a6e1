"""The same cells by other means: the published scheme on full grids, and py-pde."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy import fft
from threadpoolctl import threadpool_limits

from morphosim import Scene
from morphosim.cell_field import CellField, centroid
from morphosim.geometry.phase_field import lattice_field
from morphosim.physics.confinement_repulsion import wall_repulsion
from morphosim.scene.stability import explicit_rate

AXES = (1, 2, 3)
CUT = 0.02
"""Centroids are those of φ above this, as the published program takes them."""
LOST = 1e-3
"""Largest share of a start field that may lie beyond the full grid."""


@dataclass(frozen=True)
class Problem:
    """A scene on one full grid, whose first point is the origin.

    Attributes
    ----------
    scene : Scene
    phi : (N, nx, ny, nz) start fields
    wall : (nx, ny, nz), g_e φ_e² as the engine places it on the lattice
    sigma : (N, N), sigma[j, i] the pull of j on i
    targets : (N,) volumes, µm³
    """

    scene: Scene
    phi: np.ndarray
    wall: np.ndarray
    sigma: np.ndarray
    targets: np.ndarray

    @property
    def h(self) -> float:
        """Spacing, µm."""
        return self.scene.numerics.spacing


def problem(scene: Scene, size: tuple[float, float, float]) -> Problem:
    """A scene on a full grid of `size` µm, from the start fields that the engine lays out."""
    physics, h = scene.physics, scene.numerics.spacing
    shape = tuple(round(length / h) for length in size)
    phi = np.zeros((len(scene.cells), *shape))
    for whole, cell in zip(phi, scene.cells, strict=True):
        scale = physics.interface_scale
        origin, part = lattice_field(cell.shape, cell.name, scale, h, cell.start_volume)
        ends = zip(origin, part.shape, shape, strict=True)
        there = [slice(max(o, 0), min(o + n, m)) for o, n, m in ends]
        here = tuple(slice(s.start - o, s.stop - o) for s, o in zip(there, origin, strict=True))
        whole[tuple(there)] = part[here]
        if whole.sum() < (1 - LOST) * part.sum():
            message = f"cell {cell.name!r} does not fit into a grid of {size} µm"
            raise ValueError(message)
    points = np.meshgrid(*(h * np.arange(n) for n in shape), indexing="ij", sparse=True)
    gamma = float(np.mean(scene.tensions))
    assert scene.confinement is not None
    return Problem(
        scene=scene,
        phi=phi,
        wall=wall_repulsion(scene.confinement, physics.g_e, gamma, scene.numerics)(*points),
        sigma=physics.attraction.matrix(scene.names, scene.types, scene.parents),
        targets=np.array([cell.target_volume(0.0) for cell in scene.cells]),
    )


def cut_centroids(fields: Sequence[CellField], h: float) -> np.ndarray:
    """(N, 3) centroids of φ > CUT, µm."""
    cut = [CellField(f.name, f.origin, np.where(f.phi > CUT, f.phi, 0)) for f in fields]
    return np.array([centroid(f, h) for f in cut])


def grid_centroids(phi: np.ndarray, h: float) -> np.ndarray:
    """The same of fields on the full grid."""
    return cut_centroids([CellField("", np.zeros(3, np.int64), cell) for cell in phi], h)


class FullGrid:
    """The published scheme (Eq. 9, first step by Eq. 8): N periodic grids, Fourier derivatives.

    As `tests/reference/full_grid.py`, written for speed: the spectrum of φ is that which the
    implicit solve has left, ∇ψ is a sum of the ∇φ of all cells, so a cell takes five transforms
    a step. SciPy takes them on `threads` threads, all cells together.
    """

    def __init__(self, start: Problem, dtype: type, threads: int, dt: float, S: float) -> None:
        self.start, self.threads, self.dt, self.S = start, threads, dt, S
        physics, shape = start.scene.physics, start.phi.shape[1:]
        self.phi = start.phi.astype(dtype)
        self.wall = start.wall.astype(dtype)
        self.sigma = start.sigma.astype(dtype)
        self.gamma = np.array(start.scene.tensions, dtype).reshape(-1, 1, 1, 1)
        self.well = 2 * self.gamma * dtype(physics.c)
        self.g, self.tau, self.M = dtype(physics.g), physics.tau, physics.volume_strength
        waves = [2 * np.pi * fft.fftfreq(n, start.h) for n in shape[:2]]
        waves.append(2 * np.pi * fft.rfftfreq(shape[2], start.h))
        axes = np.meshgrid(*waves, indexing="ij", sparse=True)
        self.k2 = sum(k**2 for k in axes).astype(dtype)
        # The highest wave of an even grid is its own mirror image: its derivative is 0.
        inner = [np.where(np.isclose(np.abs(k), np.pi / start.h), 0, k) for k in axes]
        self.ik = [(1j * k).astype(np.result_type(dtype, np.complex64)) for k in inner]
        self.spectrum = fft.rfftn(self.phi, axes=AXES, workers=threads)
        self.phi_old: np.ndarray | None = None
        self.force_old: np.ndarray | None = None

    @property
    def nbytes(self) -> int:
        """Bytes kept from step to step: φ and F twice, and the spectrum."""
        return 4 * self.phi.nbytes + self.spectrum.nbytes

    def centroids(self) -> np.ndarray:
        """(N, 3), µm."""
        return grid_centroids(self.phi, self.start.h)

    def advance(self, steps: int) -> None:
        """Advance by steps of δt."""
        with threadpool_limits(self.threads, user_api="blas"):
            for _ in range(steps):
                self._step()

    def _inverse(self, spectrum: np.ndarray) -> np.ndarray:
        return fft.irfftn(
            spectrum, s=self.phi.shape[1:], axes=AXES, workers=self.threads, overwrite_x=True
        )

    def _force(self) -> np.ndarray:
        """All terms but the Laplacian."""
        phi, h = self.phi, self.start.h
        squares = phi * phi
        around = self.g * squares.sum(axis=0) + self.wall
        around = around - self.g * squares
        force = -phi * (self.well * (2 * squares - 3 * phi + 1) + around)
        slope = squares  # its memory is free now
        slope[:] = 0
        for ik in self.ik:
            part = self._inverse(ik * self.spectrum)
            pull = (self.sigma.T @ part.reshape(len(phi), -1)).reshape(phi.shape)
            force -= np.multiply(pull, part, out=pull)
            slope += np.multiply(part, part, out=part)
        volumes = phi.sum(axis=AXES, dtype=np.float64) * h**3
        pressure = (self.M * (1 - volumes / self.start.targets)).astype(phi.dtype)
        np.sqrt(slope, out=slope)
        slope *= pressure.reshape(-1, 1, 1, 1)
        force += slope
        return force

    def _step(self) -> None:
        phi, force, real = self.phi, self._force(), self.phi.dtype.type
        if self.phi_old is None or self.force_old is None:
            lhs = real(self.tau / self.dt + self.S)
            rhs = lhs * phi + force
        else:
            b, S = self.tau / (2 * self.dt), self.S
            lhs = real(3 * b + S)
            rhs = real(4 * b + 2 * S) * phi
            rhs -= real(b + S) * self.phi_old
            rhs += 2 * force
            rhs -= self.force_old
        self.spectrum = fft.rfftn(rhs, axes=AXES, workers=self.threads, overwrite_x=True)
        self.spectrum /= lhs + self.gamma * self.k2
        self.phi_old, self.force_old = phi, force
        self.phi = self._inverse(self.spectrum.copy())


def largest_explicit_step(scene: Scene) -> float:
    """2τ / (f + γ k²) with k² = 12/h², the largest eigenvalue of the 7-point -Δ of py-pde."""
    k2 = 12 / scene.numerics.spacing**2
    return 2 * scene.physics.tau / (explicit_rate(scene) + max(scene.tensions) * k2)


def embryo_equation(pde: Any, start: Problem) -> Any:
    """The phase-field model as a `pde.PDEBase`: N fields, second-order operators of py-pde."""
    physics, h, n = start.scene.physics, start.h, len(start.phi)
    gammas, sigma, wall = np.array(start.scene.tensions), start.sigma, start.wall
    tau, c, g = physics.tau, physics.c, physics.g
    strength = physics.volume_strength / start.targets
    targets = start.targets

    class Embryo(pde.PDEBase):
        def evolution_rate(self, state: Any, t: float = 0) -> Any:
            message = "the model is written for compiled backends: take backend='numba'"
            raise NotImplementedError(message)

        def make_evolution_rate(self, state: Any, backend: Any) -> Any:
            options = {"bc": {"derivative": 0}, "backend": backend, "dtype": state.dtype}
            laplace = state.grid.make_operator("laplace", **options)
            gradient = state.grid.make_operator("gradient", **options)
            real = state.dtype.type
            walls, ones = wall.astype(real), np.array([1, 2, 3], real)
            tensions, wells = gammas.astype(real), (2 * c * gammas).astype(real)
            pulls, mobility, repulsion = sigma.astype(real), real(1 / tau), real(g)

            @backend.compile_function
            def combine(i, phi, lap, grad, pull, squares, pressure, rate):  # type: ignore
                one, two, three = ones
                for x in range(phi.shape[0]):
                    for y in range(phi.shape[1]):
                        for z in range(phi.shape[2]):
                            p = phi[x, y, z]
                            a, b, c = grad[0, x, y, z], grad[1, x, y, z], grad[2, x, y, z]
                            u, v, w = pull[0, x, y, z], pull[1, x, y, z], pull[2, x, y, z]
                            others = repulsion * (squares[x, y, z] - p * p) + walls[x, y, z]
                            others += wells[i] * ((two * p - three) * p + one)
                            force = tensions[i] * lap[x, y, z] - p * others
                            force += pressure * np.sqrt(a * a + b * b + c * c)
                            rate[x, y, z] = mobility * (force - (a * u + b * v + c * w))

            def evolution(state_data, t=0):  # type: ignore
                rate = np.empty_like(state_data)
                squares = np.zeros_like(state_data[0])
                for i in range(n):
                    squares += state_data[i] * state_data[i]
                for i in range(n):
                    phi = state_data[i]
                    psi = np.zeros_like(phi)
                    for j in range(n):
                        if pulls[j, i] != 0:
                            psi += pulls[j, i] * state_data[j]
                    pressure = real(strength[i] * (targets[i] - phi.sum() * h**3))
                    combine(
                        i, phi, laplace(phi), gradient(phi), gradient(psi), squares, pressure,
                        rate[i],
                    )  # fmt: skip
                return rate

            return evolution

    return Embryo()


class PyPde:
    """Explicit Euler with py-pde, Numba backend, on a grid with Neumann boundaries.

    py-pde runs its Laplacians and gradients on `threads` threads, the rest on one.
    """

    def __init__(self, start: Problem, dtype: type, threads: int, dt: float) -> None:
        import pde

        pde.config["backend.numba.multithreading"] = "always" if threads > 1 else "never"
        self.start, self.threads, self.dt, self.time = start, threads, dt, 0.0
        edges = [((-0.5) * start.h, (n - 0.5) * start.h) for n in start.phi.shape[1:]]
        grid = pde.CartesianGrid(edges, start.phi.shape[1:])
        fields = [pde.ScalarField(grid, cell, dtype=dtype) for cell in start.phi]
        self.state = pde.FieldCollection(fields, dtype=dtype)
        solver = pde.EulerSolver(embryo_equation(pde, start), backend="numba")
        self.stepper = solver.make_stepper(self.state, dt=dt)

    @property
    def nbytes(self) -> int:
        """Bytes of the fields and of their rates."""
        return 2 * int(self.state.data.nbytes)

    def centroids(self) -> np.ndarray:
        """(N, 3), µm."""
        return grid_centroids(self.state.data, self.start.h)

    def advance(self, steps: int) -> None:
        """Advance by steps of δt."""
        before = numba.get_num_threads()
        numba.set_num_threads(self.threads)
        try:
            self.time = self.stepper(self.state, self.time, self.time + steps * self.dt)
        finally:
            numba.set_num_threads(before)


def dividing_step(largest: float, time: float) -> float:
    """The largest step, at most `largest`, that divides a time."""
    return time / math.ceil(time / largest)
