"""The nonlinear force and the right-hand side, against plain NumPy."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.frames import HALO
from morphosim.kernels.layout import CellTerms, Scheme
from morphosim.kernels.points import point_force, records
from morphosim.kernels.stencils import COEFFICIENTS

from .example_boxes import (
    H,
    band_of,
    both_ways,
    box,
    empty_frame,
    flat_laplacian,
    grid,
    in_band,
    in_runs,
    inside,
    loaded,
    make_boxes,
    make_stencil,
    positions,
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
    boxes, pool = make_boxes(seed=6)
    rng = np.random.default_rng(7)
    phi = loaded(boxes, CELL, pool, whole)
    random: dict[str, Any] = {
        key: rng.random(len(phi)) if key in present else None
        for key in ("repulsion", "psi", "history")
    }
    terms = make_terms(len(boxes.start), "drift" in present)
    scheme = Scheme(**{key: np.float64(value) for key, value in NUMBERS.items()})
    rhs = empty_frame(boxes, CELL) if random["repulsion"] is None else random["repulsion"].copy()
    history = None if random["history"] is None else random["history"].copy()
    start = empty_frame(boxes, CELL) if "start" in present else None

    taken(right_hand_side, way)(
        CELL, boxes, whole, terms, terms.drift, phi, random["psi"], rhs, history, start,
        make_stencil(order), scheme, np.float64(0.5), True if "repulsion" in present else None,
    )  # fmt: skip

    fields = {k: None if v is None else grid(v, boxes, CELL) for k, v in random.items()}
    wide = grid(phi, boxes, CELL)
    value, force = wide, expected_force(wide, terms, order, fields)
    memory = 0 if history is None else fields["history"]
    expected = {"rhs": (rhs, scheme.a0 * value + scheme.a1 * force + memory)}
    if history is not None:
        expected["history"] = history, scheme.b0 * value + scheme.b1 * force
    if start is not None:
        extrapolated = scheme.e0 * value + scheme.e1 * (memory + force)
        expected["start"] = start, value if history is None else extrapolated
    rows = in_band(boxes, CELL, whole)
    assert rows.any()
    for key, (found, wanted) in expected.items():
        values = inside(found, boxes, CELL)[rows]
        wanted = wanted[HALO:-HALO, HALO:-HALO, HALO : HALO + values.shape[1]]
        np.testing.assert_allclose(values, wanted[rows], rtol=1e-12, atol=1e-12, err_msg=key)
    # Nothing but the runs is written, and the field not at all.
    beside = ~in_runs(boxes, CELL, whole)
    for key, found in (("repulsion", rhs), ("history", history), ("start", start)):
        if found is not None and random.get(key) is not None:
            np.testing.assert_array_equal(found[beside], random[key][beside])
        elif found is not None:
            assert np.isnan(found[beside]).all()
            assert np.isfinite(found[~beside]).all()
    np.testing.assert_array_equal(phi, loaded(boxes, CELL, pool, whole))


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
    phi, rhs = loaded(boxes, CELL, pool), empty_frame(boxes, CELL)
    values = np.random.default_rng(8).random((len(boxes.start), 2))
    terms = make_terms(len(boxes.start), drift=False)
    parts = [(constant, np.full((len(values), 1), 0.7)), (of_all, values)]
    terms = terms._replace(points=records(parts, np.dtype(float)))
    taken(right_hand_side, "python")(
        CELL, boxes, False, terms, None, phi, None, rhs, None, None, make_stencil(order),
        Scheme(*map(np.float64, (1, 0, 1, 0, 0, 0, 0))), np.float64(0.5), None,
    )  # fmt: skip
    runs = in_runs(boxes, CELL)
    wide = grid(phi, boxes, CELL)
    plain = expected_force(wide, terms, order, {"repulsion": None, "psi": None})
    slope = gradient(wide, order)
    laplacian = grid(flat_laplacian(phi, boxes, CELL, order), boxes, CELL)
    expected = empty_frame(boxes, CELL)
    grid(expected, boxes, CELL)[:] = (
        plain + 0.7 + values[CELL, 0] * wide + 2 * slope[0] + 3 * slope[1] + 5 * slope[2]
        + values[CELL, 1] * laplacian
    )  # fmt: skip
    assert np.isfinite(rhs[runs]).all()
    np.testing.assert_allclose(rhs[runs], expected[runs], rtol=1e-11, atol=1e-11)


def test_without_history_the_start_is_the_field() -> None:
    """Whatever e0 is."""
    boxes, pool = make_boxes(seed=6)
    phi, start = loaded(boxes, CELL, pool), empty_frame(boxes, CELL)
    scheme = Scheme(*np.arange(7.0) + 2)
    terms = make_terms(len(boxes.start), drift=False)
    right_hand_side(
        CELL, boxes, False, terms, None, phi, None, empty_frame(boxes, CELL), None, start,
        make_stencil(6), scheme, np.float64(0.5), None,
    )  # fmt: skip
    runs = in_runs(boxes, CELL)
    np.testing.assert_array_equal(start[runs], phi[runs])


def test_a_smooth_field_has_the_force_of_the_continuum() -> None:
    boxes, pool = make_boxes(seed=6)
    wave = np.sin(0.1 * sum(positions(boxes, CELL)) * H)
    box(pool, boxes, CELL)[:] = wave
    band_of(boxes, CELL)[:] = 0, boxes.shape[CELL, 1]
    terms = make_terms(len(boxes.start), drift=False)
    rhs = empty_frame(boxes, CELL)
    right_hand_side(
        CELL, boxes, False, terms, None, loaded(boxes, CELL, pool), None, rhs, None, None,
        make_stencil(6), Scheme(*map(np.float64, (1, 0, 1, 0, 0, 0, 0))), np.float64(0.5), None,
    )  # fmt: skip
    slope = np.sqrt(3) * 0.1 * np.abs(np.cos(0.1 * sum(positions(boxes, CELL)) * H))
    exact = terms.pressure[CELL] * slope - terms.well[CELL] * wave * (wave - 0.5) * (wave - 1)
    deep = (slice(3, -3),) * 3
    np.testing.assert_allclose(inside(rhs, boxes, CELL)[deep], exact[deep], atol=1e-9)
