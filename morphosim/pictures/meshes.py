"""Triangle meshes of cells and of the shell around them, which every picture is made of."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._extras import need
from morphosim.cell_field import CellField
from morphosim.errors import warn
from morphosim.measure.surfaces import cell_surface
from morphosim.pictures.joining import joined, smoothed
from morphosim.runs.saved_fields import load_fields, spacing, time_index, variable
from morphosim.runs.shell import read_shell, said_as_data

if TYPE_CHECKING:
    import xarray as xr

    from morphosim.geometry.confinement import Confinement

SMOOTHINGS = 2
"""How often normals are averaged over the triangles around."""
POINT = 1e-3
"""µm, corners nearer than this are one."""
SHELL = "shell"
SCENE_FILE, SCENE_TEXT = "scene.toml", "scene_toml"
"""Where a run directory and a packed run keep the scene."""


@dataclass(frozen=True, slots=True)
class CellMesh:
    """Closed triangle mesh, seen from outside counterclockwise.

    Attributes
    ----------
    name, type : str
        Of the cell; of a shell "shell" and "".
    vertices : (V, 3) float32, µm
    faces : (F, 3) int32, indices of vertices
    """

    name: str
    type: str
    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]


def cell_meshes(run: "xr.Dataset", time: float | None = None) -> list[CellMesh]:
    """Surfaces φ = 1/2 of the cells of the save nearest to `time`, or of the last; see `joined`.

    Parameters
    ----------
    run : Dataset of `open_run`
    time : float, optional

    Returns
    -------
    list of CellMesh, in the order of `run.cell`; a cell that is nowhere above 1/2 is left out

    Raises
    ------
    ValueError
        The save was made without fields, or the Dataset is not a whole run.
    """
    if time is not None:
        _validate.number("time", time)
    save = time_index(run, time)
    return field_meshes(load_fields(run, save), spacing(run), types_of(run, save))


def types_of(run: "xr.Dataset", save: int) -> dict[str, str]:
    """Type of each cell of a run at a save, by name."""
    kinds = variable(run, "type", "time", "cell")[save].values
    names = variable(run, "cell", "cell").values
    return {str(name): str(kind) for name, kind in zip(names, kinds, strict=True)}


def field_meshes(
    fields: Iterable[CellField],
    spacing: float,
    types: Mapping[str, str] | None = None,
    chosen: Iterable[int] | None = None,
) -> list[CellMesh]:
    """Surfaces φ = 1/2 of fields, as a running simulation has them, joined where cells touch.

    Parameters
    ----------
    fields : of the cells
    spacing : float, µm
    types : optional
        Type of each cell by name; "" for cells that it lacks.
    chosen : places of fields, optional
        Of these alone meshes are made; by default of all.
    """
    types = types or {}
    surfaces = (smoothed(cell_surface(field, spacing)) for field in joined(fields, chosen))
    return [
        CellMesh(
            surface.name,
            types.get(surface.name, ""),
            surface.vertices.astype(np.float32),
            surface.faces.astype(np.int32),
        )
        for surface in surfaces
        if len(surface.faces)
    ]


def reduced(mesh: CellMesh, triangles: int) -> CellMesh:
    """Simplify a mesh to about so many triangles. Needs PyVista.

    By quadric error metrics, and so that the volume stays nearly the same; a mesh with fewer
    triangles is returned as it is. Triangles without area, of a surface that goes through lattice
    points, are dropped first: they keep the rest from being simplified evenly.
    """
    _validate.integer("triangles", triangles, least=4)
    if len(mesh.faces) <= triangles:
        return mesh
    poly_data = need("pyvista", "a mesh of fewer triangles", "pictures").PolyData
    surface = poly_data.from_regular_faces(mesh.vertices, mesh.faces)
    surface = surface.clean(
        tolerance=POINT, absolute=True, polys_to_lines=False, lines_to_points=False
    )
    reduction = max(1 - triangles / surface.n_cells, 0.0)
    small = surface.decimate(reduction, volume_preservation=True)
    return replace(
        mesh,
        vertices=np.asarray(small.points, np.float32),
        faces=np.asarray(small.regular_faces, np.int32),
    )


def normals(mesh: CellMesh) -> NDArray[np.float32]:
    """Unit normals of the vertices, outward, averaged so that no triangles show: (V, 3)."""
    corners = mesh.vertices[mesh.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for _ in range(SMOOTHINGS):
        flat = _at_vertices(mesh, flat)[mesh.faces].mean(axis=1)
    return _at_vertices(mesh, flat)


def _at_vertices(mesh: CellMesh, flat: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit vectors along the sum of what the triangles around a vertex have: (V, 3)."""
    summed = np.zeros_like(mesh.vertices)
    for corner in mesh.faces.T:
        np.add.at(summed, corner, flat)
    lengths = np.linalg.norm(summed, axis=1, keepdims=True)
    return np.asarray(np.divide(summed, lengths, out=np.zeros_like(summed), where=lengths > 0))


def mirrored(mesh: CellMesh) -> CellMesh:
    """Reflect a mesh in the plane z = 0; outside stays outside."""
    flip = np.array([1, 1, -1], np.float32)
    return replace(mesh, vertices=mesh.vertices * flip, faces=mesh.faces[:, ::-1])


def shell_mesh(walls: "Confinement | CellMesh") -> CellMesh:
    """Surface of a confinement, where its depth is 0; plane walls are two triangles each."""
    from morphosim.geometry.confinement import BoxWalls
    from morphosim.geometry.confinement.surface import wall_surface

    if isinstance(walls, CellMesh):
        return walls
    if isinstance(walls, BoxWalls):
        return _box(*walls.bounds())
    return CellMesh(SHELL, "", *wall_surface(walls))


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> CellMesh:
    """Six plane faces, each with corners of its own so that edges stay sharp."""
    vertices: list[NDArray[np.float64]] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for side in (0, 1):
            square = np.array([[a, b] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))])
            corner = np.insert(square, axis, side, axis=1)
            along = (axis == 1) != bool(side)  # (u, v, axis) is left-handed for y
            order = [[0, 1, 2], [0, 2, 3]] if along else [[0, 2, 1], [0, 3, 2]]
            faces += (np.array(order) + 4 * len(vertices)).tolist()
            vertices.append(low + corner * (high - low))
    return CellMesh(
        SHELL, "", np.concatenate(vertices).astype(np.float32), np.array(faces, np.int32)
    )


def run_confinement(run: "xr.Dataset") -> "Confinement | CellMesh | None":
    """What confines a run, or its surface, from what its directory or its packed file holds.

    None in open space, and where it is not known: a Dataset that is not of `open_run`, a scene
    that a file cannot hold. A run is data: no function or class that its scene names is imported.

    Warns
    -----
    UserWarning
        The scene says walls that cannot be drawn: by code, while the run was made before their
        surface was kept (version 0.1), or by an image that is elsewhere.
    """
    source = Path(run.encoding.get("source", ""))
    file = source / SCENE_FILE
    try:
        text = file.read_text("utf-8") if file.is_file() else run.attrs.get(SCENE_TEXT, "")
        mesh = read_shell(source)
        return said_as_data(text, source) if mesh is None else CellMesh(SHELL, "", *mesh)
    except (OSError, TypeError, ValueError) as error:
        warn(f"the shell is not drawn: {error}")
        return None
