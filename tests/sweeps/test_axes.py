"""Axes: which members they make, and what is refused."""

import numpy as np
import pytest

from morphosim.sweeps.axes import Axis, Range

from .scenes import plan


def test_a_grid_has_every_combination_the_last_axis_fastest() -> None:
    made = plan({"physics.gamma": np.array([0.2, 0.3]), "numerics.dt": [1.0, 2.0, 4.0]})
    assert made.sizes == {"physics.gamma": 2, "numerics.dt": 3}
    assert [m.number for m in made.members] == list(range(6))
    assert made.members[4].settings == {"physics.gamma": 0.3, "numerics.dt": 2.0}


def test_an_axis_sets_several_keys_and_parts_of_a_value() -> None:
    axis = Axis(
        values=[0.5],
        sets={"physics.g": "{value}", "physics.sigma.pairs": [["EMS", "P2", "{value}"]]},
    )
    (member,) = plan({"w": axis}, fixed={"physics.gamma": 0.3}).members
    assert member.settings == {
        "physics.gamma": 0.3, "physics.g": 0.5, "physics.sigma.pairs": [["EMS", "P2", 0.5]],
    }  # fmt: skip


def test_replicates_count_seeds_from_the_scenes() -> None:
    made = plan({"physics.kappa": [0.1, 0.2]}, replicates=3, seed=5)
    assert made.sizes == {"physics.kappa": 2, "replicate": 3}
    assert [m.settings["numerics.seed"] for m in made.members] == [5, 6, 7, 5, 6, 7]
    assert made.coordinates()["seed"][1].tolist() == [5, 6, 7]


@pytest.mark.parametrize("sampling", ["sobol", "latin"])
def test_samples_fill_each_range_evenly(sampling: str) -> None:
    axes = {
        "physics.gamma": Range(low=0.1, high=0.9),
        "physics.g": Range(low=1.0, high=100.0, log=True),
        "numerics.dt": [1.0, 2.0],
    }
    made = plan(axes, samples=8, sampling=sampling, sample_seed=3)
    assert made.sizes == {"numerics.dt": 2, "sample": 8}
    gamma, g = (np.array(made.ranges[name]) for name in ("physics.gamma", "physics.g"))
    for share in ((gamma - 0.1) / 0.8, np.log10(g) / 2):
        assert sorted(np.floor(share * 8)) == list(range(8))
    again = plan(axes, samples=8, sampling=sampling, sample_seed=3)
    assert again.ranges == made.ranges
    assert plan(axes, samples=8, sampling=sampling, sample_seed=4).ranges != made.ranges


def test_coordinates_are_numbers_texts_or_json() -> None:
    values = {"a": [1, 2], "b": ["x", "y"], "c": [[1, 2], [3, 4]], "d": [True, False]}
    found = {name: c[1].tolist() for name, c in plan(values).coordinates().items()}
    assert found == {
        "a": [1, 2], "b": ["x", "y"], "c": ["[1, 2]", "[3, 4]"], "d": ["true", "false"],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("axes", "options", "expected"),
    [
        ({}, {}, "axes is empty"),
        ({"physics.gamma": []}, {}, "'physics.gamma' = []"),
        ({"physics.gamma": 0.3}, {}, "expected a list"),
        ({"physics.gamma": [0.3, 0.3]}, {}, "occurs twice"),
        ({"physics.gamma": [{1, 2}]}, {}, "scene file cannot say"),
        ({"numerics.threads": [1, 2]}, {}, "threads_per_member"),
        ({"physics.gamma": [0.3]}, {"fixed": {"physics.gamma": 0.2}}, "and so do overrides"),
        ({"numerics.seed": [1]}, {"replicates": 2}, "and so do replicates"),
        ({"physics.gamma": [0.3], "x": Axis(values=[1], sets="physics.gamma")}, {}, "axis 'x'"),
        ({"x": Axis(values=[1], sets={"physics.gamma": 2})}, {}, "does not occur"),
        ({"physics.gamma": Range(low=0.1, high=1)}, {}, "go together"),
        ({"physics.gamma": [0.3]}, {"samples": 4}, "no axis is a range"),
        ({"physics.gamma": Range(low=2, high=1)}, {"samples": 4}, "high = 1"),
        ({"physics.gamma": Range(low=0, high=1, log=True)}, {"samples": 4}, "low of a log"),
        ({"physics.gamma": Range(low=0.1, high=1)}, {"samples": 12}, "take 8 or 16"),
        ({"physics.gamma": Range(low=0.1, high=1)}, {"samples": 4, "sampling": "halton"}, "'latin"),
        ({"physics.gamma": [0.3]}, {"replicates": 0}, "replicates = 0"),
    ],
)
def test_what_makes_no_scan_is_refused(axes: dict, options: dict, expected: str) -> None:
    with pytest.raises(ValueError, match=r"axis|axes|range|sampl|replicates") as caught:
        plan(axes, **options)
    assert expected in str(caught.value)
