"""A hundred malformed inputs of each reader: every one ends right, or in an error of one line."""

from collections.abc import Iterator

import pytest

from tests.malformed.readers import READERS
from tests.malformed.workers import Workers

EACH = 100


@pytest.fixture(scope="module")
def workers() -> Iterator[Workers]:
    tried = Workers()
    yield tried
    tried.close()


@pytest.mark.parametrize("reader", READERS)
def test_a_malformed_input_ends_in_one_line_or_right(workers: Workers, reader: str) -> None:
    outcomes = [workers.outcome(reader, number) for number in range(EACH)]
    faults = {n: told.text for n, told in enumerate(outcomes) if told.kind == "fault"}
    assert not faults
    assert any(told.kind == "error" for told in outcomes)
    assert any(told.kind == "right" for told in outcomes)
