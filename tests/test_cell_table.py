"""The table of living cells against lists kept by hand."""

import numpy as np
import pytest

from morphosim.cell_table import CellTable, Column

COLUMNS = (
    Column("age", inherits=False),
    Column("place", np.int64, (2,), default=-1),
    Column("share", inherits=lambda mothers: np.repeat(mothers / 2, 2)),
    Column("scratch", saved=False),
    Column("known", bool, shared=True),
)


def table(count: int = 5) -> CellTable:
    cells = CellTable(COLUMNS)
    cells.add(
        {
            "name": [f"c{k}" for k in range(count)],
            "age": np.arange(count) + 1.0,
            "place": np.arange(2 * count).reshape(count, 2),
            "share": np.arange(count) * 2.0,
            "scratch": 7.0,
        },
        [["", "soft"][k % 2] for k in range(count)],
    )
    return cells


def test_division_follows_what_columns_declare() -> None:
    cells = table()
    rows = cells.divide([1, 3], {"name": list("wxyz")}, ["", "new", "soft", "soft"])
    assert rows.tolist() == [3, 4, 5, 6]
    assert cells.names == ["c0", "c2", "c4", "w", "x", "y", "z"]
    assert cells["id"].tolist() == [0, 2, 4, 5, 6, 7, 8]
    assert cells.types == ["", "", "", "", "new", "soft", "soft"]
    assert cells["age"].tolist() == [1, 3, 5, 0, 0, 0, 0]
    assert cells["place"][3:].tolist() == [[2, 3], [2, 3], [6, 7], [6, 7]]
    assert cells["share"][3:].tolist() == [1, 1, 3, 3]
    assert [cells.row(name) for name in cells.names] == list(range(7))
    assert not cells.has("c1")
    with pytest.raises(KeyError):
        cells.row("c1")


def test_ids_are_never_used_twice() -> None:
    cells = table()
    cells.remove([4, 0])
    cells.add({"name": ["new"]}, [""])
    assert cells["id"].tolist() == [1, 2, 3, 5]
    again = CellTable(COLUMNS)
    cells.remove(cells.row("new"))
    again.restore(cells.saved())
    again.add({"name": ["later"]}, [""])
    assert again["id"].tolist() == [1, 2, 3, 6]


def test_what_is_saved_comes_back() -> None:
    cells, again = table(), CellTable(COLUMNS)
    cells.divide(2, {"name": ["x", "y"]})
    again.restore(cells.saved())
    for name in ("id", "name", "kind", "age", "place", "share", "known"):
        np.testing.assert_array_equal(again[name], cells[name])
    assert again["scratch"].tolist() == [0] * 6
    assert again.types == cells.types
    assert again.row("y") == 5


def test_columns_come_and_go() -> None:
    cells = table()
    assert cells.require([*COLUMNS[:2], Column("more", default=2.0)]) == ["more"]
    assert cells["age"].tolist() == [1, 2, 3, 4, 5]
    assert cells["more"].tolist() == [2] * 5
    assert "share" not in cells
    with pytest.raises(ValueError, match="two columns of the cell table are named 'age'"):
        cells.require([COLUMNS[0], COLUMNS[0]])
    assert cells["more"].tolist() == [2] * 5, "a refused change leaves the table as it was"


def test_types_are_counted_as_they_occur() -> None:
    cells = table()
    cells.set_types(np.array([0, 1]), ["hard", "hard"])
    assert cells.types == ["hard", "hard", "", "soft", ""]
    assert [cells.kinds[k] for k in cells.present_kinds] == ["", "hard", "soft"]
    cells.remove([3])
    assert [cells.kinds[k] for k in cells.present_kinds] == ["", "hard"]


def test_arranging_keeps_some_rows_and_empties_the_others() -> None:
    cells = table(3)
    cells.arrange(np.array([2, 0]), np.array([1, 3]), 4)
    cells.fill({"name": np.array(list("abcd"), object), "id": np.arange(4, dtype=np.uint64)})
    cells.index()
    assert cells["age"].tolist() == [0, 3, 0, 1]
    assert cells["place"][0].tolist() == [-1, -1]
    assert cells.row("d") == 3


def test_a_division_that_fails_leaves_the_table_as_it_was() -> None:
    cells = CellTable([Column("odd", shape=(2,), inherits=lambda mothers: np.zeros((5, 3)))])
    cells.add({"name": ["a", "b"]}, ["", ""])
    with pytest.raises(ValueError, match=r"column 'odd' of 2 cells takes values of shape \(2, 2\)"):
        cells.divide(0, {"name": ["x", "y"]})
    assert cells.names == ["a", "b"]
    assert cells.divide(0, {"name": ["x", "y"], "odd": 1.0}).tolist() == [1, 2]
    assert cells["id"].tolist() == [1, 2, 3]
    cells["odd"] += 2
    assert cells["odd"][2].tolist() == [3, 3]
