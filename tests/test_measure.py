"""What is measured of all cells, against exact shapes."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest
from numba import get_num_threads, set_num_threads
from numpy.typing import ArrayLike, NDArray

from morphosim import contact_areas
from morphosim.cell_field import CellField, centroid
from morphosim.engine.engine import Engine
from morphosim.kernels.layout import Boxes
from morphosim.measure.label_image import label_image
from morphosim.measure.measurement import Measurement, measure, measure_fields
from morphosim.measure.surfaces import cell_surface
from morphosim.measure.variable import MEASURED

from .helpers import make_engine, sphere

H = 0.5
MARGIN = 4.0
STEEP = 4.0
"""Slope of the profile of ellipsoids, whose radius is 1."""


def laid_out(
    center: ArrayLike, reach: float, phi: Callable[[NDArray], NDArray], h: float = H
) -> CellField:
    """Field of a function of positions (3, …) relative to the centre, in a box around it."""
    low = np.floor((np.asarray(center) - reach) / h).astype(np.int64)
    shape = np.ceil((np.asarray(center) + reach) / h).astype(np.int64) - low + 1
    at = (np.indices(shape) + low.reshape(3, 1, 1, 1)) * h - np.reshape(center, (3, 1, 1, 1))
    return CellField("cell", low, phi(at))


def ball(radius: float, center: ArrayLike = (0.13, -0.31, 0.22), h: float = H) -> CellField:
    """Ball with the profile of a cell at rest."""
    return laid_out(
        center, radius + MARGIN,
        lambda at: 0.5 * (1 + np.tanh(radius - np.sqrt((at**2).sum(axis=0)))), h,
    )  # fmt: skip


def ellipsoid(
    axes: Sequence[float], rotation: NDArray, center: ArrayLike = (20, -7, 3.3)
) -> CellField:
    """Ellipsoid with these semi-axes along the columns of a rotation."""
    inverse = np.diag(1 / np.array(axes)) @ rotation.T

    def phi(at: NDArray) -> NDArray:
        r = np.sqrt((np.tensordot(inverse, at, 1) ** 2).sum(axis=0))
        return 0.5 * (1 + np.tanh(STEEP * (1 - r)))

    return laid_out(center, 2.5 * max(axes), phi)


def radial(power: int) -> float:
    """∫ rᵖ φ dr of the profile of ellipsoids."""
    r = np.linspace(0, 8, 80_001)
    return float(np.trapezoid(r**power * 0.5 * (1 + np.tanh(STEEP * (1 - r))), r))


def rotation(seed: int) -> NDArray[np.float64]:
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def same(a: Measurement, b: Measurement, rtol: float = 0) -> None:
    declared = [name for name, each in MEASURED.items() if each.owner is Measurement]
    assert len(declared) == 7
    for name in ("volume", "centroid", "contacts", "contact_area", *declared):
        one, other = getattr(a, name), getattr(b, name)
        np.testing.assert_allclose(one, other, rtol=rtol, atol=rtol, err_msg=name)


# --- surfaces ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("radius", "area_error", "volume_error"),
    [(3, 0.008, 0.016), (4, 0.005, 0.009), (5, 0.003, 0.006), (8, 0.001, 0.003)],
)
def test_surface_of_balls(radius: float, area_error: float, volume_error: float) -> None:
    found = measure_fields([ball(radius)], H)
    assert found.surface_area[0] == pytest.approx(4 * np.pi * radius**2, rel=area_error)
    assert found.enclosed_volume[0] == pytest.approx(4 / 3 * np.pi * radius**3, rel=volume_error)
    assert found.sphericity[0] == pytest.approx(1, abs=0.005)
    assert found.irregularity[0] == pytest.approx((36 * np.pi) ** (1 / 6), rel=0.003)
    surface = cell_surface(ball(radius), H)
    assert found.surface_area[0] == pytest.approx(surface.area, rel=0.003)
    assert found.enclosed_volume[0] == pytest.approx(surface.volume, rel=0.003)


def test_errors_fall_with_the_square_of_the_spacing() -> None:
    found = [measure_fields([ball(3, h=h)], h) for h in (0.5, 0.25, 0.125)]
    areas = [m.surface_area[0] - 36 * np.pi for m in found]
    volumes = [m.enclosed_volume[0] - 36 * np.pi for m in found]
    for errors in (areas, volumes):
        orders = np.log2(np.divide(errors[:-1], errors[1:]))
        np.testing.assert_allclose(orders, 2, atol=0.15)


def test_surface_of_a_spheroid() -> None:
    a, c = 3.0, 6.0
    found = measure_fields([ellipsoid((a, a, c), rotation(1))], H)
    e = np.sqrt(1 - a**2 / c**2)
    area, volume = 2 * np.pi * a * (a + c * np.arcsin(e) / e), 4 / 3 * np.pi * a * a * c
    assert found.surface_area[0] == pytest.approx(area, rel=0.01)
    assert found.enclosed_volume[0] == pytest.approx(volume, rel=0.015)
    sphericity = np.pi ** (1 / 3) * (6 * volume) ** (2 / 3) / area
    assert sphericity < 0.95
    assert found.sphericity[0] == pytest.approx(sphericity, rel=0.004)
    assert found.irregularity[0] == pytest.approx(np.sqrt(area) / np.cbrt(volume), rel=0.003)


def test_a_cell_cut_by_the_face_of_its_box_is_closed_there() -> None:
    h = 0.25
    whole = ball(5, center=(0, 0, 0), h=h)
    half = CellField("half", np.array([0, *whole.origin[1:]]), whole.phi[-whole.origin[0] :])
    found, surface = measure_fields([half], h), cell_surface(half, h)
    assert found.surface_area[0] == pytest.approx(surface.area, rel=0.002)
    assert found.enclosed_volume[0] == pytest.approx(surface.volume, rel=0.002)
    # φ falls to 0 within the lattice step before the face, so that the cut is up to half a step
    # before it, less at the rim.
    side, disc = 2 * np.pi * 5 * (5 + h / 2), np.pi * 5**2
    assert found.surface_area[0] == pytest.approx(side + disc, rel=0.02)
    assert found.enclosed_volume[0] == pytest.approx(disc * (10 / 3 + h / 2), rel=0.01)


# --- moments -----------------------------------------------------------------------------------


def test_volume_centroid_and_axes_of_an_ellipsoid() -> None:
    axes, turned, center = (7.0, 5.0, 3.5), rotation(2), (20, -7, 3.3)
    found = measure_fields([ellipsoid(axes, turned, center)], H)
    assert found.volume[0] == pytest.approx(4 * np.pi * np.prod(axes) * radial(2), rel=1e-4)
    np.testing.assert_allclose(found.centroid[0], center, atol=1e-5)
    np.testing.assert_allclose(found.semi_axes[0], axes, rtol=5e-3)
    signs = np.sign(turned[np.abs(turned).argmax(axis=0), range(3)])
    np.testing.assert_allclose(found.principal_axes[0], (turned * signs).T, atol=5e-3)


def test_axes_are_ordered_and_point_forward() -> None:
    found = measure_fields([ellipsoid((3, 6, 4), np.eye(3)), ellipsoid((6, 3, 4), np.eye(3))], H)
    np.testing.assert_allclose(found.principal_axes[0], np.eye(3)[[1, 2, 0]], atol=1e-4)
    np.testing.assert_allclose(found.principal_axes[1], np.eye(3)[[0, 2, 1]], atol=1e-4)
    np.testing.assert_allclose(found.semi_axes[0], found.semi_axes[1], rtol=1e-4)
    np.testing.assert_allclose(found.semi_axes[0], [6, 4, 3], rtol=1e-2)


def test_centroid_is_that_of_the_field() -> None:
    field = CellField("noise", np.array([-5, 90, 3]), np.random.default_rng(0).random((4, 6, 5)))
    found = measure_fields([field], 0.25)
    np.testing.assert_allclose(found.centroid[0], centroid(field, 0.25), rtol=1e-12)


# --- all cells ---------------------------------------------------------------------------------


def some_balls() -> list[CellField]:
    """Three that touch in a row, and one far away."""
    return [
        CellField(name, f.origin, f.phi)
        for name, x, radius in (("b", 9.2, 5), ("a", 0, 4), ("far", 90, 3), ("c", 17, 3))
        for f in [ball(radius, (x, 0.1, 0.2))]
    ]


@pytest.fixture
def _threads_back() -> Iterator[None]:
    before = get_num_threads()
    yield
    set_num_threads(before)


@pytest.mark.usefixtures("_threads_back")
def test_the_result_does_not_depend_on_threads() -> None:
    results = []
    for threads in (1, 2):
        set_num_threads(min(threads, get_num_threads()))
        results.append(measure_fields(some_balls(), H))
    same(*results)


def test_each_cell_is_measured_as_if_alone() -> None:
    together = measure_fields(some_balls(), H)
    for i, field in enumerate(some_balls()):
        alone = measure_fields([field], H)
        for name in ("volume", "centroid", "semi_axes", "surface_area", "enclosed_volume"):
            np.testing.assert_array_equal(getattr(together, name)[i], getattr(alone, name)[0])
        assert alone.contacts.shape == (0, 2)
        assert alone.contact_area.shape == (0,)


def test_contacts_are_those_of_contact_areas() -> None:
    fields = some_balls()
    found = measure_fields(fields, H)
    np.testing.assert_array_equal(found.contacts, [(0, 1), (0, 3)])
    names = [(fields[i].name, fields[j].name) for i, j in found.contacts]
    assert dict(zip(names, found.contact_area, strict=True)) == contact_areas(fields, H)
    assert found.contact_area.min() > 5


def test_single_and_double_precision_agree() -> None:
    fields = some_balls()
    single = [CellField(f.name, f.origin, f.phi.astype(np.float32)) for f in fields]
    found = measure_fields(single, H)
    expected = measure_fields(fields, H)
    for name in ("volume", "centroid", "semi_axes", "surface_area", "contact_area"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-5, atol=1e-5
        )


def test_measures_scale_with_the_spacing() -> None:
    one, two = (measure_fields(some_balls(), h) for h in (1, 2))
    for name, power in (
        ("volume", 3), ("centroid", 1), ("semi_axes", 1), ("principal_axes", 0),
        ("surface_area", 2), ("enclosed_volume", 3), ("sphericity", 0), ("irregularity", 0),
        ("contact_area", 2),
    ):  # fmt: skip
        np.testing.assert_allclose(getattr(two, name), 2**power * getattr(one, name), rtol=1e-12)


SOLVERS = pytest.mark.parametrize("solver", ["dct", "band"])
"""The one holds whole boxes, the other the band."""


def two_cells(solver: str) -> Engine:
    fields = [sphere((0, 0, 0), 4, tail=1e-4), sphere((7.5, 1, 0), 4, tail=1e-4)]
    return make_engine(fields, solver=solver)


@SOLVERS
def test_a_pool_of_the_engine_is_measured_where_it_is(solver: str) -> None:
    engine = two_cells(solver)
    pool = engine.pool
    found = measure(pool.phi, pool.stored, H)
    fields = [CellField(str(i), pool.origin[i], pool.box(i)) for i in range(2)]
    # Sums along a part of a row are those along all of it but for rounding.
    same(found, measure_fields(fields, H), rtol=0 if solver == "dct" else 1e-12)
    np.testing.assert_allclose(found.volume, engine.volumes, rtol=1e-12)
    np.testing.assert_array_equal(found.contacts, [(0, 1)])
    held = sum(pool.stretch(i).stop - pool.stretch(i).start for i in range(2))
    assert (held < pool.sizes().sum()) == (solver == "band")


@SOLVERS
def test_a_measurement_does_not_change_with_the_fields(solver: str) -> None:
    engine = two_cells(solver)
    pool = engine.pool
    copied = Boxes(*(values.copy() for values in pool.stored))
    found, kept = measure(pool.phi, pool.stored, H), measure(pool.phi.copy(), copied, H)
    pool.phi[:] = 0
    pool.origin[:] += 7
    pool.high[:] = 0
    same(found, kept)


def test_a_faint_cell_has_no_surface() -> None:
    whole = ball(4)
    faint = CellField("faint", whole.origin, 0.45 * whole.phi)
    found = measure_fields([whole, faint], H)
    assert found.surface_area[1] == found.enclosed_volume[1] == 0
    assert np.isnan([found.sphericity[1], found.irregularity[1]]).all()
    assert (found.semi_axes[1] < 0.8 * found.semi_axes[0]).all()  # what is above 3/8 is left
    np.testing.assert_allclose(found.centroid[1], found.centroid[0], atol=1e-9)
    np.testing.assert_array_equal(found.contacts, [(0, 1)])  # φ = 0.34 is still reached


def test_a_cell_without_inside_has_no_axes() -> None:
    whole = ball(4)
    found = measure_fields([CellField("faint", whole.origin, 0.35 * whole.phi)], H)
    assert np.isnan(found.semi_axes).all()
    assert np.isnan(found.principal_axes).all()
    assert np.isfinite(found.centroid).all()


def test_an_empty_field_has_nothing_to_measure() -> None:
    found = measure_fields([CellField("empty", np.zeros(3, np.int64), np.zeros((4, 4, 4)))], H)
    assert found.volume[0] == found.surface_area[0] == 0
    for name in ("centroid", "semi_axes", "principal_axes", "sphericity", "irregularity"):
        assert np.isnan(getattr(found, name)).all()


def test_no_cells_at_all() -> None:
    found = measure_fields([], H)
    assert found.principal_axes.shape == (0, 3, 3)
    assert found.contacts.shape == (0, 2)


@pytest.mark.parametrize("spacing", [0, -0.5, np.nan])
def test_spacing_must_be_positive(spacing: float) -> None:
    with pytest.raises(ValueError, match="spacing = "):
        measure_fields([ball(3)], spacing)


def test_a_point_of_a_label_image_belongs_to_the_cell_of_largest_phi() -> None:
    """If that exceeds one half, and in whatever order cells come."""
    values = np.array([[0.9, 0.6, 0.4, 0.0], [0.7, 0.8, 0.3, 0.6], [0.8, 0.9, 0.45, 0.5]])
    fields = [
        CellField(str(k), np.array([0, 0, 3]), row.reshape(1, 1, 4))
        for k, row in enumerate(values)
    ]  # fmt: skip
    origin, labels = label_image(fields)
    assert origin.tolist() == [0, 0, 3]
    assert labels.ravel().tolist() == [1, 3, 0, 2]
    _, backwards = label_image(fields[::-1])
    assert backwards.ravel().tolist() == [3, 1, 0, 2]
