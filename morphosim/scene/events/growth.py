"""Cells grow by rule."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from morphosim import _validate
from morphosim._shown import short_repr
from morphosim.scene.events.living import (
    COURSE,
    DYING,
    Floats,
    check_types,
    rehearse_types,
    spread_out,
)
from morphosim.scene.target import Foreseen, Target

LAWS = ("exponential", "linear")


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """Target volumes V grow, without jumps, at rates that are looked at as often as rules are.

    Cells of which V is a function of time, and those that are frozen or die, do not. Where V has
    come to `limit` it stays; where it is beyond it already, it stays as it is. A cell grows so
    until the next look, and no longer than its stage lasts; if it divides, its daughters go on at
    its rate until then. State this rule behind those that divide: then they begin with their own.

    Attributes
    ----------
    rate : float, optional
        Per unit of time, V' = rate V; with the law "linear" in µm³ per unit of time, V' = rate.
    doubling_time : float, optional
        *In silico* time in which V doubles, in place of a rate; for the law "exponential".
    law : {"exponential", "linear"}
    spread : float
        Standard deviation of the rates of cells, in their mean. Each cell draws its rate once, from
        a lognormal distribution.
    limit : float, optional
        Volume in µm³ that V does not grow beyond.
    pressure : float, optional
        Growth is slower by the factor 1 - p / pressure, p = 1 - v/V, and is 0 from there on.
    contact : float, optional
        Growth is slower by the factor 1 - s / contact, s the share of the cell's surface that
        touches others, and is 0 from there on; 1 stops cells that are enclosed. Measuring surfaces
        takes as long as some steps.
    types : types of the cells that grow; () are all.
    """

    rate: float | None = None
    doubling_time: float | None = None
    law: str = "exponential"
    spread: float = 0.0
    limit: float | None = None
    pressure: float | None = None
    contact: float | None = None
    types: Sequence[str] = ()

    columns = (*COURSE, DYING)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _validate.choice("growth: law", self.law, LAWS)
        if (self.rate is None) == (self.doubling_time is None):
            message = (
                f"growth: rate = {_validate.brief(self.rate, 40)} and doubling_time = "
                f"{_validate.brief(self.doubling_time, 40)}; give one of the two"
            )
            raise ValueError(message)
        if self.law == "linear" and self.rate is None:
            message = (
                f"growth: doubling_time = {_validate.brief(self.doubling_time)} is not allowed "
                "with law = 'linear', by which it depends on the volume: give rate, in µm³ per "
                "unit of time"
            )
            raise ValueError(message)
        for name in ("rate", "doubling_time", "limit", "pressure"):
            if getattr(self, name) is not None:
                _validate.number(f"growth: {name}", getattr(self, name), above=0)
        if self.contact is not None:
            _validate.number("growth: contact", self.contact, above=0, most=1)
        _validate.number("growth: spread", self.spread, least=0, most=1)
        object.__setattr__(self, "types", check_types("growth", self.types))

    def rehearse(self, rehearsal: Foreseen) -> None:
        """See `Event`."""
        rehearse_types("growth", self.types, rehearsal)

    def apply(self, simulation: Target) -> None:
        """Set the rates."""
        rate = np.log(2) / self.doubling_time if self.doubling_time is not None else self.rate
        rates = spread_out(float(rate or 0), self.spread, simulation.chance("growth")[:, 0])
        simulation.grow(
            simulation.ready(self.types), rates * self._slowing(simulation),
            law=self.law, limit=np.inf if self.limit is None else self.limit,
        )  # fmt: skip

    def _slowing(self, simulation: Target) -> Floats:
        """Factor (N,) between 0 and 1."""
        factor = np.ones(len(simulation.names))
        if self.pressure is not None:
            factor *= np.clip(1 - simulation.pressures / self.pressure, 0, 1)
        if self.contact is not None:
            touched = np.nan_to_num(1 - simulation.measured().exposed_fraction)
            factor *= np.clip(1 - touched / self.contact, 0, 1)
        return factor
