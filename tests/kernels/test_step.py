"""One step of all cells: force, solve and survey put together, against NumPy and SciPy."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba import get_num_threads, set_num_threads
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from morphosim.engine.solvers.cosine_transforms import CosineTables
from morphosim.kernels.boxes import BAD, CORE, FACE, N_SURVEYED, TOTAL, WANTED
from morphosim.kernels.columns import accumulate
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.frames import frame_size
from morphosim.kernels.layout import Boxes, Limits, Pairs, Room, Scheme
from morphosim.kernels.pairs import accumulate_pairs
from morphosim.kernels.sharing import shares_of
from morphosim.kernels.step import accept_all, prepare_all, step_band, step_transform
from morphosim.numerics.chebyshev import chebyshev_roots, largest_eigenvalue
from morphosim.numerics.parameters import Numerics

from .example_boxes import (
    ORIGINS,
    SHAPES,
    H,
    band_in_frame,
    band_of,
    blocks_of,
    both_ways,
    box,
    empty_frame,
    expected_band,
    flat_laplacian,
    held,
    in_band,
    inside,
    lay_out,
    loaded,
    make_boxes,
    make_stencil,
    mask_of,
    mirrored,
    positions,
    put,
    room_for,
    rows_of,
    set_band,
    spread_out,
    taken,
)
from .example_columns import Cover, interaction
from .test_forces import make_terms

TOLERANCE, RUNAWAY = 0.15, 4.0
STEPPED = [3, 0, 4, 1]
"""Cell 2 is not stepped."""
SCHEME = {"lhs": 2.0, "a0": 1.0, "a1": 0.3, "b0": -0.5, "b1": -0.2, "e0": 0.9, "e1": 0.4}
EULER = {"lhs": 0.0, "a0": 0.0, "a1": 1.0, "b0": 0.0, "b1": 0.0, "e0": 1.0, "e1": 0.0}


class Setting:
    """Cells, and all that a step needs; without neighbours' terms until `couple`."""

    def __init__(
        self, boxes: Boxes, phi: NDArray, numbers: dict, *, order: int = 6, iterations: int = 0,
        drift: bool = False, memory: bool = True, laplacian: str = "exact",
        tolerance: float = TOLERANCE, dtype: type = np.float64, whole: bool = False,
    ) -> None:  # fmt: skip
        self.boxes, self.dtype, self.whole, n = boxes, dtype, whole, len(boxes.start)
        self.phi = np.where(np.isnan(phi), 7, phi).astype(dtype)  # a sentinel one can compare
        self.terms = make_terms(n, drift, iterations)
        self.terms = self.terms._replace(
            **{
                k: v.astype(dtype)
                for k, v in self.terms._asdict().items()
                if v is not None and v.dtype.kind == "f"
            }
        )
        self.history = np.full_like(self.phi, 9) if memory else None
        if self.history is not None:
            rng = np.random.default_rng(14)
            for i in range(n):
                values = rng.uniform(-0.5, 1, boxes.shape[i])
                put(self.history, boxes, i, np.where(in_band(boxes, i), values, 0))
        self.scheme = Scheme(**{key: dtype(value) for key, value in numbers.items()})
        self.first = Scheme(*(dtype(0.9) * value for value in self.scheme))
        self.fd_order, self.stencil = order, make_stencil(order, dtype)
        self.cosines = CosineTables(
            Numerics(spacing=H, laplacian=laplacian, order=order), dtype
        ).require(boxes.shape)
        self.limits = Limits(*map(dtype, (tolerance, RUNAWAY, 0.5)))
        self.surveys, self.lost = np.full((n, N_SURVEYED), -1.0), np.full(n, 0.25)
        self.room = boxes.shape.prod(axis=1)
        self.order = np.array(STEPPED)
        self.shares = shares_of([0, 2, len(STEPPED)], threads=2)
        self.coupling: tuple = (interaction(), None, None, None)
        self.uses: tuple = (None, None)

    def couple(self, cover: Cover, *, attracts: bool = True, pairs: Pairs | None = None) -> None:
        """Repulsion, and attraction by type and by pairs, by the present fields."""
        columns = cover.columns(background=False, n_types=3 if attracts else 0)
        accumulate(cover.shares(), cover.lists(), self.phi, self.boxes, interaction(), columns)
        pool = None
        if pairs is not None:
            sizes = [frame_size(i, self.boxes) for i in range(len(self.boxes.start))]
            pairs.frame_start[:] = np.cumsum([0, *sizes[:-1]])
            pool = np.full(sum(sizes), np.nan)
            accumulate_pairs(self.shares, self.order, pairs, self.phi, self.boxes, pool)
        self.coupling = interaction(), columns, None if pairs is None else pairs.frame_start, pool
        self.uses = True, True if attracts or pairs is not None else None

    def scheme_of(self, i: int) -> Scheme:
        return self.first if self.terms.fresh[i] else self.scheme

    def acting(self) -> tuple:
        return (
            self.shares, self.order, self.phi, self.history, self.boxes, self.terms,
            *self.coupling,
        )  # fmt: skip

    def space(self) -> Room:
        return room_for(self.boxes, self.order, self.shares.threads, self.whole, self.dtype)

    def band_step(self, way: str = "compiled") -> None:
        work = self.space()
        taken(step_band, way)(
            *self.acting(), work, self.room, self.stencil, self.scheme, self.first, self.limits,
            self.surveys, self.lost, *self.uses,
        )  # fmt: skip
        assert not work.frames[:, [0, 2]].any(), "a frame is left as it is to be found"

    def transform_step(self, way: str = "compiled") -> None:
        taken(step_transform, way)(
            *self.acting(), self.space(), self.stencil, self.scheme, self.first, self.cosines,
            self.limits, self.surveys, *self.uses,
        )  # fmt: skip

    def outside_step(self, way: str = "compiled") -> None:
        """With a transform outside of Numba."""
        rhs, work = np.zeros_like(self.phi), self.space()
        taken(prepare_all, way)(
            *self.acting(), work, self.stencil, self.scheme, self.first, self.limits.half, rhs,
            *self.uses,
        )  # fmt: skip
        for i in self.order:
            put(rhs, self.boxes, i, solved(self, i, box(rhs, self.boxes, i)))
        taken(accept_all, way)(
            self.shares, self.order, self.phi, rhs, self.boxes, self.limits, work, self.surveys
        )

    def state(self) -> dict[str, Any]:
        """Copy of all that a step changes."""
        return {
            "phi": self.phi.copy(),
            "history": None if self.history is None else self.history.copy(),
            "low": self.boxes.low.copy(),
            "high": self.boxes.high.copy(),
            "place": self.boxes.place.copy(),
            "surveys": self.surveys.copy(),
            "lost": self.lost.copy(),
        }


BY_TRANSFORMS = (Setting.transform_step, Setting.outside_step)
"""These hold whole boxes."""


def random_setting(numbers: dict, *, whole: bool = False, **options: Any) -> Setting:
    """Random fields that are faint at the ends of spans, and in some rows, which leave the band."""
    boxes, phi = make_boxes(13, whole=whole)
    rng = np.random.default_rng(19)
    for i in range(len(boxes.start)):
        field, spans = box(phi, boxes, i), band_of(boxes, i)
        for x, y in np.ndindex(*spans.shape[:2]):
            low, high = spans[x, y]
            if rng.random() < 0.4:
                field[x, y] *= 1e-3
            if not whole:
                field[x, y, low : low + rng.integers(7)] *= 1e-3
                field[x, y, high - rng.integers(7) : high] *= 1e-3
        if whole:  # the first rows of each plane
            first = np.cumsum(spans[..., 1] > 0, axis=1) <= 4
            field[first] *= 1e-3
        put(phi, boxes, i, field)
    return Setting(boxes, phi, numbers, whole=whole, **options)


def setting_for(step: Callable, numbers: dict, **options: Any) -> Setting:
    """A random setting of boxes as this step holds them."""
    return random_setting(numbers, whole=step in BY_TRANSFORMS, **options)


def prepared(setting: Setting, i: int, whole: bool) -> tuple[NDArray, NDArray, NDArray | None]:
    """Right-hand side, start and next history in cell i's box, by a kernel with tests of its own.

    The start is in a frame, and NaN elsewhere.
    """
    boxes, size = setting.boxes, held(setting.boxes, i).sum()
    phi = mirrored(boxes, i, setting.phi) if whole else loaded(boxes, i, setting.phi)
    rhs, felt, memory = (np.full(size, np.nan) for _ in range(3))
    start = empty_frame(boxes, i)
    right_hand_side(
        i, boxes, *blocks_of(boxes, i, whole), setting.terms, setting.terms.drift, phi, None, felt,
        setting.history, rhs, None if setting.history is None else memory, start, setting.stencil,
        setting.scheme_of(i), setting.limits.half, None,
    )  # fmt: skip
    kept = None if setting.history is None else spread_out(memory, boxes, i)
    return spread_out(rhs, boxes, i), start, kept


def measured(field: NDArray, tolerance: float) -> list[float]:
    """What a survey finds, up to the faces."""
    size = np.abs(field)
    faces = size.copy()
    faces[1:-1, 1:-1, 1:-1] = 0
    bad = (~(size <= RUNAWAY)).sum()
    return [field.sum(), (size > tolerance).sum(), (field > 0.5).sum(), bad, faces.max()]


def check(
    setting: Setting, before: dict, fields: dict[int, NDArray], histories: dict[int, NDArray | None]
) -> None:
    """The stepped cells are as expected, and all else as it was."""
    boxes = setting.boxes
    for i, field in fields.items():
        band = expected_band(field, TOLERANCE, setting.whole)
        np.testing.assert_array_equal(band_of(boxes, i), band)
        np.testing.assert_allclose(box(setting.phi, boxes, i), field, rtol=1e-11, atol=1e-12)
        put(before["phi"], boxes, i, box(setting.phi, boxes, i))
        if setting.history is not None:
            found = box(setting.history, boxes, i)
            np.testing.assert_allclose(found, histories[i], rtol=1e-11, atol=1e-12)
            put(before["history"], boxes, i, found)
        rows_of(before["low"], boxes, i)[:] = band[..., 0]
        rows_of(before["high"], boxes, i)[:] = band[..., 1]
        if not setting.whole:
            length = (band[..., 1] - band[..., 0]).ravel()
            place = np.cumsum(length) - length - band[..., 0].ravel()
            rows_of(before["place"], boxes, i)[:] = place.reshape(band.shape[:2])
            # What the cell does not fill any more is of no use.
            end = boxes.start[i] + length.sum()
            rest = slice(end, boxes.start[i] + boxes.shape[i].prod())
            for name in ("phi", "history"):
                if before[name] is not None:
                    before[name][rest] = getattr(setting, name)[rest]
    for name, value in setting.state().items():
        if name not in ("surveys", "lost"):
            np.testing.assert_array_equal(value, before[name], err_msg=name)
    assert (setting.surveys[2] == -1).all()
    assert setting.lost[2] == 0.25


def symbol(shape: NDArray) -> NDArray:
    k = [np.pi * np.arange(n) / (n * H) for n in shape]
    return np.asarray(sum(a**2 for a in np.meshgrid(*k, indexing="ij", sparse=True)))


def solved(setting: Setting, i: int, rhs: NDArray) -> NDArray:
    """(lhs - γΔ)⁻¹ of a right-hand side."""
    factor = setting.scheme_of(i).lhs + setting.terms.gamma[i] * symbol(rhs.shape)
    return np.asarray(idctn(dctn(rhs) / factor))


@both_ways
@pytest.mark.parametrize("step", BY_TRANSFORMS)
def test_step_by_transforms(step: Callable, way: str) -> None:
    setting = setting_for(step, SCHEME)
    before, fields, histories = setting.state(), {}, {}
    for i in STEPPED:
        rhs, _, histories[i] = prepared(setting, i, True)
        fields[i] = solved(setting, i, rhs)
    step(setting, way)
    for i, field in fields.items():
        np.testing.assert_allclose(setting.surveys[i, : FACE + 1], measured(field, TOLERANCE))
    check(setting, before, fields, histories)


BAND_STEPS = {
    "with memory": (SCHEME, {"iterations": 4}),
    "odd number of iterations": (SCHEME, {"iterations": 3, "order": 4}),
    "without memory": (SCHEME, {"iterations": 5, "memory": False, "order": 2}),
    "explicit": (EULER, {"iterations": 1, "memory": False, "drift": True}),
}


@pytest.mark.parametrize(
    ("name", "way"), [("with memory", "compiled"), *((name, "python") for name in BAND_STEPS)]
)
def test_step_on_the_band(name: str, way: str) -> None:
    """Iteration by iteration; what leaves the band is counted."""
    numbers, options = BAND_STEPS[name]
    setting = random_setting(numbers, **options)
    boxes = setting.boxes
    before, fields, histories = setting.state(), {}, {}
    dropped, found = {}, {}
    for i in STEPPED:
        rhs, u, history = prepared(setting, i, False)
        band, gamma = band_in_frame(boxes, i), setting.terms.gamma[i]
        u, given = np.where(band, u, 0), np.zeros_like(u)
        inside(given, boxes, i)[:] = rhs
        lhs = setting.scheme_of(i).lhs
        for weight in setting.terms.weights[i, : setting.terms.n_iterations[i]]:
            change = given - lhs * u + gamma * flat_laplacian(u, boxes, i, setting.fd_order)
            u = np.where(band, u + weight * change, 0)
        field = inside(u, boxes, i).copy()
        kept = mask_of(expected_band(field, TOLERANCE), boxes.shape[i, 2])
        fields[i], dropped[i] = np.where(kept, field, 0), np.where(kept, 0, field).sum()
        found[i] = [fields[i].sum(), *measured(field, TOLERANCE)[1:]]
        if history is not None:
            histories[i] = np.where(kept & in_band(boxes, i), history, 0)
    setting.band_step(way)
    assert max(map(abs, dropped.values())) > 1e-4, "nothing left a band"
    for i in STEPPED:
        np.testing.assert_allclose(setting.lost[i], 0.25 + dropped[i], rtol=1e-12)
        np.testing.assert_allclose(setting.surveys[i, : FACE + 1], found[i], rtol=1e-12, atol=1e-13)
    check(setting, before, fields, histories)


def reaching_its_edge() -> Setting:
    """Cells whose field is 1 on the whole band."""
    rows = np.zeros((8, 10, 2), int)
    rows[3:5, 4:6] = 6, 24
    boxes, phi = lay_out([(0, 0, 0)] * 5, [(8, 10, 30)] * 5, [rows] * 5)
    for i in range(5):
        put(phi, boxes, i, 1)
    return Setting(boxes, phi, SCHEME, iterations=2)


@both_ways
def test_the_band_grows_where_the_field_reaches_its_edge(way: str) -> None:
    """By two steps along rows and across them; what is there is 0."""
    setting = reaching_its_edge()
    boxes = setting.boxes
    setting.band_step(way)
    for i in STEPPED:
        expected = np.zeros((8, 10, 2), int)
        for x, y in np.ndindex(8, 10):
            far = max(3 - x, x - 4, 0) + max(4 - y, y - 5, 0)
            if far <= 2:
                expected[x, y] = 4 + far, 26 - far
        np.testing.assert_array_equal(band_of(boxes, i), expected)
        field = box(setting.phi, boxes, i)
        assert field[3:5, 4:6, 6:24].all()
        field[3:5, 4:6, 6:24] = 0
        assert not field.any()
    assert (setting.lost == 0.25).all()
    setting.band_step(way)
    assert box(setting.phi, boxes, 0)[3, 3].any()
    assert box(setting.phi, boxes, 0)[3, 4, [5, 24]].all()


@both_ways
def test_a_band_for_which_there_is_no_room_stays(way: str) -> None:
    """The field moves on, and the survey tells what it wants."""
    setting, free = reaching_its_edge(), reaching_its_edge()
    size = held(setting.boxes, 0).sum()
    setting.room[0] = size
    before = setting.state()
    setting.band_step(way)
    free.band_step(way)
    for name in ("low", "high", "place"):
        found = rows_of(getattr(setting.boxes, name), setting.boxes, 0)
        np.testing.assert_array_equal(found, rows_of(before[name], setting.boxes, 0))
    for name in ("phi", "history"):
        found, wanted = (box(getattr(s, name), s.boxes, 0) for s in (setting, free))
        np.testing.assert_array_equal(found, wanted)
        beyond = slice(setting.boxes.start[0] + size, setting.boxes.start[1])
        np.testing.assert_array_equal(getattr(setting, name)[beyond], before[name][beyond])
    assert setting.surveys[0, WANTED] == held(free.boxes, 0).sum() > size
    np.testing.assert_array_equal(setting.surveys, free.surveys)
    np.testing.assert_array_equal(band_of(setting.boxes, 1), band_of(free.boxes, 1))
    setting.room[0] = setting.surveys[0, WANTED]
    setting.band_step(way)
    assert held(setting.boxes, 0).sum() == setting.room[0], "it has room now"


def band_kept(setting: Setting, before: dict, i: int) -> None:
    """Assert that the band of cell i is as it was."""
    for name in ("low", "high", "place"):
        now = rows_of(getattr(setting.boxes, name), setting.boxes, i)
        np.testing.assert_array_equal(now, rows_of(before[name], setting.boxes, i), err_msg=name)


def field_in(state: dict, setting: Setting, i: int, name: str = "phi") -> NDArray:
    """Cell i's field in a state."""
    rows = {key: state[key] for key in ("low", "high", "place")}
    return box(state[name], setting.boxes._replace(**rows), i)


@both_ways
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6])
def test_a_cell_that_diverges_keeps_field_and_history(value: float, way: str) -> None:
    setting = random_setting(SCHEME, iterations=4)
    history = box(setting.history, setting.boxes, 0)
    history[tuple(np.argwhere(in_band(setting.boxes, 0))[-40])] = value
    put(setting.history, setting.boxes, 0, history)
    setting.surveys[0] = np.arange(N_SURVEYED) + 20.0
    setting.surveys[0, BAD] = 0
    before = setting.state()
    setting.band_step(way)
    band_kept(setting, before, 0)
    for key in ("phi", "history"):
        now = box(getattr(setting, key), setting.boxes, 0)
        np.testing.assert_array_equal(now, field_in(before, setting, 0, key))
    assert setting.surveys[0, BAD] > 0
    before["surveys"][0, BAD] = setting.surveys[0, BAD]
    np.testing.assert_array_equal(setting.surveys[0], before["surveys"][0])
    assert setting.lost[0] == 0.25
    assert setting.surveys[1, BAD] == 0
    change = box(setting.phi, setting.boxes, 1) - field_in(before, setting, 1)
    assert np.abs(change).max() > 0.01


@both_ways
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6])
@pytest.mark.parametrize("step", BY_TRANSFORMS)
def test_a_cell_that_diverges_keeps_its_field(step: Callable, value: float, way: str) -> None:
    setting = setting_for(step, SCHEME)
    history = box(setting.history, setting.boxes, 0)
    history[4, 5, 6] = value
    put(setting.history, setting.boxes, 0, history)
    setting.surveys[0, TOTAL] = 33
    before = setting.state()
    step(setting, way)
    np.testing.assert_array_equal(box(setting.phi, setting.boxes, 0), field_in(before, setting, 0))
    if step is Setting.transform_step:  # the other one stores it before it knows
        np.testing.assert_array_equal(
            box(setting.history, setting.boxes, 0), field_in(before, setting, 0, "history")
        )
    assert setting.surveys[0, BAD] > 0
    assert setting.surveys[0, TOTAL] == 33, "not the volume of the kept field"
    band_kept(setting, before, 0)
    assert setting.surveys[1, BAD] == 0
    change = box(setting.phi, setting.boxes, 1) - field_in(before, setting, 1)
    assert np.abs(change).max() > 0.01


# Three smooth cells that touch, in boxes at whose faces they are all but 0.
SMOOTH_SHAPES = ((36, 34, 40), (34, 38, 36), (34, 34, 34), (34, 34, 34), (8, 8, 16))
SMOOTH_CENTERS = np.array([(0, 0, 0), (2, 3, -2), (-3, 1, 2), (90, 0, 0), (0, 90, 0)])
PAIRS = [(0, 1, 0.5), (1, 0, -0.3), (1, 2, 0.2)]


def smooth_setting(whole: bool, **options: Any) -> Setting:
    shapes = np.array(SMOOTH_SHAPES)
    rows = [np.broadcast_to([0, nz], (nx, ny, 2)) for nx, ny, nz in SMOOTH_SHAPES]
    boxes, phi = lay_out(SMOOTH_CENTERS - shapes // 2, shapes, rows, whole)
    for i in range(5):
        at = positions(boxes, i)
        r2 = sum((p - c) ** 2 for p, c in zip(at, SMOOTH_CENTERS[i], strict=True)) * H**2
        put(phi, boxes, i, np.exp(-0.5 * r2 / 0.9**2) * (0.9 if i < 4 else 0))
    numbers = SCHEME | {"lhs": 9.0}
    setting = Setting(boxes, phi, numbers, tolerance=1e-12, whole=whole, **options)
    if setting.history is not None:
        setting.history[:] = np.where(setting.phi == 7, 9, 0.3 * setting.phi)
    setting.order, setting.shares = np.arange(5), shares_of([0, 2, 5], threads=2)
    return setting


def with_iterations(setting: Setting, cycles: int) -> None:
    """Weights of `cycles` times six iterations."""
    top = largest_eigenvalue(setting.fd_order, H)
    gammas = setting.terms.gamma
    roots = [chebyshev_roots(9.0, float(g) * 4, float(g) * top, 6) for g in gammas]
    assert {len(r) for r in roots} == {6}
    weights = np.tile(1 / np.array(roots), cycles).astype(setting.dtype)
    counts = np.full(len(gammas), weights.shape[1])
    setting.terms = setting.terms._replace(weights=weights, n_iterations=counts)


def some_pairs() -> Pairs:
    pulled = np.array([i for i, _, _ in PAIRS])
    return Pairs(
        start=np.searchsorted(pulled, np.arange(6)).astype(np.int64),
        cell=np.array([j for _, j, _ in PAIRS]),
        weight=np.array([w for _, _, w in PAIRS]),
        frame_start=np.zeros(5, np.int64),
    )


def test_iterations_and_transforms_agree() -> None:
    """With the stencil's symbol, where the box's faces do not matter; all terms at once."""
    results = []
    for step in (Setting.transform_step, Setting.band_step):
        setting = smooth_setting(
            step in BY_TRANSFORMS, order=6, laplacian="stencil", memory=True, drift=True
        )
        with_iterations(setting, cycles=12)
        setting.couple(Cover(setting.boxes, absent=0), pairs=some_pairs())
        before = setting.state()
        step(setting)
        after = setting.state()
        fields = {
            name: [field_in(after, setting, i, name) for i in range(5)]
            for name in ("phi", "history")
        }
        results.append(fields | {"surveys": after["surveys"]})
        for i in range(4):
            change = fields["phi"][i] - field_in(before, setting, i)
            assert np.abs(change).max() > 0.01
    by_transforms, on_band = results
    for name in ("phi", "history"):
        for found, wanted in zip(on_band[name], by_transforms[name], strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-9, err_msg=name)
    surveyed = [TOTAL, CORE, BAD]
    np.testing.assert_allclose(
        on_band["surveys"][:, surveyed], by_transforms["surveys"][:, surveyed], atol=1e-6
    )
    assert (on_band["surveys"][:, BAD] == 0).all()


@pytest.fixture
def _threads_back():
    before = get_num_threads()
    yield
    set_num_threads(before)


@pytest.mark.usefixtures("_threads_back")
@pytest.mark.parametrize("step", [Setting.transform_step, Setting.band_step])
def test_the_result_does_not_depend_on_the_lists(step: Callable) -> None:
    """Nor on how many threads take them, nor on what was in the frames before."""
    lists = [
        ([0, 1, 2, 3, 4], [0, 5], 1),
        ([0, 1, 2, 3, 4], [0, 2, 5], 2),
        ([4, 2, 0, 3, 1], [0, 1, 1, 4, 5], 2),
    ]
    results = []
    for order, bounds, threads in lists:
        whole = step in BY_TRANSFORMS
        boxes, phi = make_boxes(13, ORIGINS, SHAPES, whole)
        setting = Setting(boxes, phi, SCHEME, iterations=4, drift=True, whole=whole)
        setting.couple(Cover(boxes))
        setting.order, setting.shares = np.array(order), shares_of(bounds, threads)
        setting.limits = setting.limits._replace(runaway=np.float64(1e6))
        set_num_threads(min(threads, get_num_threads()))
        for _ in range(3):
            step(setting)
        results.append(setting.state())
    assert (results[0]["surveys"][:, BAD] == 0).all()
    for other in results[1:]:
        for key, value in results[0].items():
            np.testing.assert_array_equal(other[key], value, err_msg=key)


@pytest.mark.parametrize("step", [Setting.transform_step, Setting.band_step])
def test_a_cell_that_feels_nothing_need_not_look(step: Callable) -> None:
    results = []
    for felt in (True, False):
        setting = setting_for(step, SCHEME, iterations=4)
        setting.couple(Cover(setting.boxes, absent=1))
        setting.coupling[1].felt[:] = felt
        step(setting)
        results.append(setting.state())
    for key, value in results[0].items():
        np.testing.assert_allclose(results[1][key], value, rtol=1e-13, atol=1e-14, err_msg=key)


@both_ways
@pytest.mark.parametrize("step", [Setting.transform_step, Setting.band_step])
def test_a_cell_does_not_feel_itself(step: Callable, way: str) -> None:
    """Nor its mirror image beyond the faces, if the solver takes the field as mirrored there."""
    results = []
    for coupled in (True, False):
        setting = setting_for(step, SCHEME, iterations=4)
        for i in (*STEPPED[1:], 2):
            put(setting.phi, setting.boxes, i, 0)
            set_band(setting.boxes, i, 0, setting.whole)
        setting.order, setting.shares = np.array([3]), shares_of([0, 1], threads=1)
        assert box(setting.phi, setting.boxes, 3)[..., [0, -1]].any(axis=(0, 1)).all()
        if coupled:
            setting.couple(Cover(setting.boxes, absent=0))
        step(setting, way)
        results.append(box(setting.phi, setting.boxes, 3))
    np.testing.assert_allclose(*results, rtol=1e-11, atol=1e-12)


def test_others_are_felt() -> None:
    """As a check of the test before."""
    setting, alone = random_setting(SCHEME, iterations=4), random_setting(SCHEME, iterations=4)
    setting.couple(Cover(setting.boxes, absent=0))
    setting.band_step()
    alone.band_step()
    change = box(setting.phi, setting.boxes, 0) - box(alone.phi, alone.boxes, 0)
    assert np.abs(change).max() > 0.01
    # Cell 4 has columns of its own, above those of the others.
    np.testing.assert_allclose(
        box(setting.phi, setting.boxes, 4), box(alone.phi, alone.boxes, 4), rtol=1e-12, atol=1e-13
    )
