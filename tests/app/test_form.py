"""What the form says of a scene, of whatever source; what it does not touch stays as it is."""

import asyncio
import warnings
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from queue import Queue
from time import sleep
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from morphosim import (
    Attraction,
    BoxWalls,
    Cell,
    MaskWalls,
    Numerics,
    Physics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    VolumeCourse,
    _import_path,
    built_in_scene,
    load_scene,
    open_run,
    save_scene,
)
from morphosim.app import settings as form_settings
from morphosim.app import worker
from morphosim.app.form import STATE, Form
from morphosim.app.processes import Child
from morphosim.app.settings import OWN, Settings, facts, preset_of
from morphosim.app.source import NO_CODE, Source
from morphosim.app.store import Store
from morphosim.cli import app
from morphosim.library.built_in import scene_names
from morphosim.scene import stability
from morphosim.scene.file import scene_table
from morphosim.scene.stability import check, concerns
from tests.app.page_state import State

TWO = Source(kind="file", file="two.toml")


def settings(scene: Scene, source: Source = TWO, **changes: Any) -> Settings:
    """The form as it is filled with a scene, and then changed."""
    found = facts(scene)
    values = {
        "source": source, "names": [cell["name"] for cell in found["cells"]],
        "types": [cell["type"] for cell in found["cells"]], "name": scene.name,
        **{key: found["numerics"][OWN][key] for key in ("dt", "tolerance")},
        **{key: found[key] for key in ("sigma", "duration", "save_every")},
    }  # fmt: skip
    return Settings(**(values | changes))


def form(**changes: Any) -> Settings:
    """The form as it is filled for the embryo of eight cells."""
    values = {
        "source": Source(), "duration": "100", "save_every": "50", "dt": "2", "name": "run",
    }  # fmt: skip
    return settings(built_in_scene("celegans-8"), **(values | changes))


def two_cells(**changes: Any) -> Scene:
    """Cells of two types that attract each other; one grows, the other has its own tension."""
    cells = [
        Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3), type="X", gamma=0.3,
             volume=VolumeCourse(times=(0, 20), volumes=(113.0, 150.0))),
        Cell(name="b", shape=Sphere(center=(5.5, 0, 0), radius=3), type="Y"),
    ]  # fmt: skip
    sigma = Attraction(default=0.1, types={("X", "Y"): 0.2, ("X", "X"): 0.3})
    values = {"duration": 8.0, "save_every": 4.0, "name": "two"}
    return Scene(cells=cells, physics=Physics(sigma=sigma), **(values | changes))


@pytest.fixture
def store(tmp_path: Path) -> Store:
    save_scene(two_cells(), tmp_path / "two.toml")
    return Store(tmp_path)


# --- what is touched, and what is not ----------------------------------------------------------


@pytest.mark.parametrize("name", sorted({*scene_names()} - {"blastoderm"}))  # 6000 rows of cells
def test_a_form_that_nobody_touches_says_the_scene_itself(tmp_path: Path, name: str) -> None:
    scene = built_in_scene(name)
    said = settings(scene, Source(scene=name)).scene(Store(tmp_path))
    np.testing.assert_equal(scene_table(said), scene_table(scene))


def test_numbers_of_many_digits_stay_as_they_are(store: Store) -> None:
    scene = two_cells(duration=1234567.8, save_every=1 / 3, numerics=Numerics(dt=0.1 + 0.2))
    save_scene(scene, store.root / "two.toml")
    said = settings(scene, TWO).scene(store)
    assert (said.duration, said.save_every, said.numerics.dt) == (1234567.8, 1 / 3, 0.1 + 0.2)


def test_the_form_says_a_scene(tmp_path: Path) -> None:
    before = built_in_scene("celegans-8")
    scene = form(name="runs/x", preset="fast", dt="1.5").scene(Store(tmp_path))
    assert (scene.duration, scene.save_every, scene.name) == (100, 50, "runs/x")
    assert (scene.numerics.solver, scene.numerics.dt) == ("band", 1.5)
    np.testing.assert_array_equal(
        scene.physics.attraction.matrix(scene.names), before.physics.attraction.matrix(before.names)
    )
    assert scene.confinement is not None
    assert form(shell=False).scene(Store(tmp_path)).confinement is None


def test_names_and_attraction_can_be_changed(tmp_path: Path) -> None:
    names = [cell.name for cell in built_in_scene("celegans-8").cells]
    sigma = [[str(v) for v in row] for row in facts(built_in_scene("celegans-8"))["sigma"]]
    sigma[0][4] = "0.123"  # ABal pulls on MS
    scene = form(names=["first", *names[1:]], sigma=sigma).scene(Store(tmp_path))
    matrix = scene.physics.attraction.matrix(scene.names)
    assert scene.names[0] == "first"
    assert matrix[0, 4] == 0.123
    assert matrix[4, 0] == 0.5


def test_values_of_cells_and_of_the_scene_can_be_changed(store: Store) -> None:
    changed = settings(
        two_cells(), TWO, gamma="0.5", volumes=["", "120"], tensions=["0.4", " "], S="9.5",
        walls="stepped",
    ).scene(store)  # fmt: skip
    a, b = changed.cells
    assert (changed.physics.gamma, changed.numerics.S, changed.numerics.walls) == (
        0.5, 9.5, "stepped",
    )  # fmt: skip
    assert isinstance(a.volume, VolumeCourse)
    assert (a.gamma, b.gamma, b.volume) == (0.4, None, 120)
    constant = settings(two_cells(), TWO, volumes=["99", ""]).scene(store)
    assert constant.cells[0].volume == 99
    assert constant.cells[0].gamma == 0.3


def test_steps_follow_from_the_tolerance_or_are_fixed(store: Store) -> None:
    said = settings(two_cells(), TWO, tolerance="2.5").scene(store).numerics
    assert said == Numerics(tolerance=2.5)
    save_scene(two_cells(numerics=said), store.root / "two.toml")
    controlled = load_scene(store.root / "two.toml")
    found = facts(controlled)["numerics"]
    shown = [found[name]["tolerance"] for name in (OWN, "reference", "published")]
    assert shown == ["2.5", "0.5", ""]
    assert (
        "linearised · lattice 0.5 µm · tolerance 2.5 nm, δt from 0.03125 to 32"
        in found[OWN]["text"]
    )
    assert settings(controlled, TWO).scene(store).numerics == said
    assert settings(controlled, TWO, tolerance="").scene(store).numerics.tolerance is None


def test_what_empty_fields_show(store: Store) -> None:
    found = facts(two_cells())
    a, b = found["cells"]
    assert (a["own_volume"], a["own_gamma"], b["own_gamma"]) == ("113.0 … 150.0", "0.3", "")
    assert b["own_volume"] == "113.1"
    published = found["numerics"]["published"]
    assert (published["dt"], published["S"], published["walls"]) == ("2", "12", "stepped")
    assert "δt = 2 · S = 12 · stepped walls" in published["text"]
    inside = np.ones((40, 40, 40), bool)
    walled = two_cells(confinement=MaskWalls(inside=inside, origin=(-10, -10, -10), spacing=0.5))
    assert facts(walled)["numerics"][OWN]["S"] == "15 (chosen)"
    assert facts(walled.with_numerics(S=6.0))["numerics"][OWN]["S"] == "6"


def test_the_form_of_many_cells_between_walls_makes_no_fields(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(form_settings, "MANY", 2)
    monkeypatch.setattr(stability, "_outside", lambda *_: pytest.fail("a field was made"))
    walls = BoxWalls(lower=(-20, -20, -20), upper=(20, 20, 20))
    assert facts(two_cells(confinement=walls))["numerics"][OWN]["S"] == "chosen"
    assert facts(two_cells())["numerics"][OWN]["S"].endswith(" (chosen)")


def test_an_S_that_is_given_stays(store: Store) -> None:
    inside = np.ones((40, 40, 40), bool)
    walls = MaskWalls(inside=inside, origin=(-10, -10, -10), spacing=0.5)
    scene = two_cells(confinement=walls, numerics=Numerics(S=7.0))
    save_scene(scene, store.root / "two.toml")
    for dt in ("", "1.5"):
        assert settings(scene, TWO, dt=dt).scene(store).numerics.S == 7
    assert settings(scene, TWO, preset="standard").scene(store).numerics.S is None
    assert settings(scene, TWO, preset="standard", S="5").scene(store).numerics.S == 5


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"dt": "much"}, "time step δt = 'much' is not a number"),
        ({"dt": "-1"}, "time step δt = -1"),
        ({"tolerance": "fine"}, "tolerance = 'fine' is not a number"),
        ({"tolerance": "0"}, "tolerance = 0"),
        ({"duration": "0"}, "time = 0"),
        ({"preset": "best"}, "preset = 'best'"),
        ({"names": ["a"] * 8}, "cell name"),
        ({"names": ["a"]}, "1 names for 8 cells"),
        ({"types": ["a"]}, "1 types for 8 cells"),
        ({"types": ["a\x07"] * 8}, "cell 'ABal': type = .* has a control character"),
        ({"S": "big"}, "^S = 'big' is not a number"),
        ({"S": "-1"}, "^S = -1.0 is not allowed: it must be finite and >= 0"),
        ({"walls": "soft"}, "walls = 'soft' is not known; allowed are 'resolved', 'stepped'"),
        ({"gamma": "0"}, "surface tension γ = 0.0 is not allowed"),
        ({"volumes": ["", "none", *[""] * 6]}, "cell 'ABar': volume = 'none' is not a number"),
        ({"volumes": ["", "inf", *[""] * 6]}, "cell 'ABar': volume = inf is not allowed"),
        ({"tensions": ["-2", *[""] * 7]}, "cell 'ABal': gamma = -2.0 is not allowed"),
        ({"source": Source(kind="matlab")}, "no file of masks"),
        ({"source": Source(kind="file")}, r"no scene file \(\.toml\) is chosen"),
        ({"source": Source(kind="file", file="x.toml")}, "scene file .*x.toml does not exist"),
        ({"source": Source(scene="nothing")}, "nothing"),
    ],
)
def test_errors_are_worded_as_the_engine_does(
    tmp_path: Path, changes: dict[str, object], error: str
) -> None:
    with pytest.raises((ValueError, OSError), match=error) as caught:
        form(**changes).scene(Store(tmp_path))
    assert "\n" not in str(caught.value)


def test_wrong_attraction_is_named(tmp_path: Path) -> None:
    sigma = facts(built_in_scene("celegans-8"))["sigma"]
    sigma[1][2] = "-3"
    with pytest.raises(ValueError, match="attraction from 'ABar' to 'ABpl' = -3"):
        form(sigma=sigma).scene(Store(tmp_path))


def test_types_that_stages_tell_of_stay_known(tmp_path: Path) -> None:
    scene = built_in_scene("synnotch-symmetric")
    types = ["G", *scene.types[1:]]
    source = Source(scene="synnotch-symmetric")
    sigma = scene.physics.attraction.matrix(scene.names, types, scene.parents).tolist()
    said = settings(scene, source, types=types, sigma=sigma).scene(Store(tmp_path))
    assert said.types == types
    assert said.physics == scene.physics  # no pair is stated: all hold by type


# --- the form in the page ----------------------------------------------------------------------


def filled(store: Store, **chosen: str) -> tuple[Form, State]:
    """The form as it is shown when a source has been read."""
    state = State(deepcopy(STATE))
    state.update(chosen)
    shown = Form(state, store)
    asyncio.run(shown.read_source())
    return shown, state


def test_attraction_follows_the_types_but_for_what_was_typed(store: Store) -> None:
    shown, state = filled(store, source_kind="file", scene_file="two.toml")
    assert state.sigma == [[0, 0.2], [0.2, 0]]
    state["cells"][1]["type"] = " X"
    shown.show_attraction()
    assert state.sigma == [[0, 0.3], [0.3, 0]]
    scene = shown.settings().scene(store)
    assert scene.types == ["X", "X"]
    assert scene.physics.attraction.pairs == {}
    np.testing.assert_array_equal(scene.physics.attraction.matrix(["a", "b"], ["X", "X"]),
                                  [[0, 0.3], [0.3, 0]])  # fmt: skip
    state.sigma[0][1] = "0.7"
    state["cells"][1]["type"] = "Z"
    shown.show_attraction()
    assert state.sigma == [[0, "0.7"], [0.1, 0]]
    scene = shown.settings().scene(store)
    assert scene.physics.attraction.pairs == {("a", "b"): 0.7, ("b", "a"): 0.1}


def test_a_preset_shows_what_it_means_and_is_not_mixed_with_the_one_before(store: Store) -> None:
    shown, state = filled(store)
    state.update(S="20", walls="stepped", preset="draft")
    shown.show_preset()
    assert (state.tolerance, state.dt, state.S, state.walls) == ("50", "2", "", "")
    state.preset = None  # as a list is that has been emptied
    shown.show_preset()
    assert state.preset == OWN
    (store.root / state.run_name).mkdir(parents=True)
    (store.root / state.run_name / "file").touch()
    shown.take_cure()
    assert (state.preset, state.dt, state.run_name) == ("standard", "2", "runs/celegans-8-2")
    assert shown.settings().scene(store).numerics == Numerics.preset("standard")


def test_a_source_that_fails_leaves_the_form_as_it_is(store: Store) -> None:
    shown, state = filled(store, source_kind="file", scene_file="two.toml")
    (store.root / "two.toml").write_text("cells = 3")
    state.scene_file = "two.toml"
    asyncio.run(shown.read_source())
    assert state.form_error == "cells = 3 is not a list of tables"
    assert state.loaded == "two"


def test_readers_take_turns_and_hear_their_own_warnings(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []

    def slowly(source: Source, *_: Any, **__: Any) -> Scene:
        read.append(source.scene)
        sleep(0.1)
        warnings.warn(f"of {source.scene}", stacklevel=1)
        return two_cells()

    async def choose() -> None:
        reading = []
        for state.scene_name in ("first", "passed over", "last"):
            reading.append(asyncio.create_task(shown.read_source()))
            await asyncio.sleep(0.02)
        await asyncio.gather(*reading)

    shown, state = filled(store)
    monkeypatch.setattr(Source, "read", slowly)
    before = warnings.showwarning, list(warnings.filters)
    asyncio.run(choose())
    assert read == ["first", "last"]
    assert state.form_warnings == ["of last"]
    assert (warnings.showwarning, list(warnings.filters)) == before


def test_a_scene_that_has_come_is_read_where_its_tab_is_shown(store: Store) -> None:
    shown, state = filled(store)
    state["cells"][0]["name"] = "mine"
    state.scene_file = "two.toml"
    asyncio.run(shown.uploaded("scene_file"))  # from a tab that has been left
    assert state["cells"][0]["name"] == "mine"
    state.source_kind = "file"
    asyncio.run(shown.uploaded("scene_file"))
    assert state.loaded == "two"


# --- scene files -------------------------------------------------------------------------------


class Silent(SimpleNamespace):
    """A channel that keeps what it is told, and gives no command."""

    def __init__(self) -> None:
        super().__init__(told=[], asked=lambda: "", wait=lambda: "stop")

    def tell(self, kind: str, content: Any = None) -> None:
        self.told.append((kind, content))


def test_a_saved_scene_gives_the_run_that_the_form_gives(store: Store) -> None:
    inside = np.ones((44, 30, 30), bool)
    walls = MaskWalls(inside=inside, origin=(-8, -7.5, -7.5), spacing=0.5)
    save_scene(two_cells(confinement=walls), store.root / "two.toml")
    said = settings(
        two_cells(), TWO, gamma="0.3", volumes=["", "120"], types=["X", "X"],
        sigma=[[0, 0.3], ["0.4", 0]], preset="fast", name="run",
    )  # fmt: skip
    files = worker.save(Silent(), said, "mine", store)  # type: ignore[arg-type]
    assert files == ["mine.toml", "mine.npz"]
    worker.simulate(Silent(), said, store)  # type: ignore[arg-type]
    scene = load_scene(store.root / "mine.toml")
    Simulation(scene).run(observers=[RunWriter(store.root / "again", scene.save_every)])
    with open_run(store.root / "run") as first, open_run(store.root / "again") as second:
        for name in ("volume", "centroid", "surface_area"):
            np.testing.assert_array_equal(first[name], second[name])
    with pytest.raises(FileExistsError, match=r"'mine\.toml' exists; give the scene another name"):
        worker.save(Silent(), said, "mine", store)  # type: ignore[arg-type]
    (store.root / "mine.toml").rename(store.root / "yours.toml")
    with pytest.raises(FileExistsError, match=r"'mine\.npz' exists"):
        worker.save(Silent(), said, "mine.toml", store)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("celegans-8", {"volumes": ["3000", *[""] * 7], "tensions": ["0.3", *[""] * 7]}),
        ("celegans-1-to-8", {"gamma": "0.3", "preset": "fast", "types": ["Q"]}),
        ("synnotch-repair", {"preset": "draft", "S": "7", "walls": "stepped"}),
    ],
)
def test_a_saved_scene_is_the_one_that_the_form_says(
    tmp_path: Path, name: str, changes: dict[str, Any]
) -> None:
    store = Store(tmp_path)
    said = settings(built_in_scene(name), Source(scene=name), **(changes | {"name": "mine"}))
    worker.save(Silent(), said, "mine", store)  # type: ignore[arg-type]
    written = scene_table(load_scene(tmp_path / "mine.toml"))
    np.testing.assert_equal(written, scene_table(said.scene(store)))


def test_a_scene_is_saved_beside_what_has_its_name(
    series: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Told:
        async def do(self, job: Any, told: Any, name: str, **_: Any) -> list[str]:
            for kind in ("compiling", "warning", "warning"):
                told(kind, {"text": f"{kind} of the whole image"})
            (series.root / name).touch()
            return [name]

    monkeypatch.setattr("morphosim.app.form.Desk", Told)
    shown, state = filled(
        series, source_kind="labels", image="series.npz", voxel="0.5", array="other",
        background="9", image_volumes="ball",
    )  # fmt: skip
    state.form_warnings = []
    for name, after in (("series-2.toml", "series-3.toml"), ("series-3.toml", "series-4.toml")):
        assert state.save_name == name
        assert series.new_scene(name) == series.root / name
        asyncio.run(shown.save())
        assert (state.save_name, state.save_error) == (after, "")
    assert state.form_warnings == ["warning of the whole image"]


@pytest.mark.parametrize("name", ["", "../out", "a/b/c/d/e", ".hidden"])
def test_a_scene_is_saved_within_the_folder_alone(store: Store, name: str) -> None:
    with pytest.raises(ValueError, match=r"is not allowed|leads out|would not be listed"):
        store.new_scene(name)


CODE = """
from dataclasses import dataclass
from pathlib import Path
from morphosim import Term
Path(__file__).with_name("was-run").touch()
@dataclass(frozen=True)
class Own(Term):
    pass
"""


def test_code_that_a_scene_file_names_is_not_imported(store: Store) -> None:
    (store.root / "own.py").write_text(CODE)
    text = (store.root / "two.toml").read_text()
    (store.root / "own.toml").write_text(text + '\n[[physics.terms]]\nuse = "own.py:Own"\n')
    source = Source(kind="file", file="own.toml")
    error = r"use = 'own\.py:Own' names code, which is not imported here; run such a scene by the"
    with _import_path.refusing(NO_CODE):
        with pytest.raises(ValueError, match=error) as caught:
            source.read(store)
        heard: Queue[tuple[str, Any]] = Queue()
        child = Child(lambda *said: heard.put(said))
    try:
        child.do(worker.save, settings=settings(two_cells(), source), name="x", store=store)
        assert heard.get(timeout=240) == ("failed", str(caught.value))
    finally:
        child.close()
    assert "\n" not in str(caught.value)
    assert not (store.root / "was-run").exists()
    assert source.read(store).physics.terms  # allowed again
    assert (store.root / "was-run").exists()


@pytest.mark.parametrize("options", [[], ["--allow-code"]])
def test_code_is_allowed_by_who_starts_the_application(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str]
) -> None:
    server = pytest.importorskip("morphosim.app.server", reason="trame is not installed")
    refusals: list[str] = []

    class Served:
        def __init__(self, *_: Any) -> None:
            pass

        def serve(self, *_: Any) -> None:
            refusals.append(_import_path.refusal())

    monkeypatch.setattr(server, "Application", Served)
    done = CliRunner().invoke(app, ["app", "--folder", str(tmp_path), *options])
    assert done.exit_code == 0, done.output
    assert refusals == ["" if options else NO_CODE]
    assert _import_path.refusal() == ""


def test_arrays_of_a_scene_lie_in_the_folder(tmp_path: Path) -> None:
    np.savez(tmp_path / "secret.npz", mask=np.ones((3, 3, 3)))
    root = tmp_path / "root"
    (root / "run").mkdir(parents=True)
    row = 'name = "a"\nshape = {kind = "mask", mask = "%s:mask", origin = [0, 0, 0], spacing = 1}'
    for name in ("../secret.npz", str(tmp_path / "secret.npz")):
        (root / "scene.toml").write_text("[[cells]]\n" + row % name)
        with pytest.raises(ValueError, match="leads out of the folder"):
            Source(kind="file", file="scene.toml").read(Store(root))
    (root / "scene.toml").rename(root / "run" / "scene.toml")
    (root / "run" / "save-000000.nc").touch()
    with pytest.raises(ValueError, match="leads out of the folder"):
        Store(root).run("run")
    (root / "run" / "scene.toml").write_text("damaged [")  # and yet the run can be looked at
    assert Store(root).run("run") == root / "run"


def test_a_scene_and_its_arrays_come_from_the_browser_together(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for count in ("", "-2"):
        with store.receiving("own.toml") as (scene, write):
            write(b"a")
        with store.receiving("own.npz", scene) as (arrays, write):
            write(b"b")
        assert (scene, arrays) == (f"imports/own{count}/own.toml", f"imports/own{count}/own.npz")
    (tmp_path / "other.toml").touch()
    for name, beside in (
        ("own.npz", scene), ("x.npz", "other.toml"), ("x.npz", "../x.toml"), ("x.nc", scene),
    ):  # fmt: skip
        error = pytest.raises(ValueError, match=r"cannot be put beside|leads out")
        with error, store.receiving(name, beside) as (_, write):
            write(b"c")
    assert (tmp_path / arrays).read_bytes() == b"b"


# --- label images ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def series(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A label image of three times, of two cells that move apart; label 9 is the background."""
    root = tmp_path_factory.mktemp("series")
    grid = np.meshgrid(*map(np.arange, (52, 28, 28)), indexing="ij", sparse=True)
    labels = np.full((3, 52, 28, 28), 9, np.uint16)
    for time in range(3):
        for label, x in ((3, 18 - 2 * time), (7, 33 + 2 * time)):
            distance = sum((p - o) ** 2 for p, o in zip(grid, (x, 14, 14), strict=True))
            labels[time][distance < 7.5**2] = label
    np.savez(root / "series.npz", labels=labels, other=labels[0])
    (root / "known.csv").write_text("label,name,type,gamma,frozen\n3,left,X,0.4,\n7,right,Y,,\n")
    (root / "table.csv").write_text(",right,left\nright,0,0.3\nleft,0.1,0\n")
    return Store(root)


def image(**changes: str) -> Source:
    values = {
        "image": "series.npz", "spacing": "0.5", "key": "labels", "time": "1", "background": "9",
        "volumes": "ball",
    }  # fmt: skip
    return Source(kind="labels", **(values | changes))


def test_one_time_of_a_series_of_label_images(series: Store) -> None:
    places = {}
    for time in ("0", "2", "-1"):
        cells = image(time=time).read(series).cells
        assert [cell.name for cell in cells] == ["cell3", "cell7"]
        places[time] = [float(cell.shape.origin[0]) for cell in cells]
    assert places["-1"] == places["2"]
    np.testing.assert_allclose(np.subtract(places["2"], places["0"]), [-2, 2], atol=1e-6)


def test_what_is_known_of_labels(series: Store) -> None:
    scene = image(about="known.csv", table="table.csv", frozen="left, 7").read
    with pytest.raises(ValueError, match="all 2 cells are frozen"):
        scene(series)
    found = image(about="known.csv", table="table.csv", frozen="7").read(series)
    assert (found.names, found.types) == (["left", "right"], ["X", "Y"])
    assert [cell.frozen for cell in found.cells] == [False, True]
    assert found.cells[0].gamma == 0.4
    np.testing.assert_array_equal(
        found.physics.attraction.matrix(found.names), [[0, 0.1], [0.3, 0]]
    )


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"time": ""}, r"series.npz: labels holds 3 times; choose one by time_index, 0 to 2"),
        ({"time": "3"}, r"time_index = 3, but .* holds 3 times \(0 to 2\)"),
        ({"time": "first"}, "time_index = 'first' is not a number"),
        ({"time": "0.5"}, "time_index = 0.5 is not a whole number"),
        ({"axes": "tx"}, "axes = 'tx': expected the letters x, y, z"),
        ({"key": ""}, "2 could be the labels; choose one by key out of"),
        ({"key": "lables"}, "did you mean 'labels'"),
        ({"key": "other"}, "has no time axis"),
        ({"background": "8"}, "background = 8, but no voxel has this label"),
        ({"background": "-1"}, "background = -1 is not allowed"),
        ({"frozen": "cell4"}, "cell in frozen = 'cell4' is not known"),
        ({"least_voxels": "1e6"}, "labels of fewer than 1000000 voxels"),
        ({"volumes": "most"}, "volumes = 'most' is not known"),
        ({"spacing": "1 2"}, "voxel = '1 2'; expected 1 or 3 numbers"),
        ({"about": "table.csv"}, "table.csv"),
    ],
)
def test_errors_of_images_are_those_of_the_importer(
    series: Store, changes: dict[str, str], error: str
) -> None:
    with pytest.raises((ValueError, TypeError), match=error) as caught:
        image(**changes).read(series)
    assert "\n" not in str(caught.value)


def test_what_a_reader_warns_of_is_shown_before_the_run(series: Store) -> None:
    labels = np.load(series.root / "series.npz")["labels"][0][16:]  # through a cell
    np.save(series.root / "cut.npy", labels)
    shown, state = filled(
        series, source_kind="labels", image="cut.npy", voxel="0.5", background="9",
        image_volumes="surface",
    )  # fmt: skip
    (text,) = state.form_warnings
    assert text.startswith("cells at the border of the image, which may cut them off: cell3.")
    assert state.cells[1]["own_volume"].startswith("≈ ")
    assert shown.settings().source.settles


# --- what may diverge --------------------------------------------------------------------------


def told_of(scene: Scene) -> tuple[str, dict[str, Any]]:
    """How the page hears that a scene may diverge."""
    channel = Silent()
    with worker._told(channel, scene):  # type: ignore[arg-type]
        check(scene)
    ((kind, content),) = channel.told
    return kind, content


def test_what_a_preset_is_to_blame_for_is_a_remark(tmp_path: Path) -> None:
    published = Numerics.preset("published")
    scene = replace(built_in_scene("celegans-1-to-8"), numerics=published)  # daughters press walls
    kind, content = told_of(scene)
    assert (kind, content["cured"]) == ("remark", True)
    assert content["text"].startswith("As the preset 'published' has it: numerics.S = 12 may div")
    assert concerns(form(preset="standard").scene(Store(tmp_path))) == []
    assert preset_of(replace(scene.numerics, spacing=0.4)) == "published"  # as files may have it


def test_what_was_typed_is_warned_of(tmp_path: Path) -> None:
    kind, content = told_of(form(S="1").scene(Store(tmp_path)))
    assert (kind, content["cured"]) == ("warning", True)
    assert content["text"].startswith("numerics.S = 1 may diverge")


def test_what_no_preset_cures_is_warned_of() -> None:
    strong = built_in_scene("celegans-8").with_physics(sigma=9.0)
    kind, content = told_of(strong)
    assert (kind, content["cured"]) == ("warning", False)
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        channel = Silent()
        with worker._told(channel):  # type: ignore[arg-type]
            check(strong)
    assert channel.told[0][0] == "remark"  # of a run that goes on, which cannot be changed
