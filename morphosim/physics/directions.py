"""Unit vectors p that turn: at random, and towards where they are drawn.

With a normal n, p stays in the plane normal to it; without, it is anywhere on the sphere.
"""

import numpy as np
from numpy.typing import NDArray

from morphosim.kernels.noise import normal_vectors

Floats = NDArray[np.float64]
TURNS, BEGINNINGS = np.uint64(0x7475726E), np.uint64(0x62656769)
"""Streams of random numbers, apart from those of motility."""
LEAST = 1e-12
"""Lengths below count as 0."""
FARTHEST = 50.0
"""Turning by more than this makes no difference."""


def unit(vectors: Floats) -> Floats:
    """(N, 3) vectors of length 1; 0 where there is none."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.where(length > LEAST, vectors / np.maximum(length, LEAST), 0.0))


def normals(stream: np.uint64, seed: int, step: int, cells: NDArray[np.uint64]) -> Floats:
    """(N, 3) standard normal numbers by stream, seed, step and the cells' ids alone."""
    found = np.zeros((len(cells), 3))
    normal_vectors(np.uint64(seed) ^ (stream << np.uint64(32)), np.uint64(step), cells, found)
    return found


def beginnings(seed: int, cells: NDArray[np.uint64], normal: Floats | None) -> Floats:
    """(N, 3) directions of new cells, uniform on the sphere or in the plane."""
    return unit(within(normals(BEGINNINGS, seed, 0, cells), normal))


def within(vectors: Floats, normal: Floats | None) -> Floats:
    """(N, 3) parts of vectors in the plane."""
    return vectors if normal is None else vectors - (vectors @ normal)[:, None] * normal


def across(vectors: Floats, p: Floats) -> Floats:
    """(N, 3) parts of vectors that are normal to p."""
    return np.asarray(vectors - (vectors * p).sum(axis=1, keepdims=True) * p)


def diffused(p: Floats, u: Floats, spread: float, normal: Floats | None = None) -> Floats:
    """Directions after rotational diffusion for a time t, spread = D t, by normal numbers u.

    In a plane p turns by the angle √(2 D t) u. On the sphere p' = w p + √(1 - w²) e, where e is
    the direction of the part of u normal to p, and w = 2 exp(-tanh(D t) |part|²/2) - 1. The angle
    of short times is √(2 D t) |part|, ⟨w⟩ = exp(-2 D t) at any, and w is uniform in the end.
    """
    if normal is not None:
        angle = np.sqrt(2 * spread) * u[:, 2:]
        return unit(np.cos(angle) * p + np.sin(angle) * np.cross(normal, p))
    part = across(u, p)
    square = (part**2).sum(axis=1, keepdims=True)
    w = 2 * np.exp(-np.tanh(spread) * square / 2) - 1
    return unit(w * p + np.sqrt(1 - w**2) * part / np.sqrt(np.maximum(square, LEAST**2)))


def aligned(p: Floats, pull: Floats, time: float) -> Floats:
    """Directions after dp/dt = (1 - p p·) pull for a time, (N, 3) pull as it is.

    With e its direction and c = p·e, c' = |pull| (1 - c²): c goes to (c + T) / (1 + c T), T =
    tanh(|pull| t), and the part of p normal to e becomes √(1 - T²) / (1 + c T) of it.
    """
    way = np.linalg.norm(pull, axis=1, keepdims=True) * time
    e = unit(pull)
    c = (p * e).sum(axis=1, keepdims=True)
    turned = unit((c + np.tanh(way)) * e + (p - c * e) / np.cosh(np.minimum(way, FARTHEST)))
    return np.where(turned.any(axis=1, keepdims=True) & (way > LEAST), turned, p)
