"""The published example, imported, against the trajectory of the published scheme."""

import csv
from pathlib import Path

import numpy as np
import pytest

from morphosim import Simulation, import_matlab, touching
from morphosim.scene.scene import Scene
from morphosim.scene.stability import concerns

SHARED = Path(__file__).resolve().parents[1].parent / "shared"
EXAMPLE = SHARED / "matlab_example"

pytestmark = pytest.mark.skipif(
    not EXAMPLE.exists(), reason="the published example's files are not in ../shared"
)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return import_matlab(
        EXAMPLE / "Example_8Cell.mat", EXAMPLE / "Example_CellName&AttractionMatrix_2.xls"
    )


def test_the_example_raises_no_concern(scene: Scene) -> None:
    assert concerns(scene) == []


def rows(name: str, time: str) -> list[dict[str, str]]:
    with (SHARED / "reference" / name).open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["time"] == time]


@pytest.mark.filterwarnings("ignore::morphosim.ResolutionWarning")  # of stepped walls, and right
def test_centroids_volumes_and_contacts_at_t_100(scene: Scene) -> None:
    simulation = Simulation(scene)
    simulation.run(until=100)
    there = {row["cell"]: row for row in rows("trajectory_weak.csv", "100")}
    expected = np.array([[float(there[n][f"{k}_um"]) for k in "xyz"] for n in simulation.names])
    core = [float(there[n]["volume_above_half_um3"]) for n in simulation.names]
    # Cells have moved 0.9 µm. Measured: 12 nm, of which most is the start's other surface.
    assert np.linalg.norm(simulation.centroids - expected, axis=1).max() < 0.03
    np.testing.assert_allclose(simulation.engine.pool.surveys[:, 2] * 0.5**3, core, rtol=2e-3)
    assert set(touching(simulation.fields)) == {
        (row["cell1"], row["cell2"]) for row in rows("contacts_weak.csv", "100")
    }
