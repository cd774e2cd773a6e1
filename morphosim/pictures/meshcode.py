"""Triangle meshes as few bytes: what the viewer's `unpack.js` reads.

A packed frame is base64 of gzip of these arrays, little-endian, one after the other:

- number of meshes, uint32;
- of each mesh: vertices V and faces F, uint32; low corner x, y, z and step in µm, float32;
- positions, 3 V values per mesh: x y z of each vertex in steps from the low corner, each less that
  of the vertex before, folded to 0, -1, 1, -2, … -> 0, 1, 2, 3, …; of all meshes the low bytes,
  then the high bytes;
- normals, 2 V int8 per mesh: the sphere unfolded to an octahedron's square, times 127;
- faces, 3 F values per mesh: how far each index is below the next that has not occurred yet; of
  all meshes the low bytes, then the high bytes.

Faces follow each other along shared edges, and vertices are numbered as faces use them: then most
values are small, and a face with its share of vertices takes 3.3 bytes after gzip.
"""

import base64
import gzip
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from morphosim.measure.surfaces import Surface
from morphosim.pictures.meshes import CellMesh, normals, reduced

STEPS = 1023
"""Steps along the longest side of a mesh: of a cell of 20 µm they are 0.02 µm."""
MOST_TRIANGLES = 20_000
"""Vertices then have numbers of 16 bits."""


@dataclass(frozen=True, slots=True)
class Small:
    """Simplified mesh with the normals of the full one.

    Attributes
    ----------
    mesh : CellMesh
    normals : (V, 3) float32, unit vectors outward
    """

    mesh: CellMesh
    normals: NDArray[np.float32]


def packed(meshes: Sequence[CellMesh], triangles: int) -> str:
    """Meshes of at most so many triangles each, as base64 of gzip. Needs PyVista."""
    small = [_in_strips(_small(mesh, triangles)) for mesh in meshes]
    values = [
        np.array([len(small)], "<u4").tobytes(),
        *(_header(part.mesh) for part in small),
        _bytes(_positions(part.mesh) for part in small),
        *(_octahedral(part.normals).tobytes() for part in small),
        _bytes(_codes(part.mesh.faces) for part in small),
    ]
    return base64.b64encode(gzip.compress(b"".join(values), 9, mtime=0)).decode()


def _small(mesh: CellMesh, triangles: int) -> Small:
    from scipy.spatial import cKDTree

    small = _of_volume(reduced(mesh, min(triangles, MOST_TRIANGLES)), _volume(mesh))
    _, nearest = cKDTree(mesh.vertices).query(small.vertices)
    return Small(small, normals(mesh)[nearest])


def _of_volume(mesh: CellMesh, volume: float) -> CellMesh:
    """Mesh swollen to a volume (µm³): few triangles cut off what bulges between their corners."""
    middle = mesh.vertices.mean(axis=0)
    scale = (volume / _volume(mesh)) ** (1 / 3)
    return replace(mesh, vertices=((mesh.vertices - middle) * scale + middle).astype(np.float32))


def _volume(mesh: CellMesh) -> float:
    return Surface(mesh.name, mesh.vertices.astype(float), mesh.faces.astype(np.int64)).volume


def _in_strips(small: Small) -> Small:
    """Order faces along shared edges, and number vertices in the order of their use."""
    faces = small.mesh.faces[_walk(small.mesh.faces)]
    used, first = np.unique(faces, return_index=True)
    old = used[np.argsort(first)]
    new = np.zeros(len(small.mesh.vertices), np.int32)
    new[old] = np.arange(len(old))
    mesh = replace(small.mesh, vertices=small.mesh.vertices[old], faces=new[faces])
    return Small(mesh, small.normals[old])


def _walk(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """Order of the faces in which most follow one that they share an edge with."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import depth_first_order

    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    edges, sides = edges[order], order // 3
    shared = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    pairs = (sides[shared], sides[shared + 1])
    graph = coo_array((np.ones(len(shared)), pairs), shape=(len(faces), len(faces))).tocsr()
    walk = depth_first_order(graph, 0, directed=False, return_predecessors=False)
    return np.append(walk, np.setdiff1d(np.arange(len(faces)), walk))


def _low_and_step(vertices: NDArray[np.float32]) -> tuple[NDArray[np.float32], float]:
    low = vertices.min(axis=0)
    return low, max(float((vertices.max(axis=0) - low).max()) / STEPS, 1e-6)


def _header(mesh: CellMesh) -> bytes:
    low, step = _low_and_step(mesh.vertices)
    sizes = np.array([len(mesh.vertices), len(mesh.faces)], "<u4")
    return sizes.tobytes() + np.array([*low, step], "<f4").tobytes()


def _positions(mesh: CellMesh) -> NDArray[np.int64]:
    low, step = _low_and_step(mesh.vertices)
    steps = np.rint((mesh.vertices - low) / step).astype(np.int64)
    change = np.diff(steps, axis=0, prepend=0)
    return np.asarray(np.where(change < 0, -2 * change - 1, 2 * change).ravel())


def _octahedral(vectors: NDArray[np.float32]) -> NDArray[np.int8]:
    """Unit vectors as points of a square: (V, 2)."""
    lengths = np.maximum(np.abs(vectors).sum(axis=1, keepdims=True), 1e-9)
    x, y, z = (vectors / lengths).T
    square = np.stack([x, y], axis=1)
    signs = np.where(square < 0, -1, 1)
    folded = np.where(z[:, None] < 0, (1 - np.abs(square[:, ::-1])) * signs, square)
    return np.asarray(np.rint(127 * folded), np.int8)


def _codes(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """Faces, turned so that the largest index is last, as distances below the next new index."""
    turn = (faces.argmax(axis=1)[:, None] + [1, 2, 3]) % 3
    indices = np.take_along_axis(faces, turn, axis=1).ravel().astype(np.int64)
    following = np.maximum.accumulate(np.append(-1, indices[:-1])) + 1
    return following - indices


def _bytes(parts: Iterable[NDArray[np.int64]]) -> bytes:
    """Low bytes of all values, then high bytes."""
    values = np.concatenate([np.zeros(0, np.int64), *parts])
    return (values & 255).astype(np.uint8).tobytes() + (values >> 8).astype(np.uint8).tobytes()
