"""MorphoSim: phase-field simulation of multicellular shapes.

Every cell is a smooth field in its own moving box, with surface tension, volume, adhesion and
motion. The public names below are loaded when they are first used.

Examples
--------
>>> from morphosim import built_in_scene, Simulation
>>> simulation = Simulation(built_in_scene("single-cell"))
>>> simulation.run(until=20)
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

_EXPORTS = {
    "Attraction": "physics.attraction",
    "BoxWalls": "geometry.confinement",
    "EllipsoidShell": "geometry.confinement",
    "FunctionWalls": "geometry.confinement",
    "MaskWalls": "geometry.confinement",
    "contact_areas": "measure.contacts",
    "touching": "measure.contacts",
    "CellVanishedError": "errors",
    "DivergenceError": "errors",
    "SaveError": "errors",
    "export": "exports",
    "built_in_scene": "library.built_in",
    "scene_names": "library.built_in",
    "import_matlab": "importers.matlab.scene",
    "Measurement": "measure.measurement",
    "measure_fields": "measure.measurement",
    "measured": "runs.measured_state",  # with all built-in variables, whose names are taken
    "Numerics": "numerics.parameters",
    "packed_cells": "scene.random_packing",
    "Physics": "physics.parameters",
    "ProgressBar": "simulation.progress_bar",
    "relaxed": "simulation.relaxation",
    "pack": "runs.pack",
    "load_fields": "runs.saved_fields",
    "open_run": "accessor",
    "RunWriter": "runs.writer",
    "Cell": "scene.cell",
    "Scene": "scene.scene",
    "VolumeCourse": "scene.cell",
    "load_scene": "scene.file",
    "save_scene": "scene.file",
    "Ellipsoid": "geometry.shapes",
    "Field": "geometry.shapes",
    "Mask": "geometry.shapes",
    "Sphere": "geometry.shapes",
    "LabelImage": "importers.labels.label_image",
    "SegmentationWarning": "importers.labels.label_image",
    "read_labels": "importers.labels.image_file",
    "import_labels": "importers.labels.scene",
    "Simulation": "simulation.simulation",
    "StabilityWarning": "scene.stability",
    "sweep": "sweeps.run",
}

if TYPE_CHECKING:
    from morphosim.accessor import open_run
    from morphosim.errors import CellVanishedError, DivergenceError, SaveError
    from morphosim.exports import export
    from morphosim.geometry.confinement import BoxWalls, EllipsoidShell, FunctionWalls, MaskWalls
    from morphosim.geometry.shapes import Ellipsoid, Field, Mask, Sphere
    from morphosim.importers.labels.image_file import read_labels
    from morphosim.importers.labels.label_image import LabelImage, SegmentationWarning
    from morphosim.importers.labels.scene import import_labels
    from morphosim.importers.matlab.scene import import_matlab
    from morphosim.library.built_in import built_in_scene, scene_names
    from morphosim.measure.contacts import contact_areas, touching
    from morphosim.measure.measurement import Measurement, measure_fields
    from morphosim.measure.variable import measured
    from morphosim.numerics.parameters import Numerics
    from morphosim.physics.attraction import Attraction
    from morphosim.physics.parameters import Physics
    from morphosim.runs.pack import pack
    from morphosim.runs.saved_fields import load_fields
    from morphosim.runs.writer import RunWriter
    from morphosim.scene.cell import Cell, VolumeCourse
    from morphosim.scene.file import load_scene, save_scene
    from morphosim.scene.random_packing import packed_cells
    from morphosim.scene.scene import Scene
    from morphosim.scene.stability import StabilityWarning
    from morphosim.simulation.progress_bar import ProgressBar
    from morphosim.simulation.relaxation import relaxed
    from morphosim.simulation.simulation import Simulation
    from morphosim.sweeps.run import sweep

__version__ = version("morphosim")
__all__ = [
    "Attraction", "BoxWalls", "Cell", "CellVanishedError", "DivergenceError", "Ellipsoid",
    "EllipsoidShell", "Field", "FunctionWalls", "LabelImage", "Mask", "MaskWalls", "Measurement",
    "Numerics", "Physics", "ProgressBar", "RunWriter", "SaveError", "Scene", "SegmentationWarning",
    "Simulation", "Sphere", "StabilityWarning", "VolumeCourse", "__version__", "built_in_scene",
    "contact_areas", "export", "import_labels", "import_matlab", "load_fields", "load_scene",
    "measure_fields", "measured", "open_run", "pack", "packed_cells", "read_labels", "relaxed",
    "save_scene", "scene_names", "sweep", "touching",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message)
    return getattr(import_module(f"{__name__}.{_EXPORTS[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
