"""Events: divisions, removals, differentiation and changes of a running simulation."""

from typing import Any

import numpy as np
import pytest

from morphosim import (
    Attraction,
    Cell,
    CellChange,
    Differentiation,
    Division,
    Numerics,
    Physics,
    PhysicsChange,
    Removal,
    Scene,
    Simulation,
    Sphere,
    VolumeCourse,
)
from morphosim.measure.contacts import contact_areas


def ball(name: str, x: float = 0.0, radius: float = 5.0, **options: Any) -> Cell:
    return Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=radius), **options)


def start(*cells: Cell, **physics: Any) -> Simulation:
    numerics = Numerics(threads=1)
    return Simulation(Scene(cells=cells, physics=Physics(**physics), numerics=numerics))


def test_a_division_conserves_mass_and_gives_each_daughter_its_share() -> None:
    simulation = start(ball("m", gamma=0.3, type="soft"), ball("n", 12.0))
    simulation.step(5)
    before, memory = simulation.volumes.copy(), simulation.engine.nbytes
    Division(cell="m", daughters=("a", "b"), axis=(0, 0, 2), fraction=0.6).apply(simulation)
    assert simulation.names == ["n", "a", "b"]
    kept = simulation.volumes + simulation.engine.lost_volume
    assert kept[1:].sum() == pytest.approx(before[0], rel=1e-6)
    assert kept[1] / before[0] == pytest.approx(0.6, abs=1e-3)
    assert simulation.engine.nbytes < 2.5 * memory
    assert simulation.centroids[1, 2] > simulation.centroids[2, 2] + 3
    assert [c.parent for c in simulation.cells[1:]] == ["m", "m"]
    assert [c.type for c in simulation.cells[1:]] == ["soft", "soft"]
    assert [c.gamma for c in simulation.cells[1:]] == [0.3, 0.3]
    np.testing.assert_allclose(simulation.targets[1:], 523.6 * np.array([0.6, 0.4]), rtol=1e-4)
    assert simulation.column("fresh").tolist() == [False, True, True], "n keeps its history"
    simulation.step(20)
    np.testing.assert_allclose(simulation.volumes, simulation.targets, rtol=0.1)


def test_daughters_of_a_division_keep_what_is_stated() -> None:
    simulation = start(ball("m", volume=500.0))
    simulation.divide("m", ("a", "b"), axis=(1, 0, 0), types=("x", "y"), volumes=(300.0, 210.0))
    assert [c.type for c in simulation.cells] == ["x", "y"]
    assert simulation.targets.tolist() == [300, 210]


def test_sisters_and_pairs_attract_after_a_division_as_stated() -> None:
    sigma = Attraction(default=0.5, sisters=0.0)
    simulation = start(ball("m"), ball("n", 9.0), sigma=sigma)
    simulation.divide("m", ("a", "b"), axis=(0, 1, 0))
    found = sigma.matrix(simulation.names, parents=[c.parent for c in simulation.cells])
    np.testing.assert_array_equal(found, [[0, 0.5, 0.5], [0.5, 0, 0], [0.5, 0, 0]])
    assert simulation.parents == ["", "m", "m"]
    stated = start(ball("m"), ball("n", 9.0), sigma=0.5)
    stated.divide("m", ("a", "b"), axis=(0, 1, 0))
    stated.change_physics(sigma=Attraction(default=0.5, pairs={("a", "b"): 0.0}))
    for one in (simulation, stated):
        one.step(10)
    np.testing.assert_array_equal(simulation.centroids, stated.centroids)


def test_noise_of_daughters_is_their_own() -> None:
    simulation = start(ball("m"), ball("n", 20.0), kappa=0.3)
    simulation.divide("m", ("a", "b"), axis=(0, 0, 1))
    simulation.divide("a", ("c", "d"), axis=(0, 1, 0))
    assert len(set(simulation.column("id").tolist())) == 4


def test_noise_belongs_to_cells_wherever_they_stand_in_the_table() -> None:
    fewer, all_of_them = (start(ball("m"), ball("n", 60.0), kappa=0.3) for _ in range(2))
    fewer.remove(["m"])
    for simulation in (fewer, all_of_them):
        simulation.step(5)
    np.testing.assert_array_equal(fewer.centroids[0], all_of_them.centroids[1])


def test_names_do_not_come_again() -> None:
    simulation = start(ball("m"), ball("n", 12.0))
    simulation.divide("m", ("a", "b"), axis=(0, 0, 1))
    simulation.remove(["a"])
    for name in ("a", "m"):
        with pytest.raises(ValueError, match=f"daughter '{name}' of 'n': a cell has or had this"):
            simulation.divide("n", (name, "c"), axis=(0, 0, 1))
    assert simulation.names == ["n", "b"]


def test_courses_of_volumes_end_with_their_cells() -> None:
    """By division, by removal, and by another volume."""
    courses = VolumeCourse(times=[0, 100], volumes=[500, 700])
    simulation = start(*(ball(name, 12.0 * k, volume=courses) for k, name in enumerate("mno")))
    simulation.step(2)
    now = simulation.targets[0]
    assert 500 < now < 520
    simulation.divide("m", ("a", "b"), axis=(0, 0, 1), fraction=0.4)
    simulation.remove(["n"])
    simulation.change_cells(["o"], volume=450.0)
    simulation.step(5)
    np.testing.assert_allclose(simulation.targets, [450, 0.4 * now, 0.6 * now], rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"cell": "x"}, "cell = 'x' is not known"),
        ({"daughters": ("n", "b")}, "daughter 'n' of 'm': a cell has or had this name"),
    ],
)
def test_divisions_that_cannot_be(options: dict, error: str) -> None:
    simulation = start(ball("m"), ball("n", 12.0))
    event = Division(**({"cell": "m", "daughters": ("a", "b"), "axis": (0, 0, 1)} | options))
    with pytest.raises(ValueError, match=error):
        event.apply(simulation)
    assert simulation.names == ["m", "n"]


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"axis": (0, 0, 0)}, "has no direction"),
        ({"daughters": ("a",)}, "expected 2 texts, not 1"),
        ({"daughters": ("a", "a")}, "occurs twice"),
        ({"daughters": ("m", "b")}, "occurs twice"),
        ({"fraction": 0.0}, "fraction = 0.0 is not allowed"),
        ({"volumes": (1.0, -1.0)}, "volumes = -1.0 is not allowed"),
        ({"volumes": (1.0,)}, r"volumes = \(1.0,\); expected 2 numbers, not 1"),
        ({"types": "xy"}, "types = 'xy' is not a list of texts"),
        ({"types": [1, 2]}, r"types\[0\] = 1; expected a text"),
        ({"daughters": "xy"}, "daughters = 'xy' is not a list of texts"),
        ({"cell": "m\0"}, "control character"),
    ],
)
def test_divisions_are_checked_when_made(options: dict, error: str) -> None:
    with pytest.raises((TypeError, ValueError), match=error):
        Division(**({"cell": "m", "daughters": ("a", "b"), "axis": (0, 0, 1)} | options))


def test_removal_by_name_and_by_rule() -> None:
    simulation = start(ball("a"), ball("b", 12.0), ball("c", 24.0), ball("d", 36.0))
    simulation.step(2)

    def beyond(simulation: Simulation) -> list[str]:
        x = simulation.centroids[:, 0]
        return [name for name, at in zip(simulation.names, x, strict=True) if at > 30]

    Removal(cells=["b"], rule=beyond).apply(simulation)
    assert simulation.names == ["a", "c"]
    assert [name for _, name in simulation.removed] == ["d", "b"]
    assert not simulation.column("fresh").any()
    with pytest.raises(ValueError, match="all 2 cells would be removed"):
        simulation.remove(["a", "c"])


def test_removal_by_place_and_without_contact_to_the_aggregate() -> None:
    balls = [ball(name, x) for name, x in zip("abcde", (0, 9, 18, 40, 70), strict=True)]
    simulation = start(*balls, sigma=0.5)
    simulation.step(3)
    Removal(below={"x": 5.0}, above={"x": 60.0}, isolated=True).apply(simulation)
    assert simulation.names == ["b", "c"]
    assert [text for _, text in simulation.events] == [
        "removal of e", "removal of a", "removal of d",
    ]  # fmt: skip
    with pytest.raises(ValueError, match="'w' is not known"):
        Removal(below={"w": 1.0})


def test_differentiation_by_contact() -> None:
    simulation = start(
        ball("r1", type="red"),
        ball("g", 9.5, type="green"),
        ball("r2", 25.0, type="red"),
        sigma=0.5,
    )
    simulation.step(5)
    Differentiation(of="red", touching="green", into="blue").apply(simulation)
    assert [c.type for c in simulation.cells] == ["blue", "green", "red"]
    Differentiation(of="blue", touching="green", into="red", area=1e3).apply(simulation)
    assert [c.type for c in simulation.cells] == ["blue", "green", "red"]


def test_contacts_with_several_neighbours_add_up() -> None:
    simulation = start(
        ball("g1", -9.5, type="green"),
        ball("r", type="red"),
        ball("g2", 9.5, type="green"),
        sigma=0.5,
    )
    simulation.step(5)
    one, other = contact_areas(simulation.fields, simulation.spacing).values()
    least = one + 0.5 * other
    assert least > max(one, other)
    Differentiation(of="green", touching="green", into="blue").apply(simulation)
    Differentiation(of="red", touching="red", into="blue").apply(simulation)
    assert simulation.types == ["green", "red", "green"]
    Differentiation(of="red", touching="green", into="blue", area=1.01 * (one + other)).apply(
        simulation
    )
    assert simulation.types == ["green", "red", "green"]
    Differentiation(of="red", touching="green", into="blue", area=least).apply(simulation)
    assert simulation.types == ["green", "blue", "green"]


def test_changes_act_as_if_the_scene_had_been_so() -> None:
    changed = start(ball("a"), ball("b", 9.5))
    CellChange(cells=["a"], values={"gamma": 0.5, "volume": 350.0}).apply(changed)
    PhysicsChange(values={"sigma": 0.5, "g": 2.0}).apply(changed)
    given = start(ball("a", gamma=0.5, volume=350.0), ball("b", 9.5), sigma=0.5, g=2.0)
    for simulation in (changed, given):
        simulation.step(10)
    np.testing.assert_array_equal(changed.volumes, given.volumes)
    np.testing.assert_array_equal(changed.centroids, given.centroids)


def test_a_change_of_cells_keeps_their_history() -> None:
    changed, plain = (start(ball("a"), ball("b", 9.5), sigma=0.5) for _ in range(2))
    for simulation in (changed, plain):
        simulation.step(5)
    changed.change_cells(["a"], type="x")  # which no force depends on
    changed.change_cells(["b"], type="")  # as it was
    changed.change_physics(sigma=Attraction(default=0.5))
    assert [text for _, text in changed.events] == ["change of type of a"]
    for simulation in (changed, plain):
        simulation.step(5)
    np.testing.assert_array_equal(changed.centroids, plain.centroids)
    changed.change_cells(["a"], frozen=True)
    assert changed.column("fresh").tolist() == [True, False]


def test_other_physics_and_a_thaw_forget_the_history() -> None:
    """The next step is of first order, for which nothing may be left of the one before."""

    def remembers(simulation: Simulation) -> list[bool]:
        pool = simulation.engine.pool
        return [bool(pool.box(row, pool.history).any()) for row in range(len(simulation.names))]

    simulation = start(ball("a"), ball("b", 9.5), sigma=0.5)
    simulation.step(5)
    assert remembers(simulation) == [True, True]
    simulation.change_cells(["a"], frozen=True)
    assert remembers(simulation) == [False, True]
    simulation.change_physics(g=2.0)
    assert remembers(simulation) == [False, False]
    assert simulation.column("fresh").tolist() == [True, True]


def test_changes_are_checked() -> None:
    with pytest.raises(ValueError, match="'size' is not known"):
        CellChange(cells=["a"], values={"size": 3})
    with pytest.raises(ValueError, match="'gama' is not known"):
        PhysicsChange(values={"gama": 0.3})
    simulation = start(ball("a"))
    with pytest.raises(ValueError, match="'size' is not known"):
        simulation.change_cells(["a"], size=3)
    with pytest.raises(ValueError, match=r"physics\.tau"):
        simulation.change_physics(tau=-1.0)
    with pytest.raises(ValueError, match="'gama' is not known"):
        simulation.change_physics(gama=0.3)
    assert simulation.physics == Physics()


def test_stated_pairs_that_no_longer_hold() -> None:
    """The pool of pairs' potentials is there still, and no longer used."""
    pairs = Attraction(default=0.2, pairs={("a", "b"): 0.9})
    simulation = start(ball("a"), ball("b", 10.0), sigma=pairs)
    simulation.step(3)
    simulation.change_physics(sigma=0.2)
    simulation.step(3)
    assert np.isfinite(simulation.volumes).all()
