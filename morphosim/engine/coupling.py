"""What cells feel of each other and of walls: sums on accumulation columns, and pairs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from morphosim.cell_table import CellTable
from morphosim.engine.box_pool import BoxPool
from morphosim.engine.column_sums import Background, ColumnCover
from morphosim.engine.interactions import Interactions
from morphosim.engine.scheduling import Schedule
from morphosim.kernels.columns import accumulate
from morphosim.kernels.frames import HALO, frame_sizes
from morphosim.kernels.layout import Boxes, ColumnLists, Columns, Interaction
from morphosim.kernels.pairs import accumulate_pairs
from morphosim.period import Period, with_images
from morphosim.physics.term import Environment, SpaceTerm


class Coupling:
    """Sums over cells, and what is evaluated in space.

    Parameters
    ----------
    dtype : of the fields
    threads : int
    period : Period or None
        After which space repeats.

    Attributes
    ----------
    acts : bool
        Whether any cell feels another or a wall.
    fastest : float
        Largest mobility of a cell, see `CellTerms`, that `strongest` and `largest` count with.
    """

    def __init__(self, dtype: np.dtype, threads: int, period: Period | None = None) -> None:
        self._dtype, self._period = dtype, period
        self._images = np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
        self._cover = ColumnCover(dtype, threads)
        self._walls = _Space((), None, dtype)
        self._fields: list[_Space] = []
        self._pair_potential: NDArray[np.floating] | None = None
        self.acts, self.fastest = False, 1.0

    def set_up(self, environment: Environment, cells: CellTable, everyone: CellTable) -> None:
        """Take over who acts on whom; `lay_out` must follow.

        Parameters
        ----------
        environment : Environment
        cells : CellTable
            Of this engine.
        everyone : CellTable
            All cells of the simulation.
        """
        walls, potentials = environment.walls, _alike(environment.potentials, everyone)
        self._interactions = Interactions(
            environment.attraction, environment.g, list(potentials), cells, everyone, self._dtype
        )
        felt = environment.g > 0 or self._interactions.attracts
        several = len(everyone) > 1 or self._period is not None
        self.acts = bool(walls or potentials) or (several and felt)
        spacing = environment.numerics.spacing
        self._walls = self._walls.renewed(walls, spacing)
        fields = [*self._fields, *(_Space((), None, self._dtype) for _ in potentials)]
        self._fields = [
            field.renewed(given, spacing, everywhere=not all(each.local for each in given))
            for field, given in zip(fields, potentials.values(), strict=False)
        ]
        tiles = [field.tiles for field in self._fields if field.tiles is not None]
        self._cover.configure(self._interactions.n_fields, self._walls.tiles, tiles)
        self._no_pairs = np.full(len(cells), -1), np.zeros(0, self._dtype)

    def lay_out(self, pool: BoxPool) -> None:
        """Make room for the sums where the boxes are."""
        if self._period is not None:
            self._images = self._period.images(pool.boxes, HALO)
            self._interactions.repeat(self._images[0])
        pairs = self._interactions.pairs
        if pairs is not None:
            frames = frame_sizes(pool.shape)
            sizes = np.where(np.diff(pairs.start) > 0, frames, 0)
            pairs.frame_start[:] = np.where(sizes > 0, np.cumsum(sizes) - sizes, -1)
            length = int(sizes.sum())
            if self._pair_potential is None or len(self._pair_potential) != length:
                self._pair_potential = np.zeros(length, self._dtype)
        if self.acts:
            boxes = self._boxes(pool)
            self._cover.update(boxes.origin, boxes.shape, len(pool))

    def accumulate(self, pool: BoxPool, schedule: Schedule) -> None:
        """Sum over the cells of the present state."""
        if not self.acts:
            return
        cover, boxes = self._cover, self._boxes(pool)
        accumulate(cover.shares, cover.lists, pool.acting, boxes, self.interaction, cover.columns)
        if self._interactions.pairs is not None:
            accumulate_pairs(
                schedule.shares, schedule.order, self._interactions.pairs, pool.acting, boxes,
                self._pair_potential,
            )  # fmt: skip

    def _boxes(self, pool: BoxPool) -> Boxes:
        """Boxes of cells, and of their images."""
        return pool.boxes if self._period is None else with_images(pool.boxes, *self._images)

    @property
    def interaction(self) -> Interaction:
        """Strengths by type."""
        return self._interactions.interaction

    @property
    def columns(self) -> Columns | None:
        """The sums, without what walls and space add to them; None where nothing acts."""
        return self._cover.sums if self.acts else None

    @property
    def walls(self) -> NDArray[np.floating] | None:
        """R of walls by column; None without walls."""
        return self._cover.columns.background if self.acts else None

    @property
    def lists(self) -> ColumnLists:
        """Which cells lie over which column."""
        return self._cover.lists

    @property
    def pairs(self) -> tuple[Any, Any]:
        """Where the frames of pulled cells start, and the pool of their potentials."""
        pairs = self._interactions.pairs
        return self._no_pairs if pairs is None else (pairs.frame_start, self._pair_potential)

    @property
    def strongest(self) -> float:
        """About the largest R that a cell here may feel of two others, and of walls."""
        felt = 2 * float(self.interaction.g) + self._cover.wall if self.acts else 0.0
        return self.fastest * felt

    @property
    def largest(self) -> float:
        """Largest R in the present state, each cell's own share included."""
        return self.fastest * self._cover.largest if self.acts else 0.0

    @property
    def uses(self) -> tuple[bool | None, bool | None]:
        """Whether there is repulsion, and attraction; None compiles the branch away."""
        attracts = self.acts and self._interactions.attracts
        return True if self.acts else None, True if attracts else None

    @property
    def nbytes(self) -> int:
        """Bytes of the sums."""
        potential = 0 if self._pair_potential is None else self._pair_potential.nbytes
        return potential + (self._cover.nbytes if self.acts else 0)


@dataclass(frozen=True)
class _Space:
    """Functions of space, evaluated on tiles; again only if their keys change."""

    keys: tuple[Any, ...]
    tiles: Background | None
    dtype: np.dtype

    def renewed(
        self, given: Sequence[SpaceTerm], spacing: float, everywhere: bool | None = None
    ) -> "_Space":
        """The functions given; the tiles that there are, if they depend on what they did.

        Potentials may be negative, and some act `everywhere`; walls, where it is None, do neither.
        """
        keys = tuple(each.key for each in given)
        if _equal(keys, self.keys):
            return self
        tiles = None
        if given:
            negative = everywhere is not None
            tiles = Background(given, spacing, self.dtype, bool(everywhere), negative)
        return replace(self, keys=keys, tiles=tiles)


def _alike(
    potentials: Sequence[SpaceTerm], everyone: CellTable
) -> dict[tuple[float, ...], list[SpaceTerm]]:
    """Potentials that act, by their strengths for the cell types that there are."""
    kinds = [everyone.kinds[kind] for kind in everyone.present_kinds]
    found: dict[tuple[float, ...], list[SpaceTerm]] = {}
    for each in potentials:
        known = each.strength
        strengths = tuple(1.0 if known is None else known.of(kind) for kind in kinds)
        if any(strengths):
            found.setdefault(strengths, []).append(each)
    return found


def _equal(one: Any, other: Any) -> bool:
    """Whether two values are equal; those that cannot be compared, as arrays, are not."""
    try:
        return bool(one == other)
    except ValueError:
        return False
