"""The scenes that accuracy and stability are measured on."""

from morphosim import BoxWalls, Cell, Ellipsoid, Physics, Scene, Sphere, built_in_scene


def relaxing() -> Scene:
    """One free cell, from an ellipsoid towards a ball."""
    shape = Ellipsoid(center=(0.0, 0.0, 0.0), semi_axes=(6.0, 4.0, 3.0))
    return Scene(cells=[Cell(name="cell", shape=shape)], name="relaxing")


def adhering(distance: float = 8.3, radius: float = 4.0) -> Scene:
    """Two free cells that adhere and flatten each other."""
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0.0, 0.0), radius=radius))
        for name, x in (("left", 0.0), ("right", distance))
    ]
    return Scene(cells=cells, physics=Physics(sigma=0.5), name="adhering")


def walled() -> Scene:
    """Two adhering cells of R = 4 µm in a box in which they must flatten."""
    walls = BoxWalls(lower=(-4.1, -3.6, -3.7), upper=(12.3, 3.8, 3.6))
    pair = adhering()
    return Scene(cells=pair.cells, physics=pair.physics, confinement=walls, name="walled")


def embryo() -> Scene:
    """Eight cells of the C. elegans embryo in their eggshell."""
    return built_in_scene("celegans-8")
