"""What a steady drift asks of the step."""

from morphosim.physics.term import Concern, Conditions

FARTHEST = 0.3
"""Farthest stable move in a step, in widths 1 / √(c/2); 0.2 was stable, 0.4 was not."""
MOST_LOST = 0.5
"""Largest share of the surface tension that S may take off cells that move.

At δt = 2 and S = 3.6 cells are too slow by 1.8 % at 0.15, 7 % at 0.6, 17 % at 1.3, and torn at 2.3.
"""


def too_fast(what: str, force: float, conditions: Conditions) -> Concern | None:
    """Concern of a force that moves cells too far in a step of δt.

    With a tolerance it is the step that gives way.

    Parameters
    ----------
    what : str
        The parameter and its value, for the sentence.
    force : float
        |d| or |∇ψ|: cells move with this over τ.
    conditions : Conditions
    """
    if conditions.numerics.tolerance is not None:
        return None
    move = force * conditions.numerics.dt / conditions.tau
    found = (_too_far(what, move, conditions), _tension_lost(what, move, conditions))
    return next((concern for concern in found if concern.excess > 1), None)


def _too_far(what: str, move: float, conditions: Conditions) -> Concern:
    moved = move * conditions.interface_scale
    return Concern(
        moved / FARTHEST,
        f"{what} moves cells by {moved:.2g} interface widths in a step of numerics.dt = "
        f"{conditions.numerics.dt:g}; more than {FARTHEST:g} is likely to diverge. Take a smaller "
        "dt, or a weaker force",
    )


def _tension_lost(what: str, move: float, conditions: Conditions) -> Concern:
    """S acts as an inertia, which takes S (v δt)² off the surface tension of a cell that moves."""
    numerics, softest = conditions.numerics, float(conditions.tensions.min())
    S = numerics.S if numerics.scheme == "bdf2" and numerics.S is not None else 0.0
    lost = S * move**2 / softest
    return Concern(
        lost / MOST_LOST,
        f"{what} at numerics.dt = {numerics.dt:g} with S = {S:.3g} takes {100 * lost:.0f} % off "
        f"the surface tension of cells that move: from {100 * MOST_LOST:.0f} % on they are too "
        "slow by 6 % and more, or torn. Take a smaller dt or a weaker force, or scheme = "
        "'linearised'",
    )
