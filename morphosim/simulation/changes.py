"""What may change a simulation between two steps: divisions, removals, other parameters."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _shown, _validate
from morphosim.cell_field import CellField
from morphosim.cell_table import CellTable
from morphosim.engine.engine import Engine, check_columns
from morphosim.errors import warn
from morphosim.geometry.phase_field import least_volume
from morphosim.physics.parameters import Physics
from morphosim.physics.term import Conditions
from morphosim.scene import stability
from morphosim.scene.cell import CHANGEABLE, VolumeFunction, check_values, volume_at
from morphosim.scene.scene import Scene
from morphosim.scene.stability import StabilityWarning
from morphosim.scene.tables import physics_table
from morphosim.simulation import growth, lineage_names
from morphosim.simulation.division import divided
from morphosim.simulation.volumes import VolumeFunctions

Rows = NDArray[np.int64]
GONE = 0.05
"""A cell that dies is taken out when its target is this share of what it was."""


class Changes:
    """The changes that events make; a part of `Simulation`.

    A change costs what the cells that it touches cost: the others keep their history.

    Attributes
    ----------
    scene : Scene
    engine : Engine
    removed : list of (time, name)
        Cells that were taken out.
    events : list of (time, text)
        What has changed the simulation.
    since_rules, rule
        See `scene.target.Target`.
    """

    scene: Scene
    engine: Engine
    removed: list[tuple[float, str]]
    events: list[tuple[float, str]]
    since_rules: float = 0.0
    rule: int = 0
    _volumes: VolumeFunctions
    _used: set[str]
    """Names that cells have or have had, but those that number a founder's descendants."""

    @property
    def time(self) -> float:
        """*In silico* time."""
        return self.engine.time

    @property
    def physics(self) -> Physics:
        """The physics that hold now: those of the scene, as events have changed them."""
        return self.engine.physics

    def divide(
        self,
        cell: str,
        daughters: tuple[str, str],
        *,
        axis: ArrayLike,
        fraction: float = 0.5,
        types: tuple[str, str] | None = None,
        volumes: tuple[float | VolumeFunction, float | VolumeFunction] | None = None,
    ) -> None:
        """Divide a cell in its box; the daughters' next step is of first order.

        All after the daughters is given by keyword: `divide("P0", ("AB", "P1"), axis=(-1, 0, 0))`.

        Parameters
        ----------
        cell : str
        daughters : names of the daughters
        axis : (3,) from the second daughter to the first
        fraction : float
            Share of ∫ φ that the first daughter gets.
        types : optional
            By default the mother's.
        volumes : optional
            Target volumes in µm³, or functions of time; by default shares of what the mother's
            is now.

        Raises
        ------
        ValueError
            There is no such cell, or a cell has or had a daughter's name.
        """
        self._row(cell)
        pair = _validate.labels(f"division of {cell!r}: daughters", daughters, 2)
        for what, both in (("types", types), ("volumes", volumes)):
            if both is not None:
                _validate.several(f"division of {cell!r}: {what}", both, what, 2)
        self.divide_cells(
            [cell], [(pair[0], pair[1])], axes=[axis], fractions=[fraction],
            types=None if types is None else [types],
            volumes=None if volumes is None else [volumes],
        )  # fmt: skip

    def divide_cells(
        self,
        cells: Sequence[str],
        daughters: Sequence[tuple[str, str]] | None = None,
        *,
        axes: Any,
        fractions: Any = 0.5,
        types: Sequence[tuple[str, str]] | None = None,
        volumes: Sequence[tuple[float | VolumeFunction, float | VolumeFunction]] | None = None,
    ) -> None:
        """Divide several cells at once; see `divide`. Either all of them divide, or none.

        Parameters
        ----------
        cells : names of n cells
        daughters : n pairs of names, optional
            By default they are numbered: a.2 and a.3 are daughters of a, and cell k of a founder
            has 2 k and 2 k + 1. Cells must have a `generation` then, see `Proliferation`.
        axes : (n, 3)
        fractions : (n,), or one for all
        types, volumes : n pairs, optional

        Raises
        ------
        ValueError
            See `divide`; or two of the cells, or of the daughters, are the same.
        """
        names = _listed(cells)
        _validate.unique("cell that divides", names)
        rows = np.array([self._row(name) for name in names], np.int64)
        if not names:
            return
        pairs = self._pairs(names, daughters)
        shares = np.broadcast_to(np.asarray(fractions), (len(names),)).tolist()
        kinds, targets = self._heirs(rows, pairs, shares, types, volumes)
        halves: list[CellField] = []
        for row, axis, share, pair in zip(rows.tolist(), axes, shares, pairs, strict=True):
            spacing, scale = self.engine.numerics.spacing, self.physics.interface_scale
            halves += divided(self.engine.field(row), spacing, axis, share, pair, scale)
        self._bear(rows, pairs, kinds, targets, halves)
        if daughters is not None:
            self._used.update(chain.from_iterable(pairs))
        first = f"{names[0]} into {pairs[0][0]} and {pairs[0][1]}"
        self._tell("division of " + (first if len(names) == 1 else several(names)))
        self._stay_stable()

    def _pairs(
        self, names: Sequence[str], daughters: Sequence[tuple[str, str]] | None
    ) -> list[tuple[str, str]]:
        """Names of the daughters of cells, stated or by number, none of which is taken."""
        table = self.engine.everyone
        if daughters is None:
            return lineage_names.daughters_of(names, table, self._used)
        pairs = []
        for cell, given in zip(names, daughters, strict=True):
            first, second = _validate.labels(f"division of {cell!r}: daughters", given, 2)
            for name in (first, second):
                if name in self._used or table.has(name):
                    message = f"daughter {name!r} of {cell!r}: a cell has or had this name already"
                    raise ValueError(message)
                lineage_names.check_stated(name, cell, table)
            pairs.append((first, second))
        if len(pairs) > 1:
            _validate.unique("daughter", chain.from_iterable(pairs))
        return pairs

    def _heirs(
        self, rows: Rows, pairs: Sequence[tuple[str, str]], shares: Sequence[float],
        types: Sequence[tuple[str, str]] | None, volumes: Any,
    ) -> tuple[list[str], list[float | VolumeFunction]]:  # fmt: skip
        """Types and target volumes of daughters: stated, or inherited from mothers."""
        table = self.engine.everyone
        kinds: list[str] = []
        targets: list[float | VolumeFunction] = []
        for k, row in enumerate(rows.tolist()):
            whole, own = self._target(row), table.kinds[table["kind"][row]]
            kinds += (own, own) if types is None else types[k]
            halves = (shares[k] * whole, (1 - shares[k]) * whole)
            targets += halves if volumes is None else volumes[k]
        for name, kind in zip(chain.from_iterable(pairs), kinds, strict=True):
            check_values(name, {"type": kind})
        return kinds, targets

    def _bear(
        self, rows: Rows, pairs: Sequence[tuple[str, str]], kinds: Sequence[str],
        targets: Sequence[float | VolumeFunction], halves: Sequence[CellField],
    ) -> None:  # fmt: skip
        """Put the daughters of cells in their place."""
        table = self.engine.everyone
        names, mothers = list(chain.from_iterable(pairs)), table["name"][rows].tolist()
        now = [volume_at(name, v, self.time) for name, v in zip(names, targets, strict=True)]
        values: dict[str, Any] = {
            "name": names, "parent": np.repeat(np.array(mothers, object), 2), "target": now,
        }  # fmt: skip
        if "born" in table:
            values["born"] = self.time
        values |= growth.inherited(table, rows, kinds, targets, self.time)
        self.engine.divide(rows, values, kinds, halves)
        self._volumes.forget(mothers)
        for name, target in zip(names, targets, strict=True):
            self._volumes.set(name, target)

    def grow(
        self, cells: NDArray[np.bool_], rates: ArrayLike, *, law: str = "exponential",
        limit: float = np.inf,
    ) -> None:  # fmt: skip
        """Let target volumes V grow from now on, without a jump; for rules such as `Growth`.

        Cells of which V is a function of time do not, nor those that die. All that grow stop where
        a stage begins.

        Parameters
        ----------
        cells : (N,) bool
            Which cells.
        rates : (N,) or one for all
            Rates r ≥ 0: V' = r V with the law "exponential", V' = r in µm³ with "linear".
        limit : float
            Volume in µm³ that V does not grow beyond.

        Raises
        ------
        ValueError
            No rule in a stage of the scene has the columns that this takes.
        """
        table = self.engine.everyone
        growth.require(table, "grow")
        rates = np.broadcast_to(np.asarray(rates, float), (len(table),))
        which = cells & ~table["dying"]
        if self._volumes.functions:
            which[table.rows(self._volumes.functions)] = False
        rows = np.flatnonzero(which)
        growth.change(table, rows, self._targets(), rates, law, limit, self.time)

    def die(self, cells: Iterable[str], over: float) -> None:
        """Let cells die: the target volume falls, steadily, to 1/20, and then they are taken out.

        They are listed in `removed` when they are gone, which may be earlier, where φ comes below
        1/2 everywhere; `Scene.on_vanish` does not matter. Cells that die already go on as they do.

        Parameters
        ----------
        cells : names
        over : float
            *In silico* time that this takes.

        Raises
        ------
        ValueError
            There is no such cell, or no rule in a stage of the scene has the columns that this
            takes.
        """
        table, over = self.engine.everyone, _validate.number("die: over", over, above=0)
        growth.require(table, "die")
        rows = np.array(sorted({self._row(name) for name in _listed(cells)}), np.int64)
        rows = rows[~table["dying"][rows]]
        if not len(rows):
            return
        names, whole = table["name"][rows].tolist(), self._targets()[rows]
        least = np.minimum(
            np.maximum(GONE * whole, 2 * least_volume(self.engine.numerics.spacing)), whole
        )
        self._volumes.forget(names)
        growth.follow(
            table, rows, whole, self.time, slope=(least - whole) / over, until=self.time + over
        )
        table["dying"][rows] = True
        self._tell(f"death of {several(names)}")
        self._stay_stable()

    def stop_growth(self) -> None:
        """Let target volumes grow no more: a stage begins, whose rules say what holds now."""
        growth.stop(self.engine.everyone, self.time)

    def remove(self, cells: Iterable[str]) -> None:
        """Take cells out; the others keep their history. They are listed in `removed`.

        Raises
        ------
        ValueError
            There is no such cell, or none would be left.
        """
        rows = sorted({self._row(name) for name in _listed(cells)}, reverse=True)
        if len(rows) == len(self.engine):
            message = f"all {len(rows)} cells would be removed; at least one must stay"
            raise ValueError(message)
        self._take_out(rows)

    def change_cells(self, cells: Iterable[str], **values: Any) -> None:
        """Give cells other values of `Cell`: type, gamma, volume or frozen.

        Cells that are frozen or thawed take their next step without history.

        Raises
        ------
        ValueError
            There is no such cell or value.
        """
        _validate.keys("change of cells", values, CHANGEABLE)
        names = list(dict.fromkeys(_listed(cells)))
        rows = np.array([self._row(name) for name in names], np.int64)
        for name in names:
            check_values(name, values)
            if "volume" in values:
                volume_at(name, values["volume"], self.time)
        changed = np.zeros(len(rows), bool)
        setters: dict[str, Callable[[Rows, Any], NDArray[np.bool_]]] = {
            "type": self._set_type, "gamma": self._set_gamma, "volume": self._set_volume,
            "frozen": self._set_frozen,
        }  # fmt: skip
        for key, value in values.items():
            changed |= setters[key](rows, value)
        if changed.any():
            touched = ", ".join(name for name, is_so in zip(names, changed, strict=True) if is_so)
            self._tell(f"change of {', '.join(values)} of {touched}")
            self._stay_stable()

    def change_physics(self, **values: Any) -> None:
        """Give the physics other values, from the next step on, which is of first order.

        Raises
        ------
        ValueError
            A value is not allowed.
        """
        _validate.keys("change of physics", values, _validate.names_of(Physics))
        physics = replace(self.physics, **values)
        if physics_table(physics) != physics_table(self.physics):
            check_columns(physics)
            self._choose_S(physics)
            self.engine.set_physics(physics)
            self._tell(f"change of {', '.join(values)}")

    def _set_type(self, rows: Rows, kind: str) -> NDArray[np.bool_]:
        """Give cells a type; return which of them had another."""
        table = self.engine.everyone
        changed = np.array([table.kinds[k] != kind for k in table["kind"][rows]], bool)
        if changed.any():
            table.set_types(rows[changed], [kind] * int(changed.sum()))
            growth.stop(table, self.time, rows[changed])
            self.engine.change()
        return changed

    def _set_gamma(self, rows: Rows, gamma: float | None) -> NDArray[np.bool_]:
        own = np.nan if gamma is None else gamma
        return self._set_column("own_tension", rows, own)

    def _set_frozen(self, rows: Rows, frozen: bool) -> NDArray[np.bool_]:
        changed = self._set_column("frozen", rows, frozen)
        if changed.any():
            growth.stop(self.engine.everyone, self.time, rows[changed])
            self.engine.restart(rows[changed])
        return changed

    def _set_volume(self, rows: Rows, volume: Any) -> NDArray[np.bool_]:
        """Give cells a target volume; two functions are never the same."""
        table = self.engine.everyone
        changed = np.zeros(len(rows), bool)
        for k, row in enumerate(rows.tolist()):
            name, before = table["name"][row], float(table["target"][row])
            target = volume_at(name, volume, self.time)
            had = self._volumes.get(name)
            changed[k] = volume is not had if callable(volume) else had or target != before
            self._volumes.set(name, volume)
            table["target"][row] = target
        growth.forget(table, rows)
        return changed

    def _set_column(self, name: str, rows: Rows, value: Any) -> NDArray[np.bool_]:
        """Set a column for cells; return which of them had another value."""
        column = self.engine.everyone[name]
        changed = ~np.isclose(column[rows], value, rtol=0, atol=0, equal_nan=True)
        if changed.any():
            column[rows] = value
            self.engine.change()
        return np.asarray(changed)

    def _target(self, row: int) -> float:
        """Target volume of a cell now, µm³."""
        table = self.engine.everyone
        name = table["name"][row]
        if (function := self._volumes.get(name)) is not None:
            return volume_at(name, function, self.time)
        if growth.has_courses(table) and not np.isnan(table["grown_from"][row]):
            return float(growth.volumes_at(table, np.array([row]), self.time)[0])
        return volume_at(name, float(table["target"][row]), self.time)

    def _targets(self) -> NDArray[np.float64]:
        """(N,) target volumes now, µm³."""
        targets: NDArray[np.float64] = self.engine.everyone["target"].copy()
        self._fill_targets(targets, self.time)
        return targets

    def _fill_targets(self, targets: NDArray[np.float64], time: float) -> None:
        """Set those of the target volumes (N,) of all cells that change by themselves."""
        everyone = self.engine.everyone
        self._volumes.fill(targets, everyone, time)
        growth.fill(targets, everyone, time)

    def _choose_S(self, physics: Physics) -> None:
        """Choose S for other physics, or warn if it is given and too small for them."""
        conditions = self._conditions(physics)
        self.engine.explicit_rate = stability.safe_rate(physics, conditions)
        self._warn_of_S(physics, conditions)

    def _stay_stable(self) -> None:
        """Choose S anew, or warn if it is given, where cells have come to need more of it."""
        physics, engine = self.physics, self.engine
        conditions = self._conditions(physics)
        if self.scene.numerics.S is None and stability.needed_S(physics, conditions) > engine.S:
            engine.stabilise(stability.safe_rate(physics, conditions))
        self._warn_of_S(physics, conditions)

    def _warn_of_S(self, physics: Physics, conditions: Conditions) -> None:
        """Warn of an S that is given and too small, unless as much has been told of."""
        numerics, needed = self.scene.numerics, stability.needed_S(physics, conditions)
        rates = stability.rates_of(physics, conditions)
        text = stability.too_small(numerics, rates, needed)
        if text and needed > self._known_S * (1 + 1e-9):
            self._known_S = needed
            warn(f"from t = {self.time:g} on: {text}", StabilityWarning)

    def _conditions(self, physics: Physics) -> Conditions:
        """What force terms are asked about, of the cells that live now."""
        table, scene = self.engine.everyone, self.scene
        tensions, stepped = physics.surface_tension.tensions(table), ~table["frozen"]
        if not stepped.any():
            stepped[:] = True
        courses = [getattr(f, "volumes", ()) for f in self._volumes.functions.values()]
        to_come = np.array([*chain.from_iterable(courses), *growth.last_volumes(table)])
        return stability.conditions_of(
            scene, physics, tensions=tensions[stepped], mean_tension=float(tensions.mean()),
            volumes=np.concatenate([table["target"][stepped], to_come]),
            filled=np.concatenate([self.engine.volumes[stepped], to_come]),
            types=sorted({*scene.possible_types, *(table.kinds[k] for k in table.present_kinds)}),
            several=len(table) > 1 or scene.may_be_several,
        )  # fmt: skip

    @cached_property
    def _known_S(self) -> float:
        """What is known to be needed: so much has been told of before the first step."""
        return stability.least_S(self.scene)

    def _row(self, cell: str) -> int:
        """Row of a cell in the table."""
        table = self.engine.everyone
        if not isinstance(cell, str) or not table.has(cell):
            _validate.choice("cell", cell, table.names)
        return table.row(cell)

    def _tell(self, text: str) -> None:
        self.events.append((self.time, text))

    def _take_out(self, rows: Sequence[int]) -> None:
        """Take out the cells of these rows, the last first."""
        if not rows:
            return
        names = [self.engine.everyone["name"][row] for row in rows]
        for name in names:
            self._tell(f"removal of {name}")
            self.removed.append((self.time, name))
        self.engine.remove(rows)
        self._volumes.forget(names)


def _listed(cells: Iterable[str]) -> tuple[str, ...]:
    """Names of cells; TypeError if it is one text, or no texts."""
    given = isinstance(cells, Iterable) and not isinstance(cells, str | bytes)
    return _validate.labels("cells", list(cells) if given else cells)


def several(names: Sequence[str]) -> str:
    """Some cells in few words, such as "5 cells: a, b, c, d, … and 1 more"."""
    return names[0] if len(names) == 1 else f"{len(names)} cells: {_shown.listed(names)}"


def used_names(table: CellTable) -> set[str]:
    """Names that cells have or have had at the start: their own, and their mothers'."""
    return {*table["name"], *table["parent"]} - {""}
