"""The linearly implicit step of all cells, tried and taken, against NumPy."""

from typing import Any

import numpy as np
import pytest
from numba import get_num_threads, set_num_threads
from numpy.typing import NDArray

from morphosim.kernels.boxes import BAD, CORE, FACE, N_SURVEYED, TOTAL, WANTED
from morphosim.kernels.columns import gather
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.layout import Boxes, Linearisation, Scheme
from morphosim.kernels.linearised import (
    MISSED,
    MOVED,
    N_CHANGES,
    SQUARE,
    stretch,
    take_steps,
    try_steps,
)
from morphosim.kernels.sharing import shares_of
from morphosim.kernels.stencils import COEFFICIENTS

from .example_boxes import (
    H,
    band_in_frame,
    band_of,
    blocks_of,
    both_ways,
    box,
    empty_frame,
    empty_spans,
    expected_band,
    flat_laplacian,
    held,
    in_band,
    inside,
    loaded,
    make_stencil,
    mask_of,
    put,
    rows_of,
    spread_out,
    strides,
    taken,
)
from .example_columns import Cover
from .test_step import (
    STEPPED,
    TOLERANCE,
    Setting,
    band_kept,
    field_in,
    measured,
    random_setting,
    reaching_its_edge,
)

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
        self.low, self.high = (np.full_like(setting.boxes.low, -7) for _ in range(2))
        self.found = np.full((n, N_SURVEYED), -2.0)
        self.changes = np.full((n, N_CHANGES), -3.0)
        self.totals = np.full(n, -4.0)

    def attempt(self, way: str = "compiled") -> None:
        setting = self.setting
        work = setting.space()
        taken(try_steps, way)(
            *setting.acting(), work, setting.room, setting.stencil, make_stencil(2, setting.dtype),
            self.linear, setting.limits, self.new, self.low, self.high, self.found, self.changes,
            *setting.uses,
        )  # fmt: skip
        assert not work.frames[:, [0, 2, 3]].any(), "a frame is left as it is to be found"

    def take(self, way: str = "compiled") -> None:
        setting = self.setting
        taken(take_steps, way)(
            setting.shares, setting.order, self.new, setting.phi, setting.history,
            setting.dtype(GROWTH), setting.boxes, self.low, self.high, self.found, setting.surveys,
            setting.lost, self.totals, setting.space(),
        )  # fmt: skip

    def band(self, i: int) -> NDArray[np.int64]:
        """New band of cell i."""
        rows = [rows_of(values, self.setting.boxes, i) for values in (self.low, self.high)]
        return np.stack(rows, axis=-1).astype(np.int64)

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
    """New field of cell i on its band, and Σ u², Σ (φⁿ⁺¹ - φⁿ)², Σ |∇φ*|² over it."""
    setting, linear = tried.setting, tried.linear
    boxes, terms, band = setting.boxes, setting.terms, band_in_frame(setting.boxes, i)
    phi, last = loaded(boxes, i, setting.history), loaded(boxes, i, setting.phi)
    size = held(boxes, i).sum()
    felt, psi = np.zeros(size), None
    if setting.uses[0]:
        felt, psi = np.full(size, np.nan), empty_frame(boxes, i)
        gather(i, boxes, False, *setting.coupling, phi, felt, psi, empty_spans(boxes, i))
    force = np.full(size, np.nan)
    right_hand_side(
        i, boxes, *blocks_of(boxes, i), terms, terms.drift, phi, psi, felt, None, force, None, None,
        setting.stencil, FORCE, setting.limits.half, setting.uses[0],
    )  # fmt: skip
    gamma, well, lhs = terms.gamma[i], terms.well[i], linear.lhs[i]
    values, old = (np.where(band, part, 0) for part in (phi, last))
    felt, force = (in_frame(boxes, i, spread_out(part, boxes, i)) for part in (felt, force))
    slope = np.where(band, np.sqrt(sum(g**2 for g in flat_gradient(phi, setting, i))), 0)
    damping = np.where(band, well / 4 * (12 * values**2 - 12 * values + 2) + felt, 0)
    explicit = force - RATE * (values - old)
    stiff = linear.stiffness[i]
    implicit = lhs * slope.sum() + (damping * slope).sum() + stiff * slope.sum() ** 2
    loss = stiff * explicit.sum() * slope.sum() / implicit if implicit > 0 else 0.0
    rhs = explicit + gamma * flat_laplacian(phi, boxes, i, ORDER) - loss * slope
    u = np.zeros_like(values)
    for weight in terms.weights[i, : terms.n_iterations[i]]:
        left = (lhs + damping) * u - (gamma + SPREAD) * flat_laplacian(u, boxes, i, 2)
        u = np.where(band, u + weight * (rhs - left), 0)
    sums = [(u**2).sum(), ((values + u - old)[band] ** 2).sum(), (slope**2).sum()]
    return inside(values + u, boxes, i).copy(), sums


def in_frame(boxes: Boxes, i: int, field: NDArray) -> NDArray[np.float64]:
    """A frame with this field, and 0 around it."""
    frame = empty_frame(boxes, i, 0.0)
    inside(frame, boxes, i)[:] = field
    return frame


def linearised_setting(*, coupled: bool = True, **options: Any) -> Setting:
    """Random fields that are faint at the ends of spans, which leave the band."""
    chosen = {"iterations": 4, "drift": coupled} | options
    setting = random_setting(dict.fromkeys(FORCE._fields, 0.0), **chosen)
    ahead = setting.history
    for i in range(len(setting.boxes.start)):
        near = box(setting.phi, setting.boxes, i)
        put(ahead, setting.boxes, i, near * (1 + 0.1 * box(ahead, setting.boxes, i)))
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
        np.testing.assert_allclose(box(tried.new, boxes, i), field, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(tried.changes[i, [MISSED, MOVED, SQUARE]], sums, rtol=1e-11)
        np.testing.assert_allclose(
            tried.found[i, : FACE + 1], measured(field, TOLERANCE), rtol=1e-11, atol=1e-12
        )
        np.testing.assert_array_equal(tried.band(i), expected_band(field, TOLERANCE))
        put(untouched, boxes, i, 5)
    assert (untouched == 5).all(), "of cells that are not stepped, and beyond bands"
    assert (tried.band(2) == -7).all()
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
        put(pool, setting.boxes, 0, 0)
    assert held(setting.boxes, 0).any()
    tried.attempt("python")
    tried.take("python")
    assert setting.surveys[0, BAD] == 0
    assert tried.totals[0] == setting.surveys[0, TOTAL] == setting.surveys[0, CORE] == 0
    assert (tried.changes[0] == 0).all()
    assert (band_of(setting.boxes, 0) == 0).all()


# --- steps that are taken ------------------------------------------------------------------------


@both_ways
def test_a_step_that_is_taken_moves_fields_bands_and_extrapolations(way: str) -> None:
    """What leaves the band is counted; what is new is 0 still."""
    tried = Tried(linearised_setting())
    setting, boxes = tried.setting, tried.setting.boxes
    tried.attempt()
    before, fields, dropped = tried.state(), {}, {}
    for i in STEPPED:
        band = tried.band(i)
        kept = mask_of(band, boxes.shape[i, 2])
        assert (kept & ~in_band(boxes, i)).any()
        new = box(tried.new, boxes, i)
        ahead = np.where(kept, new + GROWTH * (new - box(setting.phi, boxes, i)), 0)
        fields[i] = band, np.where(kept, new, 0), ahead
        dropped[i] = np.where(kept, 0, new).sum()
    tried.take(way)
    assert max(map(abs, dropped.values())) > 1e-4, "nothing left a band"
    for i, (band, phi, ahead) in fields.items():
        np.testing.assert_array_equal(band_of(boxes, i), band)
        np.testing.assert_allclose(box(setting.phi, boxes, i), phi, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(box(setting.history, boxes, i), ahead, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(tried.totals[i], ahead.sum(), rtol=1e-11)
        np.testing.assert_allclose(setting.lost[i], 0.25 + dropped[i], rtol=1e-11)
        survey = tried.found[i].copy()
        survey[TOTAL] = phi.sum()
        np.testing.assert_allclose(setting.surveys[i], survey, rtol=1e-11, atol=1e-12)
    band_kept(setting, before, 2)
    for name in ("phi", "history"):
        rest = np.ones(len(setting.phi), bool)
        for i in STEPPED:
            rest[boxes.start[i] : boxes.start[i] + boxes.shape[i].prod()] = False
        np.testing.assert_array_equal(getattr(setting, name)[rest], before[name][rest])
    after = tried.state()
    for name in ("lost", "totals", "surveys"):
        np.testing.assert_array_equal(after[name][2], before[name][2], err_msg=name)


@both_ways
def test_a_band_for_which_there_is_no_room_stays(way: str) -> None:
    tried, free = Tried(edge_setting()), Tried(edge_setting())
    boxes = tried.setting.boxes
    size = held(boxes, 0).sum()
    tried.setting.room[0] = size
    before = tried.state()
    for each in (tried, free):
        each.attempt(way)
        each.take(way)
    band_kept(tried.setting, before, 0)
    assert tried.setting.surveys[0, WANTED] == held(free.setting.boxes, 0).sum() > size
    for name in ("phi", "history"):
        pools = [getattr(each.setting, name) for each in (tried, free)]
        np.testing.assert_array_equal(box(pools[0], boxes, 0), box(pools[1], free.setting.boxes, 0))
    np.testing.assert_array_equal(band_of(boxes, 1), band_of(free.setting.boxes, 1))


def edge_setting() -> Setting:
    """Cells whose field is 1 on the whole band, as is φ*."""
    setting = reaching_its_edge()
    setting.history[:] = setting.phi
    return setting


@both_ways
def test_new_fields_may_take_the_place_of_extrapolations(way: str) -> None:
    results = []
    for apart in (True, False):
        tried = Tried(linearised_setting(), apart)
        tried.attempt(way)
        tried.take(way)
        state = tried.state()
        for name in ("phi", "history"):
            fields = [field_in(state, tried.setting, i, name) for i in range(5)]
            state[name] = np.concatenate([field.ravel() for field in fields])
        results.append(state)
    for name, value in results[0].items():
        np.testing.assert_allclose(results[1][name], value, rtol=1e-14, err_msg=name)


@both_ways
@pytest.mark.parametrize("apart", [True, False])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6])
def test_a_cell_that_diverges_keeps_its_field(value: float, apart: bool, way: str) -> None:
    tried = Tried(linearised_setting(), apart)
    setting, boxes = tried.setting, tried.setting.boxes
    ahead = box(setting.history, boxes, 0)
    ahead[tuple(np.argwhere(in_band(boxes, 0))[-40])] = value
    put(setting.history, boxes, 0, ahead)
    setting.surveys[0] = np.arange(N_SURVEYED) + 20.0
    setting.surveys[0, BAD] = 0
    before = tried.state()
    tried.attempt(way)
    tried.take(way)
    assert tried.found[0, BAD] > 0
    before["surveys"][0, BAD] = tried.found[0, BAD]
    after = tried.state()
    for name in ("surveys", "lost", "totals"):
        assert np.array_equal(after[name][0], before[name][0]), name
    band_kept(setting, before, 0)
    for name in ("phi", "history") if apart else ("phi",):
        now, then = (field_in(state, setting, 0, name) for state in (after, before))
        np.testing.assert_array_equal(now, then, err_msg=name)
    assert setting.surveys[1, BAD] == 0
    change = box(setting.phi, boxes, 1) - field_in(before, setting, 1)
    assert np.abs(change).max() > 0.01


@both_ways
def test_extrapolations_to_another_time_lie_on_the_same_line(way: str) -> None:
    tried = Tried(linearised_setting())
    setting, boxes, share = tried.setting, tried.setting.boxes, 0.3
    after = tried.state()
    for i in STEPPED:
        phi, ahead = box(after["phi"], boxes, i), box(after["history"], boxes, i)
        ahead = phi + share * (ahead - phi)
        put(after["history"], boxes, i, ahead)
        after["totals"][i] = ahead.sum()
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
