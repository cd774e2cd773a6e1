"""Names of cells: on them, in letters that fit, and steady in a film."""

import numpy as np
import pytest
from numpy.typing import NDArray

from morphosim.pictures.camera import Camera
from morphosim.pictures.name_tags import NameTag, place_names
from morphosim.pictures.painter import Panel

SIZE = (120, 300)


def measure(text: str, size: float) -> tuple[int, int]:
    return round(0.8 * size * len(text)), round(size) + 2


def panel(*parts: tuple[int, int, int, int], names: list[str]) -> Panel:
    """Cells that fill these first and last rows and columns."""
    seen = np.full(SIZE, -1, np.int32)
    for place, (top, bottom, left, right) in enumerate(parts):
        seen[top:bottom, left:right] = place
    areas = [float((seen == place).sum()) for place in range(len(parts))]
    axes = np.eye(3)
    camera = Camera(axes[0], axes[1], np.zeros(3), 1.0, SIZE[::-1])
    white = np.full((*SIZE, 3), 255, np.uint8)
    return Panel(white, seen, names, np.array(areas), camera)


def only(tags: list[NameTag]) -> NameTag:
    (tag,) = tags
    return tag


def covered(tag: NameTag, shape: tuple[int, int] = SIZE) -> NDArray[np.bool_]:
    width, height = measure(tag.text, tag.size)
    mask = np.zeros(shape, bool)
    top, left = round(tag.row - height / 2), round(tag.column - width / 2)
    mask[max(top, 0) : top + height, max(left, 0) : left + width] = True
    return mask


def test_a_long_name_keeps_its_ends_where_it_does_not_fit() -> None:
    names = ["a cell of the second lineage, no. 000007", "a cell of the second lineage, no. 000008"]
    cells = panel((10, 60, 10, 100), (70, 110, 10, 290), names=names)
    first, second = place_names(cells, measure)
    assert (first.text, first.size) == ("a cell …. 000007", 6)
    assert (second.text, second.size) == (names[1], 8.5)


def test_names_that_would_be_written_alike_are_not_cut() -> None:
    alike = [f"the same ahead {k} the same behind" for k in range(2)]
    tags = place_names(panel((10, 60, 0, 60), (70, 110, 0, 60), names=alike), measure)
    assert {tag.text for tag in tags} <= set(alike)


def test_names_stay_in_a_film_as_long_as_they_fit() -> None:
    first = only(place_names(panel((20, 60, 40, 120), names=["ABpl"]), measure))
    assert first.size == 10
    before = {"ABpl": first}
    moved = panel((22, 62, 44, 130), names=["ABpl"])
    assert only(place_names(moved, measure, before=before)) == first
    away = panel((70, 110, 150, 230), names=["ABpl"])
    other = only(place_names(away, measure, before=before))
    assert (away.seen[covered(other)] == 0).all()
    assert other == only(place_names(away, measure))


def test_letters_grow_again_only_where_there_is_plenty_of_room() -> None:
    before = {"ABpl": NameTag("ABpl", "ABpl", 80.0, 40.0, 8.5)}
    little = panel((20, 60, 62, 98), names=["ABpl"])  # 36 wide: 10 points would just fit
    assert only(place_names(little, measure)).size == 10
    assert only(place_names(little, measure, before=before)).size == 8.5
    plenty = panel((20, 60, 50, 110), names=["ABpl"])
    assert only(place_names(plenty, measure, before=before)).size == 10


def test_a_name_beside_its_cell_keeps_its_side() -> None:
    cell = panel((50, 54, 100, 104), names=["ABpl"])
    right = only(place_names(cell, measure))
    assert right.side == 0
    kept = place_names(cell, measure, before={"ABpl": NameTag("ABpl", "ABpl", 0, 0, 7.0, 2)})
    assert only(kept).side == 2


@pytest.mark.parametrize("foot", [0, 40])
def test_names_beside_cells_leave_the_foot_free(foot: int) -> None:
    cells = panel((100, 104, 100, 104), names=["ABpl"])
    tags = place_names(cells, measure, foot=foot)
    assert all(tag.row + 5 <= SIZE[0] - foot for tag in tags)
    assert bool(tags) == (foot == 0)
