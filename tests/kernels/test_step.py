"""One step of all cells: force, solve and survey put together, against SciPy."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from morphosim.kernels.boxes import survey
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.helmholtz import COLUMNS
from morphosim.kernels.layout import Boxes, CellTerms, Interaction, Limits, Scheme
from morphosim.kernels.step import N_WORK, accept_all, prepare_all, step_explicit, step_implicit
from morphosim.transforms import CosineTables

from .example_boxes import both_ways, box, make_boxes, taken
from .test_forces import H, make_stencil, make_terms

TOLERANCE, RUNAWAY = np.float64(0.15), np.float64(4.0)
STEPPED = [3, 0, 1]
"""Cell 2 is not stepped."""


class Setting:
    """Four cells without neighbours' terms, for two threads."""

    def __init__(self, lhs: float, a1: float, drift: bool) -> None:
        self.boxes, self.phi = make_boxes(seed=13)
        n, shape = len(self.boxes.start), self.boxes.shape
        size = max(int(shape.prod(axis=1).max()), COLUMNS * int(shape.max()))
        self.phi[np.isnan(self.phi)] = 7.0  # a sentinel that can be compared
        self.terms = make_terms(n, drift)
        self.history = np.random.default_rng(14).random(len(self.phi))
        self.scheme = Scheme(*map(np.float64, (lhs, 1.0, a1, -0.5, -0.2)))
        tables = CosineTables(H, "exact", 6, np.float64)
        self.cosines = tables.require(self.boxes.shape)
        self.limits = Limits(TOLERANCE, RUNAWAY, np.float64(0.5))
        self.surveys = np.full((n, 5), -1.0)
        self.bounds, self.order = np.array([0, 2, 3]), np.array(STEPPED)
        self.work, self.force = np.full((2, N_WORK, size), np.nan), np.full((2, 20), np.nan)

    def common(self) -> tuple:
        """Arguments that all kernels share, from the boxes to the scheme."""
        no_others = Interaction(np.float64(0), np.zeros(4, np.int64), np.zeros((1, 1)))
        return (
            self.boxes, self.terms, no_others, None, None, self.work, self.force,
            make_stencil(6), self.scheme,
        )  # fmt: skip

    def rest(self) -> tuple:
        return self.cosines, self.limits, self.surveys, None, None

    def copy_for_reference(self) -> tuple[Boxes, NDArray, NDArray]:
        return (
            self.boxes._replace(spans=self.boxes.spans.copy()),
            self.phi.copy(),
            self.history.copy(),
        )


def rhs_of(setting: Setting, i: int, state: tuple, history: NDArray | None) -> NDArray:
    """Right-hand side of cell i by the kernel that has tests of its own."""
    boxes, phi, _ = state
    rhs = np.zeros(boxes.shape[i].prod())
    terms: CellTerms = setting.terms
    right_hand_side(
        i, phi, history, boxes, terms, terms.drift, None, None, np.zeros(20), rhs,
        make_stencil(6), setting.scheme, np.float64(0.5),
    )  # fmt: skip
    return rhs.reshape(boxes.shape[i])


def symbol(shape: NDArray) -> NDArray:
    k = [np.pi * np.arange(n) / (n * H) for n in shape]
    return sum(a**2 for a in np.meshgrid(*k, indexing="ij", sparse=True))


def check_state(setting: Setting, expected: dict[int, NDArray], before: tuple) -> None:
    """Fields and surveys of the stepped cells are as expected; all else is as it was."""
    boxes, phi, _ = before
    for i, field in expected.items():
        np.testing.assert_allclose(box(setting.phi, boxes, i), field, rtol=1e-11, atol=1e-12)
        box(phi, boxes, i)[:] = box(setting.phi, boxes, i)
        out, spans = np.zeros(5), boxes.spans
        survey(
            phi, boxes.start[i], *boxes.shape[i], TOLERANCE, RUNAWAY, np.float64(0.5), spans,
            boxes.row_start[i], out,
        )  # fmt: skip
        np.testing.assert_allclose(setting.surveys[i], out, rtol=1e-12)
    np.testing.assert_array_equal(setting.phi, phi)
    np.testing.assert_array_equal(setting.boxes.spans, boxes.spans)
    assert (setting.surveys[2] == -1).all()


def implicit(setting: Setting, before: tuple) -> dict[int, NDArray]:
    """(lhs - γΔ)⁻¹ of the right-hand sides."""
    result = {}
    for i in STEPPED:
        rhs = rhs_of(setting, i, before, before[2])
        factor = setting.scheme.lhs + setting.terms.gamma[i] * symbol(rhs.shape)
        result[i] = idctn(dctn(rhs) / factor)
    return result


@both_ways
def test_implicit_step(way: str) -> None:
    setting = Setting(lhs=2.0, a1=0.3, drift=False)
    before = setting.copy_for_reference()
    taken(step_implicit, way)(
        setting.bounds, setting.order, setting.phi, setting.history, *setting.common(),
        *setting.rest(),
    )  # fmt: skip
    check_state(setting, implicit(setting, before), before)
    np.testing.assert_allclose(setting.history, before[2])


@both_ways
def test_explicit_step(way: str) -> None:
    setting = Setting(lhs=0.0, a1=0.02, drift=True)
    before = setting.copy_for_reference()
    taken(step_explicit, way)(
        setting.bounds, setting.order, setting.phi, *setting.common(), *setting.rest()
    )
    expected = {}
    for i in STEPPED:
        phi = box(before[1], before[0], i)
        diffusion = idctn(-setting.terms.gamma[i] * symbol(phi.shape) * dctn(phi))
        expected[i] = rhs_of(setting, i, before, None) + setting.scheme.a1 * diffusion
    check_state(setting, expected, before)


@both_ways
def test_step_with_a_transform_from_outside(way: str) -> None:
    setting = Setting(lhs=2.0, a1=0.3, drift=False)
    before = setting.copy_for_reference()
    rhs = np.zeros(len(setting.phi))
    taken(prepare_all, way)(
        setting.bounds, setting.order, setting.phi, setting.history, *setting.common(),
        np.float64(0.5), rhs, None, None,
    )  # fmt: skip
    expected = implicit(setting, before)
    for i, field in expected.items():
        box(rhs, setting.boxes, i)[:] = field
    taken(accept_all, way)(
        setting.bounds, setting.order, setting.phi, rhs, setting.boxes, setting.limits,
        setting.surveys,
    )  # fmt: skip
    check_state(setting, expected, before)
    np.testing.assert_allclose(setting.history, before[2])


@both_ways
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6])
def test_a_cell_that_diverges_keeps_its_field(value: float, way: str) -> None:
    setting = Setting(lhs=2.0, a1=0.3, drift=False)
    box(setting.history, setting.boxes, 0)[4, 5, 6] = value
    kept: Any = box(setting.phi, setting.boxes, 0).copy()
    other: Any = box(setting.phi, setting.boxes, 1).copy()
    taken(step_implicit, way)(
        setting.bounds, setting.order, setting.phi, setting.history, *setting.common(),
        *setting.rest(),
    )  # fmt: skip
    np.testing.assert_array_equal(box(setting.phi, setting.boxes, 0), kept)
    assert setting.surveys[0, 3] > 0
    assert setting.surveys[0, 0] == pytest.approx(kept.sum()), "not the volume of the kept field"
    assert setting.surveys[1, 3] == 0
    assert np.abs(box(setting.phi, setting.boxes, 1) - other).max() > 0.01
