"""Meshes: where the fields are, closed, outside out, small if they are to be."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim import BoxWalls, Cell, EllipsoidShell, Mask, Scene, Sphere, save_scene
from morphosim.cell_field import CellField
from morphosim.measure.contacts import contact_areas
from morphosim.pictures.meshes import (
    CellMesh,
    cell_meshes,
    field_meshes,
    mirrored,
    normals,
    reduced,
    run_confinement,
    shell_mesh,
)
from morphosim.runs.saved_fields import load_fields

from .made import HIGH, LOW, PAIR, Ball, H, made_run

BALL = 4 / 3 * np.pi * 4.0**3


def volume(mesh: CellMesh) -> float:
    """µm³, negative if the inside is out."""
    a, b, c = np.moveaxis(mesh.vertices.astype(np.float64)[mesh.faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def open_edges(faces: NDArray) -> int:
    """Edges that do not have one triangle on each side."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return len({tuple(e) for e in edges} ^ {tuple(e[::-1]) for e in edges})


def test_cells_are_where_their_fields_are() -> None:
    low, high = cell_meshes(made_run([PAIR]))
    assert (low.name, low.type, high.name, high.type) == ("low", "R", "high", "G")
    for mesh, center in ((low, LOW), (high, HIGH)):
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), 8, atol=0.05)
        np.testing.assert_allclose(mesh.vertices.mean(axis=0), center, atol=0.02)
        assert volume(mesh) == pytest.approx(BALL, rel=0.02)
        assert open_edges(mesh.faces) == 0
        assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float32, np.int32)


def test_the_save_nearest_to_a_time_is_taken() -> None:
    run = made_run([PAIR, {"high": Ball((5, 5, 5), type="B")}])
    assert [mesh.name for mesh in cell_meshes(run, 4)] == ["low", "high"]
    assert [(mesh.name, mesh.type) for mesh in cell_meshes(run)] == [("high", "B")]


def test_a_field_nowhere_above_a_half_has_no_mesh() -> None:
    field = CellField("faint", np.zeros(3, np.int64), np.full((4, 4, 4), 0.3))
    assert field_meshes([field], 0.5) == []


@pytest.mark.parametrize(("gap", "drawn"), [(-0.5, 0.0), (0.0, 0.0), (0.7, 0.0), (2.0, 2.0)])
def test_cells_with_contact_area_are_drawn_without_a_gap(gap: float, drawn: float) -> None:
    run = made_run([{"a": Ball((9.0, 9.0, 9.0)), "b": Ball((17.0 + gap, 9.0, 9.0))}])
    areas = contact_areas(load_fields(run, 0), H)
    a, b = cell_meshes(run)
    assert bool(areas) == (drawn == 0)
    assert b.vertices[:, 0].min() - a.vertices[:, 0].max() == pytest.approx(drawn, abs=0.12)
    assert a.vertices[:, 0].min() == pytest.approx(5, abs=0.05)  # free surface stays
    assert open_edges(a.faces) == open_edges(b.faces) == 0


def test_what_is_no_number_is_outside_and_takes_nothing_from_a_neighbour() -> None:
    low, high = (CellField(name, np.zeros(3, np.int64), np.zeros((9, 9, 9))) for name in "ab")
    low.phi[2:7, 2:7, 2:7] = 1
    alone = field_meshes([low], 0.5)[0]
    high.phi[:] = np.nan
    (mesh,) = field_meshes([low, high], 0.5)
    np.testing.assert_array_equal(mesh.vertices, alone.vertices)


def test_reduced_meshes_are_small_closed_and_keep_their_volume() -> None:
    pytest.importorskip("pyvista", reason="the extra pictures is not installed")
    mesh = cell_meshes(made_run([PAIR]))[0]
    small = reduced(mesh, 200)
    assert 150 < len(small.faces) <= 200 < len(mesh.faces)
    assert volume(small) == pytest.approx(volume(mesh), rel=0.03)
    assert open_edges(small.faces) == 0
    assert reduced(mesh, 10**6) is mesh


def test_a_surface_through_lattice_points_is_reduced_evenly() -> None:
    pytest.importorskip("pyvista", reason="the extra pictures is not installed")
    mesh = cell_meshes(made_run([{"ball": Ball((15.0, 15.0, 15.0), 6.0)}]))[0]
    small = reduced(mesh, 200)
    assert len(small.faces) <= 200
    radii = np.linalg.norm(small.vertices - 15, axis=1)
    assert 5.9 < radii.min() < radii.max() < 6.2
    assert open_edges(small.faces) == 0


def test_normals_point_outward() -> None:
    mesh = cell_meshes(made_run([PAIR]))[0]
    radial = mesh.vertices - np.array(LOW)
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert (np.sum(normals(mesh) * radial, axis=1) > 0.97).all()


def test_mirrored_meshes_have_z_reversed_and_the_outside_out() -> None:
    mesh = mirrored(cell_meshes(made_run([PAIR]))[0])
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), (7, 9, -11), atol=0.02)
    assert volume(mesh) == pytest.approx(BALL, rel=0.02)


def test_a_shell_is_the_surface_of_its_confinement() -> None:
    mesh = shell_mesh(
        EllipsoidShell(center=(1, 2, 3), semi_axes=(10, 8, 6), cut=(np.inf, np.inf, 4))
    )
    np.testing.assert_allclose(mesh.vertices.min(axis=0), (-9, -6, -1), atol=0.1)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), (11, 10, 7), atol=0.1)
    part = 4 / 6 - (4 / 6) ** 3 / 3  # of the ellipsoid's half that the cut leaves
    assert volume(mesh) == pytest.approx(2 * np.pi * 10 * 8 * 6 * part, rel=0.01)
    assert open_edges(mesh.faces) == 0


def scene(confinement: object) -> Scene:
    return Scene(
        cells=[Cell(name="a", shape=Sphere(center=(5, 5, 5), radius=3))],
        confinement=confinement,  # type: ignore[arg-type]
    )


def test_the_confinement_is_that_of_the_scene_file(tmp_path: Path) -> None:
    walls = BoxWalls(lower=(0, 0, 0), upper=(10, 11, 12))
    save_scene(scene(walls), tmp_path / "scene.toml")
    run = made_run([PAIR])
    assert run_confinement(run) is None
    packed = run.assign_attrs(scene_toml=(tmp_path / "scene.toml").read_text())
    run.encoding["source"] = str(tmp_path)
    for known in (run, packed):
        found = run_confinement(known)
        assert isinstance(found, BoxWalls)
        np.testing.assert_array_equal(found.bounds(), walls.bounds())
    save_scene(scene(None), tmp_path / "scene.toml")
    assert run_confinement(run) is None


def test_the_confinement_needs_nothing_else_of_the_scene(tmp_path: Path) -> None:
    inside = np.zeros((20, 20, 20), bool)
    inside[5:15, 5:15, 5:15] = True
    shell = EllipsoidShell(center=(5, 5, 5), semi_axes=(5, 4, 3))
    cells = [Cell(name="a", shape=Mask(mask=inside, spacing=0.5))]
    save_scene(Scene(cells=cells, confinement=shell), tmp_path / "scene.toml")
    text = (tmp_path / "scene.toml").read_text()
    packed = made_run([PAIR]).assign_attrs(scene_toml=text)  # the mask is in another file
    found = run_confinement(packed)
    assert isinstance(found, EllipsoidShell)
    np.testing.assert_array_equal(found.semi_axes, shell.semi_axes)
    elsewhere = text.replace('kind = "ellipsoid"', 'kind = "function"\nfunction = "nowhere:walls"')
    assert elsewhere != text
    with pytest.warns(UserWarning, match="the shell is not drawn: .* names code") as told:
        assert run_confinement(packed.assign_attrs(scene_toml=elsewhere)) is None
    assert told[0].filename == __file__


@pytest.mark.parametrize(("time", "error"), [("now", TypeError), (float("nan"), ValueError)])
def test_a_time_is_a_number(time: object, error: type[Exception]) -> None:
    with pytest.raises(error, match="time = "):
        cell_meshes(made_run([PAIR]), time)  # type: ignore[arg-type]


def test_a_run_without_fields_says_so() -> None:
    with pytest.raises(ValueError, match="the run has no fields"):
        cell_meshes(made_run([PAIR]).drop_vars("phi"))


def test_plane_walls_are_a_closed_box_of_twelve_triangles() -> None:
    mesh = shell_mesh(BoxWalls(lower=(0, 1, 2), upper=(10, 20, 30)))
    assert mesh.faces.shape == (12, 3)
    corners = mesh.vertices[mesh.faces].astype(float)
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(10 * 19 * 28)  # positive: all triangles look outward
    flat = np.abs(normals(mesh)).max(axis=1)
    np.testing.assert_allclose(flat, 1)
