"""Surfaces of cells as binary STL files, in µm: `t_TIME/CELL.stl`."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from morphosim.measure.surfaces import Surface, cell_surface
from morphosim.progress import Tell
from morphosim.runs.saved_fields import each_field, spacing

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = b"MorphoSim surface, um"
HEADER_BYTES = 80


def write(run: xr.Dataset, directory: Path, saves: Sequence[int], tell: Tell) -> list[Path]:
    """Write one file per cell and save; a cell without a surface has none."""
    names = [str(name) for name in run["cell"].values]
    files = dict(zip(names, file_names(names), strict=True))
    paths = []
    for done, save in enumerate(saves, 1):
        folder = directory / f"t_{float(run['time'].values[save]):.12g}"
        for field in each_field(run, save):
            surface = cell_surface(field, spacing(run))
            if len(surface.faces):
                folder.mkdir(exist_ok=True)
                paths.append(folder / f"{files[field.name]}.stl")
                paths[-1].write_bytes(stl_bytes(surface))
        tell(done, len(saves))
    return paths


def stl_bytes(surface: Surface) -> bytes:
    """Binary STL file of a surface; normals point outward."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.zeros(len(corners), TRIANGLE)
    triangles["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    triangles["corners"] = corners
    count = np.array(len(corners), "<u4")
    return HEADER.ljust(HEADER_BYTES) + count.tobytes() + triangles.tobytes()


def file_names(names: Iterable[str]) -> list[str]:
    """File names without extension that every system takes, all different also without case."""
    taken: set[str] = set()
    result = []
    for name in names:
        safe = re.sub(r"[^\w.+-]", "_", name).strip(".") or "_"
        choice, number = safe, 1
        while choice.casefold() in taken:
            number += 1
            choice = f"{safe}-{number}"
        taken.add(choice.casefold())
        result.append(choice)
    return result
