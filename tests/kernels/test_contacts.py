"""Contact areas, against plain geometry and SciPy's interpolation."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from morphosim.kernels.contacts import Neighbours, contacts
from morphosim.kernels.moments import Fields
from morphosim.kernels.sharing import shares_of

from .example_boxes import both_precisions, both_ways, box, put, taken
from .example_fields import (
    FAINT,
    LEVEL,
    LOW_LEVEL,
    SHAPES,
    Piece,
    make_work,
    pieces,
    random_fields,
    with_extents,
)

NEIGHBOUR_LEVEL = 0.3
SHARES = shares_of([0, 1, 1, 4], threads=3)
PAIRS = [(0, 1), (0, 2), (0, 3), (1, 0), (2, 0), (3, 0), (3, 1)]
NEIGHBOURS = Neighbours(
    np.searchsorted([i for i, _ in PAIRS], np.arange(5)), np.array([j for _, j in PAIRS])
)


def looked_up(fields: Fields, j: int, points: NDArray) -> NDArray[np.float64]:
    """φ_j at lattice positions (K, 3); it falls to 0 within a step beyond its box."""
    padded = np.pad(box(fields.phi, fields, j).astype(float), 1)
    return np.asarray(map_coordinates(padded, (points - fields.origin[j] + 1).T, order=1))


def covered(piece: Piece, fields: Fields, j: int) -> float:
    """Area of a piece that lies in cell j, in or next to a cube that reaches into its extent."""
    low, high = fields.origin[j] + fields.extent[j].T
    if not ((piece.corner >= low - 2) & (piece.corner <= high)).all():
        return 0.0
    at = piece.corner + piece.centre
    ends = np.array([[at, at] for _ in range(3)])
    for axis in range(3):
        ends[axis, :, axis] = piece.corner[axis] + np.array([0, 1])
    slope = np.diff([looked_up(fields, j, pair) for pair in ends])[:, 0]
    value = looked_up(fields, j, at[None])[0]
    along = slope - (slope @ piece.normal) * piece.normal
    rise = np.linalg.norm(along) * np.sqrt(piece.area)
    if rise < 1e-12:
        return piece.area * (value >= NEIGHBOUR_LEVEL)
    return piece.area * np.clip((value - NEIGHBOUR_LEVEL) / rise + 0.5, 0, 1)


def check_areas(way: str, fields: Fields) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Areas of the pairs, and of what any neighbour covers, which are those of plain geometry."""
    found, touched = np.full(len(PAIRS), 1e30), np.full(len(SHAPES), 1e30)
    work = make_work(fields, threads=3)
    taken(contacts, way)(SHARES, fields, LEVEL, NEIGHBOUR_LEVEL, NEIGHBOURS, work, found, touched)
    expected = [sum(covered(p, fields, j) for p in pieces(fields, i, LEVEL)) for i, j in PAIRS]
    union = [
        sum(
            max((covered(p, fields, j) for k, j in PAIRS if k == i), default=0)
            for p in pieces(fields, i, LEVEL)
        )
        for i in range(len(SHAPES))
    ]
    np.testing.assert_allclose(touched, union, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    return found, touched


@both_ways
@pytest.mark.parametrize("whole", [True, False])
@both_precisions
def test_contact_areas(way: str, dtype: type, whole: bool) -> None:
    found, _ = check_areas(way, with_extents(random_fields(6, dtype, whole), LOW_LEVEL))
    assert min(found[0], found[3]) > 10
    assert (found[[1, 2, 4, 5, 6]] == 0).all(), "contact with a cell far away or faint"


@both_ways
def test_where_two_neighbours_lie_on_one_piece_the_larger_contact_counts(way: str) -> None:
    fields = random_fields(6)
    put(fields.phi, fields, FAINT, np.random.default_rng(8).uniform(0, 1, SHAPES[FAINT]))
    found, touched = check_areas(way, with_extents(fields, LOW_LEVEL))
    apart = found[PAIRS.index((0, 1))], found[PAIRS.index((0, FAINT))]
    assert max(apart) + 5 < touched[0] < sum(apart) - 5


@both_ways
def test_a_cell_without_neighbours_is_skipped(way: str) -> None:
    fields = with_extents(random_fields(6))
    touched = np.full(len(SHAPES), 1e30)
    nobody = Neighbours(np.zeros(len(SHAPES) + 1, np.int64), np.zeros(0, np.int64))
    work = make_work(fields, threads=3)
    taken(contacts, way)(SHARES, fields, LEVEL, NEIGHBOUR_LEVEL, nobody, work, np.zeros(0), touched)
    assert (touched == 0).all()
    assert np.isnan(work.values).all()


@both_ways
def test_all_of_the_surface_within_a_larger_cell_is_in_contact(way: str) -> None:
    fields = random_fields(7, whole=True)
    put(fields.phi, fields, 1, 1)
    inner = np.zeros(SHAPES[0])
    inner[3, 3, 1] = 1  # its surface lies within the cubes of cell 1's box
    put(fields.phi, fields, 0, inner)
    with_extents(fields)
    found = np.zeros(len(PAIRS))
    work = make_work(fields, threads=3)
    taken(contacts, way)(
        SHARES, fields, LEVEL, NEIGHBOUR_LEVEL, NEIGHBOURS, work, found, np.zeros(len(SHAPES))
    )
    assert found[0] == pytest.approx(sum(p.area for p in pieces(fields, 0, LEVEL)))
    assert found[3] == 0
