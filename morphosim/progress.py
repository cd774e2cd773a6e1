"""Progress of long work, drawn on standard error."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

Tell = Callable[[int, int], None]
"""Told how much of something is done, and of how much."""
TellWhat = Callable[[str, int, int], None]
"""Told what is done, how much of it is done, and of how much."""


def silent(*told: object) -> None:
    """Tell nobody; a `Tell` and a `TellWhat`."""


@contextmanager
def progress_line() -> Iterator[TellWhat]:
    """Bar that appears when it is first told something, and is removed at the end."""
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f}"), TimeRemainingColumn(),
        console=Console(stderr=True), transient=True,
    )  # fmt: skip
    tasks: dict[str, TaskID] = {}

    def tell(what: str, done: int, of: int) -> None:
        if what not in tasks:
            bar.start()
            for task in tasks.values():
                bar.update(task, visible=False)
            tasks[what] = bar.add_task(what, total=of)
        bar.update(tasks[what], completed=done, total=of)

    try:
        yield tell
    finally:
        if tasks:
            bar.stop()
