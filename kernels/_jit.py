"""JIT options of every kernel, in one place.

Fast-math is used without `nnan` and `ninf`: with them a compiled `isfinite` is always true and a
diverging run goes unnoticed. Nothing is compiled at import; compiled code is cached on disk.
"""

from functools import partial

from numba import njit

FAST_MATH = frozenset({"reassoc", "nsz", "arcp", "contract", "afn"})

kernel = partial(
    njit, error_model="numpy", fastmath=set(FAST_MATH), nogil=True, boundscheck=False, cache=True
)
parallel_kernel = partial(kernel, parallel=True)
inline_kernel = partial(kernel, forceinline=True)
"""For helpers of inner loops: a call that hands over a dozen arrays costs more than a row does."""
