"""What holds for all tests."""

import signal
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="session")
def _heard_signals() -> None:
    """Hear Ctrl-C, which tests press; a shell starts what runs in its background deaf to it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def own_variables() -> Iterator[None]:
    """What a test declares by `measured` is not there for others."""
    import morphosim.runs.measured_state  # noqa: F401  (which declares those of every run)
    from morphosim.measure.variable import MEASURED

    before = dict(MEASURED)
    yield
    MEASURED.clear()
    MEASURED.update(before)
