"""Checkpoints: what is written is read, to the bit; a damaged file is said to be one."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as of_numpy

from morphosim.runs.checkpoint import FIELDS, NEEDED, Checkpoint

plain = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8)
facts = st.recursive(
    plain,
    lambda some: (
        st.lists(some, max_size=3) | st.dictionaries(st.text(max_size=5), some, max_size=3)
    ),
    max_leaves=6,
)
tables = st.dictionaries(st.text(max_size=5), facts, max_size=3)
array_names = st.from_regex(r"[a-z][a-z_]{0,7}", fullmatch=True).filter(
    lambda name: name not in ("facts", *NEEDED, *FIELDS)
)
arrays = of_numpy.arrays(
    st.sampled_from([np.dtype(kind) for kind in ("f4", "f8", "i4", "i8", "u8", "?")]),
    of_numpy.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
)


def cells(count: int) -> dict[str, np.ndarray]:
    """What every state has of its cells."""
    names = np.array([f"cell {k}" for k in range(count)], "U8")
    high = np.arange(count, dtype=np.int16) % 2  # of boxes of one point, which the band has or not
    return {
        "name": names, "shape": np.ones((count, 3), int), "room": np.full(count, 64),
        "points": high.astype(int), "low": np.zeros(count, np.int16), "high": high,
        "phi": np.zeros(high.sum()),
    }  # fmt: skip


def checkpoints(back: st.SearchStrategy[Checkpoint | None]) -> st.SearchStrategy[Checkpoint]:
    """States of any content, with such states to go back to."""
    return st.builds(
        Checkpoint,
        physics=tables,
        steps=st.integers(0, 2**63),
        ticks=st.integers(0, 2**63),
        stage=st.text(max_size=8),
        removed=st.lists(st.tuples(st.floats(0, 1e6), st.text(max_size=5)), max_size=2).map(tuple),
        settings=tables,
        used=st.lists(st.text(max_size=5), max_size=2).map(tuple),
        arrays=st.builds(
            lambda count, others: cells(count) | others,
            st.integers(0, 3),
            st.dictionaries(array_names, arrays, max_size=4),
        ),
        volumes=st.dictionaries(st.text(max_size=5), st.none() | tables, max_size=2),
        progress=st.none() | tables,
        back=back,
    )


states = checkpoints(st.none() | checkpoints(st.none() | checkpoints(st.none())))
damages = st.sampled_from(["cut", "changed", "gone", "more"])


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the file is, again and again."""
    return tmp_path_factory.mktemp("checkpoints") / "state.npz"


def same(one: Checkpoint | None, other: Checkpoint | None) -> bool:
    """Whether two states are the same to the bit, NaN and all."""
    if one is None or other is None:
        return one is other
    rest = [f.name for f in fields(one) if f.name not in ("arrays", "back")]
    return (
        all(getattr(one, name) == getattr(other, name) for name in rest)
        and list(one.arrays) == list(other.arrays)
        and all(bits(one.arrays[name]) == bits(other.arrays[name]) for name in one.arrays)
        and same(one.back, other.back)
    )


def bits(array: Any) -> tuple:
    """What two arrays that are the same have in common."""
    array = np.asarray(array)
    return array.dtype, array.shape, array.tobytes()


def damaged(data: bytes, damage: str, place: int, junk: bytes) -> bytes:
    """A file with one thing wrong from some place on."""
    end = place + len(junk)
    return {
        "cut": data[:place],
        "changed": data[:place] + junk + data[end:],
        "gone": data[:place] + data[end:],
        "more": data[:place] + junk + data[place:],
    }[damage]


def read_or_error(path: Path) -> Checkpoint | ValueError | OSError:
    """The state in a file, or what reading it raises, if it is an error for users."""
    try:
        return Checkpoint.read(path)
    except (ValueError, OSError) as error:
        return error


@given(state=states)
def test_what_is_written_is_read(path: Path, state: Checkpoint) -> None:
    state.write(path)
    assert same(Checkpoint.read(path), state)


@given(state=states, damage=damages, data=st.data())
def test_a_damaged_file_is_said_to_be_one(
    path: Path, state: Checkpoint, damage: str, data: st.DataObject
) -> None:
    """One line that names the file, or, where the damage is in what nobody reads, the state."""
    state.write(path)
    whole = path.read_bytes()
    place = data.draw(st.integers(0, len(whole) - 1))
    path.write_bytes(damaged(whole, damage, place, data.draw(st.binary(min_size=1, max_size=9))))
    found = read_or_error(path)
    if isinstance(found, Checkpoint):
        assert same(found, state)
    else:
        assert str(path) in str(found)
        assert "\n" not in str(found)


@pytest.mark.parametrize(
    "facts",
    [{}, {"facts": "no JSON"}, {"facts": "{}"}, {"facts": "[1]"}, {"facts": '{"format": 1}'}],
)
def test_a_file_of_something_else_is_refused(path: Path, facts: dict[str, str]) -> None:
    np.savez(path, phi=np.zeros(3), **{name: np.array(text) for name, text in facts.items()})
    error = read_or_error(path)
    assert not isinstance(error, Checkpoint)
    assert str(path) in str(error)
    assert "\n" not in str(error)
