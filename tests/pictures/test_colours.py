"""Colours: the same in every save, apart where cells touch, and what a legend says."""

import tracemalloc

import numpy as np
import pytest
import xarray as xr

from morphosim.pictures.colours import cell_colours, colouring_by_save
from morphosim.pictures.lineages import founders
from morphosim.pictures.palettes import GREY, interpolated, rgb

from .made import PAIR, Ball, all_touch, crowd, made_run

AT = (5.0, 5.0, 5.0)


def test_cells_that_touch_have_colours_that_differ() -> None:
    names = list(crowd(8))
    run = made_run([crowd(8)], all_touch(names))
    colours = np.array(list(cell_colours(run).colours.values()))
    distances = np.linalg.norm(colours[:, None] - colours[None], axis=2)
    assert distances[np.triu_indices(8, 1)].min() > 0.2


def test_a_cell_keeps_its_colour() -> None:
    run = made_run([PAIR, {"high": Ball(AT)}])
    before, after = cell_colours(run, 0).colours, cell_colours(run, 10).colours
    assert after == {"high": before["high"]}


def test_types_are_of_the_time_and_their_colours_of_the_run() -> None:
    run = made_run([{"a": Ball(AT, type="R")}, {"a": Ball(AT, type="G"), "b": Ball(AT)}])
    first, last = cell_colours(run, 0, "type"), cell_colours(run, 10, "type")
    assert [text for text, _ in first.legend] == ["R"]
    assert dict(last.legend) == {"G": last.colours["a"], "no type": GREY}
    assert first.colours["a"] != last.colours["a"]


def test_given_colours_are_taken_and_those_of_other_runs_passed_over() -> None:
    chosen = {"R": "#d55e00", "G": (0.0, 0.5, 0.0), "B": "#0072b2"}
    colours = cell_colours(made_run([PAIR]), by="type", colours=chosen).colours
    assert colours == {"low": rgb("#d55e00"), "high": (0.0, 0.5, 0.0)}


def test_volume_errors_are_on_a_scale_with_white_at_0() -> None:
    run = made_run([{"small": Ball(AT, error=-4), "right": Ball(AT), "large": Ball(AT, error=4)}])
    colouring = cell_colours(run, by="volume")
    assert colouring.scale is not None
    assert (colouring.scale.low, colouring.scale.high) == (-5, 5)
    small, right, large = (np.array(rgb) for rgb in colouring.colours.values())
    assert right.min() > 0.9
    assert small[2] > small[0] + 0.3  # blue
    assert large[0] > large[2] + 0.3  # red


def test_cells_without_a_target_are_grey() -> None:
    run = made_run([{"a": Ball(AT, error=-4), "b": Ball(AT)}])
    run["target_volume"].loc[{"cell": "a"}] = np.nan
    assert cell_colours(run, by="volume").colours["a"] == GREY


def test_numbers_of_cells_are_on_the_scale_of_all_saves() -> None:
    run = made_run([{"a": Ball(AT)}, {"a": Ball(AT), "b": Ball(AT), "c": Ball(AT)}])
    values = [[1.0, np.nan, np.nan], [3.0, 5.0, np.nan]]
    run["sphericity"] = (("time", "cell"), np.array(values), {"units": "um2"})
    first, last = cell_colours(run, 0, "sphericity"), cell_colours(run, 10, "sphericity")
    assert first.title == "sphericity, µm²"
    assert first.scale == last.scale
    assert first.scale is not None
    assert (first.scale.low, first.scale.high) == (1, 5)
    assert [text for _, text in first.scale.ticks] == ["1", "2", "3", "4", "5"]
    stops = first.scale.stops
    assert first.colours == {"a": interpolated(stops, 0)}
    assert last.colours == {"a": interpolated(stops, 0.5), "b": interpolated(stops, 1), "c": GREY}
    run["sphericity"][:] = 2.0
    assert cell_colours(run, 10, "sphericity").scale is not None, "all alike"


def test_marks_of_a_scale_are_round_and_those_of_whole_numbers_whole() -> None:
    run = made_run([{"a": Ball(AT), "b": Ball(AT), "c": Ball(AT)}])

    def marks(*values: float) -> list[str]:
        run["generation"] = (("time", "cell"), np.array([values]))
        scale = cell_colours(run, by="generation").scale
        assert scale is not None
        return [text for _, text in scale.ticks]

    assert marks(0, 1, 1) == ["0", "1"]
    assert marks(0, 3, 13) == ["0", "5", "10"]
    assert marks(2, 2, 2) == ["2"]
    assert marks(0.0003, 0.04, 0.084) == ["0.02", "0.04", "0.06", "0.08"]
    assert marks(-0.2, 0.1, 0.3) == ["−0.2", "−0.1", "0", "0.1", "0.2", "0.3"]


def test_stages_are_those_in_which_cells_appear() -> None:
    run = made_run([{"a": Ball(AT)}, {"a": Ball(AT), "b": Ball(AT)}], stages=["one", "two"])
    colouring = cell_colours(run, by="stage")
    assert dict(colouring.legend) == {
        "one": colouring.colours["a"], "two": colouring.colours["b"],
    }  # fmt: skip


def test_founders_of_the_embryo_have_the_same_colours_in_every_run() -> None:
    early = cell_colours(made_run([{"AB": Ball(AT), "P1": Ball(AT)}]), by="lineage")
    late = cell_colours(made_run([dict.fromkeys(("MSa", "ABal", "Z2"), Ball(AT))]), by="lineage")
    assert early.colours["AB"] == late.colours["ABal"]
    assert early.colours["P1"] == late.colours["Z2"]
    assert [text for text, _ in late.legend] == ["AB", "MS", "P"]


def test_other_cells_have_the_colour_of_their_first_ancestor() -> None:
    parents = {"left": "top", "right": "top"}
    run = made_run(
        [{"top": Ball(AT)}, dict.fromkeys(("left", "right", "new"), Ball(AT))], None, None, parents
    )
    colours = cell_colours(run, by="lineage").colours
    assert colours["left"] == colours["right"] != colours["new"]


def test_mothers_that_go_round_in_a_circle_end() -> None:
    parents = {"own": "own", "one": "two", "two": "three", "three": "one"}
    run = made_run([dict.fromkeys(parents, Ball(AT))], None, None, parents)
    assert founders(run) == {"own": "own", "one": "three", "two": "one", "three": "two"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"by": "sort"}, "by = 'sort' is not known"),
        ({"by": "type", "colours": {"X": "#000000"}}, "colours of type = 'X' is not known"),
        ({"by": "type", "colours": {"R": "red"}}, "colour = 'red' is not of the form"),
        ({"by": "type", "colours": {"R": (0, 0, 2)}}, "colour = 2.0 is not allowed"),
        ({"by": "volume", "colours": {"R": "#000000"}}, "colours has no effect"),
    ],
)
def test_errors(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cell_colours(made_run([PAIR]), **options)


@pytest.mark.parametrize("by", ["pressure", "volume", "type", "stage"])
def test_memory_of_colours_does_not_grow_with_the_saves(by: str) -> None:
    shape, names = (60, 400), [f"c{k}" for k in range(400)]
    run = xr.Dataset(
        {
            "volume": (("time", "cell"), np.linspace(1, 2, 24000).reshape(shape)),
            "target_volume": (("time", "cell"), np.ones(shape)),
            "pressure": (("time", "cell"), np.linspace(0, 1, 24000).reshape(shape)),
            "type": (("time", "cell"), np.full(shape, "A")),
            "stage": ("time", np.full(60, "S")),
        },
        {"time": np.arange(60.0), "cell": names},
    )

    def peak(count: int) -> int:
        of_save = colouring_by_save(run, range(60), by)
        tracemalloc.start()
        for save in range(count):
            assert len(of_save(save).colours) == 400
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    assert peak(60) < 2.5 * peak(1)
