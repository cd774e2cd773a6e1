"""How many lattice points the cells of a scene take, told before anything is laid out."""

from morphosim.geometry.phase_field import check_memory, lattice_corners
from morphosim.scene.scene import Scene


def lattice_points(scene: Scene) -> list[float]:
    """Number of lattice points of the box that each cell starts in.

    Raises
    ------
    ValueError
        A cell lies too far out for the lattice.
    """
    scale, spacing = scene.physics.interface_scale, scene.numerics.spacing
    corners = [
        lattice_corners(c.shape, c.name, scale, spacing, c.start_volume) for c in scene.cells
    ]
    return [float((last - first + 1.0).prod()) for first, last in corners]


def check_size(scene: Scene) -> None:
    """Raise ValueError if the cells do not fit into memory, or those to which they shall grow."""
    count, points, most = len(scene.cells), lattice_points(scene), scene.most_cells
    what = f"cell {scene.names[0]!r} takes" if count == 1 else f"the {count} cells take"
    check_memory(what, points, scene.numerics.spacing)
    if most > count:
        what = f"the {most} cells to which a stage goes on, as large as those of the start, take"
        check_memory(what, points + [sum(points) / count] * (most - count), scene.numerics.spacing)
