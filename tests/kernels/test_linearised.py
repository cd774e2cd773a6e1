"""The linearly implicit step of all cells, tried and taken, against NumPy."""

from typing import Any

import numpy as np
import pytest
from numba import get_num_threads, set_num_threads
from numpy.typing import NDArray

from morphosim.kernels.boxes import BAD, CORE, FACE, N_SURVEYED, TOTAL
from morphosim.kernels.columns import gather
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.layout import Linearisation, Scheme
from morphosim.kernels.linearised import (
    MISSED,
    MOVED,
    N_CHANGES,
    SLOPE,
    stretch,
    take_steps,
    try_steps,
)
from morphosim.kernels.sharing import shares_of
from morphosim.kernels.stencils import COEFFICIENTS

from .example_boxes import (
    H,
    band_of,
    both_ways,
    box,
    empty_frame,
    expected_band,
    flat_laplacian,
    in_band,
    in_runs,
    inside,
    loaded,
    make_stencil,
    strides,
    taken,
)
from .example_columns import Cover
from .test_step import STEPPED, TOLERANCE, Setting, measured, random_setting

ORDER, RATE, SPREAD = 6, 1.3, 0.4
FORCE = Scheme(*(np.float64(v) for v in (0, 0, 1, 0, 0, 0, 0)))
"""With this the right-hand side is F."""
GROWTH = 1.4


class Tried:
    """A setting whose `history` is φ*, and what a step that is tried writes."""

    def __init__(self, setting: Setting, apart: bool = True) -> None:
        n, real = len(setting.boxes.start), setting.dtype
        self.setting = setting
        self.linear = Linearisation(
            lhs=np.where(setting.terms.fresh, RATE, 1.6 * RATE).astype(real),
            rate=real(RATE), spread=real(SPREAD), stiffness=np.linspace(0, 2e-3, n),
        )  # fmt: skip
        self.new = np.full_like(setting.phi, 5) if apart else setting.history
        self.rows = np.full_like(setting.boxes.band, -7)
        self.found = np.full((n, N_SURVEYED), -2.0)
        self.changes = np.full((n, N_CHANGES), -3.0)
        self.totals = np.full(n, -4.0)

    def attempt(self, way: str = "compiled") -> None:
        setting = self.setting
        taken(try_steps, way)(
            *setting.acting(), *setting.space(), setting.stencil, make_stencil(2, setting.dtype),
            self.linear, setting.limits, self.new, self.rows, self.found, self.changes,
            *setting.uses,
        )  # fmt: skip

    def take(self, way: str = "compiled") -> None:
        setting = self.setting
        taken(take_steps, way)(
            setting.shares, setting.order, self.new, setting.phi, setting.history,
            setting.dtype(GROWTH), setting.boxes, self.rows, self.found, setting.surveys,
            setting.lost, self.totals,
        )  # fmt: skip

    def state(self) -> dict[str, NDArray]:
        """Copy of all that taking a step changes."""
        return self.setting.state() | {"totals": self.totals.copy()}


def flat_gradient(frame: NDArray, setting: Setting, i: int) -> list[NDArray]:
    """∇ of a flat frame."""
    return [
        sum(
            w / H * (np.roll(frame, -m * stride) - np.roll(frame, m * stride))
            for m, w in enumerate(COEFFICIENTS[ORDER], 1)
        )
        for stride in (*strides(i, setting.boxes), 1)
    ]


def expected(tried: Tried, i: int) -> tuple[NDArray, list[float]]:
    """New field of cell i on its band, and Σ u², Σ (φⁿ⁺¹ - φⁿ)², Σ |∇φ*|² over its runs."""
    setting, linear = tried.setting, tried.linear
    boxes, terms, runs = setting.boxes, setting.terms, in_runs(setting.boxes, i)
    phi, last = loaded(boxes, i, setting.history), loaded(boxes, i, setting.phi)
    felt, psi = np.zeros_like(phi), None
    if setting.uses[0]:
        felt, psi = empty_frame(boxes, i), empty_frame(boxes, i)
        gather(i, boxes, False, *setting.coupling, phi, felt, psi)
    force = felt.copy()
    right_hand_side(
        i, boxes, False, terms, terms.drift, phi, psi, force, None, None, setting.stencil, FORCE,
        setting.limits.half, setting.uses[0],
    )  # fmt: skip
    gamma, well, lhs = terms.gamma[i], terms.well[i], linear.lhs[i]
    zeroed = [np.where(runs, part, 0) for part in (phi, last, felt, force)]
    values, old, felt, force = zeroed
    slope = np.where(runs, np.sqrt(sum(g**2 for g in flat_gradient(phi, setting, i))), 0)
    damping = np.where(runs, well / 4 * (12 * values**2 - 12 * values + 2) + felt, 0)
    explicit = force - RATE * (values - old)
    stiff = linear.stiffness[i]
    implicit = lhs * slope.sum() + (damping * slope).sum() + stiff * slope.sum() ** 2
    loss = stiff * explicit.sum() * slope.sum() / implicit if implicit > 0 else 0.0
    rhs = explicit + gamma * flat_laplacian(phi, boxes, i, ORDER) - loss * slope
    u = np.zeros_like(values)
    for weight in terms.weights[i, : terms.n_iterations[i]]:
        left = (lhs + damping) * u - (gamma + SPREAD) * flat_laplacian(u, boxes, i, 2)
        u = np.where(runs, u + weight * (rhs - left), 0)
    sums = [(u**2).sum(), ((values + u - old)[runs] ** 2).sum(), (slope**2).sum()]
    on_band = in_band(boxes, i)[..., None]
    return np.where(on_band, inside(values + u, boxes, i), 0), sums


def linearised_setting(*, coupled: bool = True, **options: Any) -> Setting:
    """Random fields whose outermost rows are faint, so that they leave the band."""
    chosen = {"iterations": 4, "drift": coupled} | options
    setting = random_setting(dict.fromkeys(FORCE._fields, 0.0), **chosen)
    ahead = setting.history
    for i in range(len(setting.boxes.start)):
        near = box(setting.phi, setting.boxes, i)
        box(ahead, setting.boxes, i)[:] = near * (1 + 0.1 * box(ahead, setting.boxes, i))
    if coupled:
        setting.phi, setting.history = ahead, setting.phi  # what cells feel of each other
        setting.couple(Cover(setting.boxes))
        setting.phi, setting.history = setting.history, ahead
    return setting


# --- steps that are tried ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("way", "options"),
    [
        ("compiled", {}),
        ("python", {}),
        ("python", {"iterations": 5, "coupled": False}),
    ],
)
def test_a_tried_step_solves_for_the_new_field_and_changes_nothing(way: str, options: Any) -> None:
    tried = Tried(linearised_setting(**options))
    boxes = tried.setting.boxes
    before = tried.state()
    fields = {i: expected(tried, i) for i in STEPPED}
    tried.attempt(way)
    untouched = tried.new.copy()
    for i, (field, sums) in fields.items():
        on_band = in_band(boxes, i)
        new = np.where(on_band[..., None], box(tried.new, boxes, i), 0)
        np.testing.assert_allclose(new, field, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(tried.changes[i, [MISSED, MOVED, SLOPE]], sums, rtol=1e-11)
        np.testing.assert_allclose(
            tried.found[i, : FACE + 1], measured(field, TOLERANCE), rtol=1e-11, atol=1e-12
        )
        rows = tried.rows[boxes.plane_start[i] :][: boxes.shape[i, 0]]
        np.testing.assert_array_equal(rows, expected_band(field, TOLERANCE))
        box(untouched, boxes, i)[on_band] = 5
    assert (untouched == 5).all(), "of cells that are not stepped, and beyond bands"
    assert (tried.found[2] == -2).all()
    assert (tried.changes[2] == -3).all()
    for name, value in tried.state().items():
        np.testing.assert_array_equal(value, before[name], err_msg=name)


def test_what_a_cell_feels_is_in_its_step() -> None:
    """As a check of the test before."""
    options = {"coupled": False, "drift": True}
    with_others, alone = Tried(linearised_setting()), Tried(linearised_setting(**options))
    with_others.attempt()
    alone.attempt("python")
    boxes = alone.setting.boxes
    assert np.abs(box(with_others.new - alone.new, boxes, 0)).max() > 1e-3
    felt = with_others.setting.coupling[1].felt
    felt[:] = False
    with_others.attempt()
    np.testing.assert_allclose(with_others.new, alone.new, rtol=1e-12, atol=1e-14)


def test_a_cell_that_is_nowhere_stays_so() -> None:
    """There the loss of its pressure would be 0 / 0."""
    tried = Tried(linearised_setting())
    setting = tried.setting
    for pool in (setting.phi, setting.history):
        box(pool, setting.boxes, 0)[:] = 0
    band_of(setting.boxes, 0)[3:5] = 2, 6
    tried.attempt("python")
    tried.take("python")
    assert setting.surveys[0, BAD] == 0
    assert tried.totals[0] == setting.surveys[0, TOTAL] == setting.surveys[0, CORE] == 0
    assert (tried.changes[0] == 0).all()
    assert (band_of(setting.boxes, 0)[:, 0] >= band_of(setting.boxes, 0)[:, 1]).all()


# --- steps that are taken ------------------------------------------------------------------------


@both_ways
def test_a_step_that_is_taken_moves_fields_bands_and_extrapolations(way: str) -> None:
    """Rows that leave the band are 0 then, and counted; new rows are 0 still."""
    tried = Tried(linearised_setting())
    boxes = tried.setting.boxes
    tried.attempt()
    after, dropped = tried.state(), {}
    for i in STEPPED:
        y, rows = np.arange(boxes.shape[i, 1]), tried.rows[boxes.plane_start[i] :]
        rows = rows[: boxes.shape[i, 0]]
        old = in_band(boxes, i)
        kept = (old & (y >= rows[:, :1]) & (y < rows[:, 1:]))[..., None]
        new = np.where(old[..., None], box(tried.new, boxes, i), 0)
        phi, ahead = box(after["phi"], boxes, i), box(after["history"], boxes, i)
        ahead[:] = np.where(kept, new + GROWTH * (new - phi), 0)
        phi[:] = np.where(kept, new, 0)
        dropped[i] = np.where(kept, 0, new).sum()
        after["totals"][i] = ahead.sum()
        after["lost"][i] += dropped[i]
        after["surveys"][i] = tried.found[i]
        after["surveys"][i, TOTAL] = phi.sum()
        after["band"][boxes.plane_start[i] :][: boxes.shape[i, 0]] = rows
    tried.take(way)
    assert max(map(abs, dropped.values())) > 1e-4, "no row left a band"
    for name, value in tried.state().items():
        np.testing.assert_allclose(value, after[name], rtol=1e-11, atol=1e-12, err_msg=name)


@both_ways
def test_new_fields_may_take_the_place_of_extrapolations(way: str) -> None:
    results = []
    for apart in (True, False):
        tried = Tried(linearised_setting(), apart)
        tried.attempt(way)
        tried.take(way)
        results.append(tried.state())
    for name, value in results[0].items():
        np.testing.assert_allclose(results[1][name], value, rtol=1e-14, err_msg=name)


@both_ways
@pytest.mark.parametrize("apart", [True, False])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6])
def test_a_cell_that_diverges_keeps_its_field(value: float, apart: bool, way: str) -> None:
    tried = Tried(linearised_setting(), apart)
    setting, boxes = tried.setting, tried.setting.boxes
    x, y = np.argwhere(in_band(boxes, 0))[-1]
    box(setting.history, boxes, 0)[x, y, 6] = value
    setting.surveys[0] = np.arange(N_SURVEYED) + 20.0
    setting.surveys[0, BAD] = 0
    before = tried.state()
    tried.attempt(way)
    tried.take(way)
    assert tried.found[0, BAD] > 0
    before["surveys"][0, BAD] = tried.found[0, BAD]
    after, rows = tried.state(), slice(boxes.plane_start[0], boxes.plane_start[1])
    for name in ("surveys", "lost", "totals"):
        assert np.array_equal(after[name][0], before[name][0]), name
    np.testing.assert_array_equal(after["band"][rows], before["band"][rows])
    for name in ("phi", "history") if apart else ("phi",):
        now, then = (box(state[name], boxes, 0) for state in (after, before))
        np.testing.assert_array_equal(now, then, err_msg=name)
    assert setting.surveys[1, BAD] == 0
    assert np.abs(box(after["phi"] - before["phi"], boxes, 1)).max() > 0.01


@both_ways
def test_extrapolations_to_another_time_lie_on_the_same_line(way: str) -> None:
    tried = Tried(linearised_setting())
    setting, boxes, share = tried.setting, tried.setting.boxes, 0.3
    after = tried.state()
    for i in STEPPED:
        phi, ahead = box(after["phi"], boxes, i), box(after["history"], boxes, i)
        ahead[:] = np.where(in_band(boxes, i)[..., None], phi + share * (ahead - phi), ahead)
        after["totals"][i] = np.where(in_band(boxes, i)[..., None], ahead, 0).sum()
    taken(stretch, way)(
        setting.shares, setting.order, setting.phi, setting.history, share, boxes, tried.totals
    )
    for name, value in tried.state().items():
        np.testing.assert_allclose(value, after[name], rtol=1e-12, atol=1e-13, err_msg=name)


# --- what must not matter ------------------------------------------------------------------------


@pytest.fixture
def _threads_back():
    before = get_num_threads()
    yield
    set_num_threads(before)


@pytest.mark.usefixtures("_threads_back")
def test_the_result_does_not_depend_on_the_lists() -> None:
    """Nor on how many threads take them, nor on what was in the frames before."""
    lists = [
        ([0, 1, 2, 3, 4], [0, 5], 1),
        ([0, 1, 2, 3, 4], [0, 2, 5], 2),
        ([4, 2, 0, 3, 1], [0, 1, 1, 4, 5], 2),
    ]
    results = []
    for order, bounds, threads in lists:
        tried = Tried(linearised_setting())
        setting = tried.setting
        setting.order, setting.shares = np.array(order), shares_of(bounds, threads)
        set_num_threads(min(threads, get_num_threads()))
        for _ in range(2):
            tried.attempt()
            tried.take()
            stretch(
                setting.shares, setting.order, setting.phi, setting.history, 0.8, setting.boxes,
                tried.totals,
            )  # fmt: skip
        results.append(tried.state())
    assert (results[0]["surveys"][:, BAD] == 0).all()
    for other in results[1:]:
        for key, value in results[0].items():
            np.testing.assert_array_equal(other[key], value, err_msg=key)
