"""MorphoSim: phase-field simulation of multicellular shapes.

Every cell is a smooth field in its own moving box, with surface tension, volume, adhesion and
motion. The public names below are loaded when they are first used.

Examples
--------
>>> from morphosim import built_in_scene, Simulation
>>> simulation = Simulation(built_in_scene("single-cell"))
>>> simulation.run(until=20)
"""

import sys
from importlib import import_module
from importlib.metadata import version
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any

_EXPORTS = {
    "Column": "cell_table",
    "Concern": "physics.term",
    "Conditions": "physics.term",
    "Environment": "physics.term",
    "Forces": "physics.term",
    "Step": "physics.term",
    "Term": "physics.term",
    "CellTable": "cell_table",
    "point_force": "kernels.points",
    "open_run": "accessor",
    "CellVanishedError": "errors",
    "DivergenceError": "errors",
    "ResolutionWarning": "errors",
    "SaveError": "errors",
    "export": "exports.export",
    "BoxWalls": "geometry.confinement",
    "EllipsoidShell": "geometry.confinement",
    "FunctionWalls": "geometry.confinement",
    "MaskWalls": "geometry.confinement",
    "Ellipsoid": "geometry.shapes",
    "Field": "geometry.shapes",
    "Mask": "geometry.shapes",
    "Polyhedron": "geometry.shapes",
    "Sphere": "geometry.shapes",
    "read_labels": "importers.labels.image_file",
    "LabelImage": "importers.labels.label_image",
    "SegmentationWarning": "importers.labels.label_image",
    "import_labels": "importers.labels.scene",
    "Lineage": "importers.lineage",
    "celegans_contact_areas": "importers.lineage",
    "celegans_contacts": "importers.lineage",
    "read_lineage": "importers.lineage",
    "lineage_scene": "importers.lineage.scene",
    "import_matlab": "importers.matlab.scene",
    "built_in_scene": "library.built_in",
    "scene_names": "library.built_in",
    "celegans_1_to_102": "library.celegans.scenes",
    "celegans_1_to_8": "library.celegans.scenes",
    "contact_areas": "measure.contacts",
    "touching": "measure.contacts",
    "label_image": "measure.label_image",
    "voxel_contact_areas": "measure.voxel_contacts",
    "Measurement": "measure.measurement",
    "measure_fields": "measure.measurement",
    "measured": "runs.measured_state",  # with all built-in variables, whose names are taken
    "DistributedSimulation": "mpi.distributed_simulation",
    "RootObserver": "mpi.distributed_simulation",
    "Numerics": "numerics.parameters",
    "Attraction": "physics.attraction",
    "Centrifuge": "physics.centrifuge",
    "Chemotaxis": "physics.chemotaxis",
    "AxialTension": "physics.axial_tension",
    "ContractileRing": "physics.contractile_ring",
    "Flow": "physics.flow",
    "Gravity": "physics.gravity",
    "Polarity": "physics.polarity",
    "WallAdhesion": "physics.wall_adhesion",
    "Physics": "physics.parameters",
    "pack": "runs.pack",
    "load_fields": "runs.saved_fields",
    "RunWriter": "runs.writer",
    "ColumnarLayer": "scene.columnar_layer",
    "Cell": "scene.cell",
    "VolumeCourse": "scene.cell",
    "CellCount": "scene.ends",
    "Duration": "scene.ends",
    "QuasiSteady": "scene.ends",
    "Steady": "scene.ends",
    "When": "scene.ends",
    "Apoptosis": "scene.events",
    "CellChange": "scene.events",
    "Differentiation": "scene.events",
    "Division": "scene.events",
    "Growth": "scene.events",
    "PhysicsChange": "scene.events",
    "Proliferation": "scene.events",
    "Removal": "scene.events",
    "load_scene": "scene.file",
    "save_scene": "scene.file",
    "Aggregate": "scene.random_packing",
    "packed_cells": "scene.random_packing",
    "Scene": "scene.scene",
    "StabilityWarning": "scene.stability",
    "Stage": "scene.stages",
    "Observer": "simulation.observers",
    "ProgressBar": "simulation.progress_bar",
    "relaxed": "simulation.relaxation",
    "Simulation": "simulation.simulation",
    "Axis": "sweeps.axes",
    "Range": "sweeps.axes",
    "sweep": "sweeps.run",
    "fit": "inference.run",
}

if TYPE_CHECKING:
    from morphosim.accessor import open_run
    from morphosim.cell_table import CellTable, Column
    from morphosim.errors import CellVanishedError, DivergenceError, ResolutionWarning, SaveError
    from morphosim.exports.export import export
    from morphosim.geometry.confinement import BoxWalls, EllipsoidShell, FunctionWalls, MaskWalls
    from morphosim.geometry.shapes import Ellipsoid, Field, Mask, Polyhedron, Sphere
    from morphosim.importers.labels.image_file import read_labels
    from morphosim.importers.labels.label_image import LabelImage, SegmentationWarning
    from morphosim.importers.labels.scene import import_labels
    from morphosim.importers.lineage import (
        Lineage,
        celegans_contact_areas,
        celegans_contacts,
        read_lineage,
    )
    from morphosim.importers.lineage.scene import lineage_scene
    from morphosim.importers.matlab.scene import import_matlab
    from morphosim.inference.run import fit
    from morphosim.kernels.points import point_force
    from morphosim.library.built_in import built_in_scene, scene_names
    from morphosim.library.celegans.scenes import celegans_1_to_8, celegans_1_to_102
    from morphosim.measure.contacts import contact_areas, touching
    from morphosim.measure.label_image import label_image
    from morphosim.measure.measurement import Measurement, measure_fields
    from morphosim.measure.variable import measured
    from morphosim.measure.voxel_contacts import voxel_contact_areas
    from morphosim.mpi.distributed_simulation import DistributedSimulation, RootObserver
    from morphosim.numerics.parameters import Numerics
    from morphosim.physics.attraction import Attraction
    from morphosim.physics.axial_tension import AxialTension
    from morphosim.physics.centrifuge import Centrifuge
    from morphosim.physics.chemotaxis import Chemotaxis
    from morphosim.physics.contractile_ring import ContractileRing
    from morphosim.physics.flow import Flow
    from morphosim.physics.gravity import Gravity
    from morphosim.physics.parameters import Physics
    from morphosim.physics.polarity import Polarity
    from morphosim.physics.term import (
        Concern,
        Conditions,
        Environment,
        Forces,
        Step,
        Term,
    )
    from morphosim.physics.wall_adhesion import WallAdhesion
    from morphosim.runs.pack import pack
    from morphosim.runs.saved_fields import load_fields
    from morphosim.runs.writer import RunWriter
    from morphosim.scene.cell import Cell, VolumeCourse
    from morphosim.scene.columnar_layer import ColumnarLayer
    from morphosim.scene.ends import CellCount, Duration, QuasiSteady, Steady, When
    from morphosim.scene.events import (
        Apoptosis,
        CellChange,
        Differentiation,
        Division,
        Growth,
        PhysicsChange,
        Proliferation,
        Removal,
    )
    from morphosim.scene.file import load_scene, save_scene
    from morphosim.scene.random_packing import Aggregate, packed_cells
    from morphosim.scene.scene import Scene
    from morphosim.scene.stability import StabilityWarning
    from morphosim.scene.stages import Stage
    from morphosim.simulation.observers import Observer
    from morphosim.simulation.progress_bar import ProgressBar
    from morphosim.simulation.relaxation import relaxed
    from morphosim.simulation.simulation import Simulation
    from morphosim.sweeps.axes import Axis, Range
    from morphosim.sweeps.run import sweep

__version__ = version("morphosim")
__all__ = [
    "Aggregate",
    "Apoptosis",
    "Attraction",
    "AxialTension",
    "Axis",
    "BoxWalls",
    "Cell",
    "CellChange",
    "CellCount",
    "CellTable",
    "CellVanishedError",
    "Centrifuge",
    "Chemotaxis",
    "Column",
    "ColumnarLayer",
    "Concern",
    "Conditions",
    "ContractileRing",
    "Differentiation",
    "DistributedSimulation",
    "DivergenceError",
    "Division",
    "Duration",
    "Ellipsoid",
    "EllipsoidShell",
    "Environment",
    "Field",
    "Flow",
    "Forces",
    "FunctionWalls",
    "Gravity",
    "Growth",
    "LabelImage",
    "Lineage",
    "Mask",
    "MaskWalls",
    "Measurement",
    "Numerics",
    "Observer",
    "Physics",
    "PhysicsChange",
    "Polarity",
    "Polyhedron",
    "ProgressBar",
    "Proliferation",
    "QuasiSteady",
    "Range",
    "Removal",
    "ResolutionWarning",
    "RootObserver",
    "RunWriter",
    "SaveError",
    "Scene",
    "SegmentationWarning",
    "Simulation",
    "Sphere",
    "StabilityWarning",
    "Stage",
    "Steady",
    "Step",
    "Term",
    "VolumeCourse",
    "WallAdhesion",
    "When",
    "__version__",
    "built_in_scene",
    "celegans_1_to_8",
    "celegans_1_to_102",
    "celegans_contact_areas",
    "celegans_contacts",
    "contact_areas",
    "export",
    "fit",
    "import_labels",
    "import_matlab",
    "label_image",
    "lineage_scene",
    "load_fields",
    "load_scene",
    "measure_fields",
    "measured",
    "open_run",
    "pack",
    "packed_cells",
    "point_force",
    "read_labels",
    "read_lineage",
    "relaxed",
    "save_scene",
    "scene_names",
    "sweep",
    "touching",
    "voxel_contact_areas",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message)
    return getattr(import_module(f"{__name__}.{_EXPORTS[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)


def _load_kernels_of_clone() -> None:
    """Load `morphosim.kernels` from beside this folder if the folder is that of a clone.

    An installation has the kernels within the package. Python started at the root of a clone
    imports the clone's folder instead, which has none.
    """
    folder, name = Path(__file__).parent, f"{__name__}.kernels"
    spec = spec_from_file_location(name, folder.parent / "kernels" / "__init__.py")
    installed = (folder / "kernels").is_dir()
    if installed or spec is None or spec.loader is None or not Path(str(spec.origin)).is_file():
        return
    module = module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    globals()["kernels"] = module  # as the import system binds it


_load_kernels_of_clone()
