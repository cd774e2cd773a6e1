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
        name = package.partition(".")[0]
        message = f"{what} needs the package {name}; {how_to_install(extra)}"
        raise ImportError(message) from error


def how_to_install(extra: str) -> str:
    """How to install an extra of this package, which no index of packages has."""
    return f"in a clone: pip install '.[{extra}]'; with a wheel: pip install 'FILE.whl[{extra}]'"
