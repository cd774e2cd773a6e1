"""A process that tries inputs, and is replaced if one kills it or takes too long."""

import json
import os
import resource
import select
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.malformed.outcome import Outcome

ONE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
LONGEST = 180.0
"""Seconds after which an input counts as a hang; the first ones may compile kernels."""
MEMORY = 6 << 30
"""Bytes of addresses that an input may take beyond what the process has when it is ready."""


class Workers:
    """Tries inputs one after the other; close it at the end."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def outcome(self, reader: str, number: int) -> Outcome:
        """What came of the input of this number."""
        process = self._ready()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps([reader, number]) + "\n")
        process.stdin.flush()
        if not select.select([process.stdout], [], [], LONGEST)[0]:
            self.close()
            return Outcome("fault", f"no end after {LONGEST:g} s")
        line = process.stdout.readline()
        if not line:
            code = process.wait()
            self.close()
            return Outcome("fault", f"the process died ({code})")
        return Outcome(*json.loads(line))

    def _ready(self) -> subprocess.Popen[str]:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.malformed.workers"], cwd=Path(__file__).parents[2],
                env=os.environ | ONE_THREAD, text=True, stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            assert self._process.stdout is not None
            self._process.stdout.readline()
        return self._process

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def _work() -> None:
    """Try what is asked for on standard input, and answer there."""
    from tests.malformed.inputs import write_all
    from tests.malformed.outcome import outcome
    from tests.malformed.readers import case

    answers = sys.stdout
    sys.stdout = sys.stderr
    with tempfile.TemporaryDirectory() as place:
        sound = Path(place) / "sound"
        sound.mkdir()
        write_all(sound)
        _limit_memory()
        _answer(answers, "ready")
        for line in sys.stdin:
            reader, number = json.loads(line)
            folder = Path(place) / "case"
            _answer(answers, outcome(case(reader, number, sound, folder)))
            shutil.rmtree(folder, ignore_errors=True)


def _answer(answers: Any, value: Any) -> None:
    answers.write(json.dumps(value) + "\n")
    answers.flush()


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    used = pages * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))


if __name__ == "__main__":
    _work()
