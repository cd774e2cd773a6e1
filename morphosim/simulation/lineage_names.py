"""Names that cells get by numbers: a.2 and a.3 are daughters of a, and k has 2 k and 2 k + 1.

No name is given twice: a founder's name is unique, and so is a number among its descendants. So
none of these names need be remembered.
"""

from collections.abc import Collection, Iterable, Sequence

from morphosim import _validate
from morphosim.cell_table import CellTable
from morphosim.scene.events.proliferation import NUMBERED


def daughters_of(
    names: Sequence[str], cells: CellTable, used: Collection[str]
) -> list[tuple[str, str]]:
    """Names of the daughters of cells, by number.

    Raises
    ------
    ValueError
        Cells have no `generation`, or a name is taken.
    """
    _validate.choice(
        "divide_cells without names: state of the cells that it needs (from the rule Proliferation "
        "in a stage of the scene, or an event with its columns)", "generation", cells.columns,
    )  # fmt: skip
    pairs = []
    for name in names:
        founder, number = _place(name, int(cells["generation"][cells.row(name)]))
        first, second = f"{founder}.{2 * number}", f"{founder}.{2 * number + 1}"
        for daughter in (first, second):
            if daughter in used or cells.has(daughter):
                message = (
                    f"daughter {daughter!r} of {name!r}: a cell has or had this name already; "
                    "give cells names that do not end in a number after a point"
                )
                raise ValueError(message)
        pairs.append((first, second))
    return pairs


def check_stated(name: str, mother: str, cells: CellTable) -> None:
    """Raise ValueError if a stated name of a daughter may be one that is given by number."""
    if "generation" in cells and NUMBERED.fullmatch(name):
        message = (
            f"daughter {name!r} of {mother!r}: names that end in a number after a point are given "
            "by the rule of proliferation; take another one"
        )
        raise ValueError(message)


def stated(names: Iterable[str], generations: Iterable[int]) -> set[str]:
    """Those of the names of cells that are not given by number."""
    return {
        name for name, generation in zip(names, generations, strict=True)
        if _place(name, generation) == (name, 1)
    }  # fmt: skip


def _place(name: str, generation: int) -> tuple[str, int]:
    """Founder of a cell, and its number among her descendants; herself is number 1."""
    found = NUMBERED.fullmatch(name) if generation else None
    return (name, 1) if found is None else (found["founder"], int(found["number"]))
