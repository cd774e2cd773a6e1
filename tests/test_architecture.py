"""What docs/architecture.md and the lint settings say is what the code is."""

import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def drawing() -> dict[str, Any]:
    """The names of `docs/draw_architecture.py`."""
    return runpy.run_path(str(ROOT / "docs" / "draw_architecture.py"))


def test_the_table_of_folders_is_that_of_the_docstrings(drawing: dict[str, Any]) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = drawing["folder_table"](drawing["modules"]())
    advice = "run: python docs/draw_architecture.py"
    assert drawing["with_table"](page, table) == page, advice
    assert "|  |" not in table, "a folder without a docstring"


def test_arrows_point_down_the_layers(drawing: dict[str, Any]) -> None:
    graph, layers = drawing["arrows"](drawing["modules"]()), drawing["layers"]()
    height = {part: -k for k, layer in enumerate(layers) for part in layer}
    assert graph.number_of_edges() > 10
    assert all(height[above] > height[below] for above, below in graph.edges)


def test_a_page_without_marks_is_refused(drawing: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="put them around the table"):
        drawing["with_table"]("# Architecture\n", "| a | b |\n")


def test_pre_commit_has_a_ruff_that_the_package_allows() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = next(w for w in project["optional-dependencies"]["test"] if w.startswith("ruff>="))
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    pinned = set(re.findall(r"ruff==([\d.]+)", hooks))
    assert len(pinned) == 1, "hooks with different versions"
    least, taken = (
        [int(part) for part in version.split(".")]
        for version in (wanted.partition(">=")[2], *pinned)
    )
    assert taken >= least
