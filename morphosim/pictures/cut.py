"""A cut through the cells: half of space is taken away, so that the inside shows."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._extras import need
from morphosim.pictures.meshes import CellMesh

AXES = "xyz"
FORM = re.compile(r"(-?)([xyz])(?:\s*=\s*(.+))?")
ASIDE = 1e-4
"""µm that meshes are cut beside the plane: vertices that lie in it would make their section
ambiguous."""


@dataclass(frozen=True, slots=True)
class Cut:
    """Plane across an axis, and the side of it that is kept.

    Attributes
    ----------
    text : str
        As it was given.
    axis : int
    place : float or None
        Coordinate of the plane, µm; None in the middle.
    keeps_low : bool
        Whether what lies below the plane is kept, or what lies above.
    """

    text: str
    axis: int
    place: float | None
    keeps_low: bool

    def placed(self, points: NDArray[np.float64]) -> "Cut":
        """The same, by default through the middle of points (N, 3) in µm."""
        if self.place is not None:
            return self
        along = points[:, self.axis]
        return replace(self, place=float(along.min() + along.max()) / 2)

    def mirrored(self) -> "Cut":
        """The same where z is reversed."""
        if self.axis != AXES.index("z"):
            return self
        return replace(self, place=None if self.place is None else -self.place,
                       keeps_low=not self.keeps_low)  # fmt: skip

    def depth(self, along: NDArray[np.floating]) -> NDArray[np.float64]:
        """How far coordinates along the axis are on the side that is kept, µm."""
        towards = -1.0 if self.keeps_low else 1.0
        return np.asarray(towards * (np.asarray(along, float) - self.at))

    @property
    def at(self) -> float:
        """Coordinate of the plane, µm; only once it is placed."""
        if self.place is None:
            message = "the cut has no place yet"
            raise TypeError(message)
        return self.place

    def meets(self, points: NDArray[np.floating]) -> bool:
        """Whether it goes through what is between these points (N, 3)."""
        depth = self.depth(points[:, self.axis])
        return bool(depth.min(initial=np.inf) < 0 < depth.max(initial=-np.inf))

    def closed(self, mesh: CellMesh) -> CellMesh:
        """What it leaves of a cell, with a flat face where it was cut; maybe without triangles."""
        if not self.meets(mesh.vertices):
            kept = self.depth(mesh.vertices[:, self.axis]).min(initial=np.inf) >= 0
            return mesh if kept else replace(mesh, faces=mesh.faces[:0], vertices=mesh.vertices[:0])
        small = _surface(mesh).clip_closed_surface(normal=self._normal(), origin=self._origin())
        return self._with_rim(_mesh(mesh, small))

    def open(self, mesh: CellMesh) -> CellMesh:
        """What it leaves of a shell, which has no thickness."""
        if not self.meets(mesh.vertices):
            return self.closed(mesh)
        small = _surface(mesh).clip(normal=self._normal(), origin=self._origin(), invert=False)
        return _mesh(mesh, small.extract_surface(algorithm="dataset_surface").triangulate())

    def _normal(self) -> Sequence[float]:
        normal = np.zeros(3)
        normal[self.axis] = -1.0 if self.keeps_low else 1.0
        return tuple(normal.tolist())

    def _origin(self) -> Sequence[float]:
        origin = np.zeros(3)
        origin[self.axis] = self.at + ASIDE
        return tuple(origin.tolist())

    def _with_rim(self, mesh: CellMesh) -> CellMesh:
        """The flat face with vertices of its own, so that light shows its edge."""
        flat = np.abs(mesh.vertices[:, self.axis] - self.at) < 2 * ASIDE
        face = flat[mesh.faces].all(axis=1)
        used, faces = np.unique(mesh.faces[face], return_inverse=True)
        whole = mesh.faces.copy()
        whole[face] = len(mesh.vertices) + faces.reshape(-1, 3)
        return replace(
            mesh, vertices=np.concatenate([mesh.vertices, mesh.vertices[used]]), faces=whole
        )


def read_cut(cut: str | None) -> Cut | None:
    """Cut of a word: "z" takes away the upper half along z, "-z=12.5" what is below z = 12.5 µm.

    Raises
    ------
    ValueError
        It is not of this form.
    """
    if cut is None:
        return None
    found = FORM.fullmatch(cut.strip()) if isinstance(cut, str) else None
    if found is None:
        message = (
            f"cut = {cut!r} is not known; take 'z', '-z', 'z=12.5' or '-z=12.5' (x and y "
            "likewise): what is beyond the plane at that end of the axis is cut away, by default "
            "half"
        )
        raise ValueError(message)
    sign, axis, place = found.groups()
    return Cut(cut, AXES.index(axis), None if place is None else _place(cut, place), not sign)


def _place(cut: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        message = f"cut = {cut!r}: {text!r} is not a number of µm"
        raise ValueError(message) from error
    return _validate.number("cut", value)


def _surface(mesh: CellMesh) -> Any:
    poly_data = need("pyvista", "a cut", "pictures").PolyData
    return poly_data.from_regular_faces(mesh.vertices, mesh.faces)


def _mesh(mesh: CellMesh, surface: Any) -> CellMesh:
    faces = np.asarray(surface.regular_faces if surface.n_cells else np.zeros((0, 3)), np.int32)
    return replace(mesh, vertices=np.asarray(surface.points, np.float32), faces=faces)
