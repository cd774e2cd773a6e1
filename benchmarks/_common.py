"""What all benchmarks share: machine description, timing, scenes, results as table and JSON."""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from morphosim.bench import alternating_medians, packed_points, packed_scene, stepper, table
from morphosim.provenance import machine

__all__ = [
    "alternating_medians", "arguments", "machine", "markdown_table", "packed_points",
    "packed_scene", "print_table", "report", "stepper",
]  # fmt: skip


def print_table(rows: Sequence[Mapping[str, Any]]) -> None:
    """Rows as a plain table; the first row gives the columns."""
    print(table(rows))


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def arguments(description: str, **options: Any) -> argparse.Namespace:
    """Command line of a benchmark: its own options, and --json FILE; False makes a flag."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, help="write the result to this file")
    for name, default in options.items():
        flag = f"--{name.replace('_', '-')}"
        if default is False:
            parser.add_argument(flag, action="store_true")
        else:
            parser.add_argument(flag, type=type(default), default=default, help=f"{default}")
    return parser.parse_args()


def report(rows: Sequence[Mapping[str, Any]], path: Path | None) -> None:
    """Print a table and, on request, write it as JSON with the machine's description."""
    print_table(rows)
    if path is not None:
        path.write_text(json.dumps({"machine": machine(), "rows": list(rows)}, indent=1))
