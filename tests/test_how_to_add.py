"""What docs/architecture.md says of adding things, done."""

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from morphosim import (
    Cell,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    export,
    load_scene,
    open_run,
    save_scene,
)
from morphosim.exports.formats import FORMATS, Format
from morphosim.measure.variable import MEASURED
from morphosim.numerics.parameters import SOLVERS

PAGE = (Path(__file__).parents[1] / "docs" / "architecture.md").read_text(encoding="utf-8")


def written(what: str, name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Module with the code that the page gives."""
    found = re.search(rf"<!-- how to add: {what} -->\n```python\n(.*?)```", PAGE, flags=re.DOTALL)
    assert found is not None
    assert len([line for line in found[1].splitlines() if line.strip()]) <= 20
    module = ModuleType(name)
    monkeypatch.setitem(sys.modules, name, module)
    exec(found[1], vars(module))
    return module


def scene(**options: object) -> Scene:
    cells = [Cell(name=name, shape=Sphere(center=(x, 0, 0), radius=4)) for name, x in
             (("a", 0.0), ("b", 8.5))]  # fmt: skip
    numerics = Numerics(solver="band", threads=1)
    return Scene(**({"cells": cells, "numerics": numerics, "duration": 40.0} | options))


def test_a_term(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    swim = written("term", "swimming", monkeypatch).Swim
    given = scene(physics=Physics(terms=[swim(speed=0.2)]))
    simulation = Simulation(given)
    simulation.run(until=20, observers=[RunWriter(tmp_path / "run", 20)])
    assert (simulation.centroids[:, 0] > [0.7, 9.2]).all()
    again = Simulation.from_run(tmp_path / "run")
    assert again.column("age").tolist() == [20, 20]
    save_scene(given, tmp_path / "s.toml")
    assert 'use = "swimming:Swim"' in (tmp_path / "s.toml").read_text()
    assert load_scene(tmp_path / "s.toml").physics == given.physics


def test_a_measured_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        written("measured variable", "measuring", monkeypatch)
        Simulation(scene()).run(until=4, observers=[RunWriter(tmp_path / "run", 4)])
    finally:
        MEASURED.pop("eccentricity", None)
    with open_run(tmp_path / "run") as run:
        assert run["eccentricity"].dims == ("time", "cell")
        assert run["eccentricity"].attrs["units"] == "um"
        np.testing.assert_allclose(run["eccentricity"][0], 4.25, atol=0.01)


def test_a_confinement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tube = written("confinement", "walling", monkeypatch).Tube
    squeezed, free = Simulation(scene(confinement=tube(radius=3.5))), Simulation(scene())
    for simulation in (squeezed, free):
        simulation.step(20)
    assert squeezed.measured().semi_axes[0, -1] < free.measured().semi_axes[0, -1] - 0.2
    save_scene(scene(confinement=tube(radius=3.5)), tmp_path / "s.toml")
    assert load_scene(tmp_path / "s.toml").confinement == tube(radius=3.5)


def test_a_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    written("solver", "morphosim.engine.solvers.patient", monkeypatch)
    monkeypatch.setitem(SOLVERS, "patient", "patient")
    fields = []
    for numerics in ({"solver": "patient"}, {"sweeps": 4}, {}):
        simulation = Simulation(scene().with_numerics(**numerics))
        simulation.step(10)
        fields.append(simulation.fields[0].phi)
    np.testing.assert_array_equal(fields[0], fields[1])
    assert (fields[0] != fields[2]).any()


def test_an_export_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written("export format", "morphosim.exports.texts", monkeypatch)
    monkeypatch.setitem(FORMATS, "text", Format(module="texts", title="centroids"))
    Simulation(scene()).run(until=4, observers=[RunWriter(tmp_path / "run", 4)])
    with open_run(tmp_path / "run") as run:
        paths = export(run, tmp_path / "out", to="text")
        np.testing.assert_allclose(np.loadtxt(paths[1]), run["centroid"].values[1])
    assert [path.name for path in paths] == ["centroids_0.txt", "centroids_1.txt"]
