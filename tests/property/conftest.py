"""How Hypothesis searches: by default the same inputs every time.

`pytest tests/property --hypothesis-profile=explore` tries many more, and others every time.
"""

import pytest
from hypothesis import settings

settings.register_profile("fixed", max_examples=100, derandomize=True, deadline=None, database=None)
settings.register_profile("explore", max_examples=5000, deadline=None, database=None)


def pytest_configure(config: pytest.Config) -> None:
    """Take the fixed profile, unless the command line names one."""
    if not config.getoption("--hypothesis-profile"):
        settings.load_profile("fixed")
