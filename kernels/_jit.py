"""JIT options of every kernel, in one place, and where compiled kernels are kept.

Fast-math is used without `nnan` and `ninf`: with them a compiled `isfinite` is always true and a
diverging run goes unnoticed. Nothing is compiled at import; compiled code is cached on disk.

Numba notices a change of a kernel's own file only, not of the files that it calls. Our caches
therefore lie in a folder named after the content of all kernel files: a change of any of them
starts a new one.

Arrays that a kernel takes do not overlap where it writes (`noalias`): without that promise every
loop begins by comparing all addresses, and some are not vectorised. A kernel that may be given one
array twice, and writes to it, is made `overlapping`.

What lies in a cache is executed. So it is a folder of this user's (mode 0700), in which, and above
which, nobody else can put anything; this is looked at whenever Python starts.
"""

import atexit
import hashlib
import os
import shutil
import stat
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numba
from llvmlite.binding import Linkage
from numba.core import types
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.typed_passes import AnnotateTypes
from numba.extending import overload

from morphosim.kernels._shared_cache import share

FAST_MATH = frozenset({"reassoc", "nsz", "arcp", "contract", "afn"})


class Cache(NamedTuple):
    """Where compiled kernels are kept: None is nowhere; a folder that is not kept ends with us."""

    folder: str | None
    kept: bool


NEEDED = (
    "compiled kernels need a folder that this user can write to, and nobody else there or above"
)


def _find_cache() -> Cache:
    """First folder that can be written to, by this user alone; else a new one for this process.

    That of NUMBA_CACHE_DIR, beside a clone's kernels, the user's. Not beside installed kernels:
    what an uninstalled package leaves there would hide another one.
    """
    here = Path(__file__).parent
    content = b"".join(path.read_bytes() for path in sorted(here.glob("*.py")))
    name = hashlib.sha256(content).hexdigest()[:16]
    user = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    bases = [user / "morphosim"] if user.is_absolute() else []  # it is not if no home is known
    if not {"site-packages", "dist-packages"} & set(here.parts):
        bases.insert(0, here / "__pycache__")
    if wanted := numba.config.CACHE_DIR:
        if folder := _private(Path(wanted, "morphosim", name)):
            return Cache(folder, kept=True)
        message = f"NUMBA_CACHE_DIR = {wanted} is not used: {NEEDED}"
        warnings.warn(message, RuntimeWarning, stacklevel=2)
    kept = next((folder for base in bases if (folder := _private(base / name))), None)
    return Cache(kept, kept=True) if kept else Cache(_temporary(), kept=False)


def _private(folder: Path) -> str | None:
    """The folder, made if it is not there; None if it cannot be ours, and ours alone."""
    try:
        folder = folder.resolve()
        for part in (*reversed(folder.parents), folder):
            if not part.exists():
                part.mkdir(mode=0o700, exist_ok=True)
            if not _is_guarded(part.lstat()):  # a link that has just been planted is not
                return None
        well = _is_ours_alone(folder.lstat()) and os.access(folder, os.W_OK | os.X_OK)
    except (OSError, RuntimeError):  # RuntimeError: links in a circle
        return None
    return str(folder) if well else None


def _is_guarded(found: os.stat_result) -> bool:
    """Whether nobody but the system and this user can rename what lies in a folder.

    In a sticky folder, as /tmp is, only its owner and that of the thing itself can.
    """
    if not hasattr(os, "geteuid"):  # Windows: a profile is its user's by other means
        return True
    if found.st_uid not in {os.geteuid(), 0, os.stat("/").st_uid}:
        return False
    return not found.st_mode & 0o022 or bool(found.st_mode & stat.S_ISVTX)


def _is_ours_alone(found: os.stat_result) -> bool:
    """Whether a folder belongs to this user, and is closed to all others."""
    if not hasattr(os, "geteuid"):
        return True
    return found.st_uid == os.geteuid() and not found.st_mode & 0o077


def _temporary() -> str | None:
    """New folder, which is removed when this process ends; None if there can be none."""
    try:
        folder = tempfile.mkdtemp(prefix="morphosim-")
    except OSError:
        return None
    atexit.register(_remove, folder, os.getpid())
    return _private(Path(folder))


def _remove(folder: str, maker: int) -> None:
    """Remove a folder in the process that has made it, not in forks of it."""
    if os.getpid() == maker:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _cached_in(folder: str) -> Iterator[None]:
    """Numba's cache directory, for the dispatchers made within."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = folder
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


CACHE = _find_cache()


@register_pass(mutates_CFG=False, analysis_only=True)
class _KeepCopies(AnalysisPass):  # type: ignore[misc]  # Numba has no types
    """Let nobody else see the copies that a compiled function has of what it calls."""

    _name = "keep_copies"

    def __init__(self) -> None:
        AnalysisPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        library = state.targetctx.codegen().create_library(state.func_id.func_qualname)
        library.enable_object_caching()
        finish = library._finalize_final_module

        def finish_alone() -> None:
            for function in library._final_module.functions:
                if function.linkage == Linkage.linkonce_odr:
                    function.linkage = Linkage.internal
            finish()

        library._finalize_final_module = finish_alone
        state.library = library  # into which Numba puts the function
        return False


class _Whole(Compiler):  # type: ignore[misc]  # Numba has no types
    """Compiler of functions that run as they are kept: with their own copies of what they call.

    Of a helper that several kernels have copies of, the process that compiles them would run the
    first for all, and one that loads a kernel that kernel's own; with fast-math these may differ in
    their last bits.
    """

    def define_pipelines(self) -> list[Any]:
        """Numba's, with the copies kept."""
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.add_pass_after(_KeepCopies, AnnotateTypes)
            pipeline.finalize()
        return list(pipelines)


class _Apart(_Whole):
    """Compiler of functions whose arrays do not overlap where they are written, too."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.noalias = True


def kernel(
    overlapping: bool = False, kept: bool = True, **options: Any
) -> Callable[[Callable[..., Any]], Any]:
    """Decorator that makes a kernel; `options` are further ones of `numba.njit`.

    Compiled code is `kept` on disk, but that of generators: Numba does not find them there again.
    Kernels that they are a part of are kept with them.
    """
    compiler = _Whole if overlapping else _Apart

    def decorate(function: Callable[..., Any]) -> Any:
        with _cached_in(CACHE.folder or ""):
            compiled = numba.njit(
                error_model="numpy", fastmath=set(FAST_MATH), nogil=True, boundscheck=False,
                pipeline_class=compiler, no_cfunc_wrapper=True, **options,
            )(function)  # fmt: skip
            if kept and CACHE.folder is not None and not numba.config.DISABLE_JIT:
                share(compiled)
        return compiled

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


def times(factor: Any, weight: Any) -> Any:
    """`factor` times `weight`, or None where there is no weight; decided by type."""
    return None if weight is None else factor * weight


@overload(times)
def _typed_times(factor, weight):  # without types: Numba compares the signatures
    if isinstance(weight, types.NoneType):
        return lambda factor, weight: None
    return lambda factor, weight: factor * weight
