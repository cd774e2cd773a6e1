"""The example notebook runs on a run."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from morphosim import RunWriter, Simulation, built_in_scene

NOTEBOOK = Path(__file__).resolve().parents[1] / "examples" / "analysis.ipynb"


@pytest.fixture(scope="module")
def executed(tmp_path_factory: pytest.TempPathFactory) -> list[nbformat.NotebookNode]:
    """Code cells of the notebook, executed beside a short run."""
    folder = tmp_path_factory.mktemp("notebook")
    simulation = Simulation(built_in_scene("celegans-8", {"numerics.preset": "draft"}))
    simulation.run(until=20, observers=[RunWriter(folder / "runs" / "embryo", 10)])
    book = nbformat.read(NOTEBOOK, as_version=4)
    (folder / "examples").mkdir()
    NotebookClient(book, resources={"metadata": {"path": str(folder / "examples")}}).execute()
    return [cell for cell in book.cells if cell.cell_type == "code"]


def test_it_makes_three_figures_in_under_30_lines(executed: list[nbformat.NotebookNode]) -> None:
    outputs = [output for cell in executed for output in cell.outputs]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    assert not [output for output in outputs if output.output_type in ("error", "stream")]
    assert sum(len(cell.source.splitlines()) for cell in executed) < 30
