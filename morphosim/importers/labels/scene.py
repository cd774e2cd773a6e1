"""Scenes from segmented images: every label a cell, from where and how it was measured."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.errors import warn
from morphosim.geometry.confinement import Confinement
from morphosim.geometry.phase_field import ball_integral, least_volume
from morphosim.geometry.shapes import Mask
from morphosim.importers.labels.cell_table import read_cells
from morphosim.importers.labels.image_file import read_labels
from morphosim.importers.labels.label_image import LabelImage, Piece, SegmentationWarning, pieces_of
from morphosim.importers.labels.resampling import resampled, walls_around
from morphosim.importers.labels.target_volumes import (
    ball_target,
    settled_targets,
)
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics
from morphosim.progress import Tell, silent
from morphosim.scene.cell import Cell
from morphosim.scene.scene import Scene

VOLUMES = ("surface", "ball", "voxels")
LEAST_SMOOTHING = 2.0
"""Default smoothing of a mask is this many µm, and at least two of the image's coarsest steps.

In the eight-cell embryo (voxels of 0.5 µm) start fields agree with the labels to a mean IoU of
0.962, 0.955, 0.948 and 0.931 at a smoothing of 1, 2, 3 and 4.5 µm: more rounds edges off. Less
keeps what is not shape: where slices are displaced by 0.3 µm at random, φ of balls is off by 0.29,
0.25 and 0.22 at 1, 2 and 3 µm (root mean square in the interface). After 20 *in silico* units the
IoU is 0.965 with all of them; of frozen cells the start stays.
"""
CLEARANCE = 0.8
"""Distance of a wall from labels, in widths 1/√(c/2): φ = 1/2 of cells pressed to a hard wall lies
so far inside of it (0.65 to 1.0 in the eight-cell embryo)."""
CLOSING = 5.0
"""Gaps of up to twice this (µm) between cells are inside of walls from the image."""


def import_labels(
    image: LabelImage | str | Path,
    *,
    names: Mapping[int, str] | str | Path | None = None,
    spacing: ArrayLike | None = None,
    frozen: Collection[str | int] = (),
    active: Collection[str | int] | None = None,
    confinement: Confinement | str | None = None,
    physics: Physics | None = None,
    numerics: Numerics | None = None,
    volumes: str = "surface",
    smoothing: float | None = None,
    least_voxels: int | None = None,
    background: int = 0,
    name: str | None = None,
    tell: Tell = silent,
) -> Scene:
    """Scene from a label image: each label is a cell, 0 is background.

    Each cell is sampled anew on cubes, by interpolation of the signed distance to its surface, so
    an image may have any voxels; then it is a `Mask`. The cubes have half the lattice spacing, or
    half the image's finest step if that is more.

    Parameters
    ----------
    image : LabelImage or path
        For files that need more to be said than `spacing`, use `read_labels`.
    names : mapping from label to name, or path of a .csv table, optional
        Columns of a table: label, name, type, parent, volume (target, µm³), gamma and frozen; only
        label is needed. Cells that it does not name are "cell1", "cell2", ... by their label.
        Labels that are not in the image are passed over.
    spacing : float or (3,) µm, optional
        Size of a voxel, where `image` is a path; see `read_labels`.
    frozen : names or labels
        Cells that act on others and are not stepped, besides those that the table freezes.
    active : names or labels, optional
        The only cells that are stepped: a region of interest with what was measured around it.
    confinement : Confinement, "image" or None
        None is open space. "image" is a wall around all labels, gaps between them closed.
    physics, numerics : optional
        See `Scene`. The walls of confinement = "image" are stepped, for which an S of 14 to 17 is
        chosen with the default physics.
    volumes : {"surface", "ball", "voxels"}
        Target volume, where the table has none. "surface": that with which the surface φ = 1/2
        encloses the volume of the label's voxels once the cell has settled among its neighbours
        and walls; all cells are run for 40 to 200 units of time to find it. "ball": that of a free
        ball, by a formula (see `importers.labels.target_volumes`). "voxels": the voxels' volume,
        as the published program has it, with which cells come out smaller than they were measured.
    smoothing : float, optional
        See `Mask`; by default 2 µm, and at least two of the image's coarsest steps.
    least_voxels : int, optional
        Labels of fewer voxels are refused; by default as many as 27 lattice points fill.
    background : int
        A label that is the background too, besides 0.
    name : str, optional
        Name of the scene; by default the file name, or "scene".
    tell : callable
        Told now and then how far cells have settled, where `volumes` is "surface": how many rounds
        are done, and how many there are at most.

    Returns
    -------
    Scene

    Raises
    ------
    FileNotFoundError
        A file does not exist.
    ValueError
        The image has no label, or one that is too small or in several pieces, or something given
        does not fit; the message names it.

    Warns
    -----
    SegmentationWarning
        A cell that is stepped is cut off by the border of the image; loose voxels are left out;
        holes within cells are filled; there is no background; cells could not be settled.

    Examples
    --------
    >>> scene = import_labels("embryo.tif", spacing=(0.2, 0.2, 0.6),
    ...                       physics=Physics(sigma=0.5))  # doctest: +SKIP
    """
    _validate.choice("volumes", volumes, VOLUMES)
    picture = _picture(image, spacing)
    picture = picture.without(background) if background != 0 else picture
    physics = Physics() if physics is None else physics
    lattice = Numerics() if numerics is None else numerics
    _validate.instance("physics", physics, Physics)
    _validate.instance("numerics", lattice, Numerics)
    pieces = pieces_of(picture, least_voxels_of(least_voxels, picture, lattice.spacing))
    about = _about([piece.label for piece in pieces], known_cells(names), frozen, active)
    _warn_of_border(pieces, about)
    width = _smoothing(picture) if smoothing is None else smoothing
    scene = Scene(
        cells=list(_cells(picture, pieces, about, physics, lattice, volumes, width)),
        physics=physics,
        numerics=lattice,
        confinement=_confinement(confinement, picture, physics, lattice),
        name=_name(image) if name is None else name,
    )
    if volumes != "surface" or not physics.constraint.present:
        return scene
    enclosed = {
        said["name"]: piece.count * picture.voxel
        for piece, said in zip(pieces, about, strict=True)
        if "volume" not in said
    }
    return settled_targets(scene, enclosed, tell)


def _cells(
    image: LabelImage,
    pieces: Sequence[Piece],
    about: Sequence[dict[str, Any]],
    physics: Physics,
    numerics: Numerics,
    volumes: str,
    smoothing: float,
) -> Iterator[Cell]:
    """One cell per piece, with its target volume."""
    step = 0.5 * max(numerics.spacing, float(image.steps.min()))
    for piece, said in zip(pieces, about, strict=True):
        start = target = piece.count * image.voxel
        if volumes != "voxels":
            gamma = said.get("gamma") or physics.gamma
            target = ball_target(start, gamma, physics)
            start = ball_integral(start, physics.interface_scale)
        mask, origin = resampled(piece, image, step, start)
        shape = Mask(mask=mask, origin=origin, spacing=step, smoothing=smoothing)
        yield Cell(shape=shape, **({"volume": target} | said))


def _picture(image: LabelImage | str | Path, spacing: ArrayLike | None) -> LabelImage:
    if isinstance(image, str | Path):
        return read_labels(image, spacing=spacing)
    if not isinstance(image, LabelImage):
        message = f"image = {_validate.brief(image)} is neither a LabelImage nor a path"
        raise TypeError(message)
    if spacing is not None:
        message = f"spacing = {spacing!r}, but the LabelImage has its own; give it there"
        raise ValueError(message)
    return image


def _name(image: LabelImage | str | Path) -> str:
    return "scene" if isinstance(image, LabelImage) else Path(image).name.partition(".")[0]


def least_voxels_of(given: int | None, image: LabelImage, spacing: float) -> int:
    """Number of voxels below which a label is refused."""
    if given is not None:
        return _validate.integer("least_voxels", given, least=1)
    return math.ceil(least_volume(spacing) / image.voxel - 1e-9)


def _smoothing(image: LabelImage) -> float:
    """Default smoothing of masks, µm."""
    return max(LEAST_SMOOTHING, 2 * float(image.steps.max()))


def known_cells(names: Mapping[int, str] | str | Path | None) -> Mapping[int, dict[str, Any]]:
    """What is said of each label, as keywords of `Cell`."""
    if names is None:
        return {}
    if isinstance(names, str | Path):
        return read_cells(Path(names))
    _validate.instance("names", names, Mapping)
    return {
        _validate.integer("label in names", label, least=1): {"name": name}
        for label, name in names.items()
    }


def _about(
    labels: Sequence[int],
    known: Mapping[int, dict[str, Any]],
    frozen: Collection[str | int],
    active: Collection[str | int] | None,
) -> list[dict[str, Any]]:
    """Name of each cell, and what else is said of it."""
    if known and not set(labels) & set(known):
        message = f"names are given of labels {_some(known)}, but the image holds {_some(labels)}"
        raise ValueError(message)
    about = [{"name": f"cell{label}"} | known.get(label, {}) for label in labels]
    _freeze(about, labels, frozen, active)
    if all(said.get("frozen") for said in about):
        message = f"all {len(about)} cells are frozen; leave at least one that is stepped"
        raise ValueError(message)
    return about


def _some(labels: Collection[int]) -> str:
    """The first labels, as a text."""
    listed = [str(label) for label in sorted(labels)]
    return ", ".join(listed[:5]) + (", ..." if len(listed) > 5 else "")


def _freeze(
    about: Sequence[dict[str, Any]],
    labels: Sequence[int],
    frozen: Collection[str | int],
    active: Collection[str | int] | None,
) -> None:
    """Mark the cells that are not stepped."""
    for option, cells in (("frozen", frozen), ("active", () if active is None else active)):
        _validate.several(option, cells, "names or labels")
    if active is not None and len(frozen):
        message = f"frozen = {list(frozen)} and active = {list(active)}; give one of them"
        raise ValueError(message)
    if active is not None:
        chosen = _places("active", active, about, labels)
        for k, said in enumerate(about):
            said["frozen"] = k not in chosen
    for k in _places("frozen", frozen, about, labels):
        about[k]["frozen"] = True


def _places(
    option: str,
    cells: Collection[str | int],
    about: Sequence[dict[str, Any]],
    labels: Sequence[int],
) -> set[int]:
    """Places of cells given by name or label; a text of digits is a label if it is no name."""
    known: dict[str | int, int] = {}
    for k, label in enumerate(labels):
        known |= {label: k, str(label): k}
    names = {said["name"]: k for k, said in enumerate(about)}
    for cell in cells:
        if cell not in known and cell not in names:
            _validate.choice(f"cell in {option}", cell, names)
    return {(known | names)[cell] for cell in cells}


def _warn_of_border(pieces: Sequence[Piece], about: Sequence[dict[str, Any]]) -> None:
    cut = [
        said["name"]
        for piece, said in zip(pieces, about, strict=True)
        if piece.at_border and not said.get("frozen")
    ]
    if cut:
        message = (
            f"cells at the border of the image, which may cut them off: {', '.join(cut)}. Freeze "
            "them, so that they keep their shape, or take an image with a margin"
        )
        warn(message, SegmentationWarning)


def _confinement(
    wanted: Confinement | str | None, image: LabelImage, physics: Physics, numerics: Numerics
) -> Confinement | None:
    if not isinstance(wanted, str):
        return wanted
    _validate.choice("confinement", wanted, ("image",))
    clearance = CLEARANCE / physics.interface_scale
    return walls_around(image, numerics.spacing, clearance, CLOSING)
