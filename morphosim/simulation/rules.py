"""What rules of living tissues ask of a simulation, and do to it: growth, death and chance."""

import zlib
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim.geometry.phase_field import least_volume
from morphosim.kernels.noise import normal_vectors
from morphosim.simulation import growth
from morphosim.simulation.changes import listed, several
from morphosim.simulation.divisions import Divisions

GONE = 0.05
"""A cell that dies is taken out when its target is this share of what it was."""


class Rules(Divisions):
    """Growth, death and chance; a part of `Simulation`.

    Attributes
    ----------
    since_rules, rule
        See `scene.target.Target`.
    """

    since_rules: float = 0.0
    rule: int = 0

    def ready(self, types: Sequence[str] = ()) -> NDArray[np.bool_]:
        """(N,) which cells rules may act on: of these types, or all; see `Target`."""
        table = self.engine.everyone
        found = ~table["frozen"]
        if self._furrows:
            found[table.rows(self._furrows)] = False
        if "dying" in table:
            found &= ~table["dying"]
        if types:
            wanted = [place for place, kind in enumerate(table.kinds) if kind in types]
            found &= np.isin(table["kind"], wanted)
        return np.asarray(found)

    def chance(self, purpose: str, again: bool = False) -> NDArray[np.float64]:
        """(N, 3) standard normal numbers of each cell, for rules that go by chance.

        They follow from `Numerics.seed`, the cell's id and the purpose, and from nothing else: the
        same for any number of threads and ranks, and for a run that goes on.

        Parameters
        ----------
        purpose : str
            What they are for; another purpose has other numbers.
        again : bool
            Whether each time, and each rule of a stage, has its own; else a cell keeps them for
            life.
        """
        key, at = purpose, 0
        if again:
            key, at = f"{purpose} of rule {self.rule}", self.engine.ticks & 0xFFFFFFFF
        told = zlib.crc32(key.encode()) & 0x7FFFFFFF
        counter = np.uint64(1 << 63 | told << 32 | at)  # the noise counts ticks, far below
        ids = self.engine.everyone["id"]
        drawn = np.empty((len(ids), 3))
        normal_vectors(np.uint64(self.scene.numerics.seed), counter, ids, drawn)
        return drawn

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
        1/2 everywhere; `Scene.on_vanish` does not matter. Cells that die already go on as they do;
        those that are dividing do not divide.

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
        rows = np.array(sorted({self._row(name) for name in listed(cells)}), np.int64)
        rows = rows[~table["dying"][rows]]
        if not len(rows):
            return
        names, whole = table["name"][rows].tolist(), self._targets()[rows]
        self._drop_furrows(names)
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
