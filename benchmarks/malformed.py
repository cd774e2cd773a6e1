"""Malformed inputs, many of each reader: how many end right, in an error of one line, or wrongly.

Run as `python benchmarks/malformed.py [--count 2000] [--reader "scene file"] [--first 0]`; the
tests try a hundred of each. What ends wrongly is listed, with the number that makes it again.
"""

import sys
from collections import Counter
from pathlib import Path

from _common import arguments, report

sys.path.append(str(Path(__file__).parents[1]))
from tests.malformed.readers import READERS
from tests.malformed.workers import Workers


def main() -> None:
    """Try inputs and count."""
    options = arguments(__doc__, count=2000, reader="", first=0)
    chosen = [options.reader] if options.reader else list(READERS)
    each = -(-options.count // len(chosen))
    workers, rows = Workers(), []
    for reader in chosen:
        counts: Counter[str] = Counter()
        for number in range(options.first, options.first + each):
            kind, text = workers.outcome(reader, number)
            counts[kind] += 1
            if kind == "fault":
                print(f"{reader} {number}: {text[:400]}", flush=True)
        rows.append({"reader": reader} | {k: counts[k] for k in ("right", "error", "fault")})
    workers.close()
    report(rows, options.json)
    sys.exit(any(row["fault"] for row in rows))


if __name__ == "__main__":
    main()
