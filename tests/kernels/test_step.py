"""One step of all cells: force, solve and survey put together, against NumPy and SciPy."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba import get_num_threads, set_num_threads
from numpy.typing import NDArray
from scipy.fft import dctn, idctn

from morphosim.engine.solvers.cosine_transforms import CosineTables
from morphosim.kernels.boxes import BAD, CORE, FACE, N_SURVEYED, TOTAL
from morphosim.kernels.columns import accumulate
from morphosim.kernels.forces import right_hand_side
from morphosim.kernels.frames import frame_size
from morphosim.kernels.helmholtz import COLUMNS
from morphosim.kernels.layout import Boxes, Limits, Pairs, Scheme
from morphosim.kernels.pairs import accumulate_pairs
from morphosim.kernels.sharing import shares_of
from morphosim.kernels.step import N_FRAMES, accept_all, prepare_all, step_band, step_transform
from morphosim.numerics.chebyshev import chebyshev_roots, largest_eigenvalue
from morphosim.numerics.parameters import Numerics

from .example_boxes import (
    ORIGINS,
    SHAPES,
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
    lay_out,
    loaded,
    make_boxes,
    make_stencil,
    mirrored,
    positions,
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
        tolerance: float = TOLERANCE, dtype: type = np.float64,
    ) -> None:  # fmt: skip
        self.boxes, self.dtype, n = boxes, dtype, len(boxes.start)
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
                rows = in_band(boxes, i)[..., None]
                box(self.history, boxes, i)[:] = rows * rng.uniform(-0.5, 1, boxes.shape[i])
        self.scheme = Scheme(**{key: dtype(value) for key, value in numbers.items()})
        self.first = Scheme(*(dtype(0.9) * value for value in self.scheme))
        self.fd_order, self.stencil = order, make_stencil(order, dtype)
        self.cosines = CosineTables(
            Numerics(spacing=H, laplacian=laplacian, order=order), dtype
        ).require(boxes.shape)
        self.limits = Limits(*map(dtype, (tolerance, RUNAWAY, 0.5)))
        self.surveys, self.lost = np.full((n, N_SURVEYED), -1.0), np.full(n, 0.25)
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

    def space(self) -> tuple:
        """Work space with nothing sensible in it, as large as it must be and no larger."""
        shape, threads = self.boxes.shape, self.shares.threads
        sizes = [frame_size(i, self.boxes) for i in self.order]
        size = max(*sizes, COLUMNS * int(shape.max()))
        return (
            np.full((threads, N_FRAMES, size), np.nan, self.dtype),
            np.full((threads, shape[:, 0].max(), 2), -5, np.int32),
            np.full((threads, N_SURVEYED), np.nan),
        )  # fmt: skip

    def band_step(self, way: str = "compiled") -> None:
        taken(step_band, way)(
            *self.acting(), *self.space(), self.stencil, self.scheme, self.first, self.limits,
            self.surveys, self.lost, *self.uses,
        )  # fmt: skip

    def transform_step(self, way: str = "compiled") -> None:
        taken(step_transform, way)(
            *self.acting(), *self.space(), self.stencil, self.scheme, self.first, self.cosines,
            self.limits, self.surveys, *self.uses,
        )  # fmt: skip

    def outside_step(self, way: str = "compiled") -> None:
        """With a transform outside of Numba."""
        rhs = np.zeros_like(self.phi)
        work, found, measured = self.space()
        taken(prepare_all, way)(
            *self.acting(),
            work,
            self.stencil,
            self.scheme,
            self.first,
            self.limits.half,
            rhs,
            *self.uses,
        )
        for i in self.order:
            box(rhs, self.boxes, i)[:] = solved(self, i, box(rhs, self.boxes, i))
        taken(accept_all, way)(
            self.shares, self.order, self.phi, rhs, self.boxes, self.limits, found, measured,
            self.surveys,
        )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """Copy of all that a step changes."""
        return {
            "phi": self.phi.copy(),
            "history": None if self.history is None else self.history.copy(),
            "band": self.boxes.band.copy(),
            "surveys": self.surveys.copy(),
            "lost": self.lost.copy(),
        }


def random_setting(numbers: dict, **options: Any) -> Setting:
    """Random fields whose outermost rows are faint, so that they leave the band."""
    boxes, phi = make_boxes(seed=13)
    for i in range(len(boxes.start)):
        for plane, (y0, y1) in zip(box(phi, boxes, i), band_of(boxes, i), strict=True):
            for y in range(y0, min(y0 + 4, y1)):
                plane[y] *= 1e-3
    return Setting(boxes, phi, numbers, **options)


def prepared(setting: Setting, i: int, whole: bool) -> tuple[NDArray, NDArray, NDArray | None]:
    """Right-hand side, start and next history of cell i, by a kernel with tests of its own."""
    boxes = setting.boxes
    phi = mirrored(boxes, i, setting.phi) if whole else loaded(boxes, i, setting.phi)
    history = None if setting.history is None else loaded(boxes, i, setting.history, whole)
    rhs, start = empty_frame(boxes, i), empty_frame(boxes, i)
    right_hand_side(
        i, boxes, whole, setting.terms, setting.terms.drift, phi, None, rhs, history, start,
        setting.stencil, setting.scheme_of(i), setting.limits.half, None,
    )  # fmt: skip
    return rhs, start, history


def measured(field: NDArray, tolerance: float) -> list[float]:
    """What a survey finds, up to the edge."""
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
        np.testing.assert_allclose(box(setting.phi, boxes, i), field, rtol=1e-11, atol=1e-12)
        box(before["phi"], boxes, i)[:] = box(setting.phi, boxes, i)
        if setting.history is not None:
            found = box(setting.history, boxes, i)
            np.testing.assert_allclose(found, histories[i], rtol=1e-11, atol=1e-12)
            box(before["history"], boxes, i)[:] = found
        rows = slice(boxes.plane_start[i], boxes.plane_start[i] + boxes.shape[i, 0])
        before["band"][rows] = expected_band(field, TOLERANCE)
    np.testing.assert_array_equal(setting.phi, before["phi"])
    np.testing.assert_array_equal(boxes.band, before["band"])
    if setting.history is not None:
        np.testing.assert_array_equal(setting.history, before["history"])
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
@pytest.mark.parametrize("step", [Setting.transform_step, Setting.outside_step])
def test_step_by_transforms(step: Callable, way: str) -> None:
    setting = random_setting(SCHEME)
    before, fields, histories = setting.state(), {}, {}
    for i in STEPPED:
        rhs, _, history = prepared(setting, i, True)
        fields[i] = solved(setting, i, inside(rhs, setting.boxes, i))
        histories[i] = inside(history, setting.boxes, i)
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
    """Iteration by iteration; rows that leave the band are counted."""
    numbers, options = BAND_STEPS[name]
    setting = random_setting(numbers, **options)
    boxes = setting.boxes
    before, fields, histories = setting.state(), {}, {}
    dropped, found = {}, {}
    for i in STEPPED:
        rhs, u, history = prepared(setting, i, False)
        runs, gamma = in_runs(boxes, i), setting.terms.gamma[i]
        u = np.where(runs, u, 0)
        lhs = setting.scheme_of(i).lhs
        for weight in setting.terms.weights[i, : setting.terms.n_iterations[i]]:
            change = rhs - lhs * u + gamma * flat_laplacian(u, boxes, i, setting.fd_order)
            u = np.where(runs, u + weight * change, 0)
        field = np.where(in_band(boxes, i)[..., None], inside(u, boxes, i), 0)
        y, rows = np.arange(boxes.shape[i, 1]), expected_band(field, TOLERANCE)
        kept = ((y >= rows[:, :1]) & (y < rows[:, 1:]))[..., None]
        fields[i], dropped[i] = np.where(kept, field, 0), np.where(kept, 0, field).sum()
        found[i] = [fields[i].sum(), *measured(field, TOLERANCE)[1:]]
        if history is not None:
            on_band = kept & in_band(boxes, i)[..., None]
            histories[i] = np.where(on_band, inside(history, boxes, i), 0)
    setting.band_step(way)
    assert max(map(abs, dropped.values())) > 1e-4, "no row left a band"
    for i in STEPPED:
        np.testing.assert_allclose(setting.lost[i], 0.25 + dropped[i], rtol=1e-12)
        np.testing.assert_allclose(setting.surveys[i, : FACE + 1], found[i], rtol=1e-12, atol=1e-13)
    check(setting, before, fields, histories)


@both_ways
def test_the_band_grows_where_the_field_reaches_its_edge(way: str) -> None:
    """By a row on each side, and by a plane; what is there is 0."""
    boxes, phi = lay_out([(0, 0, 0)] * 5, [(8, 10, 12)] * 5)
    for i in range(5):
        band_of(boxes, i)[3:5] = 4, 6
        box(phi, boxes, i)[3:5, 4:6, 5:7] = 1
    setting = Setting(boxes, phi, SCHEME, iterations=2)
    setting.band_step(way)
    for i in STEPPED:
        expected = [[10, 0], [10, 0], [4, 6], [3, 7], [3, 7], [4, 6], [10, 0], [10, 0]]
        np.testing.assert_array_equal(band_of(boxes, i), expected)
        field = box(setting.phi, boxes, i)
        assert not field[2].any()
        assert not field[3, 3].any()
        assert field[3, 4].any()
    assert (setting.lost == 0.25).all()
    before = setting.state()
    setting.band_step(way)
    assert box(setting.phi, boxes, 0)[3, 3].any()
    assert not np.array_equal(setting.phi, before["phi"])


@both_ways
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6])
def test_a_cell_that_diverges_keeps_field_and_history(value: float, way: str) -> None:
    setting = random_setting(SCHEME, iterations=4)
    x, y = np.argwhere(in_band(setting.boxes, 0))[-1]
    box(setting.history, setting.boxes, 0)[x, y, 6] = value
    setting.surveys[0] = np.arange(N_SURVEYED) + 20.0
    setting.surveys[0, BAD] = 0
    before = setting.state()
    setting.band_step(way)
    for key in ("phi", "history"):
        now = box(getattr(setting, key), setting.boxes, 0)
        np.testing.assert_array_equal(now, box(before[key], setting.boxes, 0))
    rows = slice(setting.boxes.plane_start[0], setting.boxes.plane_start[1])
    np.testing.assert_array_equal(setting.boxes.band[rows], before["band"][rows])
    assert setting.surveys[0, BAD] > 0
    before["surveys"][0, BAD] = setting.surveys[0, BAD]
    np.testing.assert_array_equal(setting.surveys[0], before["surveys"][0])
    assert setting.lost[0] == 0.25
    assert setting.surveys[1, BAD] == 0
    change = box(setting.phi, setting.boxes, 1) - box(before["phi"], setting.boxes, 1)
    assert np.abs(change).max() > 0.01


@both_ways
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6])
@pytest.mark.parametrize("step", [Setting.transform_step, Setting.outside_step])
def test_a_cell_that_diverges_keeps_its_field(step: Callable, value: float, way: str) -> None:
    setting = random_setting(SCHEME)
    box(setting.history, setting.boxes, 0)[4, 5, 6] = value
    setting.surveys[0, TOTAL] = 33
    before = setting.state()
    step(setting, way)
    kept = box(before["phi"], setting.boxes, 0)
    np.testing.assert_array_equal(box(setting.phi, setting.boxes, 0), kept)
    if step is Setting.transform_step:  # the other one stores it before it knows
        kept = box(before["history"], setting.boxes, 0)
        np.testing.assert_array_equal(box(setting.history, setting.boxes, 0), kept)
    assert setting.surveys[0, BAD] > 0
    assert setting.surveys[0, TOTAL] == 33, "not the volume of the kept field"
    rows = slice(setting.boxes.plane_start[0], setting.boxes.plane_start[1])
    np.testing.assert_array_equal(setting.boxes.band[rows], before["band"][rows])
    assert setting.surveys[1, BAD] == 0
    change = box(setting.phi, setting.boxes, 1) - box(before["phi"], setting.boxes, 1)
    assert np.abs(change).max() > 0.01


# Three smooth cells that touch, in boxes at whose faces they are all but 0.
SMOOTH_SHAPES = ((36, 34, 40), (34, 38, 36), (34, 34, 34), (34, 34, 34), (8, 8, 8))
SMOOTH_CENTERS = np.array([(0, 0, 0), (2, 3, -2), (-3, 1, 2), (90, 0, 0), (0, 90, 0)])
PAIRS = [(0, 1, 0.5), (1, 0, -0.3), (1, 2, 0.2)]


def smooth_setting(**options: Any) -> Setting:
    shapes = np.array(SMOOTH_SHAPES)
    boxes, phi = lay_out(SMOOTH_CENTERS - shapes // 2, shapes)
    for i in range(5):
        at = positions(boxes, i)
        r2 = sum((p - c) ** 2 for p, c in zip(at, SMOOTH_CENTERS[i], strict=True)) * H**2
        box(phi, boxes, i)[:] = np.exp(-0.5 * r2 / 0.9**2) * (0.9 if i < 4 else 0)
        band_of(boxes, i)[:] = 0, boxes.shape[i, 1]
    setting = Setting(boxes, phi, SCHEME | {"lhs": 9.0}, tolerance=1e-12, **options)
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
        setting = smooth_setting(order=6, laplacian="stencil", memory=True, drift=True)
        with_iterations(setting, cycles=12)
        setting.couple(Cover(setting.boxes, absent=0), pairs=some_pairs())
        before = setting.state()
        step(setting)
        results.append(setting.state())
        for i in range(4):
            change = box(setting.phi, setting.boxes, i) - box(before["phi"], setting.boxes, i)
            assert np.abs(change).max() > 0.01
    by_transforms, on_band = results
    np.testing.assert_allclose(on_band["phi"], by_transforms["phi"], atol=1e-9)
    np.testing.assert_allclose(on_band["history"], by_transforms["history"], atol=1e-9)
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
        boxes, phi = make_boxes(13, ORIGINS, SHAPES)
        setting = Setting(boxes, phi, SCHEME, iterations=4, drift=True)
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
        setting = random_setting(SCHEME, iterations=4)
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
        setting = random_setting(SCHEME, iterations=4)
        for i in STEPPED[1:]:
            box(setting.phi, setting.boxes, i)[:] = 0
            band_of(setting.boxes, i)[:] = 99, 0
        box(setting.phi, setting.boxes, 2)[:] = 0
        band_of(setting.boxes, 2)[:] = 99, 0
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
