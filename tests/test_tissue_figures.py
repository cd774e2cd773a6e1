"""Figures of tissues, by known values: growth, pair correlation, neighbours, profiles, clones."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from numpy.typing import NDArray

from morphosim import accessor, export  # noqa: F401  every Dataset has .morpho
from morphosim.measure.tissue import pair_correlation, region_of, tissue_region

Real = NDArray[np.float64]


def in_ball(count: int, radius: float, space: int = 3) -> Real:
    """Random points of uniform density in a ball or a disk."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(count, space))
    points /= np.linalg.norm(points, axis=1)[:, None]
    return np.asarray(points * radius * rng.random((count, 1)) ** (1 / space))


def hexagonal(radius: float) -> Real:
    """Triangular lattice of spacing 1 in a disk, whose points have six neighbours each."""
    i, j = np.mgrid[-40:41, -40:41].reshape(2, -1)
    points = np.stack([i + j / 2, j * np.sqrt(3) / 2], axis=1)
    return points[np.linalg.norm(points, axis=1) < radius]


def truncated_octahedra(radius: float) -> Real:
    """Centres of Kelvin's cells, body-centred cubic of spacing 1: 14 neighbours, 8 and 6."""
    grid = np.mgrid[-12:13, -12:13, -12:13].reshape(3, -1).T
    points = np.concatenate([grid, grid + 0.5]) * 1.0
    return points[np.linalg.norm(points, axis=1) < radius]


def tissue(
    centroids: Real, volumes: Real | None = None, reach: float = 0.0, **variables: Real
) -> xr.Dataset:
    """Run with one save of these cells, of volume 1; those within reach of each other touch."""
    from scipy.spatial import cKDTree

    count = len(centroids)
    pairs = cKDTree(centroids).query_pairs(reach, output_type="ndarray").astype(np.int32)
    per_cell = {"volume": np.ones(count) if volumes is None else volumes} | variables
    return xr.Dataset(
        {
            "centroid": (("time", "cell", "axis"), centroids[None]),
            **{name: (("time", "cell"), values[None]) for name, values in per_cell.items()},
        },
        {
            "time": [0.0],
            "cell": [f"c{k}" for k in range(count)],
            "contact_time": ("contact", np.zeros(len(pairs), np.int32)),
            "contact_cell": ("contact", pairs[:, 0]),
            "contact_neighbour": ("contact", pairs[:, 1]),
            "contact_pair_area": ("contact", np.ones(len(pairs))),
        },
    )


def lived() -> xr.Dataset:
    """Three saves: a and b; a.2, a.3 and b; a.2, a.6, a.7, b.4 to b.7, of which b.4 dies.

    Mothers b.2 and b.3 have come and gone between two saves.
    """
    names = ["a", "b", "a.2", "a.3", "a.6", "a.7", "b.4", "b.5", "b.6", "b.7"]
    parents = ["", "", "a", "a", "a.3", "a.3", "b.2", "b.2", "b.3", "b.3"]
    volume = np.full((4, len(names)), np.nan)
    volume[0, :2] = 2, 4
    volume[1, 1:4] = 4, 2, 2
    volume[2, [2, *range(4, 10)]] = 4, 2, 2, 3, 3, 3, 3
    volume[3, [2, 4, 5, 7, 8, 9]] = 8, 4, 4, 6, 6, 6
    area = np.zeros((4, 10, 10), np.float32)
    for i, j in ((2, 4), (2, 5), (4, 5), (6, 7), (7, 8), (5, 9)):
        area[2, [i, j], [j, i]] = 1
    return xr.Dataset(
        {
            "volume": (("time", "cell"), volume),
            "target_volume": (("time", "cell"), 1.25 * volume),
            "contact_area": (("time", "cell", "neighbour"), area),
        },
        {"time": [0.0, 10.0, 20.0, 30.0], "cell": names, "neighbour": names,
         "parent": ("cell", parents)},
    )  # fmt: skip


@pytest.mark.parametrize("space", [2, 3])
def test_random_points_in_a_ball_are_not_correlated(space: int) -> None:
    points = in_ball(4000, 1.0, space)
    region = region_of(points, np.pi * (1 if space == 2 else 4 / 3))
    assert region is not None
    g, pairs = pair_correlation(region, np.linspace(0, 1.2, 13))
    np.testing.assert_allclose(g, 1, atol=0.03)
    assert pairs.sum() < 4000 * 3999 / 2
    # Without the correction of edges the last bin would be below a half.
    shell = (1.2**space - 1.1**space) * 4000 * 3999 / 2
    assert pairs[-1] / shell < 0.5


def test_random_points_in_a_long_box_are_not_correlated() -> None:
    points = np.random.default_rng(0).random((4000, 3)) * [4, 1, 2]
    region = region_of(points, 8.0)
    assert region is not None
    assert region.volume == pytest.approx(8, rel=1e-3)
    np.testing.assert_allclose(pair_correlation(region, np.linspace(0, 1, 6))[0][1:], 1, atol=0.04)


def test_a_lattice_has_its_peaks_and_coordination_numbers() -> None:
    """In a cubic one 6 neighbours at 1, 12 at √2, 8 at √3, and none between."""
    grid = np.mgrid[-12:13, -12:13, -12:13].reshape(3, -1).T * 1.0
    points = grid[np.linalg.norm(grid, axis=1) < 11.2]
    region = region_of(points, len(points))
    assert region is not None
    edges = np.array([0.5, 0.95, 1.05, 1.36, 1.46, 1.68, 1.78])
    g, _ = pair_correlation(region, edges)
    neighbours = g * np.diff(4 / 3 * np.pi * edges**3)
    np.testing.assert_allclose(neighbours, [0, 6, 0, 12, 0, 8], rtol=0.02)


def test_region_of_a_ball_of_cells() -> None:
    centres = truncated_octahedra(6.0)
    region = tissue_region(centres, np.full(len(centres), 0.5))
    assert region is not None
    assert region.volume == pytest.approx(len(centres) / 2, rel=1e-5)
    assert region.spacing == pytest.approx(0.5 ** (1 / 3), rel=1e-5)
    radius = (3 * region.volume / 4 / np.pi) ** (1 / 3)
    depth = radius - np.linalg.norm(centres, axis=1)
    np.testing.assert_allclose(region.depth, depth, atol=0.3)
    assert region.depth.min() > 0


def test_one_layer_counts_in_its_plane() -> None:
    sheet = hexagonal(8.0)
    tilted = np.stack([sheet[:, 0], 0.6 * sheet[:, 1], 0.8 * sheet[:, 1]], axis=1)
    region = tissue_region(tilted, np.ones(len(tilted)))
    assert region is not None
    assert region.points.shape == (len(sheet), 2)
    assert region.spacing == pytest.approx((np.sqrt(3) / 2) ** 0.5, rel=0.03)
    g = tissue(tilted).morpho.pair_correlation(bins=30, furthest=3.0)
    assert g["distance"].values[g["g"].values.argmax()] == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize(
    "centres", [np.zeros((0, 3)), np.eye(3), np.arange(5.0)[:, None] * [1, 2, 3]],
    ids=["none", "three", "line"],
)  # fmt: skip
def test_few_cells_span_no_tissue(centres: Real) -> None:
    found = tissue(centres, radial_position=np.zeros(len(centres))).morpho
    assert np.isnan(found.pair_correlation(bins=3)["g"]).all()
    inner = found.neighbour_distribution(inner=True)
    assert int(inner["cells"]) == 0
    assert np.isnan(inner["mean"])
    assert int(found.profile("volume", against="depth")["cells"].sum()) == 0
    assert int(found.profile("volume")["cells"].sum()) == len(centres)


def test_a_hollow_tissue_has_the_hull_of_its_centres() -> None:
    """Cells on a sphere fill less than it; all lie on its sides."""
    centres = in_ball(500, 1.0)
    centres /= np.linalg.norm(centres, axis=1)[:, None]
    region = tissue_region(centres, np.full(500, 1e-3))
    assert region is not None
    assert region.volume == pytest.approx(4 / 3 * np.pi, rel=0.05)
    np.testing.assert_allclose(region.depth, 0, atol=1e-9)
    g, pairs = pair_correlation(region, np.linspace(0, 2, 11))
    assert np.isfinite(g).all()
    assert pairs.sum() == 500 * 499 / 2
    # On a sphere pairs are spread evenly over r²: in the hull near ones are too many.
    np.testing.assert_allclose(pairs / pairs.sum(), np.diff(np.linspace(0, 1, 11) ** 2), atol=0.01)
    assert g[0] == pytest.approx(2.5, rel=0.2)


@pytest.mark.parametrize(
    ("centres", "reach", "known"),
    [
        (np.pad(hexagonal(9.0), ((0, 0), (0, 1))), 1.01, 6),
        (truncated_octahedra(5.0), 1.01, 14),
    ],
    ids=["sheet", "kelvin"],
)
def test_inner_cells_have_the_neighbours_of_their_packing(
    centres: Real, reach: float, known: int
) -> None:
    run = tissue(centres, np.full(len(centres), 0.5), reach)
    everyone = run.morpho.neighbour_distribution()
    inner = run.morpho.neighbour_distribution(inner=True)
    assert int(everyone["cells"]) == len(centres)
    assert float(everyone["mean"]) < 0.95 * known
    assert float(everyone["share"].sum()) == pytest.approx(1)
    assert len(centres) / 4 < int(inner["cells"]) < len(centres)
    assert float(inner["mean"]) == pytest.approx(known, rel=0.02)
    assert float(inner["share"].sel(neighbours=known)) > 0.9
    assert float(run.morpho.neighbour_distribution(least_area=1.5)["mean"]) == 0


def test_profile_is_of_bins_of_distance() -> None:
    centres = in_ball(2000, 10.0)
    radius = np.linalg.norm(centres, axis=1)
    volumes = np.full(2000, 4 / 3 * np.pi * 1000 / 2000)
    run = tissue(centres, volumes, pressure=2 * radius, radial_position=radius)
    run["pressure"].attrs |= {"units": "1", "long_name": "pressure"}
    along = run.morpho.profile("pressure", bins=5)
    np.testing.assert_allclose(along["radius"], radius.max() * (np.arange(5) + 0.5) / 5)
    edges = radius.max() * np.arange(6) / 5
    expected = 2 * 3 / 4 * np.diff(edges**4) / np.diff(edges**3)
    np.testing.assert_allclose(along["mean"], expected, rtol=0.02, atol=0.5)
    assert int(along["cells"].sum()) == 2000
    assert along["mean"].attrs == {"units": "1", "long_name": "mean of pressure"}
    deep = run.morpho.profile("pressure", against="depth", bins=5)
    np.testing.assert_allclose(deep["mean"], 2 * (10 - deep["depth"]), atol=1)
    assert deep["depth"].attrs["units"] == "um"


def test_growth_curve() -> None:
    run = lived()
    found = run.morpho.growth()
    np.testing.assert_array_equal(found["cells"], [2, 3, 7, 6])
    np.testing.assert_array_equal(found["volume"], [6, 8, 20, 34])
    np.testing.assert_array_equal(found["target_volume"], 1.25 * found["volume"])
    times = np.linspace(0, 100, 6)
    doubling = xr.Dataset(
        dict.fromkeys(("volume", "target_volume"), (("time", "cell"), 2 ** (times / 50)[:, None])),
        {"time": times, "cell": ["a"]},
    )
    np.testing.assert_allclose(np.log(2) / doubling.morpho.growth()["growth_rate"], 50)


def test_clones_follow_mothers_also_those_that_no_save_has() -> None:
    run = lived()
    found = run.morpho.clones(20)
    assert found["clone"].values.tolist() == ["a", "b"]
    np.testing.assert_array_equal(found["cells"], [3, 4])
    np.testing.assert_array_equal(found["volume"], [8, 12])
    np.testing.assert_array_equal(found["pieces"], [1, 2])  # b.7 touches a.7 alone
    assert found["clone_of"].values.tolist() == [*"abaaaabbbb"]
    every = run.morpho.clones(run["time"])
    np.testing.assert_array_equal(every["cells"], [[1, 1], [2, 1], [3, 4], [3, 3]])


def test_clones_of_ancestors_at_a_time() -> None:
    found = lived().morpho.clones(since=10)
    assert found["clone"].values.tolist() == ["b", "a.2", "a.3"]
    np.testing.assert_array_equal(found["cells"], [3, 1, 2])
    assert found["clone_of"].values.tolist() == ["", *("b", "a.2", *["a.3"] * 3), *["b"] * 4]


def test_clones_by_named_mothers() -> None:
    run = lived()
    table = {"a.2": "left", "a.3": "E", "a.6": "Ea", "a.7": "Ep"}
    names = [table.get(name, name) for name in run["cell"].values]
    mothers = [table.get(name, name) for name in run["parent"].values]
    named = run.assign_coords(cell=names, neighbour=names, parent=("cell", mothers))
    assert named.morpho.clones()["clone_of"].values.tolist() == [*"abaaaabbbb"]


def test_contacts_are_the_same_from_a_matrix_and_a_list() -> None:
    run = lived()
    i, j = np.nonzero(np.triu(run["contact_area"][2]))
    listed = run.drop_vars(["contact_area", "neighbour"]).assign_coords(
        contact_time=("contact", np.full(len(i), 2, np.int32)),
        contact_cell=("contact", i), contact_neighbour=("contact", j),
        contact_pair_area=("contact", np.ones(len(i))),
    )  # fmt: skip
    for figure in ("clones", "neighbour_distribution"):
        one, other = (getattr(each.morpho, figure)([20, 30]) for each in (run, listed))
        xr.testing.assert_identical(one, other)


def test_several_times_are_along_time() -> None:
    run = lived()
    found = run.morpho.neighbour_distribution(run["time"])
    assert found["share"].dims == ("time", "neighbours")
    np.testing.assert_array_equal(found["time"], run["time"])
    np.testing.assert_allclose(found["mean"], [0, 0, 12 / 7, 0])
    one = run.morpho.neighbour_distribution(20)
    xr.testing.assert_identical(one["mean"], found["mean"].sel(time=20))
    assert run.morpho.neighbour_distribution([20, 20.1])["mean"].sizes == {"time": 1}


def test_every_figure_says_its_units_and_meaning() -> None:
    centres = truncated_octahedra(3.0)
    run = tissue(centres, target_volume=np.ones(len(centres)),
                 radial_position=np.linalg.norm(centres, axis=1))  # fmt: skip
    run = run.assign_coords(parent=("cell", [""] * len(centres)))
    morpho = run.morpho
    figures = (
        morpho.growth(), morpho.pair_correlation(), morpho.neighbour_distribution(),
        morpho.profile("volume"), morpho.clones(),
    )  # fmt: skip
    for figure in figures:
        for name, values in figure.data_vars.items():
            assert {"units", "long_name"} <= values.attrs.keys(), name
            for dim in values.dims:
                assert dim == "time" or figure[dim].attrs["long_name"], dim


def test_export_has_a_table_of_each_figure(tmp_path: Path) -> None:
    run = lived()
    run["centroid"] = ("time", "cell", "axis"), np.random.default_rng(0).random((4, 10, 3))
    run["radial_position"] = run["volume"] / 2
    run.coords["stage"] = "time", ["growth"] * 4
    paths = export(run, tmp_path / "out", "tissue", [20, 30])
    tables = {path.stem: pd.read_csv(path) for path in paths}
    assert [*tables] == ["growth", "pair_correlation", "neighbours", "profiles", "clones"]
    assert all(table["time"].unique().tolist() == [20, 30] for table in tables.values())
    assert tables["growth"].columns.tolist() == [
        "time", "cells", "volume", "target_volume", "growth_rate",
    ]  # fmt: skip
    assert tables["growth"]["cells"].tolist() == [7, 6]
    assert tables["clones"].query("time == 20 and clone == 'b'")["pieces"].item() == 2
    assert tables["profiles"]["variable"].unique().tolist() == ["volume"]
    assert sorted(tables["neighbours"]["inner"].unique()) == [False, True]


@pytest.mark.parametrize(
    ("figure", "options", "told"),
    [
        ("profile", {"name": "presure"}, "presure.* is not known; .*did you mean 'pressure'"),
        ("profile", {"name": "type"}, "variable per time and cell = 'type' is not known"),
        ("profile", {"name": "pressure", "against": "height"}, "against = 'height' is not known"),
        ("profile", {"name": "pressure", "bins": 0}, "bins = 0 is not allowed"),
        ("pair_correlation", {"furthest": 0}, "furthest = 0 is not allowed"),
        ("pair_correlation", {"bins": 0}, "bins = 0 is not allowed"),
        ("pair_correlation", {"bins": 10**9}, "bins = 1000000000 is not allowed: .* <= 10000"),
        ("neighbour_distribution", {"least_area": -1}, "least_area = -1 is not allowed"),
        ("neighbour_distribution", {"time": 50}, "time = 50: the run has no save near it"),
        ("neighbour_distribution", {"time": []}, "time is empty"),
        ("clones", {"since": 50}, "time = 50: the run has no save near it"),
        ("growth", {}, "no variable 'target_volume'"),
    ],
)
def test_bad_input_is_told(figure: str, options: dict, told: str) -> None:
    run = tissue(np.eye(3), pressure=np.ones(3)).assign_coords(type=(("time", "cell"), [["a"] * 3]))
    with pytest.raises(ValueError, match=told):
        getattr(run.morpho, figure)(**options)


def test_inner_is_a_flag() -> None:
    with pytest.raises(TypeError, match="inner = 'no' is not true or false"):
        tissue(np.eye(3)).morpho.neighbour_distribution(inner="no")
