"""The nonlinear force and the right-hand side, against plain NumPy."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.layout import Boxes, CellTerms, Scheme, Stencil
from morphosim.kernels.stencils import COEFFICIENTS

from .example_boxes import both_ways, box, empty_pool, make_boxes, positions, taken

H = 0.5
CELL = 1
NUMBERS = {"lhs": 9.0, "a0": 3.0, "a1": 0.7, "b0": -1.3, "b1": -0.4}
# Which terms there are; each combination is compiled on its own.
PRESENT = {
    "bare": (6, ()),
    "with memory": (6, ("history",)),
    "with noise, order 2": (2, ("drift",)),
    "with noise, order 4": (4, ("drift",)),
    "with noise, order 6": (6, ("drift",)),
    "repelled": (6, ("history", "repulsion")),
    "all": (6, ("history", "repulsion", "psi", "drift")),
}


def make_stencil(order: int) -> Stencil:
    weights = [np.float64(w / H) for w in COEFFICIENTS[order]]
    c1, c2, c3 = (*weights, None, None)[:3]
    return Stencil(radius=order // 2, edge=np.float64(0.5 / H), c1=c1, c2=c2, c3=c3)


def make_terms(n: int, drift: bool) -> CellTerms:
    rng = np.random.default_rng(5)
    return CellTerms(
        gamma=rng.random(n),
        well=rng.random(n),
        pressure=rng.random(n),
        drift=rng.normal(size=(n, 3)) if drift else None,
    )


def central(field: NDArray, order: int) -> NDArray:
    """Gradient by shifted arrays; wrong near the faces, where it wraps."""
    return np.array(
        [
            sum(
                w / H * (np.roll(field, -m, axis) - np.roll(field, m, axis))
                for m, w in enumerate(COEFFICIENTS[order], start=1)
            )
            for axis in range(3)
        ]
    )


def inner(field: NDArray, layer: int) -> NDArray:
    """Points at least `layer` points away from the faces."""
    mask = np.zeros(field.shape, bool)
    mask[(slice(layer, -layer),) * 3] = True
    return mask


def gradient(field: NDArray, order: int) -> NDArray:
    """Of the given order inside, of order 2 where that would reach out, 0 on the faces."""
    near = np.where(inner(field, 1), central(field, 2), 0)
    return np.where(inner(field, order // 2), central(field, order), near)


def expected_force(
    phi: NDArray, band: NDArray, terms: CellTerms, order: int, given: dict[str, Any]
) -> NDArray:
    """F of cell `CELL`, by the formula."""
    force = -terms.well[CELL] / 4 * (4 * phi**3 - 6 * phi**2 + 2 * phi)
    slope = gradient(phi, order)
    gradient_terms = terms.pressure[CELL] * np.sqrt((slope**2).sum(axis=0))
    if given["repulsion"] is not None:
        force -= phi * given["repulsion"]
    if given["psi"] is not None:
        gradient_terms -= (slope * gradient(given["psi"], order)).sum(axis=0)
    if terms.drift is not None:
        gradient_terms += np.einsum("axyz,a->xyz", slope, terms.drift[CELL])
    return force + np.where(band, gradient_terms, 0)


def band_of(boxes: Boxes) -> NDArray:
    """Points within the row spans of cell `CELL`."""
    nx, ny, nz = boxes.shape[CELL]
    first = boxes.row_start[CELL]
    spans = boxes.spans[first : first + nx * ny].reshape(nx, ny, 2)
    z = np.arange(nz)
    return (z >= spans[..., :1]) & (z < spans[..., 1:])


@both_ways
@pytest.mark.parametrize("name", PRESENT)
def test_right_hand_side(name: str, way: str) -> None:
    order, present = PRESENT[name]
    boxes, pool = make_boxes(seed=6)
    rng = np.random.default_rng(7)
    shape = tuple(boxes.shape[CELL])
    work = {key: rng.random(shape) if key in present else None for key in ("repulsion", "psi")}
    history = rng.random(len(pool)) if "history" in present else None
    before = None if history is None else history.copy()
    terms = make_terms(len(boxes.start), "drift" in present)
    rhs = np.full(np.prod(shape), np.nan)
    scheme = Scheme(**{key: np.float64(value) for key, value in NUMBERS.items()})
    flat = {key: None if value is None else value.ravel() for key, value in work.items()}

    taken(right_hand_side, way)(
        CELL, pool, history, boxes, terms, terms.drift, flat["repulsion"], flat["psi"],
        np.full(40, np.nan), rhs, make_stencil(order), scheme, np.float64(0.5),
    )  # fmt: skip

    phi = box(pool, boxes, CELL)
    force = expected_force(phi, band_of(boxes), terms, order, work)
    expected = scheme.a0 * phi + scheme.a1 * force
    if history is not None:
        expected += box(before, boxes, CELL)
        box(before, boxes, CELL)[:] = scheme.b0 * phi + scheme.b1 * force
        np.testing.assert_allclose(history, before, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rhs.reshape(shape), expected, rtol=1e-12, atol=1e-12)


def test_a_smooth_field_has_the_force_of_the_continuum() -> None:
    boxes, pool = make_boxes(seed=6)
    wave = np.sin(0.1 * sum(positions(boxes, CELL)) * H)
    box(pool, boxes, CELL)[:] = wave
    boxes.spans[:] = 0, boxes.shape[CELL, 2]
    terms = make_terms(len(boxes.start), drift=False)
    rhs = np.zeros(wave.size)
    right_hand_side(
        CELL, pool, empty_pool(pool) * 0, boxes, terms, None, None, None, np.zeros(40), rhs,
        make_stencil(6), Scheme(*map(np.float64, (1, 0, 1, 0, 0))), np.float64(0.5),
    )  # fmt: skip
    slope = np.sqrt(3) * 0.1 * np.abs(np.cos(0.1 * sum(positions(boxes, CELL)) * H))
    exact = terms.pressure[CELL] * slope - terms.well[CELL] * wave * (wave - 0.5) * (wave - 1)
    deep = inner(wave, 3)
    np.testing.assert_allclose(rhs.reshape(wave.shape)[deep], exact[deep], atol=1e-9)
