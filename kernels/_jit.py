"""JIT options of every kernel, in one place.

Fast-math is used without `nnan` and `ninf`: with them a compiled `isfinite` is always true and a
diverging run goes unnoticed. Nothing is compiled at import; compiled code is cached on disk.

Numba notices a change of a kernel's own file only, not of the files that it calls. Our caches
therefore lie in a folder named after the content of all kernel files: a change of any of them
starts a new one.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numba
from numba.core import types
from numba.extending import overload

FAST_MATH = frozenset({"reassoc", "nsz", "arcp", "contract", "afn"})


def _cache_folder() -> str:
    """First of these that can be written to: NUMBA_CACHE_DIR, beside a clone's kernels, the user's.

    Not beside installed kernels: what an uninstalled package leaves there would hide another one.
    """
    here = Path(__file__).parent
    digest = hashlib.sha256(b"".join(p.read_bytes() for p in sorted(here.glob("*.py"))))
    user = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    bases = [user / "morphosim", Path(tempfile.gettempdir()) / "morphosim"]
    if not {"site-packages", "dist-packages"} & set(here.parts):
        bases.insert(0, here / "__pycache__")
    if numba.config.CACHE_DIR:
        bases.insert(0, Path(numba.config.CACHE_DIR) / "morphosim")
    for base in bases:
        folder = base / digest.hexdigest()[:16]
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return str(folder)
    return str(numba.config.CACHE_DIR)


@contextmanager
def _cached_in(folder: str) -> Iterator[None]:
    """Numba's cache directory, for the dispatchers made within."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = folder
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


_FOLDER = _cache_folder()


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator that makes a kernel; `options` are further ones of `numba.njit`."""

    def decorate(function: Callable[..., Any]) -> Any:
        with _cached_in(_FOLDER):
            return numba.njit(
                error_model="numpy", fastmath=set(FAST_MATH), nogil=True, boundscheck=False,
                cache=True, **options,
            )(function)  # fmt: skip

    return decorate


parallel_kernel = partial(kernel, parallel=True)
inline_kernel = partial(kernel, forceinline=True)
"""For helpers of inner loops: a call that hands over a dozen arrays costs more than a row does."""


def choose(array: Any, use: Any) -> Any:
    """`array`, or None where `use` is None."""
    return None if use is None else array


@overload(choose)
def _typed_choose(array, use):  # without types: Numba compares the signatures
    """Decide by the type of `use`.

    A branch would leave Numba with an array that may be None, which is looked at again at every
    access and keeps loops from being vectorised.
    """
    if isinstance(use, types.NoneType):
        return lambda array, use: None
    return lambda array, use: array


def entry(array: Any, i: Any, k: Any) -> Any:
    """`array[i, k]`, or None where there is no array; decided by type, as `choose` is."""
    return None if array is None else array[i, k]


@overload(entry)
def _typed_entry(array, i, k):  # without types: Numba compares the signatures
    if isinstance(array, types.NoneType):
        return lambda array, i, k: None
    return lambda array, i, k: array[i, k]
