"""`ds.morpho`: fields, surfaces, contacts, lineage, trajectories and pictures of a run.

Importing this module makes every xarray Dataset have it; it is meant for those of `open_run`.
"""

import difflib
import html
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.core.indexing import LazilyIndexedArray

from morphosim import _shown, _validate
from morphosim.cell_field import CellField
from morphosim.measure.label_image import labels_within
from morphosim.measure.motion import trajectory
from morphosim.measure.surfaces import SURFACE, Surface, cell_surface
from morphosim.runs import tissue
from morphosim.runs.reader import read_run
from morphosim.runs.saved_fields import (
    SavedBoxes,
    each_field,
    period,
    save_count,
    saved_boxes,
    spacing,
    time_index,
    variable,
)
from morphosim.runs.schema import IN_GROUPS
from morphosim.runs.views import (
    FullFields,
    axes,
    block,
    cell_columns,
    contacts,
    read_labels,
    stored_image,
)

if TYPE_CHECKING:
    import networkx as nx
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from morphosim.pictures.painter import Panel
    from morphosim.pictures.show import Page

Times = float | Sequence[float] | NDArray[np.float64] | xr.DataArray | None
MOST_NEAR_NAMES = 8
PHI = {"units": "1", "long_name": "phase field"}
HELD = {"phi": "fields", "label": "label images", "contact_time": "a list of contacts"}
"""Variables, and what a run with them holds."""
MOTION = {
    "displacement": "distance from the position in the first save",
    "path_length": "length of the path since the first save",
    "mean_speed": "mean speed since the save before, per in silico time",
}


def open_run(path: str | Path) -> xr.Dataset:
    """Open a run, directory or packed file, as one Dataset; the fields are read when used.

    A directory may be opened while its run goes on: it shows the saves there are.

    Raises
    ------
    FileNotFoundError
        There is no run at `path`.
    """
    return read_run(path)


@xr.register_dataset_accessor("morpho")
class MorphoAccessor:
    """What can be computed from a run.

    Wherever there is a `time`, the save nearest to it is taken, and the last for None. A cell that
    is not in the run, or not there at that time, is a ValueError that says what is.

    Examples
    --------
    >>> from morphosim import open_run
    >>> run = open_run("runs/pair")  # doctest: +SKIP
    >>> run.morpho.neighbours("left", time=50)  # doctest: +SKIP
    ['right']
    """

    def __init__(self, run: xr.Dataset) -> None:
        self._run = run

    def __repr__(self) -> str:
        facts = (_shown.cut(fact, _shown.LINE) for fact in self._facts())
        return "\n".join([*facts, f"run.morpho has {', '.join(self._words())}"])

    def _repr_html_(self) -> str:
        first, *rest = (html.escape(_shown.cut(fact, _shown.LINE)) for fact in self._facts())
        words = " ".join(f"<code>.{word}</code>" for word in self._words())
        said = f"<b>{first}</b><br>{'<br>'.join(rest)}<br><code>run.morpho</code> has {words}"
        return said + self._table_of_cells()

    @property
    def table(self) -> xr.Dataset:
        """The run without fields, label images and lists: what has time and cells alone.

        Runs whose fields differ in size can be joined by these, as in `xr.concat([a.morpho.table,
        b.morpho.table], "run")`.
        """
        own = {dim for name in IN_GROUPS if name in self._run for dim in self._run[name].dims}
        return self._run.drop_dims(own - {"axis"})

    def to_dataframe(self) -> "pd.DataFrame":
        """Table with a row for each cell at each save it is in.

        Columns are `time`, `cell`, `parent`, and all that the run has per time and cell; what has
        more axes has a column for each place, such as `centroid_x`.
        """
        import pandas as pd

        parts = [pd.DataFrame(cell_columns(self._run, k)) for k in range(save_count(self._run))]
        return pd.concat(parts, ignore_index=True)

    def phi(self, cell: str, time: float | None = None) -> xr.DataArray:
        """Phase field of a cell in its box: (x, y, z) with coordinates in µm."""
        save = self.save_number(time)
        boxes, box = self._box(cell, save)
        coordinates: dict[str, Any] = dict(axes(boxes.origin[box], boxes.shape[box], self._spacing))
        coordinates |= {"cell": cell, "time": self._time(save)}
        return xr.DataArray(boxes.read(box), coordinates, list("xyz"), "phi", PHI)

    def full(self, time: float | None = None) -> xr.DataArray:
        """Phase fields of all cells on one lattice: (cell, x, y, z), 0 outside of boxes.

        The array is lazy: select before using values, as in `full().sel(cell="E").sel(z=15,
        method="nearest")`, and only boxes of what is selected are read. A cell that is not there
        at that time is 0 everywhere.
        """
        save = self.save_number(time)
        boxes = saved_boxes(self._run, save)
        names = variable(self._run, "cell", "cell").values
        coordinates: dict[str, Any] = dict(axes(boxes.low, boxes.extent, self._spacing))
        coordinates |= {"cell": names, "time": self._time(save)}
        lazy = LazilyIndexedArray(FullFields(boxes, len(names)))
        return xr.DataArray(lazy, coordinates, ["cell", *"xyz"], "phi", PHI)

    def labels(self, time: float | None = None) -> xr.DataArray:
        """Label image: (x, y, z) int32, 0 outside, k + 1 in the k-th cell of `ds.cell`.

        A point belongs to the cell of largest φ, if that exceeds 1/2. The image is the one that
        the run holds, or else is made from the fields.
        """
        save = self.save_number(time)
        image = stored_image(self._run, save)
        labels = self._made_labels(save) if image is None else read_labels(self._run, image)
        low, _ = block(self._run, save)
        coordinates: dict[str, Any] = dict(axes(low, labels.shape, self._spacing))
        coordinates["time"] = self._time(save)
        attrs = {"units": "1", "long_name": "1 + index into cell; 0 where there is no cell"}
        return xr.DataArray(labels, coordinates, list("xyz"), "labels", attrs)

    def surface(self, cell: str, time: float | None = None, level: float = SURFACE) -> Surface:
        """Surface φ = `level` of a cell as a triangle mesh, µm."""
        boxes, box = self._box(cell, self.save_number(time))
        field = CellField(cell, boxes.origin[box], boxes.read(box))
        return cell_surface(field, self._spacing, level)

    def contact_graph(self, time: float | None = None, least_area: float = 0.0) -> "nx.Graph":
        """Which cells touch.

        Parameters
        ----------
        time : float, optional
        least_area : float
            Contacts of a smaller area, in µm², are left out.

        Returns
        -------
        networkx.Graph
            Nodes are the cells that are there, with `type`, `volume` (µm³) and `centroid`
            (3,) (µm); edges have `area` (µm²). The graph has `time`.
        """
        import networkx as nx

        least_area = _validate.number("least_area", least_area, least=0)
        save = self.save_number(time)
        graph = nx.Graph(time=self._time(save))
        columns = [
            variable(self._run, name, "time", "cell", *rest)[save].values
            for name, rest in (("type", ()), ("volume", ()), ("centroid", ("axis",)))
        ]
        for name, kind, volume, centroid in zip(self._names, *columns, strict=True):
            if np.isfinite(volume):
                graph.add_node(name, type=str(kind), volume=float(volume), centroid=centroid)
        for a, b, area in contacts(self._run, save):
            if area >= least_area and a in graph and b in graph:
                graph.add_edge(a, b, area=area)
        return graph

    def neighbours(self, cell: str, time: float | None = None) -> list[str]:
        """Names of the cells that touch a cell, the largest contact first."""
        save = self.save_number(time)
        self._check_there(cell, save)
        pairs = contacts(self._run, save)
        areas = {b if a == cell else a: area for a, b, area in pairs if cell in (a, b)}
        return sorted(areas, key=lambda name: -areas[name])

    def lineage(self) -> "nx.DiGraph":
        """Mothers and daughters.

        Returns
        -------
        networkx.DiGraph
            Edges go from mother to daughter. Nodes have `first` and `last`, the times of the first
            and last save they are in, and `type` at the last. A mother that is in no save has
            NaN and "".
        """
        import networkx as nx

        living, times = self._living, self._run["time"].values
        kinds = variable(self._run, "type", "time", "cell").values
        graph = nx.DiGraph()
        for k, name in enumerate(self._names):
            saves = np.flatnonzero(living[:, k])
            ends = (times[saves[0]], times[saves[-1]]) if saves.size else (np.nan, np.nan)
            kind = str(kinds[saves[-1], k]) if saves.size else ""
            graph.add_node(name, first=float(ends[0]), last=float(ends[1]), type=kind)
        for name, mother in zip(
            self._names, variable(self._run, "parent", "cell").values, strict=True
        ):
            if mother and mother not in graph:
                graph.add_node(str(mother), first=np.nan, last=np.nan, type="")
            if mother:
                graph.add_edge(str(mother), name)
        return graph

    def trajectory(self, cell: str | None = None) -> xr.Dataset:
        """Motion of the centroids, NaN where a cell is not there.

        Parameters
        ----------
        cell : str, optional
            One cell; by default all, along `cell`.

        Returns
        -------
        Dataset
            `position` (time, [cell,] axis) in µm; along (time, [cell]) `displacement`, the distance
            from where the cell was in its first save, and `path_length` since then, both in µm, and
            `mean_speed` since the save before, in µm per *in silico* time.
        """
        position = variable(self._run, "centroid", "time", "cell", "axis")
        if cell is not None:
            position = position.sel(cell=self._names[self._place(cell)])
        moves = trajectory(position.values, self._run["time"].values)
        table = {
            name: (position.dims[:-1], values, {"units": "um", "long_name": text})
            for (name, text), values in zip(MOTION.items(), moves, strict=True)
        }
        return xr.Dataset({"position": position.variable, **table}, position.coords)

    def growth(self) -> xr.Dataset:
        """Growth curve, along `time`.

        Returns
        -------
        Dataset
            `cells`, how many there are; `volume` and `target_volume` of all of them, µm³; and
            `growth_rate`, d ln(volume) / dt per *in silico* time; ln 2 over it is the time in which
            the volume doubles.
        """
        return tissue.growth(self._run)

    def pair_correlation(
        self, time: Times = None, *, bins: int = 50, furthest: float | None = None
    ) -> xr.Dataset:
        """Pair correlation g(r) of the cells' centres.

        The number of pairs of cells at a distance, over what it would be if cells were anywhere
        in the tissue; 1 where they do not know of each other. A tissue ends, so of each shell
        around a cell only that part counts which lies within (Ripley's correction of edges, [1]_).
        The tissue is the convex hull of the centres, its sides moved outwards until it has the
        volume of all cells. Where centres lie in a plane, as those of one layer of cells, g is of
        distances in that plane, and the sides are moved by half the spacing of cells. In a tissue
        that is denser in its middle, g stays above 1 up to about the tissue's size.
        The hull of one that is hollow, bent or in pieces has room without cells, so that g is well
        above 1 for near ones.

        Parameters
        ----------
        time : float, or several, optional
            With several, the result is along `time`.
        bins : int
            At most 10 000.
        furthest : float, optional
            Greatest distance, µm; by default that of five cells, cubes of the mean volume.

        Returns
        -------
        Dataset
            Along `distance`, the middles of the bins in µm, `g` and `pairs`, the number of pairs;
            1/√pairs is about the relative error of g by chance. NaN where there are too few cells
            to span a tissue, fewer than four, and at distances beyond its size.

        References
        ----------
        .. [1] Ripley, "Modelling spatial patterns", J. R. Stat. Soc. B 39, 172-212 (1977).
        """
        return self._at(time, tissue.pair_correlations, bins, furthest)

    def neighbour_distribution(
        self, time: Times = None, *, inner: bool = False, least_area: float = 0.0
    ) -> xr.Dataset:
        """How many cells have how many neighbours, and the mean of that.

        In a packed sheet whose cells meet in threes the mean is 6 (Euler). In space it is 14 for
        Kelvin's cells, 13.7 for random foams of equal cells [1]_ and 2 + 48π²/35 = 15.54 for
        Voronoi cells of random points [2]_.

        Parameters
        ----------
        time : float, or several, optional
            With several, the result is along `time`.
        inner : bool
            Leave out cells at the free surface, which have fewer: those less deep in the tissue
            (see `pair_correlation`) than the size of a cell.
        least_area : float
            Contacts of a smaller area, in µm², are left out.

        Returns
        -------
        Dataset
            Along `neighbours`, from 0 on, `share` of the cells; besides `mean` and `cells`, the
            number of cells that it is of. NaN where there are none.

        References
        ----------
        .. [1] Kraynik, Reinelt & van Swol, "Structure of random monodisperse foam", Phys. Rev. E
           67, 031403 (2003); of soap, Matzke, Am. J. Bot. 33, 58-80 (1946): 13.70.
        .. [2] Meijering, Philips Res. Rep. 8, 270-290 (1953).
        """
        return self._at(time, tissue.neighbour_distribution, inner, least_area)

    def profile(
        self, name: str, time: Times = None, *, against: str = "radius", bins: int = 8
    ) -> xr.Dataset:
        """Profile of a variable of cells, such as "pressure" or "age", through the tissue.

        Parameters
        ----------
        name : str
            A number that the run has per time and cell.
        time : float, or several, optional
            With several, the result is along `time`.
        against : {"radius", "depth"}
            Distance from the centre of the cell's aggregate, `radial_position`; or from the free
            surface of the tissue (see `pair_correlation`).
        bins : int
            Of the same width, from 0 to the greatest distance.

        Returns
        -------
        Dataset
            Along `radius` or `depth`, the middles of the bins in µm: `mean` and `std` of the
            variable over the cells there, NaN where there are none, and `cells`, their number.
        """
        return self._at(time, tissue.profile, name, against, bins)

    def clones(self, time: Times = None, *, since: float | None = None) -> xr.Dataset:
        """Clones: all cells that stem from one.

        Parameters
        ----------
        time : float, or several, optional
            With several, the result is along `time`.
        since : float, optional
            Cells of the save nearest to this time are the ancestors of one clone each; by default
            those of the first save.

        Returns
        -------
        Dataset
            Along `clone`, which has the names of the ancestors, `cells`, their number, `volume` in
            µm³ and `pieces`, in how many groups of cells in contact the clone lies. Along `cell`
            `clone_of`, the ancestor of each cell of the run, or "" where there is none.
        """
        ancestors = 0 if since is None else self.save_number(since)
        return self._at(time, tissue.clones, ancestors)

    def plot(self, time: float | None = None, **options: Any) -> "Figure":
        """Figure of the cells and their contacts, see `morphosim.pictures.plot.plot`."""
        from morphosim.pictures.plot import plot

        return plot(self._run, time, **options)

    def draw(
        self, ax: "Axes", time: float | None = None, view: Any = "z", **options: Any
    ) -> "Panel":
        """Draw the cells in the axes of a figure, see `morphosim.pictures.plot.draw`."""
        from morphosim.pictures.plot import draw

        return draw(ax, self._run, time, view, **options)

    def film(self, path: str | Path, **options: Any) -> None:
        """Film of the cells, see `morphosim.pictures.film.film`."""
        from morphosim.pictures.film import film

        film(self._run, path, **options)

    def show(self, *times: Any, **options: Any) -> "Page":
        """3-D view in a notebook, see `morphosim.pictures.show.show`."""
        from morphosim.pictures.show import show

        return show(self._run, *times, **options)

    def save_number(self, time: float | None = None) -> int:
        """Number of the save nearest to `time`, from 0; the last for None.

        Raises
        ------
        ValueError
            The nearest is further away than half the time between saves there.
        """
        return time_index(self._run, time)

    def _at(self, time: Times, figure: Callable[..., xr.Dataset], *options: Any) -> xr.Dataset:
        """A figure of the tissue at one time, or along several."""
        if time is None or np.ndim(time) == 0:
            one = None if time is None else np.asarray(time).item()
            return figure(self._run, [self.save_number(one)], *options).isel(time=0)
        saves = sorted({self.save_number(each) for each in np.ravel(time).tolist()})
        if not saves:
            message = "time is empty; give at least one, or None for the last"
            raise ValueError(message)
        return figure(self._run, saves, *options)

    def _facts(self) -> list[str]:
        """What the run is, in a few lines; also of a selection, or of another Dataset."""
        run = self._run
        facts = [f"Run of {run.attrs['scene']!r}" if "scene" in run.attrs else "Run"]
        if "time" in run.dims and run.sizes["time"]:
            times = run["time"].values
            facts.append(f"{len(times)} saves, t = {times[0]:g} to {times[-1]:g}")
        if "cell" in run.dims:
            cells = f"{run.sizes['cell']} cells"
            if "volume" in run and run["volume"].dims == ("time", "cell") and run["volume"].size:
                cells += f", {int(self._living[-1].sum())} of them at the end"
            facts.append(cells)
        held = [text for name, text in HELD.items() if name in run.variables]
        facts.append(f"holds {', '.join(['measured variables', *held])}")
        if run.attrs.get("error"):
            facts.append(f"ended by an error: {run.attrs['error']}")
        return facts

    def _table_of_cells(self) -> str:
        """Cells of the last save, for a notebook; "" where the run, or a part of it, has none."""
        run = self._run
        if not {"cell", "volume"} <= set(run.variables) or run["volume"].dims != ("time", "cell"):
            return ""
        volumes = run["volume"].values[-1:].ravel()
        living = np.flatnonzero(np.isfinite(volumes))
        rows = ((str(run["cell"].values[i]), f"{volumes[i]:.4g}") for i in living)
        return _shown.table_of(("cell", "volume, µm³"), rows, len(living))

    def _words(self) -> list[str]:
        return [name for name in dir(type(self)) if not name.startswith("_")]

    @property
    def _spacing(self) -> float:
        return spacing(self._run)

    @property
    def _names(self) -> list[str]:
        return [str(name) for name in variable(self._run, "cell", "cell").values]

    @property
    def _living(self) -> NDArray[np.bool_]:
        """Which cells are there at which save: (time, cell)."""
        return np.asarray(np.isfinite(variable(self._run, "volume", "time", "cell").values))

    def _time(self, save: int) -> float:
        return float(self._run["time"].values[save])

    def _place(self, cell: str) -> int:
        """Place of a cell in `ds.cell`."""
        names = self._names
        if cell in names:
            return names.index(cell)
        near = difflib.get_close_matches(str(cell), names, MOST_NEAR_NAMES, cutoff=0.4)
        shown = ", ".join(map(repr, near or names[:MOST_NEAR_NAMES]))
        message = (
            f"cell = {cell!r} is not in the run; {'near names are' if near else 'it has'} {shown}"
            f" ({len(names)} cells in all: ds.cell)"
        )
        raise ValueError(message)

    def _check_there(self, cell: str, save: int) -> int:
        """Place of a cell that is there at a save; ValueError that says when it is, if not."""
        place = self._place(cell)
        saves = np.flatnonzero(self._living[:, place])
        if save in saves:
            return place
        lives = (
            f"it lives from t = {self._time(saves[0]):g} to t = {self._time(saves[-1]):g}"
            if saves.size
            else "it is in no save"
        )
        message = f"cell = {cell!r} is not there at t = {self._time(save):g}: {lives}"
        raise ValueError(message)

    def _made_labels(self, save: int) -> NDArray[np.int32]:
        """Label image of a save from its fields."""
        boxes, repeats = saved_boxes(self._run, save), period(self._run)
        fields = each_field(self._run, save)
        labels = labels_within(fields, *block(self._run, save), period=repeats)
        return np.asarray(np.append(0, boxes.cell + 1).astype(np.int32)[labels])

    def _box(self, cell: str, save: int) -> tuple[SavedBoxes, int]:
        """Boxes of a save, and which of them is a cell's."""
        boxes = saved_boxes(self._run, save)
        return boxes, int(np.flatnonzero(boxes.cell == self._check_there(cell, save))[0])
