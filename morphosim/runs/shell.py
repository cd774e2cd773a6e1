"""The shell of a run as a mesh, so that it is drawn without the code that its scene may name."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._files import guarded, replacing, toml_of
from morphosim.errors import warn
from morphosim.geometry.confinement import (
    CONFINEMENTS,
    BoxWalls,
    Confinement,
    EllipsoidShell,
    MaskWalls,
)
from morphosim.geometry.confinement.surface import wall_surface
from morphosim.runs.directory import SHELL
from morphosim.scene.file import confinement_of
from morphosim.scene.objects import names_code

GROUP = "shell"
"""Where a packed run keeps it."""
DATA = (BoxWalls, EllipsoidShell, MaskWalls)
"""Walls that a scene file says by numbers and images, not by code."""
Mesh = tuple[NDArray[np.float32], NDArray[np.int32]]
"""Vertices (V, 3) in µm, and faces (F, 3)."""
KINDS = {"vertices": "f4", "faces": "i4"}

_log = logging.getLogger(__name__)


def write_shell(directory: Path, confinement: Confinement | None) -> None:
    """Write the surface of a confinement, unless the scene file says it as data.

    One that has no surface is not drawn: a run does not end for a picture.
    """
    path = directory / SHELL
    path.unlink(missing_ok=True)
    if confinement is None or isinstance(confinement, DATA):
        return
    try:
        mesh = wall_surface(confinement)
    except Exception as error:  # code of a user's own, which may not be made for this
        _log.warning("pictures of %s will have no shell: %s", directory, error)
        return
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, vertices=mesh[0], faces=mesh[1])


def read_shell(source: Path) -> Mesh | None:
    """Mesh of the shell that a run directory or a packed run holds; None if there is none.

    Raises
    ------
    ValueError
        The file is damaged.
    """
    file = source / SHELL if source.is_dir() else source
    read = _of_directory if source.is_dir() else _of_packed
    return guarded(file, lambda: _checked(read(file))) if file.is_file() else None


def said_as_data(text: str, folder: Path) -> Confinement | None:
    """Confinement that the text of a scene file says; None in open space.

    Raises
    ------
    FileNotFoundError
        An image is not in the folder.
    ValueError
        The text is damaged, or names code; or it is of a packed run, and names a file.
    """
    table = toml_of(text, "the scene of the run")
    walls = table.get("confinement")
    if names_code(walls, CONFINEMENTS):
        message = (
            "the run does not hold its surface, and its scene names code, which reading a run does "
            "not import"
        )
        raise ValueError(message)
    if folder.is_file() and isinstance(walls, dict) and isinstance(walls.get("inside"), str):
        message = (
            f"the packed run does not hold its surface, and its scene names {walls['inside']!r}: a "
            "packed run is read from its file alone"
        )
        raise ValueError(message)
    confinement: Confinement | None = confinement_of(table, folder)
    return confinement


def pack_shell(directory: Path, text: str, file: Any) -> None:
    """Add the mesh of a run directory, or that of its image, to a netCDF file that is open.

    Parameters
    ----------
    text : of the run's scene file

    Warns
    -----
    UserWarning
        It is not known.
    """
    try:
        mesh = read_shell(directory)
        if mesh is None and isinstance(walls := said_as_data(text, directory), MaskWalls):
            mesh = wall_surface(walls)
    except (OSError, TypeError, ValueError) as error:
        warn(f"the packed run will have no shell: {error}")
        return
    if mesh is None:
        return
    group = file.createGroup(GROUP)
    for (name, kind), values in zip(KINDS.items(), mesh, strict=True):
        dims = (f"{name}_count", f"{name}_of")
        for dimension, size in zip(dims, values.shape, strict=True):
            group.createDimension(dimension, size)
        group.createVariable(name, kind, dims, zlib=True, complevel=1)[:] = values


def _checked(mesh: Mesh | None) -> Mesh | None:
    """Mesh that can be drawn: VTK crashes if triangles have corners that are not there."""
    if mesh is None:
        return None
    vertices, faces = mesh
    sound = (
        (vertices.dtype.kind, faces.dtype.kind) == ("f", "i")
        and vertices.shape[1:] == faces.shape[1:] == (3,)
        and bool(np.isfinite(vertices).all())
        and bool(((faces >= 0) & (faces < len(vertices))).all())
        and len(faces) > 0
    )
    if not sound:
        message = "its arrays are no triangle mesh"
        raise ValueError(message)
    return mesh


def _of_directory(path: Path) -> Mesh:
    with np.load(path, allow_pickle=False) as file:
        return file["vertices"], file["faces"]


def _of_packed(path: Path) -> Mesh | None:
    import netCDF4

    with netCDF4.Dataset(path) as file:
        if GROUP not in file.groups:
            return None
        vertices, faces = (np.asarray(file[GROUP][name][:]) for name in KINDS)
        return vertices, faces
