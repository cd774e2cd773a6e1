"""The viewer's page: one HTML file that shows a run in 3-D, offline."""

import html
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from morphosim import _validate
from morphosim._files import writable, write_text
from morphosim._shown import short_repr
from morphosim.pictures.camera import MOST_PIXELS
from morphosim.pictures.palettes import DIVERGING, hexed, many_colours
from morphosim.pictures.viewerdata import run_data
from morphosim.progress import Tell

if TYPE_CHECKING:
    import xarray as xr

MODULES = (
    "format", "unpack", "colours", "materials", "embryo", "cut", "ids", "labels", "axes",
    "scalebar", "legend", "chart", "card", "cells", "timeline", "picture", "messages", "inputs",
    "main",
)  # fmt: skip
"""The page's JavaScript, each after those that it imports."""
NOTEBOOK_TIMES = 13
NOTEBOOK_TRIANGLES = 300_000
"""Saves and triangles of a page in a notebook, which drops outputs of more than 3 MB."""


@dataclass(frozen=True, slots=True)
class Page:
    """Page that a notebook shows where it stands.

    Attributes
    ----------
    html : str
    height : int, pixels
    """

    html: str
    height: int

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" width="100%" height="{self.height}" '
            'style="border: 0" title="3-D view"></iframe>'
        )


def show(
    run: "xr.Dataset",
    times: int | Iterable[float] | None = NOTEBOOK_TIMES,
    triangles: int | None = None,
    height: int = 560,
    *,
    by: str | None = None,
    cut: str | None = None,
) -> Page:
    """3-D view of a run in a notebook: turn, slide through time, pick cells.

    Parameters
    ----------
    run : Dataset of `open_run`
    times, triangles : see `run_data`
        By default few, for the notebook; None for all times may be more than it takes.
    height : int, pixels, from 200 to 8192
    by, cut : see `run_data`
    """
    height = _validate.integer("height", height, least=200, most=MOST_PIXELS)
    data = run_data(run, times, triangles, NOTEBOOK_TRIANGLES, by=by, cut=cut)
    return Page(viewer_page(data), height)


def save_page(
    run: "xr.Dataset",
    path: str | Path,
    times: int | Iterable[float] | None = None,
    triangles: int | None = None,
    tell: Tell | None = None,
    *,
    by: str | None = None,
    cut: str | None = None,
) -> Path:
    """Write the 3-D view of a run as one HTML file, which needs no network.

    Parameters
    ----------
    run : Dataset of `open_run`
    path : of the file; one that is there is replaced
    times, triangles, tell, by, cut : see `run_data`

    Returns
    -------
    path
    """
    path = writable(path, (".html", ".htm"))
    write_text(path, viewer_page(run_data(run, times, triangles, tell=tell, by=by, cut=cut)))
    return path


def viewer_page(data: dict[str, Any] | None) -> str:
    """HTML of the viewer.

    Parameters
    ----------
    data : as `run_data` makes it; None for a viewer that waits for messages
    """
    title = "" if data is None else str(data["title"])
    return Template(_text("viewer.html")).substitute(
        title=html.escape(f"{title} · MorphoSim" if title else "MorphoSim"),
        css=_text("viewer.css"),
        three=_text("three.min.js"),
        palette=_json({"cells": [*map(hexed, many_colours())], "errors": [*map(hexed, DIVERGING)]}),
        data=_json(data),
        script="\n".join(map(_module, MODULES)),
    )


def _json(value: Any) -> str:
    """JSON that may stand within a <script>."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


@cache
def _text(name: str) -> str:
    return (files("morphosim.pictures") / "viewer" / name).read_text(encoding="utf-8")


def _module(name: str) -> str:
    """JavaScript of one module as a function's body, for all to be one script.

    What it exports becomes an entry of `modules`, from where others import it.
    """
    script = _IMPORT.sub(r"const {\1} = modules.\2;", _text(f"{name}.js"))
    exports = ", ".join(_EXPORT.findall(script))
    return (
        f"modules.{name} = (() => {{\n{_EXPORTED.sub('', script)}\nreturn {{ {exports} }};\n}})();"
    )


_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?:async )?(?:function|class|const) (\w+)", re.MULTILINE)
_EXPORTED = re.compile(r"^export (?=(?:async )?(?:function|class|const) )", re.MULTILINE)
