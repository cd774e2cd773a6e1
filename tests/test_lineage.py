"""Lineages: the built-in one of C. elegans, its contacts, and tables of other species."""

import csv
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from morphosim.importers.lineage import (
    AREA_STAGES,
    CONTACT_STAGES,
    Lineage,
    celegans_contact_areas,
    celegans_contacts,
    read_lineage,
)

CELEGANS = Path(__file__).resolve().parents[2] / "shared" / "celegans"
"""The tables that the built-in ones are made from; not part of a checkout."""
needs_facts = pytest.mark.skipif(
    not CELEGANS.is_dir(), reason="the facts on C. elegans (../shared/celegans) are absent"
)
CELLS_AFTER = [
    2, 3, 4, 6, 7, 8, 12, 13, 14, 15, 23, 24, 26, 28, 44, 46, 50, 51, 55, 87, 95, 96, 100, 102,
]  # fmt: skip


@pytest.fixture(scope="module")
def worm() -> Lineage:
    return read_lineage()


def facts(name: str) -> list[dict[str, str]]:
    with (CELEGANS / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def alive_after(lineage: Lineage, group: int) -> list[str]:
    """Cells alive after a group has divided, daughters where their mother stood; 0: at first."""
    alive = lineage.roots
    for mothers in (g.mothers for g in lineage.groups() if g.number <= group):
        pairs = [lineage.cell(name).daughters if name in mothers else (name,) for name in alive]
        alive = [name for pair in pairs for name in pair]
    return alive


# --- C. elegans --------------------------------------------------------------------------------


def test_102_cells_come_of_24_groups(worm: Lineage) -> None:
    groups = worm.groups()
    assert len(worm.cells) == 203
    assert worm.roots == ["P0"]
    assert [g.number for g in groups] == list(range(1, 25))
    assert [g.cells_after for g in groups] == CELLS_AFTER
    assert [len(alive_after(worm, n)) for n in range(25)] == [1, *CELLS_AFTER]
    ends = alive_after(worm, 24)
    assert Counter(map(worm.founder, ends)) == {"AB": 64, "MS": 16, "E": 8, "C": 8, "D": 4, "P4": 2}
    assert {name for name in ends if worm.founder(name) == "P4"} == {"Z2", "Z3"}


def test_groups_follow_each_other_in_time(worm: Lineage) -> None:
    times = [g.time for g in worm.groups()]
    assert times == sorted(time for time in times if time is not None)
    assert times[:3] == [0.0, 15.0, 17.02]


def test_daughters_stand_in_their_mothers_place(worm: Lineage) -> None:
    assert alive_after(worm, 6) == ["ABal", "ABar", "ABpl", "ABpr", "MS", "E", "C", "P3"]
    assert worm.descendants("P3")[:4] == ["D", "P4", "Da", "Dp"]
    assert len(worm.descendants("P0")) == 202


def test_volumes_are_conserved_at_the_ratio_of_those_stated(worm: Lineage) -> None:
    for name in (name for group in worm.groups() for name in group.mothers):
        split = worm.division(name)
        first, second = (worm.volume(d) for d in split.daughters)
        stated = [worm.cell(d).stated_volume for d in split.daughters]
        assert first + second == pytest.approx(worm.volume(name), rel=1e-12)
        assert first / second == pytest.approx(stated[0] / stated[1], rel=1e-3)  # type: ignore[operator]
        assert split.fraction == pytest.approx(first / (first + second), rel=1e-12)
    total = sum(map(worm.volume, alive_after(worm, 24)))
    assert total == pytest.approx(20768.97, rel=1e-9)


@pytest.mark.parametrize("axis", ["table", "measured"])
def test_axes_are_unit_vectors_towards_the_first_daughter(worm: Lineage, axis: str) -> None:
    for name in (name for group in worm.groups() for name in group.mothers):
        vector = worm.division(name, axis).axis  # type: ignore[arg-type]
        assert vector.shape == (3,)
        assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-12)
    x, y, z = np.eye(3)
    assert worm.division("P0", axis).axis @ x < -0.98  # type: ignore[arg-type]  # AB is anterior
    assert worm.division("P2", axis).axis @ y > 0.95  # type: ignore[arg-type]  # C is dorsal
    assert worm.division("ABp", axis).axis @ z < -0.85  # type: ignore[arg-type]  # ABpl is left


def test_only_the_axis_of_ab_disagrees_with_the_nuclei(worm: Lineage) -> None:
    angles = {
        name: np.degrees(np.arccos(worm.division(name).axis @ worm.division(name, "measured").axis))
        for group in worm.groups()
        for name in group.mothers
    }
    assert angles.pop("AB") == pytest.approx(43.1, abs=0.1)
    assert max(angles.values()) < 25
    assert worm.cell("AB").measured_n == 15
    assert worm.cell("AB").measured_r == 0.972


def test_generations_are_counted_from_the_founder(worm: Lineage) -> None:
    for cell in worm.cells.values():
        mother = worm.cells.get(cell.parent or "")
        same = mother is not None and mother.founder == cell.founder
        assert cell.generation == (mother.generation + 1 if mother and same else 0)


@needs_facts
def test_lineage_is_that_of_the_facts(worm: Lineage) -> None:
    rows = facts("lineage.csv")
    assert list(worm.cells) == [row["name"] for row in rows]
    for row in rows:
        cell = worm.cell(row["name"])
        assert (cell.parent or "", cell.founder) == (row["parent"], row["founder"])
        assert cell.stated_volume == float(row["volume_um3"])
        assert cell.volume == pytest.approx(float(row["volume_closed_um3"]), rel=1e-4)
        if row["in_102"] == "0":
            assert cell.daughters == (row["daughter1"], row["daughter2"])
            assert cell.division_min == float(row["division_min"])
            table = [float(row[f"axis_{k}"]) for k in "xyz"]
            nuclei = [float(row[f"nuc28_axis_{k}"]) for k in "xyz"]
            np.testing.assert_allclose(worm.division(cell.name).axis, table, atol=2e-5)
            measured = worm.division(cell.name, "measured").axis
            np.testing.assert_allclose(measured, nuclei, atol=2e-4)


@needs_facts
def test_groups_are_those_of_the_facts(worm: Lineage) -> None:
    for group, row in zip(worm.groups(), facts("division_order.csv"), strict=True):
        assert (group.number, group.founder) == (int(row["order"]), row["founder"])
        assert group.mothers == tuple(row["mothers"].split())
        assert group.cells_after == int(row["cells_after"])
        assert group.time == pytest.approx(float(row["division_time_shortest_min"]), abs=0.13)


@needs_facts
@pytest.mark.parametrize("stage", CONTACT_STAGES)
def test_contacts_are_those_of_the_facts(stage: int) -> None:
    rows = facts(f"contacts_{stage}cell.csv")
    assert celegans_contacts(stage) == {
        (r["cell1"], r["cell2"]): r["status_inferred"] for r in rows
    }


def test_order_by_founder_and_time_gives_the_same_groups(worm: Lineage, tmp_path: Path) -> None:
    """Without the column `group`, the paper's rule finds the 24 groups."""
    lines = ["name,parent,founder,volume,fraction,axis_x,axis_y,axis_z,division_min"]
    for cell in worm.cells.values():
        axis = cell.axis or ("", "", "")
        values = [cell.parent, cell.founder, cell.volume, cell.fraction, *axis, cell.division_min]
        lines.append(",".join(["" if v is None else str(v) for v in (cell.name, *values)]))
    assert read_lineage(written(tmp_path, *lines)).groups() == worm.groups()


@pytest.mark.parametrize(
    ("stage", "cells", "counts"),
    [
        (4, 4, {"contact": 5, "noncontact": 1}),
        (6, 6, {"contact": 11, "noncontact": 3, "uncertain": 1}),
        (7, 7, {"contact": 15, "noncontact": 6}),
        (8, 8, {"contact": 16, "noncontact": 9, "uncertain": 3}),
    ],
)
def test_contacts_cover_all_pairs(
    worm: Lineage, stage: int, cells: int, counts: dict[str, int]
) -> None:
    table = celegans_contacts(stage)
    group = next(g.number for g in worm.groups() if g.cells_after == stage)
    assert Counter(table.values()) == counts
    assert len({frozenset(pair) for pair in table}) == cells * (cells - 1) // 2
    assert {name for pair in table for name in pair} == set(alive_after(worm, group))


@pytest.mark.parametrize("stage", AREA_STAGES)
def test_areas_are_of_pairs_that_touch(worm: Lineage, stage: int) -> None:
    areas = celegans_contact_areas(stage)
    group = next(g.number for g in worm.groups() if g.cells_after == stage)
    assert {name for pair in areas for name in pair} <= set(alive_after(worm, group))
    if stage in CONTACT_STAGES:
        listed = {frozenset(pair): status for pair, status in celegans_contacts(stage).items()}
        assert {listed[frozenset(pair)] for pair in areas} == {"contact"}
    assert all(50 < area < 450 for area in areas.values())


def test_areas_of_four_cells_are_of_all_five_contacts() -> None:
    touching = {pair for pair, status in celegans_contacts(4).items() if status == "contact"}
    areas = celegans_contact_areas()
    assert set(areas) == touching
    assert areas["ABa", "ABp"] == 343.3
    assert min(areas, key=areas.__getitem__) == ("EMS", "P2")


@needs_facts
def test_areas_are_those_of_the_facts() -> None:
    four = {(r["cell1"], r["cell2"]): r for r in facts("contacts_4cell_areas.csv")}
    assert celegans_contact_areas() == {
        pair: float(row["mean_of_two_embryos_um2"]) for pair, row in four.items()
    }
    further = facts("contacts_2_3_6cell_areas.csv")
    found = {stage: celegans_contact_areas(stage) for stage in (2, 3, 6)}
    assert sum(map(len, found.values())) == len(further)
    for row in further:
        frames = [float(value) for value in row["area_um2_by_frame"].split("/")]
        area = found[int(row["stage_cells"])][row["cell1"], row["cell2"]]
        assert area == pytest.approx(np.mean(frames), abs=0.05)


def test_areas_of_an_unknown_stage_list_the_known_ones() -> None:
    with pytest.raises(ValueError, match="stage = 8 is not known; allowed are 2, 3, 4, 6"):
        celegans_contact_areas(8)


def test_contacts_of_an_unknown_stage_list_the_known_ones() -> None:
    with pytest.raises(ValueError, match="stage = 5 is not known; allowed are 4, 6, 7, 8"):
        celegans_contacts(5)


# --- another species ---------------------------------------------------------------------------

HEAD = "name,parent,volume,axis_x,axis_y,axis_z,division_min"
SEVEN = (
    "egg,,4000,0,0,2,0", "top,egg,1500,1,0,0,30", "base,egg,2000,0,3,4,40", "t1,top,,,,,",
    "t2,top,,,,,", "b1,base,900,,,,", "b2,base,300,,,,",
)  # fmt: skip
"""Seven cells; the daughters of top have no volumes."""


def written(folder: Path, *lines: str) -> Path:
    path = folder / "cells.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def seven(folder: Path, *extra: str, column: str = "fraction") -> Path:
    """Table of the seven cells with one more column."""
    values = [*extra, *[""] * (7 - len(extra))]
    rows = [f"{row},{value}" for row, value in zip(SEVEN, values, strict=True)]
    return written(folder, f"{HEAD},{column}", *rows)


def test_a_table_of_seven_cells_is_enough(tmp_path: Path) -> None:
    lineage = read_lineage(seven(tmp_path, "", "0.25"))
    assert [(g.mothers, g.cells_after, g.time) for g in lineage.groups()] == [
        (("egg",), 2, 0.0),
        (("top",), 3, 30.0),
        (("base",), 4, 40.0),
    ]
    assert alive_after(lineage, 3) == ["t1", "t2", "b1", "b2"]
    split = lineage.division("base")
    assert split.axis.tolist() == [0, 0.6, 0.8]
    assert (split.fraction, split.daughters) == (0.75, ("b1", "b2"))
    sizes = {name: lineage.volume(name) for name in lineage.cells}
    assert sizes["top"] == pytest.approx(4000 * 3 / 7)
    assert sizes["t1"] == pytest.approx(1000 * 3 / 7)
    assert sum(sizes[name] for name in alive_after(lineage, 3)) == pytest.approx(4000)
    assert lineage.cell("t1").stated_volume is None
    assert lineage.founder("b2") == "egg"
    assert [c.generation for c in lineage.cells.values()] == [0, 1, 1, 2, 2, 2, 2]


def test_cells_of_equal_time_divide_together(tmp_path: Path) -> None:
    rows = [row.replace("4,40", "4,30") for row in SEVEN]
    rows = [f"{row},{f}" for row, f in zip(rows, ["", "0.5", *[""] * 5], strict=True)]
    groups = read_lineage(written(tmp_path, f"{HEAD},fraction", *rows)).groups()
    assert [(g.mothers, g.cells_after) for g in groups] == [(("egg",), 2), (("top", "base"), 4)]


def test_groups_may_be_stated_without_times_and_start_from_two_cells(tmp_path: Path) -> None:
    path = written(
        tmp_path, "name;parent;volume_um3;fraction;axis_x;axis_y;axis_z;group;daughter1;daughter2",
        "a;;100;0.5;1;0;0;7;a2;a1", "b;;60;;;;;;;", "", "a1;a;;;;;;;;", "a2;a;;;;;;;;",
    )  # fmt: skip
    lineage = read_lineage(path)
    (group,) = lineage.groups()
    assert (group.number, group.time, group.cells_after) == (7, None, 3)
    assert alive_after(lineage, 0) == ["a", "b"]
    assert alive_after(lineage, 7) == ["a2", "a1", "b"]


def test_an_order_of_rows_does_not_matter(tmp_path: Path) -> None:
    rows = [f"{row},{f}" for row, f in zip(SEVEN, ["", "0.25", *[""] * 5], strict=True)]
    lineage = read_lineage(written(tmp_path, f"{HEAD},fraction", *rows[::-1]))
    assert alive_after(lineage, 3) == ["b2", "b1", "t2", "t1"]
    assert lineage.volume("t2") == pytest.approx(0.25 * lineage.volume("top"))


# --- errors ------------------------------------------------------------------------------------


def changed(row: int, text: str) -> list[str]:
    """Rows of the seven cells, all with volumes, with one replaced (numbered as in the file)."""
    sized = [line.replace("top,,", "top,750,") for line in SEVEN]
    return [text if n == row else line for n, line in enumerate(sized, start=2)]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (changed(3, "top,eggs,9,1,0,0,30"), "row 3: parent = 'eggs' is not known.*mean 'egg'"),
        (changed(2, "egg,b1,9,0,0,1,0"), "row [26]: parent = '.*descend from itself"),
        (changed(3, "top,top,9,1,0,0,30"), r"row 3: parent = 'top'.*itself \(top <- top\)"),
        (changed(8, "b2,,300,,,,"), r"row 4: daughters of cell 'base' are 'b1'; expected 2"),
        (changed(8, "b2,top,300,,,,"), "row 3: daughters of cell 'top' are 't1', 't2', 'b2'"),
        (changed(4, "base,egg,9,,,,40"), "row 4: axis_x of cell 'base' is missing"),
        (changed(4, "base,egg,9,1,2,,40"), "row 4: axis_z of cell 'base' is missing"),
        (changed(4, "base,egg,9,0,0,0,40"), "row 4: axis_x, _y, _z = .*must not be zero"),
        (changed(8, "b2,base,-3,,,,"), "row 8: volume_um3 = -3.0 is not allowed.*> 0"),
        (changed(8, "b2,base,0,,,,"), "row 8: volume_um3 = 0.0 is not allowed.*> 0"),
        (changed(8, "b2,base,big,,,,"), "row 8: volume_um3 = 'big' is not a number"),
        (changed(8, "b1,base,300,,,,"), "row 8: name 'b1' occurs twice"),
        (changed(8, ",base,300,,,,"), "row 8: name is missing"),
        (changed(8, "b2,base,300,,,,,,1"), "row 8 has 9 entries; expected 7, as the first row"),
        (changed(2, "egg,,,0,0,1,0"), "row 2: volume_um3 of cell 'egg' is missing"),
        (changed(3, "top,egg,9,1,0,0,"), "row 3: division_min of cell 'top' is missing"),
        (changed(4, "base,egg,9,1,0,0,0"), "row 4: division_min = 0.0.*of its parent 'egg', 0"),
        (changed(8, "b2,base,300"), "row 8 has 3 entries; expected 7, .*the table is cut short"),
        (list(SEVEN), "row 3: fraction of cell 'top' is missing; expected a number between"),
        ([], "has headings .* and no rows"),
    ],
)
def test_bad_rows_are_named(tmp_path: Path, rows: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_lineage(written(tmp_path, HEAD, *rows))


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("fraction", ("", "1.0"), "row 3: fraction = 1.0 is not allowed: .*above 0 and below 1"),
        ("fraction", ("", "0.5", "0.5"), "row 4: fraction = 0.5.*daughters say 0.7500"),
        ("group", ("1", "2"), "row 4: group of cell 'base' is missing"),
        ("group", ("2", "2", "3"), "row 3: group = 2.*that of its parent 'egg', 2"),
        ("group", ("1", "2", "3", "4"), "row 5: group = 4.*no row has 't1' as its parent"),
        ("daughter1", ("", "b1"), "row 3: daughter1, daughter2 = 'b1'.*are 't1', 't2'"),
        ("fractoin", (), "column of .*cells.csv = 'fractoin' is not known.*mean 'fraction'"),
    ],
)
def test_bad_columns_are_named(
    tmp_path: Path, column: str, values: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        read_lineage(seven(tmp_path, *values, column=column))


def test_a_group_of_founders_that_precedes_a_mother_is_refused(tmp_path: Path) -> None:
    rows = (
        "a,,9,0,0,1,0,a", "b,a,5,0,0,1,100,b", "c,a,4,0,0,1,10,c", "b1,b,3,0,0,1,110,x",
        "b2,b,2,,,,,b", "c1,c,2,0,0,1,20,x", "c2,c,2,,,,,c", "e,b1,1,,,,,x", "f,b1,1,,,,,x",
        "g,c1,1,,,,,x", "h,c1,1,,,,,x",
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"row 5: founder = 'x'.*before its parent 'b'"):
        read_lineage(written(tmp_path, f"{HEAD},founder", *rows))


def test_a_table_without_order_or_parents_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"column group .* or division_min"):
        read_lineage(written(tmp_path, "name,parent,volume", "a,,9", "b,a,4", "c,a,5"))
    with pytest.raises(ValueError, match="has no column 'parent'; has 'name', 'volume_um3'"):
        read_lineage(written(tmp_path, "name,volume", "a,9"))
    with pytest.raises(FileNotFoundError, match="nowhere"):
        read_lineage(tmp_path / "nowhere.csv")


def test_asking_for_what_is_not_there_says_so(worm: Lineage, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"cell of the lineage = 'ABx' is not known"):
        worm.volume("ABx")
    with pytest.raises(ValueError, match="'Z2' does not divide in this lineage"):
        worm.division("Z2")
    with pytest.raises(ValueError, match="axis = 'nuclei' is not known"):
        worm.division("AB", "nuclei")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'egg' has no measured axis; try"):
        read_lineage(seven(tmp_path, "", "0.25")).division("egg", "measured")
