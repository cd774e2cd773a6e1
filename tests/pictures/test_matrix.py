"""The contact matrix: letters as large as there is room, and none that cannot be read."""

from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.sparse import coo_array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

    from morphosim.pictures.matrix import ContactMatrix

pytestmark = pytest.mark.skipif(
    find_spec("matplotlib") is None, reason="the extra pictures is not installed"
)


def made(names: Sequence[str], groups: int = 1) -> "ContactMatrix":
    """Cells in a row, each in contact with the next."""
    from morphosim.pictures.matrix import ContactMatrix

    count = len(names)
    areas = coo_array(100.0 * (np.eye(count, k=1) + np.eye(count, k=-1)))
    return ContactMatrix(list(names), areas, [f"group {k * groups // count}" for k in range(count)])


def drawn(matrix: "ContactMatrix", room: tuple[float, float] | None = None) -> "Axes":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from morphosim.pictures.matrix import block_room, draw_matrix

    size = room or block_room(matrix)
    figure = Figure(size, dpi=120)
    FigureCanvasAgg(figure)
    ax = draw_matrix(figure, (0, 0, *size), matrix)
    figure.canvas.draw()
    return ax


def labels(ax: "Axes") -> "list[Text]":
    return [text for text in (*ax.get_yticklabels(), *ax.get_xticklabels()) if text.get_text()]


def assert_clear(ax: "Axes") -> None:
    """No label is cut or over another."""
    whole = ax.figure.bbox
    bars = [text for child in ax.child_axes for text in child.get_yticklabels()]
    boxes = [text.get_window_extent() for text in (*labels(ax), *bars, ax.title, *ax.texts)]
    for k, box in enumerate(boxes):
        assert min(box.x0, box.y0, whole.x1 - box.x1, whole.y1 - box.y1) > -1
        for other in boxes[:k]:
            wide = min(box.x1, other.x1) - max(box.x0, other.x0)
            high = min(box.y1, other.y1) - max(box.y0, other.y0)
            assert min(wide, high) <= 1


@pytest.mark.parametrize(("count", "least"), [(2, 9), (8, 9), (20, 9), (30, 7), (45, 6), (60, 6)])
def test_all_cells_have_names_that_can_be_read(count: int, least: float) -> None:
    names = [f"ABpl{k:03d}" for k in range(count)]
    ax = drawn(made(names))
    assert [text.get_text() for text in ax.get_yticklabels()] == names
    assert [text.get_text() for text in ax.get_xticklabels()] == names
    assert min(text.get_fontsize() for text in labels(ax)) >= least
    assert_clear(ax)
    assert bool(ax.texts) == (count <= 12)  # areas as numbers, where they fit


@pytest.mark.parametrize("count", [8, 30])
def test_more_room_is_used_and_less_is_kept_to(count: int) -> None:
    matrix = made([f"c{k}" for k in range(count)])
    small, large = drawn(matrix, (4, 4)), drawn(matrix, (12, 12))
    assert labels(large)[0].get_fontsize() > labels(small)[0].get_fontsize() or count == 8
    assert large.get_window_extent().width > small.get_window_extent().width
    for ax in (small, large):
        assert_clear(ax)


@pytest.mark.parametrize("name", ["a cell of the second lineage, no. {:06d}", "W" * 20 + "{:02d}"])
def test_long_names_leave_room_for_the_matrix_and_keep_their_ends(name: str) -> None:
    ax = drawn(made([name.format(k) for k in range(9)]))
    assert_clear(ax)
    shown = [text.get_text() for text in ax.get_yticklabels()]
    assert len(set(shown)) == 9
    assert all("…" in text and text.endswith(str(k)) for k, text in enumerate(shown))
    assert ax.get_window_extent().width > 0.3 * ax.figure.bbox.width


def test_of_many_cells_the_groups_have_names() -> None:
    names = [f"c{k}" for k in range(102)]
    ax = drawn(made(names, groups=4))
    assert [text.get_text() for text in ax.get_yticklabels()] == [f"group {k}" for k in range(4)]
    assert_clear(ax)
    assert labels(drawn(made(names, groups=60))) == []  # as many as cells
    assert [text.get_text() for text in drawn(made(names), (14, 14)).get_yticklabels()] == names


@pytest.mark.parametrize("room", [(2.0, 2.0), (0.8, 0.8), (0.3, 0.5), (5.0, 1.0)])
@pytest.mark.parametrize("count", [3, 40])
def test_a_matrix_without_room_has_no_letters_over_each_other(
    room: tuple[float, float], count: int
) -> None:
    ax = drawn(made([f"ABpl{k:03d}" for k in range(count)]), room)
    boxes = [text.get_window_extent() for text in labels(ax)]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


def test_without_contacts_there_is_no_scale() -> None:
    matrix = made(["a", "b"])
    ax = drawn(matrix._replace(areas=coo_array((2, 2))))
    assert ax.get_title() == "no contacts"
    assert ax.child_axes == []


def test_a_contact_of_very_many_cells_is_seen() -> None:
    from morphosim.pictures.matrix import ContactMatrix

    count = 20_000  # of which all pairs would take 3 GB
    areas = coo_array(([5.0, 5.0], ([2460, 17540], [17540, 2460])), (count, count))
    many = ContactMatrix([f"c{k}" for k in range(count)], areas, [""] * count)
    ax = drawn(many)
    pixels = np.asarray(ax.figure.canvas.buffer_rgba())[..., :3].astype(int)  # type: ignore[attr-defined]
    box, height = ax.get_window_extent(), pixels.shape[0]
    inside = pixels[round(height - box.y1) + 2 : round(height - box.y0) - 2,
                    round(box.x0) + 2 : round(box.x1) - 2]  # fmt: skip
    rows, columns = np.nonzero(inside.max(axis=2) < 200)
    assert len(rows) >= 2
    shares = np.array([rows.min() / len(inside), columns.min() / inside.shape[1]])
    np.testing.assert_allclose(shares, 0.123, atol=0.01)
