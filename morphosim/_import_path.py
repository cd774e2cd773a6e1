"""Functions and classes of a user's own, which files name as "module:name" or "file.py:name"."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import reduce
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

_log = logging.getLogger(__name__)
_log.setLevel(logging.INFO)  # also where the command line shows warnings alone
MAIN = "__main__"
IMPORTS = "the scene names code: importing %s"
SCRIPTS = (MAIN, "__mp_main__")
"""What a script is called where it was started, and in the processes that it starts."""
_refusals: list[str] = []
"""Where nothing is loaded now: what to do instead."""


@contextmanager
def refusing(advice: str) -> Iterator[None]:
    """Load nothing in this process: `loaded` raises ValueError, with advice on what to do."""
    _refusals.append(advice)
    try:
        yield
    finally:
        _refusals.remove(advice)


def refusal() -> str:
    """Advice of `refusing`, for a process that this one starts; "" where things are loaded."""
    return _refusals[-1] if _refusals else ""


def loaded(text: str, where: str, folder: Path = Path()) -> Any:
    """Function or class named as "module:name", or as "file.py:name" by the path of its file.

    Parameters
    ----------
    text : the name
    where : where it is asked for, for errors
    folder : where files are looked up

    Raises
    ------
    ValueError
        The module cannot be imported, or has no such name; the text says what to try. Or nothing
        is loaded, see `refusing`.
    """
    if _refusals:
        message = f"{where} = {text!r} names code, which is not imported here; {refusal()}"
        raise ValueError(message)
    module, _, name = text.rpartition(":")
    try:
        return reduce(getattr, name.split("."), _module(module, folder))
    except (Exception, SystemExit) as error:  # a module may raise anything when it is imported
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        message = (
            f"{where} = {text!r} cannot be loaded as module:name ({cause}). "
            f"{_advice(module, folder, isinstance(error, ImportError | AttributeError))}"
        )
        raise ValueError(message) from error


def path_of(item: Any) -> str | None:
    """Name by which `loaded` finds a function or class; None if there is none.

    What a script defines is named by the script's file.
    """
    module, name = (getattr(item, key, None) for key in ("__module__", "__qualname__"))
    try:
        found = reduce(getattr, str(name).split("."), sys.modules[str(module)])
    except (KeyError, AttributeError):  # made within a function, perhaps
        return None
    if found is not item:
        return None
    file = getattr(sys.modules[str(module)], "__file__", None)
    if module in SCRIPTS and file is not None:
        return f"{Path(file).resolve()}:{name}"
    return f"{module}:{name}"


def _module(name: str, folder: Path) -> ModuleType:
    """Module of a name, or of a file: that which is loaded already, or it is loaded now.

    What is loaded is told to the log.
    """
    if not name:
        message = "there is no colon with a module before it"
        raise ImportError(message)
    if not name.endswith(".py"):
        if name not in sys.modules:
            _log.info(IMPORTS, name)
        return import_module(name)
    path = (folder / name).resolve()
    for module in list(sys.modules.values()):  # it may be the script that runs
        file = getattr(module, "__file__", None)
        if file is not None and Path(file).resolve() == path:
            return module
    if not path.exists():
        message = f"there is no file {path}"
        raise ImportError(message)
    _log.info(IMPORTS, path)
    return _executed(path)


def _executed(path: Path) -> ModuleType:
    """Module of a file, which can import what lies beside it; kept only if it is whole."""
    name, beside = str(path), str(path.parent)
    spec = spec_from_file_location(name, path)  # so its classes are named by the file
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, beside)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        if beside in sys.path:
            sys.path.remove(beside)
    return module


def _advice(module: str, folder: Path, absent: bool) -> str:
    """What to do about a module that is absent or lacks a name, or raises when it is imported."""
    if module == MAIN:
        return "It was defined in a notebook or console: define it there again, or in a module"
    if module.endswith(".py"):
        if (folder / module).exists():
            return f'Correct the file, and put what runs under if __name__ == "{MAIN}":'
        return "Put the file there, or say in the scene file where it is"
    if not absent:
        return f'Correct the module, and put what runs under if __name__ == "{MAIN}":'
    return "Is the module installed or on PYTHONPATH? Or name its file: 'path/to/file.py:name'"
