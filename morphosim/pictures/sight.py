"""What a picture of a save shows: meshes, their colours and what is around them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.pictures.camera import corners
from morphosim.pictures.colours import Colouring
from morphosim.pictures.cut import AXES, Cut
from morphosim.pictures.detail import drawn_meshes
from morphosim.pictures.meshes import CellMesh, mirrored, run_confinement, shell_mesh
from morphosim.runs.saved_fields import time_index, variable

if TYPE_CHECKING:
    import xarray as xr

    from morphosim.pictures.painter import Painter

Floats = NDArray[np.float64]
FLIP = np.array([1.0, 1.0, -1.0])
NOTHING = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
"""Bounds where there is nothing to see, µm."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What is around the cells of a run.

    Attributes
    ----------
    shell : CellMesh or None
        Drawn translucent.
    box : (2, 3) µm or None
        Corners of plane walls, drawn as edges.
    """

    shell: CellMesh | None = None
    box: Floats | None = None

    @property
    def points(self) -> Floats | None:
        """Points (N, 3) to have in view, µm; None in open space."""
        if self.shell is not None:
            return self.shell.vertices.astype(np.float64)
        return None if self.box is None else corners(self.box)

    def opened(self, cut: Cut | None, mirror: bool) -> "Surroundings":
        """The same with the shell cut open; the edges of a box stay."""
        if cut is None or self.shell is None:
            return self
        return replace(self, shell=(cut.mirrored() if mirror else cut).open(self.shell))


def surroundings(run: "xr.Dataset", mirror: bool = False) -> Surroundings:
    """Shell or box of a run, as far as its scene is known (`meshes.run_confinement`)."""
    from morphosim.geometry.confinement import BoxWalls

    confinement = run_confinement(run)
    if confinement is None:
        return Surroundings()
    if isinstance(confinement, BoxWalls):
        return Surroundings(box=flipped(np.stack(confinement.bounds()), mirror))
    shell = shell_mesh(confinement)
    return Surroundings(shell=mirrored(shell) if mirror else shell)


@dataclass(frozen=True, slots=True)
class Sight:
    """Cells of one save, as they are drawn.

    Attributes
    ----------
    meshes : of the cells
    colouring : Colouring
    around : Surroundings
    title : str
        Scene, time and stage.
    """

    meshes: list[CellMesh]
    colouring: Colouring
    around: Surroundings
    title: str

    @property
    def points(self) -> Floats:
        """Points (N, 3) to have in view, µm."""
        if self.around.points is not None:
            return self.around.points
        if not self.meshes:
            return corners(NOTHING)
        return np.concatenate([mesh.vertices for mesh in self.meshes]).astype(np.float64)

    def load(self, painter: "Painter") -> None:
        """Give a painter what is to be drawn."""
        painter.load(self.meshes, self.colouring.colours, self.around.shell, self.around.box)


def sight(
    run: "xr.Dataset",
    time: float | None,
    colouring: Colouring,
    mirror: bool,
    around: Surroundings,
    cut: Cut | None = None,
) -> Sight:
    """What a picture of the save nearest to `time` shows, mirrored if it is to be, and cut.

    Raises
    ------
    ValueError
        See `drawn_meshes`.
    """
    _validate.flag("mirror", mirror)
    meshes = drawn_meshes(run, time, cut)
    if mirror:
        meshes = [mirrored(mesh) for mesh in meshes]
    return Sight(meshes, colouring, around.opened(cut, mirror), title(run, time))


def placed_cut(
    run: "xr.Dataset", saves: Sequence[int], cut: Cut | None, around: Surroundings, mirror: bool
) -> Cut | None:
    """Cut in its place: by default through the middle of the shell or box, or else of the cells.

    Raises
    ------
    ValueError
        It does not meet the cells of these saves.
    """
    if cut is None:
        return None
    cells = run_corners(run, saves=saves)
    middle = cells if around.points is None else around.points * (FLIP if mirror else 1.0)
    placed = cut.placed(middle)
    if not placed.meets(cells):
        low, high = cells[:, cut.axis].min(), cells[:, cut.axis].max()
        message = (
            f"cut = {cut.text!r} does not meet the cells, which are between "
            f"{AXES[cut.axis]} = {low:.4g} and {high:.4g} µm"
        )
        raise ValueError(message)
    return placed


def title(run: "xr.Dataset", time: float | None) -> str:
    """Scene, time and stage of a save."""
    save = time_index(run, time)
    at = float(run["time"].values[save])
    stage = str(variable(run, "stage", "time")[save].values) if "stage" in run else ""
    parts = [run.attrs.get("scene", ""), f"t = {at:,.10g}".replace(",", "\u2009"), stage]
    return ", ".join(part for part in parts if part)


def flipped(bounds: ArrayLike, mirror: bool) -> Floats:
    """Box (2, 3) as it is drawn."""
    given = np.asarray(bounds, np.float64)
    return np.sort(given * FLIP, axis=0) if mirror else given


def checked_bounds(bounds: ArrayLike, mirror: bool) -> Floats:
    """Corners (8, 3) of a box that a caller gives, as it is drawn; ValueError if it is none."""
    given = _validate.array("bounds", bounds, (2, 3))
    if not (given[1] > given[0]).all():
        message = f"bounds = {bounds!r}: the second corner must exceed the first"
        raise ValueError(message)
    return corners(flipped(given, mirror))


def run_corners(
    run: "xr.Dataset", mirror: bool = False, saves: Sequence[int] | None = None
) -> Floats:
    """Corners (8, 3) of the box around all cells of some saves, by default of all, µm."""
    shown = slice(None) if saves is None else list(saves)
    low, high = (
        variable(run, f"box_{end}", "time", "cell", "axis")[shown].values.reshape(-1, 3)
        for end in ("low", "high")
    )
    if not np.isfinite(low).any():
        return corners(NOTHING)
    return corners(flipped(np.stack([np.nanmin(low, axis=0), np.nanmax(high, axis=0)]), mirror))
