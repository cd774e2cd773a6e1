"""What watches a run."""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, TypeVar

from morphosim.errors import told

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


def check_observers(observers: "Iterable[Observer[Any]]") -> None:
    """Raise TypeError unless these are a sequence of observers."""
    if not isinstance(observers, Sequence):
        message = f"observers = {observers!r} is no sequence; put it into a list"
        raise TypeError(message)
    for observer in observers:
        for name in ("start", "after_step", "finish"):
            if not callable(getattr(observer, name, None)):
                message = f"observer {observer!r} has no method {name!r}; see Observer"
                raise TypeError(message)


def finish_all(
    observers: "Iterable[Observer[Any]]", simulation: Any, ended: BaseException | None = None
) -> None:
    """Call `finish` of all observers, even if one raises.

    Parameters
    ----------
    observers : iterable of Observer
    simulation : what they watch
    ended : exception, optional
        What has ended the run. It stays the run's error: what observers raise are its notes.

    Raises
    ------
    BaseException
        What the first observer has raised, if nothing else has ended the run.
    """
    first = ended
    for observer in observers:
        try:
            observer.finish(simulation)
        except BaseException as error:
            if first is None:
                first = error
            else:
                name = type(observer).__name__
                first.add_note(f"at the end {name} raised {type(error).__name__}: {told(error)}")
    if ended is None and first is not None:
        raise first
