"""Cost of looking for divergence at every step, as a share of the step.

Run as `python benchmarks/guard.py`. The survey of a cell's new field counts the points that are not
finite or beyond the limit beside its other sums. Both surveys, with and without that count, run in
turn on the same box, beside the whole step.
"""

import numpy as np
from _common import alternating_medians, arguments, packed_scene, report, stepper

from morphosim import Simulation
from morphosim.kernels._jit import inline_kernel, kernel
from morphosim.kernels.boxes import row_sums


@inline_kernel()
def row_sums_unguarded(values, first, nz, tolerance2, half):
    zero, one = values.dtype.type(0), values.dtype.type(1)
    total = zero
    band = zero
    core = zero
    for z in range(np.uint64(nz)):
        value = values[first + z]
        total += value
        band += one if value * value > tolerance2 else zero
        core += one if value > half else zero
    return total, band, core


@kernel()
def guarded(values, rows, nz, tolerance2, limit2, half, repeats):
    found = 0.0
    for _ in range(repeats):
        for row in range(rows):
            total, band, core, bad = row_sums(
                values, np.uint64(row * nz), nz, tolerance2, limit2, half
            )
            found += total + band + core + bad
    return found


@kernel()
def unguarded(values, rows, nz, tolerance2, half, repeats):
    found = 0.0
    for _ in range(repeats):
        for row in range(rows):
            total, band, core = row_sums_unguarded(
                values, np.uint64(row * nz), nz, tolerance2, half
            )
            found += total + band + core
    return found


def main() -> None:
    """Measure and report."""
    options = arguments(__doc__, cells=20, rounds=31)
    simulation = Simulation(packed_scene(options.cells, threads=1))
    simulation.step(10)
    phi = np.ascontiguousarray(simulation.fields[0].phi)
    rows, nz, values = phi.shape[0] * phi.shape[1], phi.shape[2], phi.ravel()
    tolerance2, limit2, half = (np.float32(v) for v in (1e-6, 16.0, 0.5))
    repeats = 10 * options.cells
    medians = alternating_medians(
        {
            "survey": lambda: guarded(values, rows, nz, tolerance2, limit2, half, repeats),
            "without": lambda: unguarded(values, rows, nz, tolerance2, half, repeats),
            "step": stepper(simulation),
        },
        options.rounds,
    )
    guard = (medians["survey"] - medians["without"]) / 10
    row = {
        "step, us per cell": 1e6 * medians["step"] / options.cells,
        "survey, us per cell": 1e5 * medians["survey"] / options.cells,
        "guard, us per cell": 1e6 * guard / options.cells,
        "guard, % of the step": 100 * guard / medians["step"],
    }
    report([row], options.json)


if __name__ == "__main__":
    main()
