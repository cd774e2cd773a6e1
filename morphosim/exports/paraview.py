"""Surfaces and label images as VTK files that ParaView opens as time series.

`cells.pvd` lists one multi-block file per save, `cells/0000.vtm`, whose blocks are the cells of
the run in order, each with its name; a cell that is not there at that time is an empty block.
`labels.pvd` lists the label images, `labels/0000.vti`. Times are *in silico* time, lengths µm.
"""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import xarray as xr

from morphosim.accessor import MorphoAccessor
from morphosim.cell_field import CellField
from morphosim.errors import warn
from morphosim.measure.label_image import check_size
from morphosim.measure.surfaces import cell_surface
from morphosim.progress import Tell
from morphosim.runs.saved_fields import each_field, spacing, variable
from morphosim.runs.views import block

PER_TRIANGLE = ("volume", "surface_area")
"""Values of a cell that every triangle of its surface has, where the run has them."""


def write(run: xr.Dataset, directory: Path, saves: Sequence[int], tell: Tell) -> list[Path]:
    """Write surfaces and label images; one save is in memory at a time.

    Warns
    -----
    UserWarning
        A label image would be too large; there are none then.
    """
    times = {save: float(run["time"].values[save]) for save in saves}
    types, with_labels = _types(run), _labels_fit(run, saves)
    series: dict[str, list[Path]] = {"cells": [], "labels": []}
    paths: list[Path] = []
    for done, save in enumerate(saves, 1):
        paths += _write_cells(run, directory / "cells", save, types)
        series["cells"].append(paths[-1])
        if with_labels:
            paths.append(_write_labels(run, directory / "labels", save))
            series["labels"].append(paths[-1])
        tell(done, len(saves))
    for name, files in series.items():
        if files:
            paths.append(directory / f"{name}.pvd")
            _write_collection(paths[-1], dict(zip(times.values(), files, strict=True)))
    return paths


def _labels_fit(run: xr.Dataset, saves: Sequence[int]) -> bool:
    shapes = [block(run, save)[1] for save in saves]
    try:
        check_size(max(shapes, key=lambda shape: np.prod(shape, dtype=float)), "choose other times")
    except ValueError as error:
        warn(f"labels.pvd is not written: {error}")
        return False
    return True


def _types(run: xr.Dataset) -> list[str]:
    """All types of the run, sorted."""
    living = np.isfinite(variable(run, "volume", "time", "cell").values)
    return sorted({str(kind) for kind in variable(run, "type", "time", "cell").values[living]})


def _write_cells(run: xr.Dataset, folder: Path, save: int, types: Sequence[str]) -> list[Path]:
    """Write the surfaces of one save, and last the file that lists them."""
    blocks = folder / f"{save:04d}"
    blocks.mkdir(parents=True, exist_ok=True)
    places = {str(name): k for k, name in enumerate(run["cell"].values)}
    kinds = variable(run, "type", "time", "cell")[save].values
    known = [name for name in PER_TRIANGLE if name in run]
    rows = {name: variable(run, name, "time", "cell")[save].values for name in known}
    files: dict[str, Path] = {}
    for field in each_field(run, save):
        k = places[field.name]
        kind = str(kinds[k])
        values = {"label": np.int32(k + 1), "type": np.int32(types.index(kind))}
        values |= {name: row[k] for name, row in rows.items()}
        files[field.name] = blocks / f"{k}.vtp"
        mesh = _mesh(field, spacing(run), values, {"name": [field.name], "type": [kind]})
        _save(mesh, files[field.name], "vtkXMLPolyDataWriter")
    listing = folder / f"{save:04d}.vtm"
    _write_blocks(listing, {name: files.get(name) for name in places})
    return [*files.values(), listing]


def _mesh(
    field: CellField, spacing: float, values: Mapping[str, Any], texts: Mapping[str, Sequence[str]]
) -> Any:
    """PyVista mesh of a cell's surface with these values on every triangle."""
    pv = import_module("pyvista")
    surface = cell_surface(field, spacing)
    if len(surface.faces):
        mesh = pv.PolyData.from_regular_faces(surface.vertices.astype(np.float32), surface.faces)
    else:
        mesh = pv.PolyData()
    for name, value in values.items():
        mesh.cell_data[name] = np.full(mesh.n_cells, value)
    _add_texts(mesh, texts)
    return mesh


def _write_labels(run: xr.Dataset, folder: Path, save: int) -> Path:
    """Write the label image of one save, with the names of all cells of the run."""
    pv = import_module("pyvista")
    labels = MorphoAccessor(run).labels(float(run["time"].values[save])).values
    step = spacing(run)
    image = pv.ImageData(
        dimensions=labels.shape, spacing=(step,) * 3, origin=block(run, save)[0] * step
    )
    image.point_data["label"] = labels.ravel(order="F")
    _add_texts(image, {"name": [str(name) for name in run["cell"].values]})
    folder.mkdir(exist_ok=True)
    path = folder / f"{save:04d}.vti"
    _save(image, path, "vtkXMLImageDataWriter")
    return path


def _save(data: Any, path: Path, kind: str) -> None:
    """Write a file of VTK's by way of memory: on a full disk its writers crash the process."""
    writer = getattr(import_module("vtkmodules.vtkIOXML"), kind)()
    writer.SetInputDataObject(data)
    writer.WriteToOutputStringOn()
    writer.Write()
    path.write_text(writer.GetOutputString(), encoding="utf-8")


def _add_texts(data: Any, texts: Mapping[str, Sequence[str]]) -> None:
    """Add texts as field data; PyVista itself takes ASCII only, VTK takes all."""
    core = import_module("vtkmodules.vtkCommonCore")
    for name, values in texts.items():
        array = core.vtkStringArray()
        array.SetName(name)
        for value in values:
            array.InsertNextValue(value)
        data.GetFieldData().AddArray(array)


def _write_blocks(path: Path, blocks: Mapping[str, Path | None]) -> None:
    """Write a multi-block file (.vtm) that lists the files of its blocks; None is an empty one."""
    root = ElementTree.Element("VTKFile", type="vtkMultiBlockDataSet", version="1.0")
    listing = ElementTree.SubElement(root, "vtkMultiBlockDataSet")
    for k, (name, file) in enumerate(blocks.items()):
        entry = ElementTree.SubElement(listing, "DataSet", index=str(k), name=name)
        if file is not None:
            entry.set("file", file.relative_to(path.parent).as_posix())
    ElementTree.ElementTree(root).write(path, "utf-8", xml_declaration=True)


def _write_collection(path: Path, files: Mapping[float, Path]) -> None:
    """Write a ParaView collection (.pvd) that lists one file per time."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    listing = ElementTree.SubElement(root, "Collection")
    for time, file in files.items():
        name = file.relative_to(path.parent).as_posix()
        ElementTree.SubElement(listing, "DataSet", timestep=repr(time), part="0", file=name)
    ElementTree.ElementTree(root).write(path, "utf-8", xml_declaration=True)
