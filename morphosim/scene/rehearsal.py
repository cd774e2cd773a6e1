"""A walk through a scene's stages before its first step: who lives then, under which physics.

Events say themselves what they will do (`Event.rehearse`), so that what is wrong in the last stage
is told at once. What only the state of the cells can tell is left open: which cells rules pick, how
long a stage lasts that ends when cells rest, and what an event of a user's own does that has no
`rehearse`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from morphosim import _validate
from morphosim.geometry.phase_field import least_volume
from morphosim.numerics.parameters import Numerics
from morphosim.physics.contractile_ring import require_ring
from morphosim.physics.parameters import Physics
from morphosim.scene.cell import CHANGEABLE, VolumeFunction, check_values, volume_at
from morphosim.scene.ends import Duration
from morphosim.scene.events import Event
from morphosim.scene.stages import Stage

Volume = float | VolumeFunction | None
"""A target volume; None where it is not known."""


@dataclass(kw_only=True)
class Rehearsal:
    """What is known of a simulation at some point of its course; events act on it as on one.

    Attributes
    ----------
    cells : mapping from name to target volume
        The cells that live, as far as is known.
    physics : Physics
        What holds now.
    numerics : Numerics
    possible_names, possible_types : names and types of cells that there may ever be
    used : names that cells have or have had
    time : float or None
        *In silico* time; None where the state of the cells decides.
    gone : mapping from name to what has become of a cell that lives no more
    surprised : bool
        Whether an event has passed that does not tell what it does.
    silent : bool
        Whether there is such an event in any stage.
    courses : list of Physics
        All that has held so far.
    dividing : mapping from name to names of the daughters and their target volumes
        Cells that are cut later in the present stage.
    tensions, volumes : lists of float
        Surface tensions that cells are given, and target volumes (µm³) as far as they are known.
    """

    cells: dict[str, Volume]
    physics: Physics
    numerics: Numerics
    possible_names: Sequence[str]
    possible_types: Sequence[str]
    used: set[str]
    time: float | None = 0.0
    gone: dict[str, str] = field(default_factory=dict)
    surprised: bool = False
    silent: bool = False
    courses: list[Physics] = field(init=False)
    dividing: dict[str, list[tuple[str, Volume]]] = field(init=False, default_factory=dict)
    tensions: list[float] = field(init=False, default_factory=list)
    volumes: list[float] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.courses = [self.physics]

    @property
    def names(self) -> list[str]:
        """Names of the cells that live, as far as is known."""
        return list(self.cells)

    def divide(
        self,
        cell: str,
        daughters: tuple[str, str],
        *,
        axis: ArrayLike,
        fraction: float = 0.5,
        types: tuple[str, str] | None = None,
        volumes: tuple[Volume, Volume] | None = None,
        over: float = 0.0,
    ) -> None:
        """Divide a cell; see `Simulation.divide`."""
        self._check_alive(cell)
        if cell in self.dividing:
            first, second = (name for name, _ in self.dividing[cell])
            message = f"cell {cell!r} is dividing already, into {first!r} and {second!r}"
            raise ValueError(message)
        if over:
            require_ring(self.physics.terms, f"division of {cell!r}: over")
        for name in daughters:
            if name in self.used:
                message = f"daughter {name!r} of {cell!r}: a cell has or had this name already"
                raise ValueError(message)
        whole = self._volume(cell, self.cells[cell]) if cell in self.cells else None
        shares = (fraction, 1 - fraction)
        self.dividing[cell] = born = []
        for k, name in enumerate(daughters):
            given = None if whole is None else shares[k] * whole
            self._check_size(cell, name, given)
            check_values(name, {"type": "" if types is None else types[k]})
            born.append((name, given if volumes is None else volumes[k]))
            self.used.add(name)
        if not over:
            self._cut(cell)

    def finish_divisions(self) -> None:
        """Cut the cells that are dividing; see `Simulation.finish_divisions`."""
        for cell in list(self.dividing):
            self._cut(cell)

    def _cut(self, cell: str) -> None:
        """Let a cell that is dividing be two."""
        born = self.dividing.pop(cell)
        for name, volume in born:
            self._bring(name, volume)
        self._end(cell, "it divides into " + " and ".join(repr(name) for name, _ in born))

    def divide_cells(
        self,
        cells: Sequence[str],
        daughters: Sequence[tuple[str, str]] | None = None,
        *,
        axes: ArrayLike,
        fractions: ArrayLike = 0.5,
        types: Sequence[tuple[str, str]] | None = None,
        volumes: Any = None,
        over: float = 0.0,
    ) -> None:
        """Divide several cells; see `Simulation.divide_cells`."""
        shares = np.broadcast_to(np.asarray(fractions, float), (len(cells),)).tolist()
        if daughters is None:
            self.surprised = True
            return
        for k, (cell, pair, axis) in enumerate(zip(cells, daughters, axes, strict=True)):  # type: ignore[arg-type]
            self.divide(
                cell, pair, axis=axis, fraction=shares[k],
                types=None if types is None else types[k],
                volumes=None if volumes is None else volumes[k], over=over,
            )  # fmt: skip

    def die(self, cells: Iterable[str], over: float) -> None:
        """Let cells die; see `Simulation.die`. When they are gone is not known."""
        _validate.number("die: over", over, above=0)
        for name in cells:
            self._check_alive(name)

    def remove(self, cells: Iterable[str]) -> None:
        """Take cells out; see `Simulation.remove`."""
        names = list(dict.fromkeys(cells))
        for name in names:
            self._check_alive(name)
        if names and self.cells.keys() <= set(names) and not self.surprised:
            message = f"all {len(names)} cells would be removed; at least one must stay"
            raise ValueError(message)
        for name in names:
            self._end(name, "it is removed")

    def change_cells(self, cells: Iterable[str], **values: Any) -> None:
        """Give cells other values; see `Simulation.change_cells`."""
        _validate.keys("change of cells", values, CHANGEABLE)
        for name in cells:
            self._check_alive(name)
            check_values(name, values)
            if "volume" in values:
                self._bring(name, values["volume"])
        if values.get("gamma") is not None:
            self.tensions.append(float(values["gamma"]))

    def change_physics(self, **values: Any) -> None:
        """Give the physics other values; see `Simulation.change_physics`."""
        _validate.keys("change of physics", values, _validate.names_of(Physics))
        self.physics = replace(self.physics, **values)
        self.physics.check(self.possible_names, self.possible_types)
        self.courses.append(self.physics)

    def stop(self, why: str) -> None:
        """End the run; what would come after is rehearsed all the same, as the run may go on."""
        _validate.words("why", why)

    def check_type(self, name: str, kind: str) -> None:
        """Raise ValueError if no cell can ever have this type."""
        if not self.silent:
            _validate.choice(name, kind, self.possible_types)

    def surprise(self, event: Event) -> None:
        """Take an event into account that does not tell what it does."""
        self.surprised = True
        for name in getattr(event, "daughters", ()):
            self.used.add(name)
            self.cells.setdefault(name, None)

    def _check_alive(self, name: str) -> None:
        """Raise ValueError unless a cell may be alive."""
        if name in self.gone:
            message = f"cell {name!r} is no longer there: {self.gone[name]}"
            raise ValueError(message)
        if name not in self.cells and not self.surprised:
            _validate.choice("cell", name, self.cells)

    def _check_size(self, mother: str, name: str, volume: float | None) -> None:
        """Raise ValueError if the lattice cannot resolve a daughter's share of her mother."""
        if not self.physics.volume_strength:  # then a target tells no volume
            return
        least = least_volume(self.numerics.spacing)
        if volume is not None and volume < least / 2:  # she may have grown beyond her target
            message = (
                f"daughter {name!r} of {mother!r} would get {volume:.3g} of the at least "
                f"{least:.3g} µm³ that a lattice of {self.numerics.spacing:g} µm needs; take a "
                "fraction nearer to 1/2, a finer spacing, or divide a larger cell"
            )
            raise ValueError(message)

    def _bring(self, name: str, volume: Volume) -> None:
        """Give a cell, which there may not have been, a target volume."""
        known = [self._volume(name, volume), *getattr(volume, "volumes", ())]
        self.volumes += [value for value in known if value is not None]
        self.cells[name] = volume
        self.used.add(name)

    def _volume(self, name: str, volume: Volume) -> float | None:
        """Target volume now, µm³; None if it is not known."""
        if volume is None or (self.time is None and callable(volume)):
            return None
        return volume_at(name, volume, self.time or 0.0)

    def _end(self, name: str, how: str) -> None:
        self.cells.pop(name, None)
        self.dividing.pop(name, None)
        self.gone[name] = how


def rehearse(rehearsal: Rehearsal, stages: Sequence[Stage], duration: float) -> None:
    """Walk through stages; `duration` is the *in silico* time at which the run ends in any case.

    Raises
    ------
    TypeError, ValueError
        What is wrong, with the stage and the event that would fail.
    """
    numerics = rehearsal.numerics
    acts = [event for stage in stages for event in (*stage.events, *stage.rules)]
    rehearsal.silent = not all(hasattr(event, "rehearse") for event in acts)
    for stage in stages:
        where = f"stage {stage.name!r}"
        _apply(rehearsal, stage.events, f"{where}: events")
        if stage.physics:
            with _validate.told_of(f"{where}: physics"):
                rehearsal.change_physics(**stage.physics)
        _apply(rehearsal, stage.rules, f"{where}: rules")
        with _validate.told_of(where):
            longest = stage.longest
            ticks = math.inf if math.isinf(longest) else numerics.ticks_to(longest, "duration")
        every = stage.rules_interval(numerics.tick)
        if every < ticks and every <= numerics.ticks_to(duration):
            again = f"{where}, as rules_every = {stage.rules_every:g} have passed: rules"
            _apply(rehearsal, stage.rules, again)
        rehearsal.finish_divisions()
        known = isinstance(stage.end, Duration) and rehearsal.time is not None
        rehearsal.time = (rehearsal.time or 0.0) + ticks * numerics.tick if known else None


def _apply(rehearsal: Rehearsal, events: Sequence[Event], where: str) -> None:
    """Let events act on what is known."""
    for k, event in enumerate(events):
        with _validate.told_of(f"{where}[{k}]"):
            tell = getattr(event, "rehearse", None)
            if tell is None:
                rehearsal.surprise(event)
            else:
                tell(rehearsal)
