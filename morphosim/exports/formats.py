"""The formats that runs are exported to.

Another one is a file here with a function `write`, and a row of `FORMATS`; the command line, its
help and the application know it by that. This module imports nothing, since help needs it.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """Where the writer of a format is, and what it takes.

    Attributes
    ----------
    module : of this package; has `write(run, directory, saves, tell) -> list of paths`
    title : what it is, for people
    needs : package that an extra installs, or ""
    extra : that extra
    last_only : whether the default is the last save, not all
    """

    module: str
    title: str
    needs: str = ""
    extra: str = ""
    last_only: bool = False


FORMATS = {
    "vtk": Format(module="paraview", title="ParaView (VTK)", needs="pyvista", extra="vtk"),
    "stl": Format(module="stl", title="surfaces (STL)", last_only=True),
    "ome-tiff": Format(module="ometiff", title="label images (OME-TIFF)"),
    "csv": Format(module="tables", title="tables (CSV)"),
    "tissue": Format(module="tissue", title="figures of a tissue (CSV)"),
}
