"""What watches a run."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol, TypeVar

from morphosim import _validate
from morphosim.errors import told

S_contra = TypeVar("S_contra", contravariant=True)
METHODS = ("start", "after_step", "finish")


class Observer(Protocol[S_contra]):
    """Something that watches a run: a writer, a progress bar, an object of a user's own.

    A function of the simulation will do where only steps matter: it is called as `after_step`.
    An observer ends the run by `simulation.stop("why")`; an error that it raises ends it too.

    One that also has `stage_ended(simulation)` is told of a stage's last step by that instead of
    `after_step`; the simulation may have gone back to an earlier state then.

    Steps whose lengths follow from a tolerance end wherever they do. An observer that must be told
    at a time has `next_time(simulation)` too: the next *in silico* time at which a step has to end,
    or None. It is asked before every such step.
    """

    def start(self, simulation: S_contra) -> None:
        """Before the first step of a run."""

    def after_step(self, simulation: S_contra) -> None:
        """After every step; return quickly where there is nothing to do."""

    def finish(self, simulation: S_contra) -> None:
        """After the last step, also when the run ends by an error or by Ctrl-C."""


class AfterStep:
    """Observer that calls a function of the simulation after every step.

    Parameters
    ----------
    function : callable
    """

    def __init__(self, function: Callable[[Any], object]) -> None:
        self._function = function

    def start(self, simulation: Any) -> None:
        """See `Observer`."""

    def after_step(self, simulation: Any) -> None:
        """See `Observer`."""
        self._function(simulation)

    def finish(self, simulation: Any) -> None:
        """See `Observer`."""


def as_observers(observers: Any) -> list[Observer[Any]]:
    """Observers of what a user gives: objects with the methods of one, and functions.

    Raises
    ------
    TypeError
        They are no list, or one of them is neither.
    """
    if not isinstance(observers, Sequence) or isinstance(observers, str | bytes):
        message = f"observers = {_validate.brief(observers)} is not a list; put it into one"
        raise TypeError(message)
    return [_as_observer(f"observers[{k}]", observer) for k, observer in enumerate(observers)]


def _as_observer(name: str, observer: Any) -> Observer[Any]:
    told_of = f"{name} = {_validate.brief(observer)}"
    if isinstance(observer, type):
        message = f"{told_of} is a class; give an object of it, as {observer.__name__}(...)"
        raise TypeError(message)
    missing = [part for part in METHODS if not callable(getattr(observer, part, None))]
    if not missing:
        known: Observer[Any] = observer
        return known
    if len(missing) == len(METHODS) and callable(observer):
        _validate.function(name, observer, 1)
        return AfterStep(observer)
    message = (
        f"{told_of} has no method {missing[0]!r}; an observer is a function of the simulation, "
        "called after every step, or an object with start, after_step and finish"
    )
    raise TypeError(message)


def tell_step(observers: Iterable[Observer[Any]], simulation: Any, stage_ended: bool) -> None:
    """Tell observers of a step, those that ask for it of a stage's last one by `stage_ended`."""
    for observer in observers:
        if stage_ended:
            getattr(observer, "stage_ended", observer.after_step)(simulation)
        else:
            observer.after_step(simulation)


def next_time(observers: Iterable[Observer[Any]], simulation: Any) -> float | None:
    """The first of the times at which observers must be told, if any must."""
    times = []
    for observer in observers:
        ask = getattr(observer, "next_time", None)
        if callable(ask) and (time := ask(simulation)) is not None:
            times.append(_validate.number(f"next_time of {type(observer).__name__}", time))
    return min(times, default=None)


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
