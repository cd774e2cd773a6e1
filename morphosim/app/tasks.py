"""Work on saved runs for the page: jobs of a process of their own."""

from collections.abc import Sequence
from pathlib import Path

from morphosim.accessor import open_run
from morphosim.app.processes import Channel
from morphosim.app.worker import opening
from morphosim.progress import Tell


def view(channel: Channel, run: Path, times: Sequence[float]) -> bytes:
    """What a viewer opens a run with; tells "first" with the last time alone, which is quick."""
    first = opening(run, times=times[-1:])
    if len(times) == 1:
        return first
    channel.tell("first", first)
    return opening(run, times=times)


def picture(channel: Channel, run: Path, target: Path, time: float, by: str, mirror: bool) -> None:
    """Picture of a run at a time, in three views."""
    from morphosim.pictures.plot import plot

    with open_run(run) as data:
        plot(data, time, by=by, mirror=mirror, path=target)


def film(channel: Channel, run: Path, target: Path, by: str, mirror: bool) -> None:
    """Film of a run; tells "progress" with how much is done, and of how much."""
    from morphosim.pictures.film import film as make

    with open_run(run) as data:
        make(data, target, by=by, mirror=mirror, tell=_teller(channel))


def table(channel: Channel, run: Path, target: Path, to: str) -> int:
    """Files of a run for other programs; returns their number."""
    from morphosim.exports.export import export

    with open_run(run) as data:
        return len(export(data, target, to, tell=_teller(channel)))


def _teller(channel: Channel) -> Tell:
    return lambda done, of: channel.tell("progress", (done, of))
