"""Fig. 5: the lineage of C. elegans to 102 cells, and sections of the embryo on the way.

Run as `python examples/embryo_102.py RUN PICTURE` on a run of `celegans-1-to-102`
(`morphosim run celegans-1-to-102 -o RUN`, half a minute); needs matplotlib.
"""

import sys

import matplotlib.pyplot as plt
import networkx as nx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from xarray import Dataset

from morphosim import Lineage, open_run, read_lineage

FOUNDERS = {
    "P0": "#bbbbbb", "AB": "#4477aa", "MS": "#ee6677", "E": "#228833", "C": "#ccbb44",
    "D": "#66ccee", "P4": "#aa3377",
}  # fmt: skip
STAGES = ("4-cell", "8-cell", "24-cell", "51-cell", "102-cell")
MIDDLE = 15.0  # z of the section, µm


def founder(lineage: Lineage, name: str) -> str:
    """Founder cell, or P0 for the cells before the founders."""
    found = lineage.founder(name)
    return found if found in FOUNDERS else "P0"


def draw_tree(axes: Axes, run: Dataset, lineage: Lineage) -> None:
    """Lines down in time for cells, across for divisions."""
    tree = run.morpho.lineage()
    (root,) = [name for name, degree in tree.in_degree() if degree == 0]
    order = nx.dfs_postorder_nodes(tree, root)
    place: dict[str, float] = {}
    for name in order:
        below = [place[child] for child in tree.successors(name)]
        leaves = sum(1 for n in place if tree.out_degree(n) == 0)
        place[name] = float(np.mean(below)) if below else float(leaves)
    end = {name: tree.nodes[name]["last"] for name in tree}
    lines, colors = [], []
    for name in tree:
        (mother,) = list(tree.predecessors(name)) or [None]
        top = end[mother] if mother else 0.0
        lines.append([(place[name], top), (place[name], end[name])])
        colors.append(FOUNDERS[founder(lineage, name)])
        if mother:
            lines.append([(place[mother], top), (place[name], top)])
            colors.append(colors[-1])
    axes.add_collection(LineCollection(lines, colors=colors, linewidths=1.2))
    axes.set(xlim=(-2, 103), ylim=(max(end.values()) * 1.02, 0), ylabel="in silico time", xticks=[])
    for name, color in FOUNDERS.items():
        axes.plot([], [], color=color, lw=3, label="before" if name == "P0" else name)
    axes.legend(ncols=7, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=9)


def draw_section(axes: Axes, run: Dataset, lineage: Lineage, stage: str) -> None:
    """Cells in the middle plane at the end of a stage, coloured by founder."""
    time = float(run["time"].values[np.flatnonzero(run["stage"].values == stage)[-1]])
    labels = run.morpho.labels(time).sel(z=MIDDLE, method="nearest")
    names = list(FOUNDERS)
    kinds = [0] + [1 + names.index(founder(lineage, str(n))) for n in run["cell"].values]
    image = np.array(kinds)[labels.values]
    extent = [float(v) for v in (labels.x[0], labels.x[-1], labels.y[0], labels.y[-1])]
    colors = ListedColormap(["white", *FOUNDERS.values()])
    axes.imshow(image.T, origin="lower", extent=extent, cmap=colors, vmin=0, vmax=len(names))
    axes.contour(
        labels.x, labels.y, labels.values.T, levels=np.unique(labels.values) + 0.5,
        colors="white", linewidths=0.6,
    )  # fmt: skip
    axes.set(xlim=(0, 60), ylim=(0, 40), xticks=[], yticks=[], aspect="equal", title=stage)


def main(directory: str, picture: str) -> None:
    """Draw the run."""
    run, lineage = open_run(directory), read_lineage()
    figure = plt.figure(figsize=(12, 7), layout="constrained")
    rows = figure.add_gridspec(2, len(STAGES), height_ratios=(2.2, 1))
    draw_tree(figure.add_subplot(rows[0, :]), run, lineage)
    for k, stage in enumerate(STAGES):
        draw_section(figure.add_subplot(rows[1, k]), run, lineage, stage)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:3])
