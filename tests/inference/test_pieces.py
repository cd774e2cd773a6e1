"""The parts of a fit: surfaces in images, offsets, moved fields, unknowns, least squares."""

import numpy as np
import pytest

from morphosim import Attraction, Cell, Numerics, Physics, Scene, Simulation, Sphere
from morphosim.cell_field import CellField
from morphosim.importers.labels.label_image import LabelImage
from morphosim.inference.estimate import Misfit
from morphosim.inference.observation import closed, has_gaps, photographed, surfaces_of
from morphosim.inference.observed import ellipsoid_around
from morphosim.inference.offsets import Patches, offsets, rigid_motions
from morphosim.inference.replicates import flipped
from morphosim.inference.scatter import centres
from morphosim.inference.unknowns import unknowns_of
from morphosim.inference.warping import Displacement, moved

H = 0.5
RADIUS, HALF = 6.0, 5.2
ORIGIN = (-15.1, -10.2, -10.3)


@pytest.fixture(scope="module")
def doublet() -> list[CellField]:
    """Two cells in contact across x = 0, at rest."""
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=RADIUS))
        for name, x in (("a", -HALF), ("b", HALF))
    ]
    numerics = Numerics.preset("standard", threads=1)
    simulation = Simulation(Scene(cells=cells, physics=Physics(sigma=0.5), numerics=numerics))
    simulation.run(until=100)
    return list(simulation.fields)


def blank(
    step: float = 0.5, origin: tuple[float, float, float] = (-15.1, -10.2, -10.3)
) -> LabelImage:
    shape = np.ceil(np.array([30.0, 20.5, 20.5]) / step).astype(int)
    return LabelImage(labels=np.zeros(shape, np.int32), spacing=step, origin=ORIGIN)


def test_surfaces_of_an_image_lie_where_those_of_its_fields_do(doublet):
    image = photographed(doublet, H, blank())
    seen = surfaces_of(image, ["a", "b"])
    off = offsets(seen, doublet, H)[seen.once]
    assert abs(np.average(off, weights=seen.area[seen.once])) < 0.01  # µm, at voxels of 0.5 µm
    assert np.abs(off).max() < 0.45
    assert seen.contacts == [(0, 1)]
    across = seen.once & (seen.neighbour == 1)
    assert abs(np.average(seen.points[across, 0], weights=seen.area[across])) < 0.26
    assert (seen.normals[across, 0] > 0.7).all()


def test_offsets_tell_how_far_fields_have_been_moved(doublet):
    seen = surfaces_of(photographed(doublet, H, blank()), ["a", "b"])
    before = offsets(seen, doublet, H)
    up = np.array([0, 1, 0])  # 0.5 µm
    shifted = [CellField(f.name, f.origin + up, f.phi) for f in doublet]
    change = (offsets(seen, shifted, H) - before)[seen.once]
    along = seen.normals[seen.once, 1]
    flat = np.abs(along) > 0.8
    assert np.abs(change[flat] - 0.5 * along[flat]).mean() < 0.03
    assert abs(change[np.abs(along) < 0.05].mean()) < 0.03


def test_moved_fields_come_back(doublet):
    seen = surfaces_of(photographed(doublet, H, blank(0.25)), ["a", "b"])
    shifted = [CellField(f.name, f.origin + np.array([1, 0, 1]), f.phi) for f in doublet]
    off = offsets(seen, shifted, H)
    back = moved(shifted, H, [Displacement.along(seen, off)])
    again = offsets(seen, back, H)
    assert np.abs(again[seen.once]).mean() < 0.2 * np.abs(off[seen.once]).mean()


def test_gaps_between_cells_are_closed(doublet):
    touching = photographed(doublet, H, blank())
    labels = touching.labels.copy()
    x = np.asarray(touching.origin)[0] + 0.5 * np.arange(labels.shape[0])
    labels[np.abs(x) < 0.3] = 0  # one voxel
    parted = LabelImage(labels=labels, spacing=0.5, origin=touching.origin)
    assert has_gaps(parted)
    assert not has_gaps(touching)
    assert not surfaces_of(parted, ["a", "b"]).contacts
    assert surfaces_of(closed(parted), ["a", "b"]).contacts == [(0, 1)]
    y, z = (np.asarray(touching.origin)[a] + 0.5 * np.arange(labels.shape[a]) for a in (1, 2))
    within = np.hypot(y[:, None], z) < 2.0
    between = np.abs(x) < 2.0
    assert (parted.labels[between][:, within] == 0).any()
    assert (closed(parted).labels[between][:, within] > 0).all()


def test_rigid_motion_is_told_by_patches(doublet):
    seen = surfaces_of(photographed(doublet, H, blank()), ["a", "b"])
    patches = Patches.of(seen)
    moved_by = seen.normals @ [0.1, -0.2, 0.05]
    mean = patches.mean(seen, moved_by)
    motions = rigid_motions(patches)
    assert np.allclose(motions[:, :3] @ [0.1, -0.2, 0.05], mean, atol=1e-12)
    misfit = Misfit((patches,), _unknowns(), open_space=True)
    assert np.abs(misfit.weighted(mean)).max() < 1e-10
    held = Misfit((patches,), _unknowns(), open_space=False)
    assert np.abs(held.weighted(mean)).max() > 0.01


def _unknowns(gauge: bool = True):
    return unknowns_of(
        ["a", "b", "c"], ["x", "x", "y"], [0.25, 0.25, 0.25],
        Physics(sigma=Attraction(default=0.4, pairs={("a", "c"): 0.1})), [(0, 1), (1, 2)],
        gamma="cell", sigma="pair", M=False, still=gauge,
    )  # fmt: skip


def test_a_still_image_holds_the_mean_tension():
    unknowns = _unknowns()
    vector = np.array([0.3, -0.2, 0.1, 0.7, 0.0])
    gammas, physics = unknowns.applied(vector)
    assert gammas.mean() == pytest.approx(0.25)
    assert gammas[0] / gammas[1] == pytest.approx(np.exp(0.5))
    assert physics.attraction.pairs == {("a", "c"): 0.1, ("a", "b"): 0.7, ("b", "c"): 0.0}
    assert unknowns.values(vector)[3:].tolist() == [0.7, 0.0]
    free, _ = _unknowns(gauge=False).applied(vector)
    assert free == pytest.approx(0.25 * np.exp(vector[:3]))


def test_types_share_their_tension_and_attraction():
    unknowns = unknowns_of(
        ["a", "b", "c"], ["x", "x", "y"], [0.25] * 3, Physics(sigma=0.5), [(0, 1), (1, 2)],
        gamma="type", sigma="type", M=True, still=False,
    )  # fmt: skip
    assert [u.name for u in unknowns.each] == [
        "gamma x", "gamma y", "sigma x-x", "sigma x-y", "M",
    ]  # fmt: skip
    gammas, physics = unknowns.applied(np.array([0.1, -0.1, 0.2, 0.9, np.log(2)]))
    assert gammas[0] == gammas[1] > gammas[2]
    assert physics.attraction.of_types("y", "x") == pytest.approx(0.9)
    assert physics.volume_strength == pytest.approx(16)


def test_the_covariance_covers_what_estimates_are_off_by(doublet):
    """Of offsets with noise of both kinds, two thirds of estimates lie within one deviation."""
    patches = Patches.of(surfaces_of(photographed(doublet, H, blank()), ["a", "b"]))
    random = np.random.default_rng(0)
    unknowns = _unknowns()
    misfit = Misfit((patches,), unknowns, open_space=False)
    count = len(patches.area)
    slopes = np.stack([np.sin(patches.centre @ random.normal(size=3) * 0.4) for _ in range(5)], 1)
    slopes[:, :3] -= slopes[:, :3].mean(axis=1, keepdims=True)  # the mean tension does nothing
    apart = np.linalg.norm(patches.centre[:, None] - patches.centre, axis=-1)
    alike = (patches.normal @ patches.normal.T) * np.exp(-0.5 * (apart / 4.0) ** 2)
    root = np.linalg.cholesky(0.02**2 * alike + np.diag(0.03**2 / misfit.weight**2))
    inside = []
    for _ in range(60):
        left = root @ random.normal(size=count)
        covariance, _ = misfit.covariance(left, slopes)
        off = misfit.gain(slopes) @ misfit.weighted(left)
        inside.append(np.abs(off[3:]) < np.sqrt(np.diag(covariance))[3:])
    assert 0.55 < np.mean(inside) < 0.8


def test_an_ellipsoid_around_cells_is_the_one_they_were_cut_from():
    image = blank()
    grid = np.indices(image.labels.shape).reshape(3, -1).T * 0.5 + np.asarray(image.origin)
    inside = (((grid - [0.4, -0.2, 0.1]) / [12, 8, 7]) ** 2).sum(axis=1) <= 1
    labels = inside.reshape(image.labels.shape).astype(np.int32)
    shell = ellipsoid_around(LabelImage(labels=labels, spacing=0.5, origin=image.origin), 0.0)
    assert np.asarray(shell.center) == pytest.approx([0.4, -0.2, 0.1], abs=0.15)
    assert np.asarray(shell.semi_axes) == pytest.approx([12, 8, 7], abs=0.4)


def test_flipped_voxels_are_as_many_as_asked_for(doublet):
    image = photographed(doublet, H, blank())
    rough = flipped(image, 0.1, np.random.default_rng(1))
    differ = np.count_nonzero(rough.labels != image.labels)
    near = sum(
        np.count_nonzero(np.diff(image.labels, axis=axis)) for axis in range(3)
    )  # faces, about one for each voxel at a surface
    assert 0.05 < differ / near < 0.2
    assert np.allclose(centres(image), centres(rough), atol=0.1)
