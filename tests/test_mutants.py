"""`benchmarks/mutants.toml`: its faults fit the code, and the tests that it names are there."""

from pathlib import Path
from typing import Any

import pytest
from mutants import read_table

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def mutants() -> list[Any]:
    """All faults."""
    return list(read_table())


def test_each_fault_can_be_put_into_its_file(mutants: list[Any]) -> None:
    wrong = []
    for mutant in mutants:
        try:
            compile(mutant.applied(ROOT), mutant.file, "exec")
        except (ValueError, OSError, SyntaxError) as error:
            wrong.append(str(error))
        assert mutant.before != mutant.after, mutant.fault
    assert not wrong, "\n".join(["change benchmarks/mutants.toml with the code:", *wrong])


def test_the_tests_that_should_catch_it_are_there(mutants: list[Any]) -> None:
    for test in {test for mutant in mutants for test in mutant.tests}:
        path, _, name = test.partition("::")
        text = (ROOT / path).read_text(encoding="utf-8")
        assert not name or f"def {name.partition('[')[0]}(" in text, test


def test_a_fault_that_does_not_fit_is_named(mutants: list[Any]) -> None:
    mutant = mutants[0]
    other = type(mutant)(file=mutant.file, fault="", before="no such text", after="", tests=())
    with pytest.raises(ValueError, match="'no such text' stands there 0 times; expected once"):
        other.applied(ROOT)
