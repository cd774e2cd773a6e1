"""What watches a run."""

from typing import Protocol, TypeVar

S_contra = TypeVar("S_contra", contravariant=True)


class Observer(Protocol[S_contra]):
    """Something that watches a run: a writer, a progress bar, a user's own function.

    One that also has `stage_ended(simulation)` is told of a stage's last step by that instead of
    `after_step`; the simulation may have gone back to an earlier state then.
    """

    def start(self, simulation: S_contra) -> None:
        """Before the first step of a run."""

    def after_step(self, simulation: S_contra) -> None:
        """After every step; return quickly where there is nothing to do."""

    def finish(self, simulation: S_contra) -> None:
        """After the last step, also when the run ends by an error or by Ctrl-C."""
