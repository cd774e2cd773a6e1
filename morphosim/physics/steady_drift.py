"""What a steady drift asks of the step."""

from morphosim.physics.term import Concern, Conditions

FARTHEST = 0.3
"""Farthest stable move in a step, in widths 1 / √(c/2); 0.2 was stable, 0.4 was not."""


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
    numerics = conditions.numerics
    moved = force * numerics.dt / conditions.tau * conditions.interface_scale
    if numerics.tolerance is not None or moved <= FARTHEST:
        return None
    return Concern(
        moved / FARTHEST,
        f"{what} moves cells by {moved:.2g} interface widths in a step of numerics.dt = "
        f"{numerics.dt:g}; more than {FARTHEST:g} is likely to diverge. Take a smaller dt, or a "
        "weaker force",
    )
