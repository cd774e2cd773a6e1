"""Confinements: what φ_e is (Eq. 3). φ_e is 0 inside and 1 outside; None means open space.

Another one is a file here and a row of `CONFINEMENTS`; scene files, errors, fingerprints and
pictures know it by that.
"""

from types import NoneType

from morphosim.geometry.confinement.box import BoxWalls
from morphosim.geometry.confinement.ellipsoid import EllipsoidShell
from morphosim.geometry.confinement.function import FunctionWalls
from morphosim.geometry.confinement.mask import MaskWalls
from morphosim.geometry.confinement.protocol import Confinement

CONFINEMENTS: dict[str, type] = {
    "ellipsoid": EllipsoidShell,
    "box": BoxWalls,
    "mask": MaskWalls,
    "function": FunctionWalls,
    "none": NoneType,  # open space
}
"""Classes by the `kind` that a scene file names them by."""

__all__ = [
    "CONFINEMENTS",
    "BoxWalls",
    "Confinement",
    "EllipsoidShell",
    "FunctionWalls",
    "MaskWalls",
]
