"""A run is data: reading one imports nothing that its scene names; going on with it does."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from morphosim import (
    Cell,
    EllipsoidShell,
    FunctionWalls,
    MaskWalls,
    Numerics,
    RunWriter,
    Scene,
    Simulation,
    Sphere,
    load_scene,
    open_run,
)
from morphosim.cli import app
from morphosim.pictures.meshes import CellMesh, run_confinement, shell_mesh
from morphosim.runs.pack import pack

MODULE = "code_of_a_stranger"
CODE = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Ball:
    radius: float

    def field(self, x, y, z):
        return ((x**2 + y**2 + z**2) > self.radius**2).astype(float)

    def depth(self, x, y, z):
        return self.radius - (x**2 + y**2 + z**2) ** 0.5

    def bounds(self):
        import numpy as np
        return np.full(3, -self.radius), np.full(3, self.radius)
"""
SCENE = f"""
duration = 4
save_every = 4
[numerics]
threads = 1
S = 20
[confinement]
use = "{MODULE}:Ball"
radius = 9.0
[[cells]]
name = "a"
volume = 140
shape = {{ kind = "sphere", center = [0, 0, 0], radius = 3 }}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run whose scene names a module that no longer is there, and of a packed one."""
    folder = tmp_path_factory.mktemp("made")
    (folder / f"{MODULE}.py").write_text(CODE)
    (folder / "scene.toml").write_text(SCENE)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        scene = load_scene(folder / "scene.toml")
        Simulation(scene).run(observers=[RunWriter.of(scene, folder / "run")])
    del sys.modules[MODULE]
    pack(folder / "run", folder / "packed.nc")
    return folder


READ = {
    "info": ["info"],
    "contacts": ["contacts"],
    "plot": ["plot", "-o", "OUT.png"],
    "film": ["film", "-o", "OUT.gif"],
    "show": ["show", "-o", "OUT.html"],
    **{f"export {to}": ["export", "--to", to, "-o", "OUT"] for to in ("vtk", "stl", "csv")},
    "export ome-tiff": ["export", "--to", "ome-tiff", "-o", "OUT"],
}


@pytest.mark.parametrize("source", ["run", "packed.nc"])
@pytest.mark.parametrize("command", READ)
def test_reading_imports_nothing(
    command: str, source: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(made)
    name, *options = [part.replace("OUT", str(tmp_path / "out")) for part in READ[command]]
    done = CliRunner().invoke(app, [name, str(made / source), *options], catch_exceptions=False)
    assert done.exit_code == 0
    assert MODULE not in sys.modules


@pytest.mark.parametrize(
    "command",
    [
        ["--resume", "RUN", "--until", "8"],
        ["SCENE", "-o", "NEW"],
        ["SCENE", "--from", "RUN", "-o", "NEW"],
    ],
)
def test_running_imports_and_says_what(
    command: list[str], made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.syspath_prepend(made)
    shutil.copytree(made / "run", tmp_path / "run")
    places = {"RUN": tmp_path / "run", "SCENE": made / "scene.toml", "NEW": tmp_path / "new"}
    done = CliRunner().invoke(app, ["run", *(str(places.get(c, c)) for c in command)])
    assert done.exit_code == 0
    assert sys.modules.pop(MODULE, None) is not None
    assert f"the scene names code: importing {MODULE}" in done.stderr


@pytest.mark.parametrize("source", ["run", "packed.nc"])
def test_the_shell_is_drawn_as_it_was(source: str, made: Path) -> None:
    with open_run(made / source) as run:
        found = run_confinement(run)
    assert isinstance(found, CellMesh)
    distance = np.linalg.norm(found.vertices, axis=1)
    np.testing.assert_allclose(distance, 9, atol=0.02)
    corners = found.vertices[found.faces].astype(float)
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 9**3, rel=0.01)


def test_a_run_without_its_shell_is_drawn_without_and_says_so(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(made)
    shutil.copytree(made / "run", tmp_path / "run")
    (tmp_path / "run" / "shell.npz").unlink()
    with (
        open_run(tmp_path / "run") as run,
        pytest.warns(UserWarning, match="the shell is not drawn: .* names code, which reading"),
    ):
        assert run_confinement(run) is None
    assert MODULE not in sys.modules


@pytest.mark.parametrize(
    "scene",
    [
        b"confinement = 5",
        b"[confinement]\nkind = 'ellipsoid'\ncenter = true",
        b"[confinement]\nkind = 'mask'\ninside = 'scene.npz:none'",
        b"[confinement",
        b"\xff",
    ],
)
def test_a_scene_file_that_is_damaged_costs_no_more_than_the_shell(
    scene: bytes, made: Path, tmp_path: Path
) -> None:
    shutil.copytree(made / "run", tmp_path / "run")
    (tmp_path / "run" / "shell.npz").unlink()
    (tmp_path / "run" / "scene.toml").write_bytes(scene)
    with open_run(tmp_path / "run") as run, pytest.warns(UserWarning, match="is not drawn"):
        assert run_confinement(run) is None


@pytest.mark.parametrize(
    "arrays",
    [
        {"vertices": np.zeros((3, 3), "f4"), "faces": np.array([[0, 1, 3]], "i4")},
        {"vertices": np.full((3, 3), np.nan, "f4"), "faces": np.array([[0, 1, 2]], "i4")},
        {"vertices": np.zeros((3, 2), "f4"), "faces": np.array([[0, 1, 2]], "i4")},
        {"vertices": np.array([{}], object), "faces": np.array([[0, 1, 2]], "i4")},
        {},
    ],
)
def test_a_shell_that_is_no_mesh_is_not_drawn(
    arrays: dict[str, np.ndarray], made: Path, tmp_path: Path
) -> None:
    shutil.copytree(made / "run", tmp_path / "run")
    np.savez(tmp_path / "run" / "shell.npz", **arrays)  # type: ignore[arg-type]
    with open_run(tmp_path / "run") as run, pytest.warns(UserWarning, match=r"shell\.npz"):
        assert run_confinement(run) is None
    with pytest.warns(UserWarning, match=r"will have no shell: .*shell\.npz") as told:
        pack(tmp_path / "run", tmp_path / "packed.nc")
    assert told[0].filename == __file__
    with open_run(tmp_path / "packed.nc") as run, pytest.warns(UserWarning, match="names code"):
        assert run_confinement(run) is None


def saved(walls: object, folder: Path) -> Path:
    """Run of one cell within walls, of its start alone."""
    cell = Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=3))
    scene = Scene(cells=[cell], confinement=walls, numerics=Numerics(threads=1, S=20))  # type: ignore[arg-type]
    Simulation(scene).run(until=0, observers=[RunWriter(folder, 2)])
    return folder


def cube() -> MaskWalls:
    inside = np.zeros((40, 40, 40), bool)
    inside[2:-2, 2:-2, 2:-2] = True
    return MaskWalls(inside=inside, origin=(-10, -10, -10), spacing=0.5)


class NoDepth:
    """Walls that say no more than this simulation needs."""

    def field(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return 0.0 * (x + y + z)

    def depth(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(3, -9.0), np.full(3, 9.0)


def ball() -> EllipsoidShell:
    return EllipsoidShell(center=(0, 0, 0), semi_axes=(9, 9, 9))


@pytest.mark.parametrize("walls", [cube, NoDepth, ball])
def test_what_is_data_or_has_no_surface_is_not_kept_as_a_mesh(
    walls: Callable[[], object], tmp_path: Path
) -> None:
    run = saved(walls(), tmp_path / "run")
    assert not (run / "shell.npz").exists()


def test_a_packed_run_is_read_from_its_file_alone(tmp_path: Path) -> None:
    pack(saved(None, tmp_path / "run"), tmp_path / "packed.nc")
    np.savez(tmp_path / "secret.npz", mask=cube().inside)
    walls = f"[confinement]\nkind = 'mask'\ninside = '{tmp_path}/secret.npz:mask'"
    with open_run(tmp_path / "packed.nc") as run:
        said = run.assign_attrs(scene_toml=walls)
        said.encoding["source"] = run.encoding["source"]
        with pytest.warns(
            UserWarning, match=r"is not drawn: .* names '.*secret\.npz:mask': a pack"
        ):
            assert run_confinement(said) is None


def test_walls_that_are_an_image_are_packed_as_a_mesh(tmp_path: Path) -> None:
    run = saved(cube(), tmp_path / "run")
    pack(run, tmp_path / "packed.nc")
    shutil.rmtree(run)
    with open_run(tmp_path / "packed.nc") as data:
        found = run_confinement(data)
    assert isinstance(found, CellMesh)
    np.testing.assert_array_equal(found.vertices, shell_mesh(cube()).vertices)


def test_walls_that_no_file_can_say_are_drawn(tmp_path: Path) -> None:
    def outside(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return (x**2 + y**2 + z**2 > 64).astype(float)

    walls = FunctionWalls(function=outside, lower=(-8,) * 3, upper=(8,) * 3)
    run = saved(walls, tmp_path / "run")
    assert not (run / "scene.toml").exists()
    with open_run(run) as data:
        found = run_confinement(data)
    assert isinstance(found, CellMesh)
    np.testing.assert_array_equal(found.vertices, shell_mesh(walls).vertices)
