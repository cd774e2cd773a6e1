"""The page's state without a page."""

from typing import Any


class State(dict[str, Any]):
    """Values by key or as attributes; nobody is told of changes."""

    __getattr__ = dict.__getitem__
    __setattr__ = dict.__setitem__  # type: ignore[assignment]

    def __enter__(self) -> "State":
        return self

    def __exit__(self, *_: object) -> None:
        """Nobody is told."""
