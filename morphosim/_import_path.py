"""Functions and classes of a user's modules, which files name as "module:name"."""

import sys
from functools import reduce
from importlib import import_module
from typing import Any


def loaded(text: str, where: str) -> Any:
    """Function or class named as "module:name".

    Raises
    ------
    ValueError
        The module cannot be imported, or has no such name; the text names `where` it is asked for.
    """
    module, _, name = text.partition(":")
    try:
        return reduce(getattr, name.split("."), import_module(module))
    except Exception as error:  # a module may raise anything when it is imported
        message = (
            f"{where} = {text!r} cannot be loaded as module:name ({error}); is the module "
            "installed or on PYTHONPATH?"
        )
        raise ValueError(message) from error


def path_of(item: Any) -> str | None:
    """Function or class as "module:name"; None if another process would not get it by that."""
    module, name = (getattr(item, key, None) for key in ("__module__", "__qualname__"))
    if not module or not name or module == "__main__":
        return None
    try:
        found = reduce(getattr, name.split("."), sys.modules[module])
    except (KeyError, AttributeError):  # made within a function, perhaps
        return None
    return f"{module}:{name}" if found is item else None
