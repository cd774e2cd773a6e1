"""Pictures of many cells: what is seen and no more, as fine as it takes, and cut open."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import provenance
from morphosim.pictures import detail
from morphosim.pictures.cut import Cut, read_cut
from morphosim.pictures.detail import drawn_meshes
from morphosim.pictures.film import film
from morphosim.pictures.meshes import CellMesh, cell_meshes
from morphosim.pictures.plot import plot, render
from morphosim.runs.saved_fields import load_fields

from .made import BOX, GREEN, PAIR, RED, Ball, made_run
from .test_meshes import open_edges, volume

pytest.importorskip("pyvista", reason="the extra pictures is not installed")

APART = 3.3
BLOCK = {
    f"{x}{y}{z}": Ball(
        (APART * x, APART * y, APART * z), 2.0, "R" if (x, y, z) == (1, 1, 1) else "G"
    )
    for x, y, z in product(range(3), repeat=3)
}
"""3 x 3 x 3 balls without gaps, of which the middle one is not seen."""
ROUND = {"ball": Ball((15.0, 15.0, 15.0), 6.0)}


def merged(mesh: CellMesh) -> NDArray:
    """Faces by the place of their corners: a flat face has vertices of its own."""
    _, places = np.unique(mesh.vertices.round(5), axis=0, return_inverse=True)
    return np.asarray(places.ravel()[mesh.faces])


@pytest.fixture
def of_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take few cells for many."""
    monkeypatch.setattr(detail, "FEW", 0)


@pytest.mark.usefixtures("of_many")
def test_of_many_cells_those_that_others_enclose_are_left_out_until_a_cut_shows_them() -> None:
    run = made_run([BLOCK])
    assert {mesh.name for mesh in drawn_meshes(run)} == set(BLOCK) - {"111"}
    for side in ("z", "-z"):
        cut = read_cut(f"{side}={APART}")
        names = {mesh.name for mesh in drawn_meshes(run, cut=cut)}
        assert "111" in names
        gone = "2" if side == "z" else "0"
        assert names == {name for name in BLOCK if name[2] != gone}


@pytest.mark.usefixtures("of_many")
def test_what_is_left_out_changes_no_picture() -> None:
    run = made_run([BLOCK])
    options: dict[str, Any] = {"view": "corner", "size": (90, 90)}
    left_out = render(run, **options)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(detail, "FEW", 100)
        np.testing.assert_array_equal(left_out, render(run, **options))


def test_meshes_of_many_cells_are_coarser_and_have_the_same_volume(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = made_run([ROUND])
    (fine,), points = drawn_meshes(run), run.sizes["sample"]
    np.testing.assert_array_equal(fine.vertices, cell_meshes(run)[0].vertices)
    for most, step in ((points // 2, 2), (1, 3)):
        monkeypatch.setattr(detail, "MOST_POINTS", most)
        (coarse,) = drawn_meshes(run)
        assert len(coarse.faces) == pytest.approx(len(fine.faces) / step**2, rel=0.2)
        assert volume(coarse) == pytest.approx(volume(fine), rel=0.04)
        np.testing.assert_allclose(coarse.vertices.mean(axis=0), 15, atol=0.05)
        assert open_edges(coarse.faces) == 0


def test_coarse_fields_have_the_values_of_their_lattice_points() -> None:
    run = made_run([PAIR])
    boxes = detail.saved_boxes(run, 0)
    for fine, coarse in zip(load_fields(run, 0), detail.coarse_fields(run, boxes, 3), strict=True):
        x, y, z = 3 * coarse.origin - fine.origin
        assert min(x, y, z) >= 0
        np.testing.assert_array_equal(coarse.phi, fine.phi[x::3, y::3, z::3])


@pytest.mark.parametrize(
    ("text", "share"),
    [("z", 0.5), ("-z", 0.5), ("x", 0.5), ("z=12", 0.15625), ("-z = 12", 0.84375), ("y=15", 0.5)],
)
def test_a_cut_cell_is_closed_by_a_flat_face(text: str, share: float) -> None:
    cut = read_cut(text)
    assert cut is not None
    (whole,) = cell_meshes(made_run([ROUND]))
    placed = cut.placed(np.array([[9.0, 9, 9], [21, 21, 21]]))
    left = placed.closed(whole)
    assert volume(left) == pytest.approx(share * volume(whole), rel=0.02)
    assert open_edges(merged(left)) == 0
    along = left.vertices[:, placed.axis]
    assert placed.depth(along).min() == pytest.approx(0, abs=2e-4)
    flat = np.ptp(along[left.faces], axis=1) == 0
    corners = left.vertices[left.faces[flat]]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                           axis=1) / 2  # fmt: skip
    radius2 = 36 - (placed.at - 15) ** 2
    assert areas.sum() == pytest.approx(np.pi * radius2, rel=0.03)


def test_the_face_of_a_cut_has_the_colour_of_what_it_shows() -> None:
    run = made_run([{"in": Ball((15, 15, 15), 6.0, "R"), "front": Ball((15, 15, 25), 3.0, "G")}])
    options: dict[str, Any] = {
        "by": "type", "colours": {"R": RED, "G": GREEN}, "bounds": BOX, "size": (90, 90),
    }  # fmt: skip
    for mirror, view in ((False, "z"), (True, "-z")):  # mirrored, the cut's end is at the back
        before = render(run, view=view, mirror=mirror, **options)[45, 45].astype(int)
        after = render(run, view=view, mirror=mirror, cut="z=15", **options)
        assert before[1] > before[0] + 60
        middle = after[41:50, 41:50].reshape(-1, 3).astype(int)
        assert (middle[:, 0] > middle[:, 1] + 60).all()
        assert np.ptp(middle, axis=0).max() <= 20  # flat, lit by lamps that are near


def test_errors_of_cuts_say_what_they_may_be(tmp_path: Path) -> None:
    run = made_run([PAIR])
    for text in ("w", "z>3", "", "zz", 3):
        with pytest.raises(ValueError, match=r"cut = .* is not known; take 'z', '-z', 'z=12.5'"):
            plot(run, cut=text)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'up' is not a number of µm"):
        film(run, tmp_path / "film.gif", cut="z=up")
    with pytest.raises(ValueError, match="cut = nan is not allowed"):
        film(run, tmp_path / "film.gif", cut="z=nan")
    with pytest.raises(ValueError, match=r"cut = 'x=90' does not meet the cells, .* x = 0 and 28"):
        plot(run, cut="x=90")
    assert not list(tmp_path.iterdir())


def test_a_picture_that_does_not_fit_says_how_much_it_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(provenance, "memory", lambda: 1e6)
    with pytest.raises(ValueError, match=r"a picture of 2 cells would take .* there are 0.001 GB"):
        drawn_meshes(made_run([PAIR]))


def test_a_film_is_cut_in_one_place(tmp_path: Path) -> None:
    saves = [ROUND, {"ball": Ball((15.0, 15.0, 17.0), 6.0)}]
    seen: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        closed = Cut.closed
        patch.setattr(Cut, "closed", lambda cut, mesh: (seen.append(cut.at), closed(cut, mesh))[1])
        film(made_run(saves), tmp_path / "film.gif", cut="z", size=(64, 64))
    assert seen == [16.0, 16.0]
