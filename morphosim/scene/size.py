"""How many lattice points the cells of a scene take, told before anything is laid out."""

from morphosim.geometry.phase_field import (
    NEGLIGIBLE,
    START_BYTES,
    check_memory,
    lattice_corners,
)
from morphosim.numerics.parameters import Numerics
from morphosim.scene.scene import Scene

FIELDS = {"linearised": 2, "bdf2": 2}
"""Fields of each cell that schemes keep, of those that keep more than φⁿ."""
PACKED = 0.6
"""Share of its tail to which φ of a cell comes within a tissue, where others press (measured:
0.63 among 10 000 cells of the scene `spheroid`)."""


def point_bytes(numerics: Numerics) -> int:
    """Bytes of a lattice point in the fields of its cell; with a tolerance, steps take one more."""
    fields = FIELDS.get(numerics.scheme, 1) + (numerics.tolerance is not None)
    return fields * (8 if numerics.precision == "double" else 4)


def lattice_points(scene: Scene, least: float = NEGLIGIBLE) -> list[float]:
    """Number of lattice points of the box that each cell starts in, where φ exceeds `least`.

    Raises
    ------
    ValueError
        A cell lies too far out for the lattice.
    """
    scale, spacing = scene.physics.interface_scale, scene.numerics.spacing
    corners = [
        lattice_corners(c.shape, c.name, scale, spacing, c.start_volume, least) for c in scene.cells
    ]
    return [float((last - first + 1.0).prod()) for first, last in corners]


def check_size(scene: Scene) -> None:
    """Raise ValueError if the cells do not fit into memory, or those to which they shall grow."""
    numerics, count, most = scene.numerics, len(scene.cells), scene.most_cells
    each, start = point_bytes(numerics), START_BYTES * max(lattice_points(scene))
    what = f"cell {scene.names[0]!r} takes" if count == 1 else f"the {count} cells take"
    kept = sum(lattice_points(scene, numerics.box_tolerance**PACKED))
    check_memory(what, kept, each * kept + start, numerics.spacing)
    if most > count:
        what = f"the {most} cells to which a stage goes on, as large as those of the start, take"
        then = kept * most / count
        check_memory(what, then, each * then + start, numerics.spacing)
