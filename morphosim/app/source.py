"""Where the scene of the form comes from: a built-in scene, a scene file, or files to import."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _validate
from morphosim._tables import LARGEST_WHOLE, whole
from morphosim.app.store import Store
from morphosim.importers.matlab.name_table import NameTable, read_name_table
from morphosim.library.built_in import built_in_scene
from morphosim.physics.attraction import Attraction
from morphosim.scene.file import load_scene
from morphosim.scene.scene import Scene

if TYPE_CHECKING:
    from morphosim.importers.labels.label_image import LabelImage

KINDS = ("built-in", "matlab", "labels", "file")
IMPORTED_DURATION, IMPORTED_SAVE_EVERY = 15000.0, 500.0
"""What the form proposes for imported cells: the published example's time, 30 saves."""
NO_CODE = (
    "run such a scene by the command line: morphosim run FILE -o DIR, or --resume DIR; or allow "
    "its code to the application: morphosim app --allow-code"
)
"""What to do with a scene file that names code of a user's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Where a scene comes from; files are named as below the folder, "" is none.

    Attributes
    ----------
    kind : {"built-in", "matlab", "labels", "file"}
    scene : name of a built-in scene
    file : scene file
    masks, table, shell : files of the published program, see `import_matlab`; without `shell` its
        eggshell is taken
    image : label image, see `import_labels`; `table` has its cells' names and attraction, in rising
        order of the labels or, where `about` names them, in any
    spacing : voxel in µm, one number or three; "" where the image says it
    time, axes, key : which part of an image's file, see `read_labels`; "" as by default
    about : table of what is known of the labels, see `read_cells`
    frozen : names or labels of cells that are not stepped, with commas between
    volumes : target volumes of the cells of an image, see `import_labels`
    least_voxels, background : see `import_labels`; "" as by default
    """

    kind: str = "built-in"
    scene: str = "celegans-8"
    file: str = ""
    masks: str = ""
    table: str = ""
    shell: str = ""
    image: str = ""
    spacing: str = ""
    time: str = ""
    axes: str = ""
    key: str = ""
    about: str = ""
    frozen: str = ""
    volumes: str = "surface"
    least_voxels: str = ""
    background: str = ""

    @property
    def settles(self) -> bool:
        """Whether cells are run to find the target volumes: a look needs not wait for it."""
        return self.kind == "labels" and self.volumes == "surface"

    def read(self, store: Store, quick: bool = False) -> Scene:
        """Scene as it is there, before anything is changed.

        Parameters
        ----------
        store : Store
        quick : whether to look at the scene alone: a formula has the target volumes, see `settles`

        Raises
        ------
        ValueError, OSError, ImportError
            As the engine's readers word them; or a file that is needed is not chosen.
        """
        _validate.choice("source", self.kind, KINDS)
        if self.kind == "built-in":
            return built_in_scene(self.scene)
        if self.kind == "file":
            return load_scene(store.scene(_chosen("scene file (.toml)", self.file)))
        scene = self._of_masks(store) if self.kind == "matlab" else self._of_labels(store, quick)
        return replace(scene, duration=IMPORTED_DURATION, save_every=IMPORTED_SAVE_EVERY)

    def _of_masks(self, store: Store) -> Scene:
        from morphosim.importers.matlab.scene import import_matlab

        return import_matlab(
            store.path(_chosen("file of masks (.mat)", self.masks)),
            store.path(_chosen("table of names and attraction", self.table)),
            shell=store.path(self.shell) if self.shell else None,
            spacing=float(_spacing(self.spacing or "0.5", 1)[0]),
        )

    def _of_labels(self, store: Store, quick: bool) -> Scene:
        from morphosim.importers.labels.scene import import_labels

        image, path = self._image(store)
        table = read_name_table(store.path(self.table)) if self.table else None
        names: Any = store.path(self.about) if self.about else None
        if table and not names:
            names = _names_by_label(image, table, self.table)
        scene = import_labels(
            image,
            names=names,
            frozen=[name for name in re.split(r"\s*[,;]\s*", self.frozen.strip()) if name],
            confinement="image",
            volumes="ball" if quick and self.settles else self.volumes,
            least_voxels=_whole("least_voxels", self.least_voxels),
            name=path.name.partition(".")[0],
        )
        return scene if table is None else _with_table(scene, table, self.table)

    def _image(self, store: Store) -> "tuple[LabelImage, Path]":
        """Label image without its background, and where it is."""
        from morphosim.importers.labels.image_file import read_labels

        path = store.path(_chosen("label image (.tif)", self.image))
        image = read_labels(
            path,
            axes=self.axes.strip() or None,
            spacing=_spacings(self.spacing),
            key=self.key.strip() or None,
            time_index=_whole("time_index", self.time),
        )
        background = _whole("background", self.background) or 0
        return (image.without(background) if background else image), path


def _chosen(what: str, name: str) -> str:
    if not name:
        message = f"no {what} is chosen; choose or upload one"
        raise ValueError(message)
    return name


def _spacings(text: str) -> NDArray[np.float64] | None:
    """Voxel along x, y, z that a text says; None if it says nothing."""
    if not text.strip():
        return None
    found = _spacing(text, 1, 3)
    return np.repeat(found, 3) if len(found) == 1 else found


def _spacing(text: str, *counts: int) -> NDArray[np.float64]:
    """Numbers of a text, one or three."""
    entries = re.split(r"[\s,;x×]+", text.strip())
    if len(entries) not in counts:
        message = f"voxel = {text!r}; expected {' or '.join(map(str, counts))} numbers in µm"
        raise ValueError(message)
    return np.array([_validate.parsed_number("voxel", entry, above=0) for entry in entries])


def _whole(name: str, text: str) -> int | None:
    """Whole number that a text says; None if it says nothing. The readers know its bounds."""
    return whole(-LARGEST_WHOLE)(name, text.strip()) if text.strip() else None


def _names_by_label(image: "LabelImage", table: NameTable, where: str) -> dict[int, str]:
    """Names of a table for the labels of an image, in rising order."""
    labels = [int(label) for label in np.unique(image.labels) if label != 0]
    if len(table.names) != len(labels):
        message = (
            f"{where} has {len(table.names)} names, but the image has {len(labels)} labels; "
            "expected one name for each label, in rising order"
        )
        raise ValueError(message)
    return dict(zip(labels, table.names, strict=True))


def _with_table(scene: Scene, table: NameTable, where: str) -> Scene:
    """Scene whose cells have the attraction and volumes of a table with their names."""
    for name in scene.names:
        _validate.choice(f"name of a cell in {where}", name, table.names)
    for name in table.names:
        _validate.choice(f"name in {where}", name, scene.names)
    cells = [
        replace(cell, volume=table.volumes.get(cell.name, cell.volume)) for cell in scene.cells
    ]
    sigma = Attraction.from_matrix(table.names, table.sigma)
    return replace(scene, cells=cells, physics=replace(scene.physics, sigma=sigma))
