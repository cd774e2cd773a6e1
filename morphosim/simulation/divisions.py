"""Divisions of living cells: one by one, or many at once; at a stroke, or over a time."""

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.cell_field import CellField
from morphosim.physics.contractile_ring import PLANE, ContractileRing, require_ring
from morphosim.scene.cell import VolumeFunction, check_values, volume_at
from morphosim.simulation import growth, lineage_names
from morphosim.simulation.changes import Changes, Rows, listed, several
from morphosim.simulation.division import checked_fraction, direction_of, divided
from morphosim.simulation.furrows import LOOK, Furrow

Volumes = tuple[float | VolumeFunction, float | VolumeFunction]
"""Target volumes of two daughters, µm³."""


class Divisions(Changes):
    """The divisions of a simulation; a part of `Simulation`."""

    def divide(
        self,
        cell: str,
        daughters: tuple[str, str],
        *,
        axis: ArrayLike,
        fraction: float = 0.5,
        types: tuple[str, str] | None = None,
        volumes: Volumes | None = None,
        over: float = 0.0,
    ) -> None:
        """Divide a cell in its box; the daughters' next step is of first order.

        All after the daughters is given by keyword: `divide("P0", ("AB", "P1"), axis=(-1, 0, 0))`.

        The cell is cut at once, or in the course of a time: then the contractile ring of the
        physics draws in a furrow, and the cell is cut when its neck has closed, or when the time is
        over, or at the end of the stage. The furrow lies where the first daughter has her share.
        Until then the cell is in `dividing`, and rules leave it alone.

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
            is when she is cut.
        over : float
            *In silico* time that this may take. Volumes must be numbers then.

        Raises
        ------
        ValueError
            There is no such cell, it is dividing already, or a cell has or had a daughter's name;
            or the physics have no contractile ring, where it is to take time.
        """
        self._row(cell)
        pair = _validate.labels(f"division of {cell!r}: daughters", daughters, 2)
        for what, both in (("types", types), ("volumes", volumes)):
            if both is not None:
                _validate.several(f"division of {cell!r}: {what}", both, what, 2)
        self.divide_cells(
            [cell], [(pair[0], pair[1])], axes=[axis], fractions=[fraction],
            types=None if types is None else [types],
            volumes=None if volumes is None else [volumes], over=over,
        )  # fmt: skip

    def divide_cells(
        self,
        cells: Sequence[str],
        daughters: Sequence[tuple[str, str]] | None = None,
        *,
        axes: Any,
        fractions: Any = 0.5,
        types: Sequence[tuple[str, str]] | None = None,
        volumes: Sequence[Volumes] | None = None,
        over: float = 0.0,
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
        over : float

        Raises
        ------
        ValueError
            See `divide`; or two of the cells, or of the daughters, are the same; or a cell dies.
        """
        names = listed(cells)
        _validate.unique("cell that divides", names)
        rows = np.array([self._row(name) for name in names], np.int64)
        if not names:
            return
        self._check_live(rows)
        for what, values in (("daughters", daughters), ("axes", axes), ("types", types),
                             ("volumes", volumes)):  # fmt: skip
            if values is not None:
                _validate.several(f"divide_cells: {what}", values, what, len(names))
        pairs = self._pairs(names, daughters)
        shares = np.broadcast_to(np.asarray(fractions), (len(names),)).tolist()
        if _validate.number("over", over, least=0):
            given = None if daughters is None else pairs
            self._begin_furrows(names, given, axes, shares, types, volumes, over)
            return
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

    def _check_live(self, rows: Rows) -> None:
        """Raise ValueError if one of the cells is dying, or dividing."""
        table = self.engine.everyone
        for name in table["name"][rows] if self._furrows else ():
            if name in self._furrows:
                message = f"cell {name!r} is dividing already; it is cut before it can divide again"
                raise ValueError(message)
        if "dying" in table and (dying := rows[table["dying"][rows]]).size:
            message = f"cell {table['name'][dying[0]]!r} is dying; it cannot divide"
            raise ValueError(message)

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

    @property
    def dividing(self) -> list[str]:
        """Names of the cells that are dividing: a furrow is being drawn in."""
        return list(self._furrows)

    def finish_divisions(self) -> None:
        """Cut the cells that are dividing, however far their furrows are."""
        self._cut(self.dividing)

    def _begin_furrows(
        self, names: Sequence[str], pairs: Sequence[tuple[str, str]] | None, axes: Any,
        shares: Sequence[float], types: Any, volumes: Any, over: float,
    ) -> None:  # fmt: skip
        """Let cells begin to divide."""
        require_ring(self.physics.terms, f"division of {names[0]!r}: over")
        until = self.engine.ticks + self.engine.numerics.ticks_to(over, "over")
        begun = {}
        for k, name in enumerate(names):
            where = f"division of {name!r}"
            if volumes is not None and any(map(callable, volumes[k])):
                message = (
                    f"{where}: volumes that are functions of time cannot wait for the furrow; give "
                    "numbers, or leave `over` out"
                )
                raise ValueError(message)
            share = checked_fraction(where, shares[k])
            x, y, z = direction_of(where, axes[k]).tolist()
            begun[name] = Furrow(
                daughters=None if pairs is None else pairs[k], axis=(x, y, z), fraction=share,
                types=None if types is None else tuple(types[k]),
                volumes=None if volumes is None else tuple(volumes[k]), until=until,
            )  # fmt: skip
        self._furrows |= begun
        self._look_at_furrows(names)
        self._used.update(chain.from_iterable(pairs or ()))
        self._tell(f"furrow of {several(names)}")

    def _look_at_furrows(self, names: Sequence[str]) -> None:
        """Find where furrows lie now, and whether their necks have closed."""
        table, spacing = self.engine.everyone, self.engine.numerics.spacing
        for ring in self._rings:  # without one, cells are cut when their time is over
            strengths = self.physics.surface_tension.tensions(table) * ring.strengths.of_each(table)
            for name in names:
                row = table.row(name)
                seen = self._furrows[name].seen
                self._furrows[name] = seen(self.engine.field(row), spacing, ring, strengths[row])

    def _go_on_dividing(self, before: int) -> None:
        """After a step, which has begun at the tick `before`: follow furrows, cut what is due."""
        ticks, interval = self.engine.ticks, max(round(LOOK / self.engine.numerics.tick), 1)
        if ticks // interval > before // interval:
            self._look_at_furrows(self.dividing)
        elif any(self.scene.period):  # boxes may have been carried back
            moved = self.engine.everyone["name"][self.engine.moved]
            self._look_at_furrows([name for name in self.dividing if name in moved])
        furrows = self._furrows.items()
        self._cut([name for name, each in furrows if each.closed or ticks >= each.until])

    def _cut(self, names: Sequence[str]) -> None:
        """Cut cells that are dividing."""
        furrows = {name: self._furrows[name] for name in names}
        self._drop_furrows(names)
        for kind in sorted({furrow.says for furrow in furrows.values()}):
            group = [name for name in names if furrows[name].says == kind]
            members = [furrows[name] for name in group]
            said: dict[str, Any] = {
                what: [getattr(each, what) for each in members] for what in kind
            }
            self.divide_cells(
                group, axes=[each.axis for each in members],
                fractions=[each.fraction for each in members], **said,
            )  # fmt: skip

    @property
    def _rings(self) -> list[ContractileRing]:
        """The contractile ring of the physics, if they have one."""
        return [term for term in self.physics.active_terms if isinstance(term, ContractileRing)]

    def _set_rings(self) -> None:
        """Tell the contractile ring where the furrows lie."""
        table, spacing = self.engine.everyone, self.engine.numerics.spacing
        for ring in self._rings if PLANE.name in table else ():
            planes = table[PLANE.name]
            planes[:] = 0
            for name, furrow in self._furrows.items():
                plane = ring.plane(np.array(furrow.axis), furrow.height, spacing)
                planes[table.row(name)] = [*plane, *furrow.recoil]
