"""What of the kernel tests runs without compilation (NUMBA_DISABLE_JIT=1).

Kernels are plain functions then, and coverage sees their lines; see
`benchmarks/kernel_coverage.py`.
"""

from pathlib import Path

import numba
import pytest

NEED_COMPILATION = {
    "test_frame_shapes_are_those_of_the_frames": "asks compiled kernels for their Python functions",
    "test_normal_vectors_in_python_are_the_compiled_ones": "compares with the compiled kernel",
    "test_iterations_and_transforms_agree": "takes a minute in plain Python",
    "test_of_processes_that_need_the_same_kernel_one_compiles": "there is nothing to compile",
    "test_many_pieces_are_taken_by_more_than_one_thread": "there is one thread in plain Python",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs compilation where there is none."""
    if not numba.config.DISABLE_JIT:
        return
    for item in items:
        if item.path.parent == Path(__file__).parent and (reason := _why_not(item)):
            item.add_marker(pytest.mark.skip(reason=reason))


def _why_not(item: pytest.Item) -> str:
    """Why a test needs compilation; "" if it does not."""
    if item.path.stem == "test_guard":
        return "looks at how kernels are compiled"
    callspec = getattr(item, "callspec", None)
    if callspec is not None and callspec.params.get("way") == "compiled":
        return "the same test in Python runs"
    return NEED_COMPILATION.get(getattr(item, "originalname", item.name), "")
