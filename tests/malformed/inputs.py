"""Sound files that the readers take; the folder with all of them is made once."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from morphosim import RunWriter, Simulation
from morphosim.scene.file import save_scene, scene_of

H = 0.5
SPHERE = {"kind": "sphere", "center": [0.0, 0.0, 0.0], "radius": 3.0}


def division(**options: Any) -> dict[str, Any]:
    """Table of an event."""
    said = {"kind": "division", "cell": "m", "daughters": ["m1", "m2"], "axis": [1.0, 0.0, 0.0]}
    return said | options


def scene_tables() -> list[dict[str, Any]]:
    """Scenes that together say most of what a file can say."""
    far = SPHERE | {"center": [8.0, 0.0, 0.0]}
    staged = {
        "name": "staged", "description": "two lines\nof text", "duration": 40.0, "save_every": 10.0,
        "save_fields": "packed", "save_labels": False, "on_vanish": "stop",
        "physics": {"gamma": 0.25, "kappa": 0.01, "kappa_by_type": {"x": 0.02}},
        "numerics": {"preset": "fast", "threads": 1, "seed": 7, "dt": 2.0},
        "confinement": {
            "kind": "ellipsoid", "center": [0.0, 0.0, 0.0], "semi_axes": [15.0, 12.0, 12.0],
            "cut": [float("inf"), 10.0, 10.0], "width": 0.0,
        },
        "cells": [
            {"name": "m", "type": "x", "gamma": 0.3, "shape": SPHERE},
            {"name": "b", "type": "y", "parent": "old", "volume": 120.0, "shape": far},
        ],
        "stages": [
            {
                "name": "one", "end": {"kind": "duration", "time": 10.0}, "limit": 20.0,
                "physics": {"sigma": {"default": 0.1, "pairs": [["m1", "b", 0.2]]}},
                "events": [division(fraction=0.55, types=["x", "z"], volumes=[60.0, 50.0])],
            },
            {
                "name": "two", "end": {"kind": "steady", "speed": 1e-3},
                "rules": [{"kind": "differentiation", "of": "x", "touching": "z", "into": "w"}],
                "rules_every": 50.0,
                "events": [
                    {"kind": "removal", "cells": ["m2"], "below": {"z": -50.0}, "isolated": False},
                    {"kind": "cells", "cells": ["m1"], "values": {"gamma": 0.2, "frozen": True}},
                    {"kind": "physics", "values": {"kappa": 0.0, "g": 1.5}},
                ],
            },
        ],
    }  # fmt: skip
    points = {
        "duration": 10.0,
        "physics": {
            "tau": 2.6, "c": 2.0, "M": 8.0, "volume_constraint": "relative", "g_e": 10.0,
            "sigma": {"default": 0.0, "sisters": 0.1, "types": [["x", "y", 0.3]]},
        },
        "numerics": {"threads": 1, "S": 6.0, "spacing": 0.5, "order": 4, "walls": "stepped"},
        "confinement": {"kind": "box", "lower": [-6.0] * 3, "upper": [14.0, 6.0, 6.0]},
        "cells": [
            {
                "name": name, "type": kind, "volume": 100.0,
                "shape": {"kind": "point", "position": [x, 0.0, 0.0]},
            }
            for name, kind, x in (("p", "x", 0.0), ("q", "y", 7.0))
        ],
        "stages": [
            {
                "name": "life", "end": {"kind": "cells", "cells": 3}, "rules_every": 4.0,
                "rules": [
                    {
                        "kind": "proliferation", "volume": 110.0, "age": 5.0, "spread": 0.1,
                        "neighbours": 3, "axis": [1.0, 1.0, 0.0], "share": 0.4,
                        "share_spread": 0.1, "into": {"x": ["x", "y"]}, "probability": 0.5,
                    },
                    {"kind": "apoptosis", "rate": 1e-3, "over": 20.0, "types": ["x"]},
                    {
                        "kind": "growth", "doubling_time": 50.0, "spread": 0.2, "limit": 150.0,
                        "pressure": 0.3, "contact": 0.9, "types": ["x", "y"],
                    },
                    {"kind": "growth", "rate": 0.5, "law": "linear"},
                ],
            },
        ],
    }  # fmt: skip
    bounds = {"lower": [-20.0] * 3, "upper": [20.0] * 3}
    ellipsoid = {"kind": "ellipsoid", "center": [9.0, 0.0, 0.0], "semi_axes": [3.0, 3.5, 4.0]}
    course = {"times": [0.0, 50.0], "volumes": [150.0, 200.0]}
    mask = np.ones((4, 4, 5), int).tolist()
    others = {
        "numerics": {"threads": 1, "scheme": "imex1", "precision": "double", "sweeps": 3},
        "physics": {"sigma": {"matrix": [[0.0, 0.1, 0.0], [0.2, 0.0, 0.0], [0.0, 0.0, 0.0]]}},
        "confinement": {"kind": "function", "function": "tests.malformed.walls:inside"} | bounds,
        "cells": [
            {"name": "e", "volume": course, "shape": ellipsoid},
            {
                "name": "mask",
                "shape": {"kind": "mask", "mask": mask, "origin": [-9.0, 0.0, 0.0], "spacing": 1.0},
            },
            {"name": "s", "frozen": True, "shape": SPHERE},
        ],
    }
    return [staged, points, others]


LABELS = np.zeros((17, 10, 10), np.uint16)
LABELS[2:8, 2:8, 2:8], LABELS[9:15, 2:8, 2:8] = 3, 7
CELL_TABLE = b"label,name,type,parent,volume,gamma,frozen\n3,A,x,P,200,0.3,no\n7,B,y,P,,,true\n"
LINEAGE = (
    b"name,parent,volume_um3,axis_x,axis_y,axis_z,group\n"
    b"m,,500,1,0,0,1\na,m,270,,,,\nb,m,230,0,1,0,2\nb1,b,100,,,,\nb2,b,130,,,,\n"
)
SWEEP = """
scene = "staged.toml"
replicates = 2
samples = 4
sampling = "sobol"
sample_seed = 1
figures = ["volume", "centroid(time)"]

[overrides]
duration = 10.0

[overrides.numerics]
dt = 1.0

[axes]
"physics.gamma" = [0.2, 0.3]
strength = { low = 0.1, high = 1.0, log = true, sets = "physics.g" }
kind = { values = ["a", "b"], sets = { "physics.kappa" = 0.1, "description" = "{value}" } }
"""


def tiff(image: np.ndarray) -> bytes:
    """A TIFF file of an image (z, y, x)."""
    import tifffile

    file = io.BytesIO()
    tifffile.imwrite(file, image, imagej=True, metadata={"axes": "ZYX", "spacing": 0.5})
    return file.getvalue()


def mat_file(**variables: Any) -> bytes:
    """A MAT-file of version 5."""
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, variables, do_compression=False)
    return file.getvalue()


def write_all(folder: Path) -> None:
    """Write a sound file for each reader."""
    import tomli_w
    import xarray as xr

    for table in scene_tables():
        name = table.get("name", table["cells"][0]["name"])
        (folder / f"{name}.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    zyx = np.ascontiguousarray(LABELS.T)
    (folder / "labels.tif").write_bytes(tiff(zyx))
    np.save(folder / "labels.npy", LABELS)
    np.savez_compressed(folder / "labels.npz", labels=LABELS)
    image = xr.DataArray(LABELS, dims=("x", "y", "z"), name="labels")
    axes = {axis: (axis, H * np.arange(n), {"units": "um"}) for axis, n in image.sizes.items()}
    image.assign_coords(axes).to_netcdf(folder / "labels.nc")
    masks = np.empty((2, 1), object)
    masks[0, 0], masks[1, 0] = ((k == LABELS).transpose(1, 0, 2).astype(float) for k in (3, 7))
    (folder / "masks.mat").write_bytes(mat_file(Mask=masks))
    (folder / "names.csv").write_bytes(b",A,B\nA,0,0.5\nB,0.5,0\n")
    (folder / "cells.csv").write_bytes(CELL_TABLE)
    (folder / "lineage.csv").write_bytes(LINEAGE)
    (folder / "sweep.toml").write_text(SWEEP, encoding="utf-8")
    _run(folder)


def _run(folder: Path) -> None:
    """A run of two cells, one of which divides, with three saves."""
    table = scene_tables()[0]
    table["stages"] = [
        {"name": "one", "end": {"kind": "duration", "time": 6.0}, "events": [division()]}
    ]
    scene = scene_of(table | {"duration": 6.0, "save_every": 2.0})
    save_scene(scene, folder / "whole.toml")
    Simulation(scene).run(until=4, observers=[RunWriter.of(scene, folder / "run")])
