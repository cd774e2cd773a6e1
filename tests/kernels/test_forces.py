"""The nonlinear force and the right-hand side, against plain NumPy."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.frames import HALO
from morphosim.kernels.layout import Boxes, CellTerms, Scheme
from morphosim.kernels.points import point_force, records
from morphosim.kernels.stencils import COEFFICIENTS

from .example_boxes import (
    H,
    band_in_frame,
    blocks_of,
    both_ways,
    empty_frame,
    flat_laplacian,
    grid,
    held,
    in_band,
    inside,
    loaded,
    make_boxes,
    make_stencil,
    positions,
    put,
    set_band,
    spread_out,
    stretch,
    taken,
)

CELL = 1
NUMBERS = {"lhs": 9.0, "a0": 3.0, "a1": 0.7, "b0": -1.3, "b1": -0.4, "e0": 1.7, "e1": 0.2}
# Order, and which terms there are; each combination is compiled on its own.
PRESENT = {
    "bare": (6, ()),
    "with memory": (6, ("history",)),
    "with start": (6, ("start",)),
    "with memory and start": (6, ("history", "start")),
    "with noise, order 2": (2, ("drift",)),
    "with noise, order 4": (4, ("drift",)),
    "with noise, order 6": (6, ("drift",)),
    "repelled": (6, ("history", "repulsion")),
    "all": (6, ("history", "repulsion", "psi", "drift", "start")),
}


def make_terms(n: int, drift: bool, iterations: int = 0) -> CellTerms:
    """Terms of cells of which the first has no history, and takes an iteration less."""
    rng = np.random.default_rng(5)
    return CellTerms(
        gamma=rng.random(n),
        well=rng.random(n),
        pressure=rng.random(n),
        drift=rng.normal(size=(n, 3)) if drift else None,
        points=None,
        fresh=np.arange(n) == 0,
        mobility=None,
        n_iterations=np.maximum(iterations - (np.arange(n) == 0), min(iterations, 1)),
        weights=rng.uniform(0.005, 0.02, (n, iterations)),
    )


def gradient(field: NDArray, order: int) -> NDArray:
    """Gradient by shifted arrays; wrong near the ends of the array, where it wraps."""
    return np.array(
        [
            sum(
                w / H * (np.roll(field, -m, axis) - np.roll(field, m, axis))
                for m, w in enumerate(COEFFICIENTS[order], start=1)
            )
            for axis in range(3)
        ]
    )


def expected_force(
    phi: NDArray, terms: CellTerms, order: int, given: dict[str, NDArray | None]
) -> NDArray:
    """F of cell `CELL`, by the formula; the fields are those of the frame."""
    force = -terms.well[CELL] / 4 * (4 * phi**3 - 6 * phi**2 + 2 * phi)
    slope = gradient(phi, order)
    force += terms.pressure[CELL] * np.sqrt((slope**2).sum(axis=0))
    if given["repulsion"] is not None:
        force -= phi * given["repulsion"]
    if given["psi"] is not None:
        force -= (slope * gradient(given["psi"], order)).sum(axis=0)
    if terms.drift is not None:
        force += np.einsum("axyz,a->xyz", slope, terms.drift[CELL])
    return force


@both_ways
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("name", PRESENT)
def test_right_hand_side(name: str, whole: bool, way: str) -> None:
    order, present = PRESENT[name]
    boxes, pool = make_boxes(seed=6, whole=whole)
    rng = np.random.default_rng(7)
    phi = loaded(boxes, CELL, pool, whole)
    random: dict[str, Any] = {
        key: rng.random(boxes.shape[CELL]) if key in present else None
        for key in ("repulsion", "history")
    }
    psi = rng.random(len(phi)) if "psi" in present else None
    terms = make_terms(len(boxes.start), "drift" in present)
    scheme = Scheme(**{key: np.float64(value) for key, value in NUMBERS.items()})
    size = held(boxes, CELL).sum() + 3
    rhs, memory = np.full(size, np.nan), np.full(size, np.nan)
    felt = np.full(size, np.nan)
    history = None
    if "repulsion" in present:
        felt[:-3] = stretch(random["repulsion"], boxes, CELL)
    if "history" in present:
        history = np.full_like(pool, np.nan)
        put(history, boxes, CELL, random["history"])
    start = empty_frame(boxes, CELL) if "start" in present else None
    blocks, n = blocks_of(boxes, CELL, whole)
    before = {"psi": psi, "felt": felt, "history": history}
    before = {key: None if value is None else value.copy() for key, value in before.items()}

    taken(right_hand_side, way)(
        CELL, boxes, blocks, n, terms, terms.drift, phi, psi, felt, history, rhs,
        None if history is None else memory, start, make_stencil(order), scheme, np.float64(0.5),
        True if "repulsion" in present else None,
    )  # fmt: skip

    fields = {"psi": None if psi is None else grid(psi, boxes, CELL), "repulsion": None}
    if "repulsion" in present:
        fields["repulsion"] = as_grid(random["repulsion"], boxes)
    value = grid(phi, boxes, CELL)
    force = expected_force(value, terms, order, fields)
    kept = 0 if history is None else as_grid(random["history"], boxes)
    expected = {"rhs": (spread_out(rhs, boxes, CELL), scheme.a0 * value + scheme.a1 * force + kept)}
    if history is not None:
        expected["memory"] = (
            spread_out(memory, boxes, CELL), scheme.b0 * value + scheme.b1 * force,
        )  # fmt: skip
    if start is not None:
        extrapolated = scheme.e0 * value + scheme.e1 * (kept + force)
        expected["start"] = (
            inside(start, boxes, CELL), value if history is None else extrapolated,
        )  # fmt: skip
    worked = in_band(boxes, CELL, whole)
    assert worked.any()
    for key, (found, wanted) in expected.items():
        wanted = wanted[HALO:-HALO, HALO:-HALO, HALO : HALO + boxes.shape[CELL, 2]]
        np.testing.assert_allclose(
            found[worked], wanted[worked], rtol=1e-12, atol=1e-12, err_msg=key
        )
    # Nothing but these points is written, and of what is given nothing at all.
    assert np.isnan(rhs[-3:]).all()
    assert np.isnan(memory[-3:] if history is not None else memory).all()
    if start is not None:
        np.testing.assert_array_equal(np.isnan(start), ~band_in_frame(boxes, CELL, whole))
    for key, given in {"psi": psi, "felt": felt, "history": history}.items():
        np.testing.assert_array_equal(given, before[key], err_msg=key)
    np.testing.assert_array_equal(phi, loaded(boxes, CELL, pool, whole))


def as_grid(field: NDArray, boxes: Boxes) -> NDArray:
    """A field in the box of `CELL` as a grid of its frame."""
    frame = empty_frame(boxes, CELL, 0.0)
    inside(frame, boxes, CELL)[:] = field
    return grid(frame, boxes, CELL)


@point_force
def of_all(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return values[0] * phi + 2 * gx + 3 * gy + 5 * gz + values[1] * laplacian


@point_force
def constant(values, phi, gx, gy, gz, laplacian):  # type: ignore[no-untyped-def]
    return values[0]


@pytest.mark.parametrize("order", [2, 4, 6])
def test_forces_at_points_get_the_field_its_gradient_and_its_laplacian(order: int) -> None:
    """Each with its own values."""
    boxes, pool = make_boxes(seed=6)
    phi, felt = loaded(boxes, CELL, pool), np.full(held(boxes, CELL).sum(), np.nan)
    rhs, (blocks, n) = felt.copy(), blocks_of(boxes, CELL)
    values = np.random.default_rng(8).random((len(boxes.start), 2))
    terms = make_terms(len(boxes.start), drift=False)
    parts = [(constant, np.full((len(values), 1), 0.7)), (of_all, values)]
    terms = terms._replace(points=records(parts, np.dtype(float)))
    taken(right_hand_side, "python")(
        CELL, boxes, blocks, n, terms, None, phi, None, felt, None, rhs, None, None,
        make_stencil(order), Scheme(*map(np.float64, (1, 0, 1, 0, 0, 0, 0))), np.float64(0.5), None,
    )  # fmt: skip
    wide = grid(phi, boxes, CELL)
    plain = expected_force(wide, terms, order, {"repulsion": None, "psi": None})
    slope = gradient(wide, order)
    laplacian = grid(flat_laplacian(phi, boxes, CELL, order), boxes, CELL)
    expected = empty_frame(boxes, CELL)
    grid(expected, boxes, CELL)[:] = (
        plain + 0.7 + values[CELL, 0] * wide + 2 * slope[0] + 3 * slope[1] + 5 * slope[2]
        + values[CELL, 1] * laplacian
    )  # fmt: skip
    assert np.isfinite(rhs).all()
    expected = stretch(inside(expected, boxes, CELL), boxes, CELL)
    np.testing.assert_allclose(rhs, expected, rtol=1e-11, atol=1e-11)


def test_without_history_the_start_is_the_field() -> None:
    """Whatever e0 is."""
    boxes, pool = make_boxes(seed=6)
    phi, start = loaded(boxes, CELL, pool), empty_frame(boxes, CELL)
    scheme = Scheme(*np.arange(7.0) + 2)
    terms, felt = make_terms(len(boxes.start), drift=False), np.zeros(held(boxes, CELL).sum())
    right_hand_side(
        CELL, boxes, *blocks_of(boxes, CELL), terms, None, phi, None, felt, None, felt.copy(), None,
        start, make_stencil(6), scheme, np.float64(0.5), None,
    )  # fmt: skip
    band = band_in_frame(boxes, CELL)
    np.testing.assert_array_equal(start[band], phi[band])


def test_a_smooth_field_has_the_force_of_the_continuum() -> None:
    boxes, pool = make_boxes(seed=6)
    wave = np.sin(0.1 * sum(positions(boxes, CELL)) * H)
    set_band(boxes, CELL, (0, boxes.shape[CELL, 2]))
    put(pool, boxes, CELL, wave)
    terms = make_terms(len(boxes.start), drift=False)
    rhs, felt = np.full(wave.size, np.nan), np.zeros(wave.size)
    right_hand_side(
        CELL, boxes, *blocks_of(boxes, CELL), terms, None, loaded(boxes, CELL, pool), None, felt,
        None, rhs, None, None, make_stencil(6), Scheme(*map(np.float64, (1, 0, 1, 0, 0, 0, 0))),
        np.float64(0.5), None,
    )  # fmt: skip
    slope = np.sqrt(3) * 0.1 * np.abs(np.cos(0.1 * sum(positions(boxes, CELL)) * H))
    exact = terms.pressure[CELL] * slope - terms.well[CELL] * wave * (wave - 0.5) * (wave - 1)
    deep = (slice(3, -3),) * 3
    np.testing.assert_allclose(spread_out(rhs, boxes, CELL)[deep], exact[deep], atol=1e-9)
