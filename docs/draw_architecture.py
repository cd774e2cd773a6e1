"""Draws the folders of the package and who imports whom, and lists them in architecture.md.

Run as `python docs/draw_architecture.py` (`pip install '.[figures]'`). Folders are those of the
layers in `pyproject.toml`, arrows are the imports that stand in the code, type-checking ones too.
An arrow that a longer way implies is left out; so are those to the modules that serve all.
"""

import argparse
import ast
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from textwrap import fill
from typing import Any

import networkx as nx
import numpy as np
from scipy.optimize import isotonic_regression

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
PACKAGE = "morphosim"
PLACES = {PACKAGE: ROOT / PACKAGE, f"{PACKAGE}.kernels": ROOT / "kernels"}
BEGIN, END = "<!-- folders -->\n", "<!-- end of folders -->\n"
BOX, GAP, ROW = (1.9, 0.62), 0.35, 1.15
"""Width and height of a box, least space between two, and distance of rows."""
SCALE = 0.85
"""Inches of a unit."""
LETTERS = 9.5
"""Letters of the bar per unit."""
SWEEPS = 8
"""Times that the order of the rows is improved."""


@dataclass(frozen=True)
class Module:
    """One file of the package."""

    name: str
    path: Path
    tree: ast.Module
    lines: int

    @property
    def part(self) -> str:
        """The folder, or the module at the top, that it belongs to; "" for the package itself."""
        return self.name.split(".")[1] if "." in self.name else ""

    @property
    def says(self) -> str:
        """First line of its docstring."""
        return (ast.get_docstring(self.tree) or "").partition("\n")[0]

    def imports(self, known: Iterable[str]) -> Iterator[str]:
        """Names of all that it imports of the package."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    name = f"{node.module}.{alias.name}"
                    yield name if name in known else node.module


def modules() -> dict[str, Module]:
    """All files of the package, by the name under which they are imported."""
    found = {}
    for package, folder in PLACES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = [package, *path.relative_to(folder).with_suffix("").parts]
            name = ".".join(part for part in parts if part != "__init__")
            text = path.read_text(encoding="utf-8")
            found[name] = Module(name, path, ast.parse(text), len(text.splitlines()))
    return found


def layers() -> list[list[str]]:
    """The layers of the import contract, from the top."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    found = next(c["layers"] for c in contracts if c["type"] == "layers")
    return [[name.strip() for name in layer.split("|")] for layer in found]


def is_folder(part: str) -> bool:
    """Whether this is a folder, not a module at the top."""
    return (PLACES.get(f"{PACKAGE}.{part}", ROOT / PACKAGE / part)).is_dir()


def arrows(known: Mapping[str, Module]) -> nx.DiGraph:
    """Who imports whom, of the folders and of the modules at the top that import folders."""
    graph = nx.DiGraph(
        (module.part, name.split(".")[1])
        for module in known.values() if module.part
        for name in module.imports(known) if name.startswith(f"{PACKAGE}.")
    )  # fmt: skip
    graph.remove_edges_from(list(nx.selfloop_edges(graph)))
    graph.remove_nodes_from(serving_all(known))
    return nx.transitive_reduction(graph)


def serving_all(known: Mapping[str, Module]) -> list[str]:
    """Modules at the top that import no folder."""
    return [
        part for layer in layers() for part in layer
        if not is_folder(part) and not any(
            is_folder(name.split(".")[1])
            for name in known[f"{PACKAGE}.{part}"].imports(known) if name.startswith(f"{PACKAGE}.")
        )
    ]  # fmt: skip


# --- the picture -------------------------------------------------------------------------------


def heights(graph: nx.DiGraph) -> dict[str, int]:
    """Row of each folder, from the bottom: one more than that of the highest it imports.

    One that imports none lies right below those that import it.
    """
    result: dict[str, int] = {}
    for part in reversed(list(nx.topological_sort(graph))):
        result[part] = 1 + max((result[below] for below in graph[part]), default=-1)
    for part in (part for part in graph if not graph[part]):
        result[part] = min((result[above] for above in graph.predecessors(part)), default=1) - 1
    return result


def with_bends(graph: nx.DiGraph, height: dict[str, int]) -> tuple[nx.DiGraph, dict[str, int]]:
    """The graph with a bend, a node of its own, wherever an arrow passes a row; rows of all."""
    bent, rows = nx.DiGraph(), dict(height)
    bent.add_nodes_from(graph)
    for above, below in sorted(graph.edges):
        way = [above]
        for row in range(height[above] - 1, height[below], -1):
            bend = f"{above} > {below} > {row}"
            rows[bend] = row
            way.append(bend)
        nx.add_path(bent, [*way, below])
    return bent, rows


def crossings(upper: list[str], lower: list[str], graph: nx.DiGraph) -> int:
    """How many arrows cross between two neighbouring rows."""
    place = {name: k for k, name in enumerate(lower)}
    ends = [(k, place[b]) for k, a in enumerate(upper) for b in graph[a] if b in place]
    return sum((a - c) * (b - d) < 0 for i, (a, b) in enumerate(ends) for c, d in ends[:i])


def ordered(graph: nx.DiGraph, rows: dict[str, int]) -> list[list[str]]:
    """Rows from the bottom, ordered by swaps so that few arrows cross."""
    table = [sorted(n for n in rows if rows[n] == k) for k in range(max(rows.values()) + 1)]
    for sweep in range(SWEEPS):
        for k in range(len(table)) if sweep % 2 else reversed(range(len(table))):
            for i, j in combinations(range(len(table[k])), 2):
                swapped = table[k].copy()
                swapped[i], swapped[j] = swapped[j], swapped[i]
                if _crossed(swapped, table, k, graph) < _crossed(table[k], table, k, graph):
                    table[k] = swapped
    return table


def _crossed(row: list[str], table: list[list[str]], k: int, graph: nx.DiGraph) -> int:
    above = crossings(table[k + 1], row, graph) if k + 1 < len(table) else 0
    return above + (crossings(row, table[k - 1], graph) if k else 0)


def positions(graph: nx.DiGraph, table: list[list[str]]) -> dict[str, tuple[float, float]]:
    """Where each node lies: rows in their order, every node near the middle of its neighbours."""
    x = {name: float(np.sum(spans(row)[:k])) for row in table for k, name in enumerate(row)}
    for sweep in range(50):
        for row in table if sweep % 2 else reversed(table):
            wanted = [np.mean([x[n] for n in nx.all_neighbors(graph, name)]) for name in row]
            least = np.cumsum([0, *spans(row)[:-1]])
            found = isotonic_regression(np.array(wanted) - least).x + least
            x |= dict(zip(row, found.tolist(), strict=True))
    return {name: (x[name], ROW * k) for k, row in enumerate(table) for name in row}


def spans(row: list[str]) -> list[float]:
    """Least distance of each node of a row from the next."""
    widths = [0.1 if ">" in name else BOX[0] for name in row]
    return [GAP + (a + b) / 2 for a, b in zip(widths, [*widths[1:], 0], strict=True)]


def ports(graph: nx.DiGraph, place: Mapping[str, tuple[float, float]]) -> dict[tuple, float]:
    """Where along a box arrows begin ((node, next), "from") and end ((node, next), "to")."""
    found: dict[tuple, float] = {}
    for node in graph:
        for side, edges in (("from", graph.out_edges(node)), ("to", graph.in_edges(node))):
            other = 1 if side == "from" else 0
            by_place = sorted(edges, key=lambda edge: place[edge[other]][0])
            room = 0.0 if ">" in node else 0.3 * BOX[0]
            for k, edge in enumerate(by_place, 1):
                share = 2 * k / (len(by_place) + 1) - 1
                found[edge, side] = place[node][0] + room * share
    return found


def draw(known: Mapping[str, Module], path: Path) -> None:
    """Draw boxes and arrows, and write the picture."""
    from matplotlib import pyplot as plt

    plt.rcParams |= {"font.family": "DejaVu Sans", "svg.hashsalt": PACKAGE}
    graph = arrows(known)
    bent, rows = with_bends(graph, heights(graph))
    place = positions(bent, ordered(bent, rows))
    port = ports(bent, place)
    low, high = (f(at for at, _ in place.values()) for f in (min, max))
    low, high = low - BOX[0] / 2, high + BOX[0] / 2
    bottom, top = -ROW - BOX[1], ROW * max(rows.values()) + BOX[1]
    figure, axes = plt.subplots(figsize=(SCALE * (high - low), SCALE * (top - bottom)))
    for edge in bent.edges:
        draw_arrow(axes, edge, port, place)
    for name in graph:
        draw_box(axes, name, place[name], known)
    draw_bar(axes, serving_all(known), low, high)
    axes.set(xlim=(low - 0.1, high + 0.1), ylim=(bottom, top), aspect="equal")
    axes.axis("off")
    figure.savefig(
        path,
        bbox_inches="tight",
        dpi=150,
        metadata={"Date": None} if path.suffix == ".svg" else None,
    )


def draw_box(axes: Any, name: str, at: tuple[float, float], known: Mapping[str, Module]) -> None:
    """A folder, with how much is in it."""
    from matplotlib.patches import FancyBboxPatch

    files = [module for module in known.values() if module.part == name]
    size = f"{len(files)} file{'s' * (len(files) > 1)}, {sum(m.lines for m in files)} lines"
    corner = at[0] - BOX[0] / 2, at[1] - BOX[1] / 2
    look = {"boxstyle": "round,pad=0,rounding_size=0.08", "fc": "#eef3f8", "ec": "#3b5b7a"}
    axes.add_patch(FancyBboxPatch(corner, *BOX, zorder=2, **look))
    text = {"ha": "center", "va": "center", "zorder": 3}
    axes.text(at[0], at[1] + 0.11, name, fontsize=11, weight="bold", color="#1d3347", **text)
    axes.text(at[0], at[1] - 0.17, size, fontsize=7.5, color="#4a5a68", **text)


def draw_arrow(axes: Any, edge: tuple, port: Mapping, place: Mapping) -> None:
    """An arrow, or the part of one between two rows; upright where it passes a row."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path as Way

    (above, below), half = edge, BOX[1] / 2
    start, end = port[edge, "from"], port[edge, "to"]
    top, bottom = place[above][1] - half, place[below][1] + half
    middle = (top + bottom) / 2
    points = [(start, top), (start, middle), (end, middle), (end, bottom)]
    codes = [Way.MOVETO, Way.CURVE4, Way.CURVE4, Way.CURVE4]
    if ">" in below:
        points, codes = [*points, (end, bottom - 2 * half)], [*codes, Way.LINETO]
    style = "-" if ">" in below else "-|>,head_width=2.5,head_length=5"
    look = {"color": "#7a8894", "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0, "zorder": 1}
    axes.add_patch(FancyArrowPatch(path=Way(points, codes), arrowstyle=style, **look))


def draw_bar(axes: Any, names: list[str], low: float, high: float) -> None:
    """The modules at the top that serve all, below everything."""
    from matplotlib.patches import FancyBboxPatch

    look = {"boxstyle": "round,pad=0,rounding_size=0.08", "fc": "#f6f6f3", "ec": "#9a9a90"}
    corner = low, -ROW - BOX[1] / 2
    axes.add_patch(FancyBboxPatch(corner, high - low, BOX[1], linestyle="--", **look))
    says = fill(f"serve all: {', '.join(names)}", width=int(LETTERS * (high - low)))
    axes.text((low + high) / 2, -ROW, says, fontsize=9, ha="center", va="center", color="#55554c")


# --- the list ----------------------------------------------------------------------------------


def folder_table(known: Mapping[str, Module]) -> str:
    """Every folder, and the modules at the top, with the first line of their docstrings."""
    lines = ["| folder | holds |", "|---|---|"]
    for part in (part for layer in layers() for part in layer):
        for name, module in sorted(known.items()):
            if module.part == part and (module.path.name == "__init__.py" or not is_folder(part)):
                label = name.removeprefix(f"{PACKAGE}.").replace(".", "/")
                label += "/" if module.path.name == "__init__.py" else ".py"
                lines.append(f"| `{label}` | {module.says} |")
    return "".join(f"{line}\n" for line in lines)


def with_table(page: str, table: str) -> str:
    """The page with this table between its marks."""
    before, found, rest = page.partition(BEGIN)
    _, ended, after = rest.partition(END)
    if not found or not ended:
        message = (
            f"{PAGE} has no lines {BEGIN.strip()} and {END.strip()}; put them around the table"
        )
        raise ValueError(message)
    return before + BEGIN + table + END + after


def main() -> None:
    """Draw the picture and bring the table up to date."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=PICTURE, help="picture to write")
    output = parser.parse_args().output
    known = modules()
    draw(known, output)
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_table(page, folder_table(known)), encoding="utf-8")


if __name__ == "__main__":
    main()
