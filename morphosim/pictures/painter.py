"""Pictures of meshes, made by PyVista off screen: without a display and without a GPU."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim._extras import need
from morphosim.pictures.camera import Camera, checked_pixels
from morphosim.pictures.meshes import CellMesh
from morphosim.pictures.needs import need_drawing
from morphosim.pictures.palettes import RGB

FINER = 2
"""Pictures are made so many times finer per side, and averaged."""
OUTLINE = 0.35
"""Brightness of the lines around cells, of 1."""
SHELL_COLOUR, SHELL_OPACITY, SHELL_LINE = "#8a8a8a", 0.10, 0.55
LAMPS = (((-0.4, 0.6, 1.0), 0.75), ((0.5, -0.8, 0.7), 0.3))
"""Where lamps are as seen from the camera, which looks along -z, and how strong they are."""
SHINE = {
    "interpolation": "Gouraud", "ambient": 0.42, "diffuse": 0.8, "specular": 0.12,
    "specular_power": 12,
}  # fmt: skip
"""How cells reflect light."""
EDGE_WIDTH = 1.3
"""Width of a box's edges, pixels."""
NEAR = 512.0
"""µm within which most scenes are."""
NOWHERE = 0xFFFFFF
"""White, read as the number of a cell."""


@dataclass(frozen=True, slots=True)
class Panel:
    """Picture of cells in one view.

    Attributes
    ----------
    image : (H, W, 3) uint8
    seen : (H, W) int32
        Place in `names` of the cell at each pixel; -1 where there is none.
    names : of the cells
    rectangles : (N,)
        Pixels of the rectangle around each cell, as if no other hid it.
    camera : Camera
    lines : (H, W) bool, optional
        Where edges of a box are seen.
    """

    image: NDArray[np.uint8]
    seen: NDArray[np.int32]
    names: Sequence[str]
    rectangles: NDArray[np.float64]
    camera: Camera
    lines: NDArray[np.bool_] | None = None


class Painter(AbstractContextManager["Painter"]):
    """Window, never shown, in which meshes are drawn; close it, or use it in `with`.

    Raises
    ------
    ImportError
        PyVista is not installed.
    OSError
        The system has no library to draw with.
    """

    def __init__(self) -> None:
        self._pv = need("pyvista", "a picture", "pictures")
        need_drawing()
        with _quiet():
            self._plotter = self._pv.Plotter(off_screen=True, lighting="none")
        for place, strength in LAMPS:
            lamp = self._pv.Light(light_type="camera light", intensity=strength)
            lamp.position = place
            self._plotter.add_light(lamp)
        self._plotter.set_background("white")
        self._plotter.disable_anti_aliasing()
        self._plotter.render_window.SetMultiSamples(0)
        self._cells: Any = None

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the window."""
        self._plotter.close()

    def load(
        self,
        meshes: Sequence[CellMesh],
        colours: Mapping[str, RGB],
        shell: CellMesh | None = None,
        box: NDArray[np.float64] | None = None,
    ) -> None:
        """Take cells, and a translucent shell or the corners (2, 3) of a box, in place of others.

        Parameters
        ----------
        meshes : of the cells
        colours : RGB of each cell by name
        shell, box : optional
        """
        self._plotter.clear_actors()
        self._meshes, self._names = meshes, [mesh.name for mesh in meshes]
        self._cells = self._numbers = self._shell = self._edges = None
        if meshes:
            self._load_cells(meshes, colours)
        if shell is not None:
            self._load_shell(shell)
        if box is not None:
            edges = self._pv.Box(np.asarray(box).T.ravel()).extract_all_edges()
            self._edges = self._plotter.add_mesh(
                edges, name="edges", color="black", line_width=EDGE_WIDTH * FINER, lighting=False
            )

    def paint(self, camera: Camera) -> Panel:
        """Draw what is loaded; ValueError for more pixels than can be drawn."""
        checked_pixels(camera.size, least=1)
        self._look(camera)
        image = self._shot(self._cells, self._shell, self._edges)[..., :3]
        lines = None
        if self._edges is not None:
            lines = _coarser(image) != _coarser(self._shot(self._cells, self._shell)[..., :3])
            lines = lines.any(axis=2)
        seen = self._seen()
        _darken(image, _rims(seen), OUTLINE)
        if self._shell is not None:
            outside = self._shot(self._outline)[..., 0] > 127  # white there
            _darken(image, _rims(outside) & (seen < 0), SHELL_LINE)
        rectangles = np.array([_rectangle(camera.pixels(mesh.vertices)) for mesh in self._meshes])
        names = seen[::FINER, ::FINER], self._names
        return Panel(_coarser(image), *names, rectangles, camera, lines)

    def _load_cells(self, meshes: Sequence[CellMesh], colours: Mapping[str, RGB]) -> None:
        """One mesh of all cells, drawn in their colours and, on demand, in their numbers."""
        counts = [len(mesh.vertices) for mesh in meshes]
        starts = np.cumsum([0, *counts[:-1]])
        faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
        whole = self._pv.PolyData.from_regular_faces(
            np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces)
        )
        whole.compute_normals(
            cell_normals=False, split_vertices=False, consistent_normals=False, inplace=True
        )
        shades = np.rint(255 * np.array([colours[mesh.name] for mesh in meshes]))
        place = np.repeat(np.arange(len(meshes)), counts)
        numbers = np.stack([place, place >> 8, place >> 16], axis=1) & 255
        self._cells = self._add("cells", whole, shades.astype(np.uint8)[place], **SHINE)
        self._numbers = self._add("numbers", whole, numbers.astype(np.uint8), lighting=False)

    def _add(self, name: str, mesh: Any, values: NDArray[np.uint8], **options: Any) -> Any:
        copy = mesh.copy(deep=False)
        copy.point_data["colour"] = values
        return self._plotter.add_mesh(
            copy, name=name, scalars="colour", rgb=True, copy_mesh=False, show_scalar_bar=False,
            **options,
        )  # fmt: skip

    def _load_shell(self, shell: CellMesh) -> None:
        """Mesh, and the same in black, whose shape gives the outline."""
        mesh = self._pv.PolyData.from_regular_faces(shell.vertices, shell.faces)
        self._shell = self._plotter.add_mesh(
            mesh, name="shell", color=SHELL_COLOUR, opacity=SHELL_OPACITY, lighting=False
        )
        self._outline = self._plotter.add_mesh(mesh, name="outline", color="black", lighting=False)

    def _look(self, camera: Camera) -> None:
        width, height = camera.size
        self._plotter.window_size = [width * FINER, height * FINER]
        view = self._plotter.camera
        view.parallel_projection = True
        view.focal_point = camera.center.tolist()
        reach = self._reach(camera)
        view.position = (camera.center + camera.toward * 2 * reach).tolist()
        view.up = camera.up.tolist()
        view.parallel_scale = height * camera.scale / 2
        view.clipping_range = (0.5 * reach, 3.5 * reach)

    def _reach(self, camera: Camera) -> float:
        """At least from the middle of the picture to what is farthest from it, µm.

        In steps of 2, so that from frame to frame light falls and depths are rounded alike.
        """
        ends = np.array(self._plotter.bounds).reshape(3, 2) - camera.center[:, None]
        farthest = max(float(np.linalg.norm(np.abs(ends).max(axis=1))), NEAR)
        return float(2 ** np.ceil(np.log2(farthest)))

    def _shot(self, *actors: Any) -> NDArray[np.uint8]:
        """Picture of these actors alone, FINER times finer: (h, w, 4)."""
        for actor in self._plotter.actors.values():
            actor.SetVisibility(any(actor is chosen for chosen in actors))
        window = self._plotter.render_window
        window.Render()
        width, height = window.GetSize()
        pixels = need("vtkmodules.vtkCommonCore", "a picture", "pictures").vtkUnsignedCharArray()
        window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, pixels)
        return np.array(pixels).reshape(height, width, 4)[::-1]

    def _seen(self) -> NDArray[np.int32]:
        """Place of the cell at each pixel, FINER times finer; -1 where there is none."""
        if self._numbers is None:
            width, height = self._plotter.window_size
            return np.full((height, width), -1, np.int32)
        places = self._shot(self._numbers).view("<u4")[..., 0].astype(np.int32) & NOWHERE
        places[places == NOWHERE] = -1
        return places


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep VTK from remarking that there is no display, which it then does without."""
    logger = need("vtkmodules.vtkCommonCore", "a picture", "pictures").vtkLogger
    before = logger.GetCurrentVerbosityCutoff()
    logger.SetStderrVerbosity(logger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        logger.SetStderrVerbosity(before)


def _rectangle(points: NDArray[np.float64]) -> float:
    """Area of the rectangle around points (N, 2)."""
    return float(np.prod(points.max(axis=0) - points.min(axis=0)))


def _rims(values: NDArray) -> NDArray[np.bool_]:
    """Pixels that differ from the one to the right or below."""
    rims = np.zeros(values.shape, bool)
    rims[:, :-1] |= values[:, :-1] != values[:, 1:]
    rims[:-1] |= values[:-1] != values[1:]
    return rims


def _darken(image: NDArray[np.uint8], where: NDArray[np.bool_], brightness: float) -> None:
    image[where] = (image[where] * brightness).astype(np.uint8)


def _coarser(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Means of FINER x FINER pixels."""
    summed = np.zeros((*(n // FINER for n in image.shape[:2]), 3), np.uint16)
    for row, column in np.ndindex(FINER, FINER):
        summed += image[row::FINER, column::FINER]
    return (summed // FINER**2).astype(np.uint8)
