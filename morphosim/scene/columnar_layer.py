"""Start states: one layer of columnar cells between an ellipsoidal shell and its core."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim.geometry.confinement import EllipsoidShell
from morphosim.geometry.shapes import Polyhedron
from morphosim.scene.cell import Cell

Floats = NDArray[np.float64]
REACH, PUSH, ITERATIONS = 1.3, 0.2, 60
"""Points nearer than 1.3 widths of a cell push each other by 0.2 of what is missing to it."""
NEAREST = 16
"""So many of the cells around one may be its neighbours."""
DIGITS = 4
"""Of a corner's place in µm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnarLayer:
    """One layer of cells that reach from an ellipsoidal shell to its core, as in a blastoderm.

    Points at random on the surface half way between the two push each other apart, and share out
    the layer as Voronoi cells, named c1, c2, …

    Attributes
    ----------
    count : int
        Number of cells.
    filling : float
        Target volume of a cell, as a share of its part of the layer.
    type : str
        Type of all cells.
    seed : int, optional
        That of the places; by default that of the scene's numerics.
    """

    count: int
    filling: float = 0.95
    type: str = ""
    seed: int | None = None

    def __post_init__(self) -> None:
        _validate.integer("cells.count", self.count, least=2 * NEAREST)
        _validate.number("cells.filling", self.filling, above=0, most=1)
        _validate.label("cells.type", self.type, empty=True)
        if self.seed is not None:
            _validate.integer("cells.seed", self.seed, least=0)

    def cells(self, confinement: object, seed: int) -> list[Cell]:
        """Cells of the layer; ValueError unless the confinement is a shell with a core."""
        if not isinstance(confinement, EllipsoidShell) or confinement.core is None:
            message = (
                f"cells: a columnar layer lies between an ellipsoid and its core; confinement = "
                f"{_validate.brief(confinement)}. Give one of kind 'ellipsoid' with a core"
            )
            raise ValueError(message)
        center = np.asarray(confinement.center, float)
        outer, core = (np.asarray(a, float) for a in (confinement.semi_axes, confinement.core))
        middle = (outer + core) / 2
        rng = np.random.default_rng(seed if self.seed is None else self.seed)
        points = even_points(middle, self.count, rng)
        ends = [_ends(points, middle, axes) for axes in (outer, core)]
        shapes = (Polyhedron(vertices=(v + center).round(DIGITS)) for v in _columns(points, *ends))
        return [
            Cell(name=f"c{k}", type=self.type, shape=shape, volume=self.filling * shape.volume)
            for k, shape in enumerate(shapes, 1)
        ]


def even_points(semi_axes: Floats, count: int, rng: np.random.Generator) -> Floats:
    """(count, 3) points on an ellipsoid about the origin, at random, then pushed apart, µm."""
    from scipy.spatial import cKDTree

    points, area = _surface_points(semi_axes, count, rng)
    reach = REACH * np.sqrt(2 / np.sqrt(3) * area / count)
    for _ in range(ITERATIONS):
        pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
        apart = points[pairs[:, 0]] - points[pairs[:, 1]]
        far = np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-9)
        push = PUSH * (reach / far - 1) * apart
        np.add.at(points, pairs[:, 0], push)
        np.subtract.at(points, pairs[:, 1], push)
        points /= np.linalg.norm(points / semi_axes, axis=1, keepdims=True)
    return points


def _surface_points(
    semi_axes: Floats, count: int, rng: np.random.Generator
) -> tuple[Floats, float]:
    """(count, 3) points at random on an ellipsoid, equally likely everywhere, and its area, µm².

    A direction u of the unit sphere stands for an area ∝ |u / a| of the ellipsoid.
    """
    tried = 0
    found: list[Floats] = []
    while sum(map(len, found)) < count:
        u = rng.normal(size=(count, 3))
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        likely = semi_axes.min() * np.linalg.norm(u / semi_axes, axis=1)
        found.append(u[rng.random(count) < likely] * semi_axes)
        tried += count
    places = np.concatenate(found)
    share = len(places) / tried  # of ∫ |u / a| du, over that of its largest value
    area = 4 * np.pi * float(semi_axes.prod()) * share / float(semi_axes.min())
    return places[:count], area


def _ends(points: Floats, middle: Floats, semi_axes: Floats) -> tuple[Floats, Floats]:
    """Where normals of the middle surface meet another one: places, and its normals there."""
    normals = points / middle**2
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    a = ((normals / semi_axes) ** 2).sum(axis=1)
    b = (points * normals / semi_axes**2).sum(axis=1)
    c = ((points / semi_axes) ** 2).sum(axis=1) - 1
    root = b**2 - a * c
    if not (root >= 0).all():
        message = "cells: the core is too sharp for columns to stand on; make it blunter or larger"
        raise ValueError(message)
    places = points + ((np.sqrt(root) - b) / a)[:, None] * normals
    outward = places / semi_axes**2
    return places, outward / np.linalg.norm(outward, axis=1, keepdims=True)


def _columns(
    points: Floats, top: tuple[Floats, Floats], base: tuple[Floats, Floats]
) -> list[Floats]:
    """Corners of the Voronoi cells of points, each cut by the planes that touch top and base."""
    from scipy.spatial import HalfspaceIntersection, cKDTree

    near = np.asarray(cKDTree(points).query(points, NEAREST + 1)[1])
    found = []
    for k, point in enumerate(points):
        apart = points[near[k, 1:]] - point
        sides = np.column_stack([apart, -(apart**2).sum(axis=1) / 2])
        sides /= np.linalg.norm(apart, axis=1, keepdims=True)
        caps = [
            np.append(sign * normals[k], -sign * normals[k] @ (places[k] - point))
            for sign, (places, normals) in ((1, top), (-1, base))
        ]
        found.append(
            HalfspaceIntersection(np.vstack([sides, caps]), np.zeros(3)).intersections + point
        )
    return found
