"""What may change a simulation between two steps: removals, and parameters of cells or of all."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim import _shown, _validate
from morphosim.cell_table import CellTable
from morphosim.engine.engine import Engine, check_columns
from morphosim.errors import warn
from morphosim.physics.parameters import Physics
from morphosim.physics.term import Conditions
from morphosim.scene import stability
from morphosim.scene.cell import CHANGEABLE, check_values, volume_at
from morphosim.scene.scene import Scene
from morphosim.scene.stability import StabilityWarning
from morphosim.scene.tables import physics_table
from morphosim.simulation import growth
from morphosim.simulation.furrows import Furrow
from morphosim.simulation.volumes import VolumeFunctions

Rows = NDArray[np.int64]


class Changes:
    """Changes that events make; a part of `Simulation`.

    A change costs what the cells that it touches cost: the others keep their history.

    Attributes
    ----------
    scene : Scene
    engine : Engine
    removed : list of (time, name)
        Cells that were taken out.
    events : list of (time, text)
        What has changed the simulation.
    """

    scene: Scene
    engine: Engine
    removed: list[tuple[float, str]]
    events: list[tuple[float, str]]
    _volumes: VolumeFunctions
    _furrows: dict[str, Furrow]
    """Divisions under way, by name of the cell."""
    _used: set[str]
    """Names that cells have, have had or are to have, but those that number a founder's
    descendants."""

    @property
    def time(self) -> float:
        """*In silico* time."""
        return self.engine.time

    @property
    def physics(self) -> Physics:
        """The physics that hold now: those of the scene, as events have changed them."""
        return self.engine.physics

    def remove(self, cells: Iterable[str]) -> None:
        """Take cells out; the others keep their history. They are listed in `removed`.

        Raises
        ------
        ValueError
            There is no such cell, or none would be left.
        """
        rows = sorted({self._row(name) for name in listed(cells)}, reverse=True)
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
        names = list(dict.fromkeys(listed(cells)))
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
        self._drop_furrows(names)

    def _drop_furrows(self, names: Iterable[str]) -> None:
        """Let cells not divide that are dividing; their daughters' names are free again."""
        for name in names:
            if (furrow := self._furrows.pop(name, None)) is not None:
                self._used.difference_update(furrow.daughters or ())


def listed(cells: Iterable[str]) -> tuple[str, ...]:
    """Names of cells; TypeError if it is one text, or no texts."""
    given = isinstance(cells, Iterable) and not isinstance(cells, str | bytes)
    return _validate.labels("cells", list(cells) if given else cells)


def several(names: Sequence[str]) -> str:
    """Some cells in few words, such as "5 cells: a, b, c, d, … and 1 more"."""
    return names[0] if len(names) == 1 else f"{len(names)} cells: {_shown.listed(names)}"


def used_names(table: CellTable) -> set[str]:
    """Names that cells have or have had at the start: their own, and their mothers'."""
    return {*table["name"], *table["parent"]} - {""}
