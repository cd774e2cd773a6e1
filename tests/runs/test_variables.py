"""Variables: declared once, saved, and read by whoever does not know them; a user's own too."""

import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from morphosim import (
    Cell,
    Duration,
    Numerics,
    Physics,
    RunWriter,
    SaveError,
    Scene,
    Simulation,
    Sphere,
    Stage,
    export,
    measured,
    open_run,
)
from morphosim.measure.variable import MEASURED, PER_CELL, PER_TIME
from morphosim.runs.measured_state import MeasuredState, built_in_variables, variables
from morphosim.runs.schema import CONTACT_LIST, CONTACT_MATRIX, FIELDS, PARENT
from morphosim.scene.events import Division

from ..helpers import adopt_save

PAGE = Path(__file__).resolve().parents[2] / "docs" / "runs.md"
CELL = {"dims": ("time", "cell"), "units": "1", "text": "a number"}


pytestmark = pytest.mark.usefixtures("own_variables")


def scene(**options: Any) -> Scene:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=4), type=kind)
        for name, x, kind in (("a", 0.0, "soft"), ("b", 7.5, "stiff"))
    ]
    return Scene(**({"cells": cells, "duration": 12.0, "save_every": 4.0} | options),
                 numerics=Numerics(threads=1))  # fmt: skip


def dividing() -> Scene:
    """The second of two stages begins with the division of "a"."""
    division = Division(cell="a", daughters=("p", "q"), axis=(0, 1, 0))
    stages = (
        Stage(name="one", end=Duration(4)),
        Stage(name="two", end=Duration(8), events=[division]),
    )
    return scene(stages=stages, duration=100.0, physics=Physics(kappa=0.05))


def declare_four() -> None:
    """One of each kind."""

    @measured(dims=("time", "cell"), units="1", text="largest phi of the cell")
    def peak(state: MeasuredState) -> list[float]:
        return [field.phi.max() for field in state.fields]

    @measured(dims=("time", "cell", "axis"), units="um", text="size of the box")
    def box_size(state: MeasuredState) -> Any:
        return state["box_high"] - state["box_low"]

    @measured(dims=("time", "cell"), text="type and name", kind=str)
    def full_name(state: MeasuredState) -> list[str]:
        return [f"{kind} {name}" for kind, name in zip(state["type"], state.names, strict=True)]

    @measured(dims="time", units="1", text="number of contacts", kind="i4")
    def n_contacts(state: MeasuredState) -> int:
        return len(state.shapes.contacts)


# --- built-in ------------------------------------------------------------------------------------


def test_the_page_lists_all_variables() -> None:
    page = PAGE.read_text(encoding="utf-8")
    rows = dict(
        re.findall(r"^\| ((?:time|cell|box|image)[a-z, ]*) \| (.*) \|$", page, re.MULTILINE)
    )
    named = {along: re.findall(r"`(\w+)(?:\[box\])?`", text) for along, text in rows.items()}
    assert set(named["time"]) == {n for n, v in variables().items() if v.dims == PER_TIME}
    assert set(named["time, cell"]) == {n for n, v in variables().items() if v.dims[:2] == PER_CELL}
    assert named["cell"] == list(PARENT)
    contacts = {*CONTACT_MATRIX, *CONTACT_LIST, "contact"}
    assert set(named["time, cell, neighbour"]) == contacts
    assert set(named["box, sample"]) >= set(FIELDS)


def test_files_say_what_is_declared(tmp_path: Path) -> None:
    Simulation(scene()).run(until=0, observers=[RunWriter(tmp_path, 4)])
    path = tmp_path / "save-000000.nc"
    with netCDF4.Dataset(path) as file:
        assert [name for name in file.variables if name in MEASURED] == list(variables(scene()))
    with xr.open_dataset(path) as save:
        for name, variable in variables(scene()).items():
            assert save[name].dims == variable.dims
            assert save[name].attrs == variable.attributes


def test_a_value_that_two_variables_share_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, calls = Simulation(scene()), []
    passes = simulation.measured
    monkeypatch.setattr(simulation, "measured", lambda: calls.append("all") or passes())
    state = MeasuredState(simulation)
    assert state["step"] == 0
    assert calls == []
    assert set(state.table) == set(variables(scene()))
    assert calls == ["all"]
    assert state["volume"] is state["volume"]
    with pytest.raises(
        ValueError, match=r"variable = 'volum' is not known; .*did you mean 'volume'"
    ):
        state["volum"]


def test_a_writer_of_a_scene_saves_as_it_says(tmp_path: Path) -> None:
    writer = RunWriter.of(scene(save_fields="none", save_labels=True, save_every=6.0), tmp_path)
    assert (writer.directory, writer.every, writer.fields) == (tmp_path, 6.0, "none")
    assert (writer.labels, writer.resume) == (True, False)


# --- a user's own --------------------------------------------------------------------------------

READ = """
import sys
import numpy as np
from morphosim import Simulation, RunWriter, open_run, pack
from morphosim.measure.variable import MEASURED
assert "peak" not in MEASURED
folder = sys.argv[1]
simulation = Simulation.from_run(folder)
simulation.run(observers=[RunWriter.of(simulation.scene, folder, resume=True)])
pack(folder, folder + ".nc")
for path in (folder, folder + ".nc"):
    with open_run(path) as run:
        assert run["time"].values.tolist() == [0, 4, 8, 12]
        assert run["cell"].values.tolist() == ["a", "b", "p", "q"]
        assert run["peak"].dims == ("time", "cell")
        assert run["peak"].attrs == {"units": "1", "long_name": "largest phi of the cell"}
        there = [[True, True, False, False]] * 2 + [[False, True, True, True], [False] * 4]
        assert np.isfinite(run["peak"].values).tolist() == there
        assert np.isfinite(run["box_size"].values[..., 0]).tolist() == there
        assert run["full_name"].attrs == {"long_name": "type and name"}
        names = [["soft a", "stiff b", "", ""], ["", "stiff b", "soft p", "soft q"], [""] * 4]
        assert run["full_name"].values[1:].tolist() == names
        np.testing.assert_array_equal(run["n_contacts"].values, [1, 1, 3, np.nan])
"""


def test_variables_of_a_user_are_read_by_who_does_not_know_them(tmp_path: Path) -> None:
    declare_four()
    folder = tmp_path / "run"
    simulation = Simulation(dividing())
    simulation.run(until=8, observers=[RunWriter.of(simulation.scene, folder)])
    with open_run(folder) as run:
        names = [field.name for field in simulation.fields]
        peaks = [field.phi.max() for field in simulation.fields]
        assert run["peak"].isel(time=-1).sel(cell=names).values.tolist() == peaks
        assert run["n_contacts"].dtype == np.int32
    done = subprocess.run(
        [sys.executable, "-c", READ, str(folder)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    with open_run(folder) as run:
        export(run, tmp_path / "tables", to="csv")
    header = (tmp_path / "tables" / "cells.csv").read_text().splitlines()[0].split(",")
    assert {"peak", "box_size_x", "full_name"} <= set(header)


def test_the_example_of_the_page_works() -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (code,) = [block for block in blocks if "@measured" in block]
    exec(code, {"__name__": "script"})
    state = MeasuredState(Simulation(scene()))
    np.testing.assert_array_less(0.99, state["peak"])
    assert state["soft_volume"] == state["volume"][0]


def test_a_variable_may_use_another_of_the_user(tmp_path: Path) -> None:
    @measured(**CELL)
    def half(state: MeasuredState) -> Any:
        return state["whole"] / 2

    @measured(**CELL)
    def whole(state: MeasuredState) -> Any:
        return state["volume"]

    state = MeasuredState(Simulation(scene()))
    np.testing.assert_array_equal(half(state), state["volume"] / 2)
    assert list(state.table)[-5:] == ["half", "whole", "stage", "events", "type"]
    assert set(variables(scene())) - set(built_in_variables()) == {"half", "whole"}


def test_a_function_may_be_declared_again() -> None:
    for factor in (1, 2):

        @measured(**CELL)
        def again(state: MeasuredState, factor: int = factor) -> Any:
            return factor * state["volume"]

    state = MeasuredState(Simulation(scene()))
    np.testing.assert_array_equal(state["again"], 2 * state["volume"])


def test_another_form_of_a_variable_is_refused_where_a_run_goes_on(tmp_path: Path) -> None:
    declare_four()
    chosen = scene()
    Simulation(chosen).run(until=4, observers=[RunWriter.of(chosen, tmp_path)])
    del MEASURED["peak"]

    @measured(dims="time", units="1", text="largest phi of all")
    def peak(state: MeasuredState) -> float:
        return max(field.phi.max() for field in state.fields)

    message = (
        r"'peak' is declared as numbers of \(time\) and is numbers of \(time, cell\) in .*0001"
    )
    with pytest.raises(ValueError, match=message):
        Simulation.from_run(tmp_path).run(observers=[RunWriter.of(chosen, tmp_path, resume=True)])
    Simulation(chosen).run(until=0, observers=[RunWriter.of(chosen, tmp_path / "other")])
    adopt_save(tmp_path / "other" / "save-000000.nc", tmp_path / "save-000002.nc", 8.0, 4)
    with pytest.raises(
        ValueError, match=r"'peak' is numbers of \(time, cell\) in .* and numbers of"
    ):
        open_run(tmp_path)


def value(given: Any) -> Callable[[MeasuredState], Any]:
    def wrong(state: MeasuredState) -> Any:
        return given

    return wrong


@pytest.mark.parametrize(
    ("dims", "given", "message"),
    [
        (("time", "cell"), [1.0], r"'wrong' has shape \(1,\); expected \(2,\), along cell"),
        (("time", "cell", "axis"), [1.0, 2.0],
         r"'wrong' has shape \(2,\); expected \(2, 3\), along cell, axis"),
        ("time", [1.0], r"'wrong' has shape \(1,\); expected \(\), a single value"),
        ("time", "many", "'wrong' holds <U4, not numbers of 'f8'; convert"),
        ("time", None, "'wrong' holds object, not numbers of 'f8'"),
        ("time", 1j, "'wrong' holds complex128, not numbers of 'f8'"),
        (("time", "cell"), [[1.0], [1.0, 2.0]], "'wrong' is no array: setting an array"),
    ],
)  # fmt: skip
def test_a_value_that_does_not_fit_is_told(dims: Any, given: Any, message: str) -> None:
    measured(dims=dims, units="1", text="a number")(value(given))
    with pytest.raises(ValueError, match=message) as caught:
        MeasuredState(Simulation(scene()))["wrong"]
    assert "\n" not in str(caught.value)


def test_a_number_is_no_text() -> None:
    measured(dims="time", text="a text", kind=str)(value(3.0))
    with pytest.raises(ValueError, match="variable 'wrong' holds float64, not texts"):
        MeasuredState(Simulation(scene()))["wrong"]


def test_a_function_that_fails_ends_the_run_and_loses_no_save(tmp_path: Path) -> None:
    @measured(**CELL)
    def late(state: MeasuredState) -> Any:
        return state["volume"] / (0 if state["time"] > 6 else 1) if state["time"] < 8 else 1 // 0

    @measured(**CELL)
    def later(state: MeasuredState) -> Any:
        return state["late"]

    simulation = Simulation(scene())
    message = (
        r"cannot save t = 8 in .*: variable 'late' cannot be computed at t = 8: "
        r"ZeroDivisionError: .* All 2 saves before are whole. Correct its function"
    )
    with pytest.raises(SaveError, match=message) as caught:
        simulation.run(observers=[RunWriter.of(simulation.scene, tmp_path)])
    assert "\n" not in str(caught.value)
    del MEASURED["late"], MEASURED["later"]
    again = Simulation.from_run(tmp_path)
    assert again.time == 8  # the state was saved
    again.run(observers=[RunWriter.of(again.scene, tmp_path, resume=True)])
    with open_run(tmp_path) as run:
        assert run["time"].values.tolist() == [0, 4, 8, 12]
        assert np.isfinite(run["late"].values).all(axis=1).tolist() == [True, True, False, False]
    assert not list(tmp_path.glob("*.partial"))


def test_a_variable_that_asks_for_itself_is_told() -> None:
    @measured(**CELL)
    def circle(state: MeasuredState) -> Any:
        return state["circle"]

    with pytest.raises(ValueError, match=r"variable 'circle' cannot be computed .*RecursionError"):
        MeasuredState(Simulation(scene()))["circle"]


def named(name: str) -> Callable[[Any], Any]:
    def function(state: Any) -> Any:
        return state

    function.__name__ = name
    return function


@pytest.mark.parametrize(
    ("options", "name", "error", "message"),
    [
        ({}, "volume", ValueError, "variable 'volume' is there already, in morphosim.runs"),
        ({}, "sphericity", ValueError, "'sphericity' is there already, in morphosim.measure"),
        ({}, "phi", ValueError, "variable 'phi' is there already, in files of runs; give"),
        ({}, "sample", ValueError, "variable 'sample' is there already, in files of runs; give"),
        ({}, "<lambda>", ValueError, "variable '<lambda>' needs a name"),
        ({"dims": ("time", "cel")}, "x", ValueError,
         "dimension of variable 'x' = 'cel' is not known; .*did you mean 'cell'"),
        ({"dims": ("cell",)}, "x", ValueError, r"dims of variable 'x' = \('cell',\) is"),
        ({"dims": ()}, "x", ValueError, r"dims of variable 'x' = \(\) is not allowed"),
        ({"dims": ("time", "cell", "cell")}, "x", ValueError, "variable 'x': 'cell' occurs twice"),
        ({"kind": "f2"}, "x", ValueError, "kind of variable 'x' = 'f2' is not known"),
        ({"kind": "i4"}, "x", ValueError, "kind of variable 'x' = 'i4' is not allowed along"),
        ({"kind": str}, "x", ValueError, "units of variable 'x' = '1' is not allowed: a text has"),
        ({"units": None}, "x", TypeError, "units of variable 'x' = None is not a text; give"),
        ({"text": None}, "x", TypeError, "text of variable 'x' = None is not a text"),
    ],
)  # fmt: skip
def test_what_cannot_be_declared_is_refused(
    options: dict, name: str, error: type[Exception], message: str
) -> None:
    before = dict(MEASURED)
    with pytest.raises(error, match=message) as caught:
        measured(**(CELL | options))(named(name))
    assert "\n" not in str(caught.value)
    assert before == MEASURED


def test_only_functions_are_declared() -> None:
    with pytest.raises(TypeError, match="is not of type function"):
        measured(**CELL)(partial(max, 3))
