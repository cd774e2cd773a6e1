"""Divisions that take time: the ring's balance of tensions, where cells go, runs, files, errors."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.ndimage import map_coordinates
from scipy.optimize import brentq

from morphosim import (
    AxialTension,
    Cell,
    CellChange,
    ContractileRing,
    Division,
    Duration,
    Numerics,
    Physics,
    Proliferation,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    StabilityWarning,
    Stage,
    load_scene,
    save_scene,
)
from morphosim.scene.stability import check, explicit_rates

STRONG = ContractileRing(strength=12.0)
RADIUS = 4.0
SLOWLY = Division(cell="P", daughters=("a", "b"), axis=(1, 0, 0), over=300.0)


def scene(*terms: Any, radius: float = RADIUS, **values: Any) -> Scene:
    """A cell P, and another one far away, so that all steps are of one compiled kind."""
    cells = [
        Cell(name="P", shape=Sphere(center=(0, 0, 0), radius=radius)),
        Cell(name="far", shape=Sphere(center=(0, 0, 40), radius=2.5)),
    ]
    given = {"physics": Physics(terms=list(terms)), "duration": 400.0} | values
    return Scene(cells=cells, numerics=Numerics.preset("fast", threads=1), **given)


def stages(*events: Any, lasting: float = 300.0, **values: Any) -> list[Stage]:
    """A stage with these events, and another one."""
    first = Stage(name="first", end=Duration(lasting), events=events, **values)
    return [first, Stage(name="second", end=Duration(20))]


def balanced_neck(chi: float, width: float, volume: float) -> float:
    """Radius of the neck of a free cell at rest, with surfaces without thickness.

    r(z) has γ κ_m + γ (1 + χ e) κ_t = p within the band, and goes on as a ball beyond it, where
    r / √(1 + r'²) = p r² / 2γ. Of the necks that give the volume the widest is stable.
    """

    def edge(neck: float, pressure: float) -> tuple[float, float, float]:
        def rates(z: float, state: NDArray) -> list[float]:
            r, slope, _ = state
            q, e = 1 + slope**2, (1 - (z / width) ** 2) ** 2
            return [slope, q**1.5 * ((1 + chi * e) / (r * np.sqrt(q)) - pressure), np.pi * r**2]

        found = solve_ivp(rates, (0, width), (neck, 0, 0), rtol=1e-8, atol=1e-9)
        r, slope, inside = found.y[:, -1]
        return r, slope, inside

    def open_at_the_pole(pressure: float, neck: float) -> float:
        r, slope, _ = edge(neck, pressure)
        return float(r / np.sqrt(1 + slope**2) - pressure / 2 * r**2)

    def too_large(neck: float) -> float:
        pressure = brentq(open_at_the_pole, 0.2 / neck, 4 / neck, (neck,))
        r, slope, inside = edge(neck, pressure)
        ball = 2 / pressure
        height = ball + np.copysign(np.sqrt(ball**2 - r**2), slope)
        return float(2 * (inside + np.pi * height**2 * (3 * ball - height) / 3) - volume)

    ball = (3 * volume / (4 * np.pi)) ** (1 / 3)
    return float(brentq(too_large, 0.6 * ball, 1.05 * ball))


def neck_radius(simulation: Simulation, axis: NDArray) -> float:
    """Mean distance from the middle of cell P to its surface, across the axis, µm."""
    field, spacing = simulation.field("P"), simulation.spacing
    across = np.cross(axis, (0.3, 0.5, 0.9))
    across /= np.linalg.norm(across)
    distances, radii = np.arange(0, 8, 0.02), []
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        way = np.cos(angle) * across + np.sin(angle) * np.cross(axis, across)
        points = simulation.centroids[0][:, None] + way[:, None] * distances
        phi = map_coordinates(field.phi, points / spacing - field.origin[:, None], order=3)
        k = int(np.argmax(phi < 0.5))
        radii.append(np.interp(0.5, phi[[k, k - 1]], distances[[k, k - 1]]))
    return float(np.mean(radii))


@pytest.mark.parametrize(
    ("chi", "width", "axis"),
    [(2.0, 1.5, (1, 0, 0)), (2.0, 1.2, (1, 2, 0.5)), (1.0, 2.5, (0, 1, 1))],
)
def test_a_weak_ring_comes_to_rest_where_tensions_balance(
    chi: float, width: float, axis: tuple[float, float, float]
) -> None:
    ring = ContractileRing(strength=chi, width=width)
    simulation = Simulation(scene(ring, radius=5.0))
    simulation.divide("P", ("a", "b"), axis=axis, over=2000)
    simulation.run(until=350)
    found = neck_radius(simulation, np.array(axis) / np.linalg.norm(axis))
    expected = balanced_neck(chi, width, float(simulation.core_volumes[0]))
    assert expected < 4.4
    np.testing.assert_allclose(found, expected, rtol=0.01)


@pytest.mark.parametrize("share", [0.5, 0.35])
def test_a_strong_ring_closes_the_neck_where_daughters_have_their_shares(share: float) -> None:
    """And pulls the cell nowhere, of which unequal halves are in danger."""
    simulation = Simulation(scene(STRONG))
    simulation.divide("P", ("a", "b"), axis=(1, 0, 0), fraction=share, over=300)
    before = simulation.volumes[0]
    while "P" in simulation.names:
        assert simulation.dividing == ["P"]
        assert abs(simulation.centroids[0]).max() < 0.5
        simulation.step()
    assert 20 < simulation.time < 200
    assert simulation.names == ["far", "a", "b"]
    np.testing.assert_allclose(simulation.volumes[1:].sum(), before, rtol=0.04)
    first, second = simulation.volumes[1:]
    np.testing.assert_allclose(first / (first + second), share, atol=0.01)
    gap = simulation.centroids[1, 0] - simulation.centroids[2, 0]
    assert gap > 1.25 * RADIUS  # of halves of a ball it is 0.75, of two balls 1.59
    assert [text for _, text in simulation.events] == ["furrow of P", "division of P into a and b"]


def test_a_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole = scene(STRONG, stages=stages(SLOWLY), save_every=20.0)
    unbroken = Simulation(whole)
    unbroken.run(observers=[RunWriter(tmp_path / "unbroken", 20.0)])
    broken = Simulation(whole)
    broken.run(until=20, observers=[RunWriter(tmp_path / "run", 20.0)])
    assert broken.dividing == ["P"]
    going_on = Simulation.from_run(tmp_path / "run")
    assert going_on.dividing == ["P"]
    going_on.run(observers=[RunWriter(tmp_path / "run", 20.0, resume=True)])
    assert going_on.names == unbroken.names == ["far", "a", "b"]
    for one, other in zip(going_on.fields, unbroken.fields, strict=True):
        np.testing.assert_array_equal(one.phi, other.phi)


def test_the_end_of_its_stage_cuts_a_cell() -> None:
    """However far it is; what comes after finds daughters."""
    first, second = stages(SLOWLY, lasting=10)
    named = CellChange(cells=["a"], values={"type": "late"})
    second = Stage(name="second", end=Duration(20), events=[named])
    simulation = Simulation(scene(STRONG, stages=[first, second]))
    simulation.run()
    assert simulation.time == 30
    assert simulation.names == ["far", "a", "b"]
    assert simulation.types == ["", "late", ""]


def test_the_time_that_it_may_take_is_over() -> None:
    simulation = Simulation(scene(ContractileRing(strength=0.5)))
    simulation.divide("P", ("a", "b"), axis=(1, 0, 0), over=10)
    simulation.run(until=30)
    assert simulation.names == ["far", "a", "b"]
    (_, _), (time, _) = simulation.events
    assert 10 <= time < 12


def test_cells_divide_by_rule_in_their_time() -> None:
    rule = Proliferation(age=30.0, axis=(0, 1, 0), over=300.0, types=["grows"])
    cells = [
        Cell(name=name, type=kind, shape=Sphere(center=(x, 0, 0), radius=RADIUS))
        for name, kind, x in (("P", "grows", 0), ("Q", "grows", 20), ("far", "", 50))
    ]
    life = Stage(name="life", end=Duration(120), rules=[rule], rules_every=10.0)
    simulation = Simulation(
        Scene(cells=cells, physics=Physics(terms=[STRONG]), stages=[life],
              numerics=Numerics.preset("fast", threads=1), duration=200.0)
    )  # fmt: skip
    simulation.run(until=45)
    assert simulation.dividing == ["P", "Q"]
    simulation.run(until=105)
    assert {"P.2", "P.3", "Q.2", "Q.3"} <= {*simulation.names, *simulation.parents}
    assert simulation.column("generation").max() >= 1
    assert 45 < simulation.column("born").max() < 105


def test_cells_that_die_or_are_removed_do_not_divide() -> None:
    simulation = Simulation(scene(STRONG))
    simulation.divide("P", ("a", "b"), axis=(1, 0, 0), over=50)
    simulation.divide("far", ("c", "d"), axis=(1, 0, 0), over=50)
    simulation.remove(["far"])
    assert simulation.dividing == ["P"]
    simulation.run(until=60)
    assert simulation.names == ["a", "b"]
    simulation.divide("a", ("c", "d"), axis=(0, 0, 1))  # names that are free again
    assert simulation.names == ["b", "c", "d"]


def test_it_is_the_same_wherever_faces_of_space_lie() -> None:
    """Also where a cell is carried back while it divides."""
    found = []
    for x in (0.0, 10.45, 21.45):
        cells = [Cell(name="P", shape=Sphere(center=(x, 0, 0), radius=RADIUS))]
        cells += [Cell(name="far", shape=Sphere(center=(x, 0, 16.5), radius=2.5))]
        simulation = Simulation(
            Scene(cells=cells, physics=Physics(terms=[STRONG]), period=(22.0, 22.0, 33.0),
                  numerics=Numerics.preset("fast", threads=1), duration=200.0)
        )  # fmt: skip
        simulation.divide("P", ("a", "b"), axis=(1, 0, 0), fraction=0.4, over=300)
        simulation.run(until=100)
        assert simulation.names == ["far", "a", "b"]
        places = simulation.centroids[:, 0] - x
        found.append((places, simulation.volumes, [time for time, _ in simulation.events]))
    for places, volumes, times in found[1:]:
        np.testing.assert_allclose(places, found[0][0], atol=2e-3)
        np.testing.assert_allclose(volumes, found[0][1], rtol=1e-3)
        assert times == found[0][2]


def test_a_file_says_it(tmp_path: Path) -> None:
    ring = ContractileRing(strength=6.0, strength_by_type={"soft": 3.0}, width=2.0)
    rule = Proliferation(volume=400.0, over=50.0)
    cells = [Cell(name="P", type="soft", shape=Sphere(center=(0, 0, 0), radius=RADIUS))]
    whole = Scene(
        cells=cells, physics=Physics(terms=[ring]), numerics=Numerics.preset("fast"),
        stages=stages(SLOWLY, rules=[rule]), duration=100.0,
    )  # fmt: skip
    save_scene(whole, tmp_path / "scene.toml")
    again = load_scene(tmp_path / "scene.toml")
    assert again.physics.terms == (ring,)
    assert again.stages[0].events[0].over == SLOWLY.over
    assert again.stages[0].rules == (rule,)


@pytest.mark.parametrize(
    ("events", "rules", "text"),
    [
        ([SLOWLY, Division(cell="P", daughters=("c", "d"), axis=(1, 0, 0))], [],
         "cell 'P' is dividing already, into 'a' and 'b'"),
        ([SLOWLY, CellChange(cells=["a"], values={"gamma": 0.3})], [], "cell = 'a'"),
        ([SLOWLY, Division(cell="far", daughters=("a", "d"), axis=(1, 0, 0))], [],
         "daughter 'a' of 'far': a cell has or had this name already"),
    ],
)  # fmt: skip
def test_what_cannot_be_fails_before_the_first_step(events: Any, rules: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Simulation(scene(STRONG, stages=stages(*events, rules=rules)))


@pytest.mark.parametrize("ring", [(), (ContractileRing(strength=0.0),)])
def test_without_a_ring_there_is_no_furrow(ring: tuple[ContractileRing, ...]) -> None:
    needed = "a division that takes time needs the force term contractile_ring"
    with pytest.raises(ValueError, match=needed):
        Simulation(scene(*ring, stages=stages(SLOWLY)))
    with pytest.raises(ValueError, match=f"proliferation: over: {needed}"):
        Simulation(scene(*ring, stages=stages(rules=[Proliferation(age=5.0, over=50.0)])))
    simulation = Simulation(scene(*ring))
    with pytest.raises(ValueError, match=needed):
        simulation.divide("P", ("a", "b"), axis=(1, 0, 0), over=10)
    assert simulation.dividing == []


def test_a_division_that_fails_leaves_the_simulation_as_it_was() -> None:
    simulation = Simulation(scene(STRONG))
    given: dict[str, Any] = {"axis": (1, 0, 0), "over": 50.0}
    for wrong, text in (
        ({"over": -1.0}, "over = -1.0 is not allowed"),
        ({"axis": (0, 0, 0)}, "has no direction"),
        ({"fraction": 1.5}, "fraction = 1.5 is not allowed"),
        ({"volumes": (100.0, lambda time: 100.0)}, "cannot wait for the furrow"),
    ):
        with pytest.raises(ValueError, match=text):
            simulation.divide("P", ("a", "b"), **(given | wrong))
    assert simulation.dividing == []
    assert simulation.events == []
    simulation.divide("P", ("a", "b"), **given)
    with pytest.raises(ValueError, match="cell 'P' is dividing already"):
        simulation.divide("P", ("c", "d"), **given)
    with pytest.raises(ValueError, match="a cell has or had this name already"):
        simulation.divide("far", ("a", "d"), **given)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"strength": -1.0}, "contractile_ring.strength = -1.0 is not allowed"),
        ({"strength": 21.0}, "contractile_ring.strength = 21.0 is not allowed"),
        ({"width": 0.0}, "contractile_ring.width = 0.0 is not allowed"),
        ({"strength_by_type": {"soft": np.nan}}, r"_by_type\['soft'\] = nan is not"),
    ],
)  # fmt: skip
def test_bad_values(values: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        ContractileRing(**values)


def test_a_narrow_band_is_told_of() -> None:
    with pytest.warns(StabilityWarning, match="contractile_ring.width = 0.8 µm is too narrow"):
        check(scene(ContractileRing(width=0.8)), 1.0)


def test_explicit_steps_know_how_stiff_it_is() -> None:
    """As stiff as tension along an axis, which has one direction of three, too."""
    numerics = Numerics.preset("published")
    rates = []
    for term in (ContractileRing(strength=4.0), AxialTension(chi=4.0, direction=(1, 0, 0))):
        cells = [Cell(name="P", shape=Sphere(center=(0, 0, 0), radius=RADIUS))]
        whole = Scene(cells=cells, physics=Physics(terms=[term]), numerics=numerics, duration=10.0)
        rates.append(explicit_rates(whole)[term.name])
    assert rates[0] == rates[1] > 1
