"""The synNotch scenes over time: figures of their aggregates, and Fig. 6 of the paper.

Run as `python examples/synnotch.py RUNS`, a directory that holds the runs `asymmetric-3`,
`asymmetric-2`, `symmetric`, `repair` and `dissociation`; those that are missing are simulated
(about half an hour each). Writes RUNS/synnotch_figures.png and RUNS/synnotch.png.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import xarray as xr

from morphosim import ProgressBar, RunWriter, Simulation, built_in_scene, open_run

COLOURS = {"R": "#d55e00", "G": "#009e73", "B": "#0072b2"}
ROWS = ("asymmetric-3", "asymmetric-2", "symmetric", "repair", "dissociation")
TIMES = range(0, 50001, 10000)
BOX = built_in_scene("synnotch-symmetric").confinement.bounds()
VIEW = (1.0, 0.35, 0.45)


def simulate(runs: Path, name: str) -> None:
    """Run a scene; repair and dissociation start from the end of `symmetric`."""
    scene = built_in_scene(f"synnotch-{name}")
    if name in ("repair", "dissociation"):
        simulation = Simulation.from_run(runs / "symmetric", scene=scene.from_stage(name))
    else:
        simulation = Simulation(scene)
    writer = RunWriter(runs / name, scene.save_every)
    simulation.run(observers=[writer, ProgressBar()])


def by_type(run: xr.Dataset, name: str, kind: str) -> xr.DataArray:
    """Mean of a variable over the cells of a type in the largest aggregate."""
    chosen = (run["type"] == kind) & (run["aggregate"] == 0)
    return run[name].where(chosen).mean("cell")


def types_of(run: xr.Dataset) -> list[str]:
    """Types of the run's cells that are known by a colour."""
    return [kind for kind in COLOURS if (run["type"] == kind).any()]


def draw_figures(runs: dict[str, xr.Dataset], path: Path) -> None:
    """One row of panels per scene: sorting, place of the types, exposure, aggregates, roundness."""
    figure, axes = plt.subplots(len(runs), 5, figsize=(15, 2.5 * len(runs)), sharex=True)
    for row, (name, run) in zip(axes, runs.items(), strict=True):
        time = run["time"] / 1000
        row[0].plot(time, run["sorting_index"], color="black")
        row[0].set_ylim(0.4, 1)
        for kind in types_of(run):
            style = {"color": COLOURS[kind], "label": kind}
            row[1].plot(time, by_type(run, "radial_position", kind), **style)
            row[2].plot(time, by_type(run, "exposed_fraction", kind), **style)
        row[1].legend(frameon=False, ncols=3, loc="upper right")
        row[1].set_ylim(0, 36)
        row[2].set_ylim(0, 1)
        row[3].plot(time, run["n_aggregates"], color="black", label="aggregates")
        row[3].plot(time, run["single_cells"], color="0.5", ls="--", label="single cells")
        row[4].plot(time, run["roundness"], color="black", label="roundness")
        row[4].plot(time, run["aggregate_sphericity"], color="0.5", ls="--", label="sphericity")
        row[4].set_ylim(0, 1)
        row[0].set_ylabel(name)
        for ax in row:
            ax.spines[["top", "right"]].set_visible(False)
    axes[0, 3].legend(frameon=False)
    axes[0, 4].legend(frameon=False, loc="lower right")
    titles = (
        "like contacts / contacts", "distance from the centre, µm", "exposed share of the surface",
        "number", "largest aggregate",
    )  # fmt: skip
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=10)
    for ax in axes[-1]:
        ax.set_xlabel("time / 1000")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def draw_cells(runs: dict[str, xr.Dataset], path: Path) -> None:
    """Rows of scenes, columns of times: the cells in their box (Fig. 6)."""
    figure = plt.figure(figsize=(15, 2.5 * len(runs) + 0.3))
    grid = figure.add_gridspec(
        len(runs), len(TIMES), left=0.03, right=1, bottom=0, top=0.97, wspace=0, hspace=0
    )
    for row, (name, run) in enumerate(runs.items()):
        for column, time in enumerate(TIMES):
            ax = figure.add_subplot(grid[row, column])
            cut = name == "repair" and time == 0  # the first save is that before the cut
            run.morpho.draw(
                ax, 500 if cut else time, VIEW, by="type", colours=COLOURS, names=False,
                bounds=BOX, scale_bar=row == column == 0, axes=False, foot=0.0,
            )  # fmt: skip
            if row == 0:
                ax.set_title(f"{time:,}".replace(",", "\u2009"), fontsize=11)
        middle = (ax.get_position().y0 + ax.get_position().y1) / 2
        figure.text(0.015, middle, name, rotation=90, va="center", ha="center", fontsize=11)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Simulate what is missing and draw."""
    folder = Path(sys.argv[1])
    for name in ROWS:
        if not (folder / name).exists():
            simulate(folder, name)
    runs = {name: open_run(folder / name) for name in ROWS}
    draw_figures(runs, folder / "synnotch_figures.png")
    draw_cells(runs, folder / "synnotch.png")


if __name__ == "__main__":
    main()
