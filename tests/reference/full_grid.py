"""The paper's multicellular phase-field scheme on one full periodic grid.

This module is written to be read. It uses NumPy and Fourier transforms only, in double precision,
and every faster solution is compared with it. Where an equation has a coefficient that varies in
space, SciPy's conjugate gradients solve it.

Fields ``phi`` have shape (N, nx, ny, nz): one field per cell, axes x, y, z.
The position of a grid point is its index times ``h``, counted from 0. Lengths are in um.
Equation numbers are those of the paper; S1 to S4 are in its Supplementary Note 2.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, ndimage, optimize
from scipy.sparse.linalg import LinearOperator, cg

Array = NDArray[np.floating]
GRID_AXES = (-3, -2, -1)
SCHEMES = ("bdf2", "imex1", "euler", "linearised")

# Coefficients of f(x + m h) - f(x - m h), m = 1, 2, 3, in the first derivative times h.
FIRST_DIFFERENCE = {2: (1 / 2,), 4: (2 / 3, -1 / 12), 6: (3 / 4, -3 / 20, 1 / 60)}
# Coefficients of f(x), then of f(x + m h) + f(x - m h), in the second derivative times h^2.
SECOND_DIFFERENCE = {
    2: (-2, 1),
    4: (-5 / 2, 4 / 3, -1 / 12),
    6: (-49 / 18, 3 / 2, -3 / 20, 1 / 90),
}


@dataclass(frozen=True, kw_only=True)
class Model:
    """Physical parameters and space discretisation.

    Parameters
    ----------
    h : float
        Grid spacing (um).
    tau : float
        Viscosity (Eq. 5).
    gamma : float or (N,) array
        Surface tension (Eq. 1).
    c : float
        Double-well coefficient. The profile is (1 + tanh(sqrt(c/2) d))/2 at depth d (Eq. 1).
    M : float
        Volume constraint strength: M' of Eq. 10 if relative, M of Eq. 2 if absolute.
    volume_constraint : {"relative", "absolute"} or None
        Form of the volume constraint; None leaves it out.
    g, g_e : float
        Repulsion by the other cells and by the shell (Eq. 3).
    sigma : (N, N) array or None
        Attraction: ``sigma[j, i]`` is the pull of cell j on cell i (Eq. 4). The diagonal is unused.
    kappa : float
        Noise strength (Eq. 11).
    phi_e : (nx, ny, nz) array or None
        Shell field, 1 outside and 0 inside.
    targets : (N,) array or None
        Prescribed volumes V_i (um^3).
    gradient : {"fourier", 2, 4, 6}
        Fourier derivative, or the order of a central difference.
    laplacian : {"exact", 2, 4, 6}
        Symbol -k^2, or that of the central second difference of this order.
    """

    h: float
    tau: float = 2.62
    gamma: float | ArrayLike = 0.25
    c: float = 2.0
    M: float = 8.0
    volume_constraint: Literal["relative", "absolute"] | None = "relative"
    g: float = 1.6
    g_e: float = 16.0
    sigma: Array | None = None
    kappa: float = 0.0
    phi_e: Array | None = None
    targets: Array | None = None
    gradient: Literal["fourier", 2, 4, 6] = "fourier"
    laplacian: Literal["exact", 2, 4, 6] = "exact"


def per_cell(values: float | ArrayLike) -> Array:
    """Give one value per cell, or one for all, a shape that multiplies ``phi``."""
    return np.asarray(values, dtype=float).reshape(-1, 1, 1, 1)


# --- derivatives -------------------------------------------------------------------------------


def wavenumber(n: int, h: float, axis: int) -> Array:
    """Angular wavenumbers along one axis of an ``rfftn`` spectrum, shaped to multiply it."""
    frequency = fft.rfftfreq(n, h) if axis == 2 else fft.fftfreq(n, h)
    return 2 * np.pi * np.expand_dims(frequency, [a for a in range(3) if a != axis])


def gradient(field: Array, model: Model) -> Array:
    """Gradient along the last three axes; the components come first."""
    if model.gradient == "fourier":
        return fourier_gradient(field, model.h)
    return difference_gradient(field, model.h, model.gradient)


def fourier_gradient(field: Array, h: float) -> Array:
    """Gradient by multiplying the spectrum with i k."""
    shape = field.shape[-3:]
    spectrum = fft.rfftn(field, axes=GRID_AXES)
    out = np.empty((3, *field.shape))
    for axis, n in enumerate(shape):
        k = wavenumber(n, h, axis)
        # The highest wave of an even grid is its own mirror image: its derivative is 0.
        k[np.isclose(np.abs(k), np.pi / h)] = 0
        out[axis] = fft.irfftn(1j * k * spectrum, s=shape, axes=GRID_AXES)
    return out


def difference_gradient(field: Array, h: float, order: int) -> Array:
    """Gradient by periodic central differences of order 2, 4 or 6."""
    out = np.zeros((3, *field.shape))
    for component, axis in zip(out, GRID_AXES, strict=True):
        for m, coefficient in enumerate(FIRST_DIFFERENCE[order], start=1):
            component += coefficient * (np.roll(field, -m, axis) - np.roll(field, m, axis))
    return out / h


@cache
def laplacian_symbol(shape: tuple[int, int, int], h: float, kind: str | int) -> Array:
    """Factor by which the Laplacian multiplies an ``rfftn`` spectrum."""
    return sum(second_derivative_symbol(wavenumber(shape[a], h, a), h, kind) for a in range(3))


def second_derivative_symbol(k: Array, h: float, kind: str | int) -> Array:
    """Symbol of the second derivative: -k^2, or that of a central difference."""
    if kind == "exact":
        return -(k**2)
    centre, *sides = SECOND_DIFFERENCE[kind]
    waves = sum(2 * b * np.cos(m * k * h) for m, b in enumerate(sides, start=1))
    return (centre + waves) / h**2


def laplacian(field: Array, model: Model) -> Array:
    """Laplacian along the last three axes, through its symbol."""
    shape = field.shape[-3:]
    symbol = laplacian_symbol(shape, model.h, model.laplacian)
    return fft.irfftn(symbol * fft.rfftn(field, axes=GRID_AXES), s=shape, axes=GRID_AXES)


# --- forces ------------------------------------------------------------------------------------


def double_well(phi: Array, model: Model) -> Array:
    """Double-well part of surface tension, -gamma c W'(phi) (Eqs. 1 and 7)."""
    return -per_cell(model.gamma) * model.c * (4 * phi**3 - 6 * phi**2 + 2 * phi)


def repelled_by(phi: Array, model: Model) -> Array:
    """What repels each cell: the other cells and the shell, sum g phi_j^2 + g_e phi_e^2 (Eq. 3)."""
    squares = phi**2
    others = model.g * (squares.sum(axis=0) - squares)
    if model.phi_e is not None:
        others += model.g_e * model.phi_e**2
    return others


def repulsion(phi: Array, model: Model) -> Array:
    """Repulsion by the shell and by the other cells (Eqs. 3 and 7)."""
    return -phi * repelled_by(phi, model)


def attraction(phi: Array, grad_phi: Array, model: Model) -> Array:
    """Attraction by the other cells, -grad(phi_i) . grad(psi_i) (Eqs. 4 and 7).

    The sum of gradients is the gradient of one sum, psi_i = sum over j != i of
    sigma[j, i] phi_j. So each cell needs one gradient and not N.
    """
    sigma = np.array(model.sigma, dtype=float)
    np.fill_diagonal(sigma, 0)
    psi = np.tensordot(sigma.T, phi, axes=1)
    return -np.sum(grad_phi * gradient(psi, model), axis=0)


def volume_pressure(phi: Array, grad_phi: Array, model: Model) -> Array:
    """Volume constraint, relative (Eq. 10) or absolute (Eq. 2), times |grad(phi)|."""
    missing = np.asarray(model.targets) - volume(phi, model.h)
    if model.volume_constraint == "relative":
        missing = missing / model.targets
    return per_cell(model.M * missing) * np.sqrt(np.sum(grad_phi**2, axis=0))


def motility(grad_phi: Array, noise: Array, dt: float, model: Model) -> Array:
    """Random motion, -kappa sqrt(dt) grad(phi_i) . u_i (Eq. S3).

    ``noise`` is u, shape (N, 3): one standard normal vector per cell.
    """
    return -model.kappa * np.sqrt(dt) * np.einsum("aixyz,ia->ixyz", grad_phi, noise)


def nonlinear_force(
    phi: Array, model: Model, noise: Array | None = None, dt: float | None = None
) -> Array:
    """All terms but the Laplacian, F_i of Eqs. S2 and S3.

    ``noise`` and ``dt`` are only used together, for the random motion.
    """
    grad_phi = gradient(phi, model)
    force = double_well(phi, model) + repulsion(phi, model)
    if model.sigma is not None:
        force += attraction(phi, grad_phi, model)
    if model.volume_constraint is not None:
        force += volume_pressure(phi, grad_phi, model)
    if noise is not None:
        force += motility(grad_phi, noise, dt, model)
    return force


# --- time steps --------------------------------------------------------------------------------


def helmholtz_solve(rhs: Array, a: float, model: Model) -> Array:
    """Solve (a - gamma Laplacian) phi = rhs for every cell."""
    shape = rhs.shape[-3:]
    symbol = a - per_cell(model.gamma) * laplacian_symbol(shape, model.h, model.laplacian)
    return fft.irfftn(fft.rfftn(rhs, axes=GRID_AXES) / symbol, s=shape, axes=GRID_AXES)


def step_euler(phi: Array, model: Model, dt: float, noise: Array | None = None) -> Array:
    """One explicit Euler step of tau d(phi)/dt = gamma Laplacian(phi) + F (Eq. 5)."""
    force = nonlinear_force(phi, model, noise, dt)
    return phi + dt / model.tau * (per_cell(model.gamma) * laplacian(phi, model) + force)


def step_first_order(
    phi: Array, model: Model, dt: float, S: float, noise: Array | None = None
) -> Array:
    """One stabilised first-order step (Eq. 8); S = 0 gives Eq. 6."""
    return solve_first_order(phi, nonlinear_force(phi, model, noise, dt), model, dt, S)


def solve_first_order(phi: Array, force: Array, model: Model, dt: float, S: float) -> Array:
    """Solve Eq. 8 for a given force F."""
    a = model.tau / dt + S
    return helmholtz_solve(a * phi + force, a, model)


def step_second_order(
    phi: Array,
    phi_old: Array,
    force: Array,
    force_old: Array,
    model: Model,
    dt: float,
    S: float,
) -> Array:
    """One stabilised BDF2 step (Eq. 9).

    ``force`` and ``force_old`` are F at ``phi`` and at the step before, ``phi_old``.
    """
    b = model.tau / (2 * dt)
    rhs = b * (4 * phi - phi_old) + 2 * force - force_old + S * (2 * phi - phi_old)
    return helmholtz_solve(rhs, 3 * b + S, model)


def local_derivative(phi: Array, model: Model) -> Array:
    """How fast the force at a point falls as phi rises there, gamma c W''(phi) + R."""
    curvature = 12 * phi**2 - 12 * phi + 2
    return per_cell(model.gamma) * model.c * curvature + repelled_by(phi, model)


def volume_stiffness(model: Model) -> Array:
    """How much the pressure of each cell falls per um^3 of its volume (Eqs. 2 and 10)."""
    if model.volume_constraint is None:
        return np.zeros(1)
    targets = np.asarray(model.targets, dtype=float)
    relative = model.volume_constraint == "relative"
    return model.M / targets if relative else np.full(len(targets), model.M)


def step_linearised(
    phi: Array,
    phi_old: Array | None,
    model: Model,
    dt: float,
    S: float,
    dt_old: float | None = None,
    noise: Array | None = None,
) -> Array:
    """One step by forces that are linearised about an extrapolation.

    With r = dt / dt_old and phi* = phi + r (phi - phi_old), backward differences of second order
    give, for u = phi_new - phi*,

        (a + D - (gamma + s) Laplacian) u = F(phi*) + gamma Laplacian(phi*) - tau/dt (phi* - phi)
                                            - q |grad(phi*)|

    with a = tau/dt (1 + 2 r)/(1 + r), D of `local_derivative` at phi*, and s = S / 2c. The
    Laplacian of u is the central difference of order 2. q is what the pressure loses as the volume
    changes by that of u: p' = dp/dv times the integral of u, where u is taken as alpha |grad(phi*)|
    with the alpha that solves the integral of the equation.

    Parameters
    ----------
    phi_old : array or None
        Field of the step before; None makes a first step, phi* = phi and a = tau/dt.
    dt_old : float, optional
        Length of the step before; by default dt.
    """
    rate, r = model.tau / dt, dt / (dt_old or dt)
    ahead = phi if phi_old is None else phi + r * (phi - phi_old)
    a = rate if phi_old is None else rate * (1 + 2 * r) / (1 + r)
    slope = np.sqrt(np.sum(gradient(ahead, model) ** 2, axis=0))
    damping = local_derivative(ahead, model)
    explicit = nonlinear_force(ahead, model, noise, dt) - rate * (ahead - phi)
    stiffness = volume_stiffness(model) * model.h**3
    sums = [part.sum(axis=GRID_AXES) for part in (explicit, slope, damping * slope)]
    alpha = sums[0] / (a * sums[1] + sums[2] + stiffness * sums[1] ** 2)
    loss = per_cell(stiffness * alpha * sums[1])
    rhs = explicit + per_cell(model.gamma) * laplacian(ahead, model) - loss * slope
    diffusing = replace(model, gamma=np.asarray(model.gamma) + S / (2 * model.c), laplacian=2)
    return ahead + damped_solve(rhs, a, damping, diffusing)


def damped_solve(rhs: Array, a: float, damping: Array, model: Model) -> Array:
    """Solve (a + damping - gamma Laplacian) u = rhs for every cell."""
    shape, gamma = rhs.shape, per_cell(model.gamma)

    def apply(u: Array) -> Array:
        u = u.reshape(shape)
        return ((a + damping) * u - gamma * laplacian(u, model)).ravel()

    def undamped(u: Array) -> Array:
        return helmholtz_solve(u.reshape(shape), a + 0.5, model).ravel()

    size = (rhs.size, rhs.size)
    operator = LinearOperator(size, apply, dtype=float)
    u, failed = cg(operator, rhs.ravel(), rtol=1e-8, M=LinearOperator(size, undamped, dtype=float))
    if failed:
        message = f"conjugate gradients have not converged in {failed} iterations"
        raise RuntimeError(message)
    return u.reshape(shape)


def run(
    phi: Array,
    model: Model,
    dt: float,
    S: float = 0.0,
    scheme: Literal["bdf2", "imex1", "euler", "linearised"] = "bdf2",
    *,
    n_steps: int,
    noise: Callable[[int], Array] | None = None,
    on_step: Callable[[int, Array], None] | None = None,
) -> Array:
    """Advance ``n_steps`` steps and return the last field.

    Parameters
    ----------
    scheme : {"bdf2", "imex1", "euler", "linearised"}
        Eq. 9 with a first step by Eq. 8; Eq. 8 only; explicit Euler, which ignores S;
        `step_linearised`.
    noise : callable, optional
        Gives u of Eq. S3, shape (N, 3), for the step counted from 0. Called once per step.
    on_step : callable, optional
        Called as ``on_step(steps_done, phi)`` after each step.
    """
    if scheme not in SCHEMES:
        message = f"unknown scheme {scheme!r}; known schemes are {', '.join(SCHEMES)}"
        raise ValueError(message)
    phi_old = force_old = None
    for step in range(n_steps):
        u = noise(step) if noise is not None else None
        if scheme == "euler":
            phi = step_euler(phi, model, dt, u)
        elif scheme == "imex1":
            phi = step_first_order(phi, model, dt, S, u)
        elif scheme == "linearised":
            phi, phi_old = step_linearised(phi, phi_old, model, dt, S, noise=u), phi
        else:
            force = nonlinear_force(phi, model, u, dt)
            if step == 0:
                new = solve_first_order(phi, force, model, dt, S)
            else:
                new = step_second_order(phi, phi_old, force, force_old, model, dt, S)
            phi, phi_old, force_old = new, phi, force
        if on_step is not None:
            on_step(step + 1, phi)
    return phi


# --- start and measures ------------------------------------------------------------------------


def published_start(mask: ArrayLike, h: float) -> Array:
    """Field that the published program makes from a binary mask.

    The mask is blurred over 9 x 9 x 9 points and sharpened again by a tanh. A shift in the tanh
    makes the integral equal to the volume of the mask. The masks of interest are more than four
    points away from the grid's faces, so the blur's boundary rule has no effect.
    """
    mask = np.asarray(mask, dtype=float)
    blur = ndimage.uniform_filter(mask, size=9, mode="wrap")

    def profile(shift: float) -> Array:
        return (1 + np.tanh(np.sqrt(2) * (4.5 * (blur - 0.5) + shift))) / 2

    shift = optimize.brentq(lambda s: profile(s).sum() - mask.sum(), -5, 5, xtol=1e-14)
    return profile(shift)


def volume(phi: Array, h: float) -> Array:
    """Volume of each cell, the integral of its field (um^3)."""
    return phi.sum(axis=GRID_AXES) * h**3


def centroid(phi: Array, h: float) -> Array:
    """Centroid of each cell, weighted by phi where phi > 0.02, shape (N, 3) (um)."""
    inside = np.where(phi > 0.02, phi, 0)
    return np.array([ndimage.center_of_mass(cell) for cell in inside]) * h


def touching_pairs(phi: Array) -> dict[tuple[int, int], int]:
    """Pairs of cells in contact, with the number of grid points they share.

    Each region phi > 0.44 is grown by one point over its six faces. Cells touch if they overlap.
    """
    grown = [ndimage.binary_dilation(cell > 0.44) for cell in phi]
    shared = {
        (i, j): int(np.count_nonzero(grown[i] & grown[j]))
        for i, j in combinations(range(len(grown)), 2)
    }
    return {pair: count for pair, count in shared.items() if count > 0}
