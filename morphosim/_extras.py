"""Packages that only an extra of the installation brings."""

from importlib import import_module
from typing import Any


def need(package: str, what: str, extra: str) -> Any:
    """Import a package, or raise ImportError that says what needs it and how to install it.

    Parameters
    ----------
    package : its name, or that of a module of it
    what : what needs it: the subject of the error
    extra : extra of the installation that brings it
    """
    try:
        return import_module(package)
    except ImportError as error:
        message = (
            f"{what} needs the package {package.partition('.')[0]}; "
            f"try: pip install 'morphosim[{extra}]'"
        )
        raise ImportError(message) from error
