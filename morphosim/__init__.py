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
    "Attraction": "attraction",
    "BoxWalls": "confinement",
    "EllipsoidShell": "confinement",
    "FunctionWalls": "confinement",
    "MaskWalls": "confinement",
    "contact_areas": "contacts",
    "touching": "contacts",
    "CellVanishedError": "errors",
    "DivergenceError": "errors",
    "SaveError": "errors",
    "export": "exports",
    "built_in_scene": "library",
    "scene_names": "library",
    "import_matlab": "matlab",
    "Measurement": "measure",
    "measure_fields": "measure",
    "Numerics": "numerics",
    "packed_cells": "packing",
    "Physics": "physics",
    "ProgressBar": "progress",
    "relaxed": "relaxation",
    "pack": "runs.pack",
    "load_fields": "runs.fields",
    "open_run": "runs.reader",
    "RunWriter": "runs.writer",
    "Cell": "scene",
    "Scene": "scene",
    "VolumeCourse": "scene",
    "load_scene": "scenefile",
    "save_scene": "scenefile",
    "Ellipsoid": "shapes",
    "Field": "shapes",
    "Mask": "shapes",
    "Sphere": "shapes",
    "LabelImage": "segmentation.labelimage",
    "SegmentationWarning": "segmentation.labelimage",
    "read_labels": "segmentation.labelfile",
    "import_labels": "segmentation.scene",
    "Simulation": "simulation",
    "StabilityWarning": "stability",
    "sweep": "sweeps.run",
}

if TYPE_CHECKING:
    from morphosim.attraction import Attraction
    from morphosim.confinement import BoxWalls, EllipsoidShell, FunctionWalls, MaskWalls
    from morphosim.contacts import contact_areas, touching
    from morphosim.errors import CellVanishedError, DivergenceError, SaveError
    from morphosim.exports import export
    from morphosim.library import built_in_scene, scene_names
    from morphosim.matlab import import_matlab
    from morphosim.measure import Measurement, measure_fields
    from morphosim.numerics import Numerics
    from morphosim.packing import packed_cells
    from morphosim.physics import Physics
    from morphosim.progress import ProgressBar
    from morphosim.relaxation import relaxed
    from morphosim.runs.fields import load_fields
    from morphosim.runs.pack import pack
    from morphosim.runs.reader import open_run
    from morphosim.runs.writer import RunWriter
    from morphosim.scene import Cell, Scene, VolumeCourse
    from morphosim.scenefile import load_scene, save_scene
    from morphosim.segmentation.labelfile import read_labels
    from morphosim.segmentation.labelimage import LabelImage, SegmentationWarning
    from morphosim.segmentation.scene import import_labels
    from morphosim.shapes import Ellipsoid, Field, Mask, Sphere
    from morphosim.simulation import Simulation
    from morphosim.stability import StabilityWarning
    from morphosim.sweeps.run import sweep

__version__ = version("morphosim")
__all__ = [
    "Attraction", "BoxWalls", "Cell", "CellVanishedError", "DivergenceError", "Ellipsoid",
    "EllipsoidShell", "Field", "FunctionWalls", "LabelImage", "Mask", "MaskWalls", "Measurement",
    "Numerics", "Physics", "ProgressBar", "RunWriter", "SaveError", "Scene", "SegmentationWarning",
    "Simulation", "Sphere", "StabilityWarning", "VolumeCourse", "__version__", "built_in_scene",
    "contact_areas", "export", "import_labels", "import_matlab", "load_fields", "load_scene",
    "measure_fields", "open_run", "pack", "packed_cells", "read_labels", "relaxed", "save_scene",
    "scene_names", "sweep", "touching",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message)
    return getattr(import_module(f"{__name__}.{_EXPORTS[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
