"""Attraction: its matrix against the rules said plainly, and what kernels are told of it."""

from itertools import product
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from morphosim import Attraction
from morphosim.cell_table import CellTable
from morphosim.engine.interactions import Interactions

CELLS, TYPES, MOTHERS = list("abcdef"), ["", "S", "W"], ["", "P", "Q"]
Cells = tuple[list[str], list[str], list[str]]
"""Names, types and mothers."""

sigmas = st.sampled_from([0.0, 0.25, 0.5, 1.0]) | st.floats(0, 10)


def tables(names: list[str]) -> st.SearchStrategy[dict[tuple[str, str], float]]:
    """σ of some pairs of these."""
    return st.dictionaries(st.tuples(*[st.sampled_from(names)] * 2), sigmas, max_size=6)


attractions = st.builds(
    Attraction,
    default=sigmas,
    sisters=st.none() | sigmas,
    types=tables(TYPES),
    pairs=tables(CELLS).map(lambda table: {k: v for k, v in table.items() if k[0] != k[1]}),
)


@st.composite
def some_cells(draw: st.DrawFn) -> Cells:
    """One to six cells in any order."""
    names = draw(st.lists(st.sampled_from(CELLS), min_size=1, unique=True))
    few = st.lists(st.sampled_from(TYPES), min_size=len(names), max_size=len(names))
    mothers = st.lists(st.sampled_from(MOTHERS), min_size=len(names), max_size=len(names))
    return names, draw(few), draw(mothers)


def by_the_rules(sigma: Attraction, j: int, i: int, cells: Cells) -> float:
    """σ[j, i]: a pair of cells, else sisters, else a pair of types, else the default."""
    (name_j, name_i), (type_j, type_i), (mother_j, mother_i) = ((row[j], row[i]) for row in cells)
    if i == j:
        return 0.0
    for pair in ((name_j, name_i), (name_i, name_j)):
        if pair in sigma.pairs:
            return sigma.pairs[pair]
    if sigma.sisters is not None and mother_j == mother_i != "":
        return sigma.sisters
    for pair in ((type_j, type_i), (type_i, type_j)):
        if pair in sigma.types:
            return sigma.types[pair]
    return sigma.default


def told_to_kernels(sigma: Attraction, cells: Cells) -> NDArray[np.float64]:
    """σ[j, i] as kernels add it up: the pull of the types and the weights of pairs."""
    names, types, mothers = cells
    table = CellTable()
    table.add({"name": names, "parent": mothers}, types)
    told = Interactions(sigma, 1.6, (), table, table, np.float64)
    kinds = told.interaction.types
    result = told.interaction.pull[np.ix_(kinds, kinds)] * (told.n_fields > 0)
    if told.pairs is not None:
        for i in range(len(names)):
            for k in range(told.pairs.start[i], told.pairs.start[i + 1]):
                result[told.pairs.cell[k], i] += told.pairs.weight[k]
    np.fill_diagonal(result, 0)  # a cell does not feel itself; kernels take it out
    return result


@given(attractions, some_cells())
def test_the_matrix_follows_the_rules(sigma: Attraction, cells: Cells) -> None:
    n = len(cells[0])
    expected = np.reshape(
        [by_the_rules(sigma, j, i, cells) for j, i in product(range(n), repeat=2)], (n, n)
    )
    np.testing.assert_array_equal(sigma.matrix(*cells), expected)


@given(attractions, some_cells())
def test_kernels_are_told_the_matrix(sigma: Attraction, cells: Cells) -> None:
    expected = sigma.matrix(*cells)
    np.testing.assert_allclose(told_to_kernels(sigma, cells), expected, rtol=1e-12, atol=1e-14)


@given(attractions, some_cells(), st.data())
def test_among_says_the_same_of_those_who_stay(
    sigma: Attraction, cells: Cells, data: st.DataObject
) -> None:
    n = len(cells[0])
    stay = sorted(data.draw(st.sets(st.integers(0, n - 1), min_size=1)))
    rest = tuple([row[k] for k in stay] for row in cells)
    kept = sigma.among(rest[0], rest[1])
    np.testing.assert_array_equal(kept.matrix(*rest), sigma.matrix(*cells)[np.ix_(stay, stay)])
    kept.check(rest[0], rest[1])


@given(attractions, some_cells())
def test_the_strongest_bounds_the_matrix(sigma: Attraction, cells: Cells) -> None:
    assert sigma.matrix(*cells).max() <= sigma.strongest(cells[1])


@given(st.data(), st.lists(st.sampled_from(CELLS), min_size=1, unique=True))
def test_a_matrix_comes_back(data: Any, names: list[str]) -> None:
    n = len(names)
    values = data.draw(st.lists(sigmas, min_size=n * n, max_size=n * n))
    matrix = np.reshape(values, (n, n))
    found = Attraction.from_matrix(names, matrix).matrix(names)
    np.testing.assert_array_equal(found, np.where(np.eye(n, dtype=bool), 0, matrix))
