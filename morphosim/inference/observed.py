"""What a fit is given: label images, or a run, as cells of known names on images of known times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.accessor import open_run
from morphosim.cell_field import CellField
from morphosim.geometry.confinement import Confinement, EllipsoidShell
from morphosim.geometry.phase_field import radius_of
from morphosim.geometry.shapes import Sphere
from morphosim.importers.labels.image_file import read_labels
from morphosim.importers.labels.label_image import LabelImage, Piece, pieces_of
from morphosim.importers.labels.resampling import walls_around
from morphosim.importers.labels.scene import CLEARANCE, CLOSING, known_cells, least_voxels_of
from morphosim.inference.observation import photographed
from morphosim.library.built_in import find_scene
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics
from morphosim.runs.resume import saved_scene
from morphosim.runs.saved_fields import load_fields
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene

PRESET = "standard"
FINER = 2
"""A run is seen on voxels of its lattice spacing over this."""
MARGIN = 3.0
"""Margin of images of a run around its cells, µm."""
WALLS = ("image", "ellipsoid")
"""Walls that are found from the first image."""
CORNERS = 400
"""Most corners of the cells' convex hull by which an ellipsoid is found."""
Image = LabelImage | str | Path
Names = Mapping[int, str] | str | Path


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observed:
    """Cells, and what is seen of them.

    Attributes
    ----------
    scene : Scene
        Cells in the order of the labels, and what is given of them.
    images : sequence of LabelImage
        Labels are 1 to N.
    times : sequence of float
        *In silico*; one of a still image.
    volumes_given : bool
        Whether target volumes of all cells are known.
    """

    scene: Scene
    images: Sequence[LabelImage]
    times: Sequence[float]
    volumes_given: bool


def read_images(
    what: Image | Sequence[Image], *, scene: Scene | str | Path | None, names: Names | None,
    times: Sequence[float] | None, spacing: ArrayLike | None,
    confinement: Confinement | str | None, numerics: Numerics | None,
) -> Observed:  # fmt: skip
    """Read label images, of which the labels are the same cells, and check them.

    Raises
    ------
    FileNotFoundError
        A file does not exist.
    ValueError
        Labels touch the border, are in several pieces, or differ from one image to another; times
        do not fit the images; the message says what to do.
    """
    given_images = [what] if isinstance(what, LabelImage | str | Path) else list(what)
    images = [_image(image, spacing) for image in given_images]
    when = _times(times, len(images))
    given = None if scene is None else scene if isinstance(scene, Scene) else find_scene(str(scene))
    lattice = Numerics.preset(PRESET) if numerics is None else numerics
    pieces = [_pieces(image, lattice.spacing, k, len(images)) for k, image in enumerate(images)]
    _check_same_labels(pieces)
    clean = [_renumbered(image, found) for image, found in zip(images, pieces, strict=True)]
    known = known_cells(names)
    cells = [_cell(piece, images[0], known.get(piece.label, {}), given) for piece in pieces[0]]
    physics = Physics() if given is None else given.physics
    physics = physics.among([cell.name for cell in cells], [cell.type for cell in cells])
    walls = given.confinement if given is not None and confinement is None else confinement
    full = Scene(
        cells=cells, physics=physics, numerics=lattice, name="fit",
        confinement=_walls(walls, clean[0], physics.interface_scale, lattice.spacing),
    )  # fmt: skip
    stated = {cell.name for cell in given.cells} if given else set()
    volumes = all(
        cell.name in stated or "volume" in known.get(piece.label, {})
        for piece, cell in zip(pieces[0], cells, strict=True)
    )
    return Observed(scene=full, images=clean, times=when, volumes_given=volumes)


def read_run(
    path: Path, *, times: Sequence[float] | None, confinement: Confinement | str | None,
    numerics: Numerics | None,
) -> Observed:  # fmt: skip
    """Look at the fields of a run: at the last save, or at those of some times.

    Raises
    ------
    FileNotFoundError
        There is no run.
    ValueError
        The run has no fields, no save at a time, or other cells at one time than at another.
    """
    scene = saved_scene(path)
    if any(scene.period):
        message = f"{path} is of periodic space, where surfaces are not compared; take open space"
        raise ValueError(message)
    with open_run(path) as run:
        spacing, all_times = float(run.attrs["spacing_um"]), run["time"].values
        when = [float(all_times[-1])] if times is None else _times(times, len(times))
        fields = [load_fields(run, _save_at(all_times, time, path)) for time in when]
    names = sorted(field.name for field in fields[0])
    for time, found in zip(when, fields, strict=True):
        if sorted(field.name for field in found) != names:
            message = (
                f"the cells of {path} at time {time:g} are others than at {when[0]:g}; take times "
                "between which no cell divides or is removed"
            )
            raise ValueError(message)
    ordered = [sorted(found, key=lambda field: field.name) for found in fields]
    images = [_image_of(found, spacing) for found in ordered]
    known = {cell.name: cell for cell in scene.cells}
    cells = [_seen_cell(image, k, name, known.get(name)) for image, (k, name) in
             ((images[0], pair) for pair in enumerate(names))]  # fmt: skip
    lattice = scene.numerics if numerics is None else numerics
    physics = scene.physics.among(names, [cell.type for cell in cells])
    walls = scene.confinement if confinement is None else confinement
    full = Scene(
        cells=cells, physics=physics, numerics=lattice, name="fit",
        confinement=_walls(walls, images[0], physics.interface_scale, lattice.spacing),
    )  # fmt: skip
    return Observed(
        scene=full, images=images, times=when, volumes_given=all(name in known for name in names)
    )


def _save_at(times: NDArray[np.float64], time: float, path: Path) -> int:
    near = int(np.argmin(np.abs(times - time)))
    if abs(times[near] - time) > 1e-6 * max(abs(time), 1.0):
        message = f"{path} has no save at time {time:g}; the nearest is at {times[near]:g}"
        raise ValueError(message)
    return near


def _image_of(fields: Sequence[CellField], spacing: float) -> LabelImage:
    """Label image of fields, on voxels finer than their lattice."""
    voxel = spacing / FINER
    low = np.min([f.origin for f in fields], axis=0) * spacing - MARGIN
    high = np.max([f.origin + f.phi.shape for f in fields], axis=0) * spacing + MARGIN
    shape = np.ceil((high - low) / voxel).astype(int)
    empty = LabelImage(labels=np.zeros(shape, np.int32), spacing=voxel, origin=low)
    return photographed(fields, spacing, empty)


def _seen_cell(image: LabelImage, k: int, name: str, known: Cell | None) -> Cell:
    """Cell of a label, with what is known of a cell of this name."""
    ball = _ball(image, np.argwhere(image.labels == k + 1))
    if known is None:
        return Cell(name=name, shape=ball, volume=ball.volume)
    target = known.volume if known.volume is not None else known.shape.volume
    return replace(known, shape=ball, volume=target, frozen=False)


def _cell(piece: Piece, image: LabelImage, said: Mapping[str, Any], given: Scene | None) -> Cell:
    """Cell of a label: what a table says of it, or else a scene. It begins as a ball."""
    ball = _ball(image, piece.first + np.argwhere(piece.mask))
    about: dict[str, Any] = {"name": f"cell{piece.label}", "volume": ball.volume, **said}
    for cell in given.cells if given is not None else ():
        if cell.name == about["name"]:
            target = cell.volume if cell.volume is not None else cell.shape.volume
            mine = {"type": cell.type, "parent": cell.parent, "gamma": cell.gamma, "volume": target}
            about |= {key: value for key, value in mine.items() if key not in said}
    about["frozen"] = False
    return Cell(shape=ball, **about)


def _ball(image: LabelImage, voxels: NDArray[np.int64]) -> Sphere:
    """Ball of the volume of so many voxels (n, 3), about their centre."""
    centre = np.asarray(image.origin) + voxels.mean(axis=0) * image.steps
    return Sphere(center=centre, radius=radius_of(len(voxels) * image.voxel))


def _image(image: Image, spacing: ArrayLike | None) -> LabelImage:
    if isinstance(image, str | Path):
        return read_labels(image, spacing=spacing)
    if not isinstance(image, LabelImage):
        message = f"observed = {_validate.brief(image)} is neither a LabelImage nor a path"
        raise TypeError(message)
    return image


def _times(times: Sequence[float] | None, images: int) -> list[float]:
    """Times of images, rising; 0 of a single one."""
    if times is None:
        if images == 1:
            return [0.0]
        message = (
            f"there are {images} images and no times; give the in silico time of each as times"
        )
        raise ValueError(message)
    several = _validate.several("times", times, "numbers")
    found = [_validate.number("times", time) for time in several]
    if len(found) != images:
        message = f"there are {len(found)} times and {images} images; give one time for each"
        raise ValueError(message)
    if any(b <= a for a, b in pairwise(found)):
        message = f"times = {found} do not rise; give images in the order of time"
        raise ValueError(message)
    return found


def _pieces(image: LabelImage, spacing: float, number: int, images: int) -> list[Piece]:
    """Labels of an image, none of which touches its border."""
    which = f"image {number + 1} of {images}: " if images > 1 else ""
    pieces = pieces_of(image, least_voxels_of(None, image, spacing))
    cut = [str(piece.label) for piece in pieces if piece.at_border]
    if cut:
        message = (
            f"{which}labels {', '.join(cut)} touch the border of the image, which may cut them "
            "off; take an image with a margin, or leave these cells out (label 0)"
        )
        raise ValueError(message)
    return pieces


def _check_same_labels(pieces: Sequence[Sequence[Piece]]) -> None:
    first = {piece.label for piece in pieces[0]}
    for k, found in enumerate(pieces[1:], start=2):
        other = first ^ {piece.label for piece in found}
        if other:
            message = (
                f"label {min(other)} is not in both image 1 and image {k}; a series has the same "
                "cells at all times: take images between two divisions, of tracked cells"
            )
            raise ValueError(message)


def _renumbered(image: LabelImage, pieces: Sequence[Piece]) -> LabelImage:
    """Image of these pieces, numbered from 1 on."""
    labels = np.zeros(image.labels.shape, np.int32)
    for number, piece in enumerate(pieces, start=1):
        box = tuple(
            slice(a, a + n) for a, n in zip(piece.first.tolist(), piece.mask.shape, strict=True)
        )
        labels[box][piece.mask] = number
    return replace(image, labels=labels)


def _walls(
    walls: Confinement | str | None, image: LabelImage, scale: float, spacing: float
) -> Confinement | None:
    """Walls as given, or found from an image."""
    if not isinstance(walls, str):
        return walls
    _validate.choice("confinement", walls, WALLS)
    if walls == "image":
        return walls_around(image, spacing, CLEARANCE / scale, CLOSING)
    return ellipsoid_around(image, CLEARANCE / scale)


def ellipsoid_around(image: LabelImage, clearance: float) -> EllipsoidShell:
    """The ellipsoid along the axes of least volume around all labels, and farther out by so much.

    With b = 1 / semi-axes and d = b centre it is the maximum of Σ ln b where |b x - d| <= 1 for all
    corners x of the convex hull: a convex problem.
    """
    from scipy.optimize import minimize
    from scipy.spatial import ConvexHull

    places = np.argwhere(image.labels > 0) * image.steps + np.asarray(image.origin)
    corners = places[ConvexHull(places).vertices]
    if len(corners) > CORNERS:
        directions = np.random.default_rng(0).normal(size=(4 * CORNERS, 3))
        corners = np.unique(corners[np.argmax(corners @ directions.T, axis=0)], axis=0)
    middle = 0.5 * (corners.max(axis=0) + corners.min(axis=0))
    size = 0.5 * np.ptp(corners, axis=0).max()
    x = (corners - middle) / size

    def outside(v: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(1 - ((x * v[:3] - v[3:]) ** 2).sum(axis=1))

    def slope(v: NDArray[np.float64]) -> NDArray[np.float64]:
        off = x * v[:3] - v[3:]
        return np.concatenate([-2 * off * x, 2 * off], axis=1)

    start = np.concatenate([np.full(3, 0.9 / np.linalg.norm(x, axis=1).max()), np.zeros(3)])
    found = minimize(  # type: ignore[call-overload]
        lambda v: -np.log(v[:3]).sum(), start,
        jac=lambda v: np.concatenate([-1 / v[:3], np.zeros(3)]), method="SLSQP",
        constraints={"type": "ineq", "fun": outside, "jac": slope},
        bounds=[(1e-3, None)] * 3 + [(None, None)] * 3, options={"maxiter": 500},
    ).x  # fmt: skip
    axes = size / found[:3] + clearance + 0.5 * image.steps
    return EllipsoidShell(center=middle + size * found[3:] / found[:3], semi_axes=axes)
