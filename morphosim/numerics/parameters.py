"""How the equations are solved: the knobs that trade speed for accuracy."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from morphosim import _validate
from morphosim.numerics.threads import automatic_threads

SCHEMES = ("bdf2", "imex1", "euler", "linearised")
SOLVERS = {"dct": "cosine", "band": "band", "linearised": "linearised"}
"""Solvers, and the modules of `engine.solvers` that make them."""
OWN_SOLVERS = {"euler": "band", "linearised": "linearised"}
"""Solvers of the schemes that leave no choice."""
PRECISIONS = ("single", "double")
TRANSFORMS = ("matrix", "pyfftw", "scipy")
FITTED = "fitted"
ORDERS = (2, 4, 6, FITTED)
LAPLACIANS = ("exact", "stencil")
WALLS = ("resolved", "stepped")
MOST_SWEEPS, LARGEST_SEED = 1000, 2**64 - 1
MOST_STEPS = 10**11
"""Most steps of a run: at a thousand a second, three years."""
PARTS, LONGEST = 64, 16
"""With a tolerance steps last from δt / PARTS, which is a tick, to LONGEST δt."""
MOST_TICKS = MOST_STEPS * PARTS
LARGEST_TOLERANCE = 1000.0
BAND: dict[str, Any] = {"solver": "band", "order": FITTED}
"""What presets with a tolerance share; the solver is that of fixed steps."""
PRESETS: dict[str, dict[str, Any]] = {
    "draft": BAND | {"tolerance": 50.0, "spacing": 2 / 3, "box_tolerance": 3e-3},
    "fast": BAND | {"tolerance": 20.0, "spacing": 0.55, "box_tolerance": 3e-3},
    "standard": BAND | {"tolerance": 10.0},
    "reference": BAND | {"tolerance": 0.5, "spacing": 1 / 3},
    "published": {"S": 12.0, "walls": "stepped"},
}
"""What differs from the defaults; measured by `benchmarks/accuracy.py`."""


def preset_values(name: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """What differs from the defaults in a preset with changes.

    The tolerance of a preset gives way to a `dt` or a `scheme` among the changes.

    Raises
    ------
    ValueError
        The name is not known.
    """
    _validate.choice("preset", name, tuple(PRESETS))
    gives_way = ("tolerance",) if {"dt", "scheme"} & changes.keys() else ()
    return {k: v for k, v in PRESETS[name].items() if k not in gives_way} | dict(changes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Numerics:
    """Numerical parameters.

    Attributes
    ----------
    dt : float
        Time step δt, *in silico* time. S δt²/τ must be short for the run: see `stability.missed`.
        With a tolerance it sets the range of steps.
    tolerance : float, optional
        Error in time that steps may make, in nm of a cell's interface per 100 units of *in silico*
        time; of cells that go farther than 1 µm in that time, so many per mille of their way. The
        steps' lengths follow from it, from δt/64 to 16 δt. By default all steps are δt.
    S : float, optional
        Stabilisation (Eq. 8, 9); 0 is the plain semi-implicit scheme of Eq. 6. Not used by
        "euler". By default it is chosen for the scene: what `stability.least_S` asks for, with a
        margin. More makes what moves late, see `stability.lag`.
    scheme : {"bdf2", "imex1", "euler", "linearised"}
        Second order (Eq. 9, first step by Eq. 8), first order (Eq. 8), explicit Euler, or second
        order with the forces' own derivative implicit at each point, for long steps. A tolerance
        needs "linearised", and takes it instead of "bdf2".
    start_S : float, optional
        Stabilisation of the first step of "bdf2"; by default S, as published. S acts as inertia:
        after a stabilised start velocities take S δt/τ steps to build up. Start a smooth state
        that is already in motion with 0.
    solver : {"dct", "band"}
        How the implicit step is solved: exactly, by cosine transforms of each box, or by `sweeps`
        Chebyshev iterations on the narrow band, the points where the field is not 0. Not used by
        "euler" and "linearised", which work on the band.
    sweeps : int
        Least number of Chebyshev iterations of the "band" solver; more are taken where fewer would
        not converge (see `numerics.chebyshev`).
    spacing : float
        Lattice spacing in µm.
    order : {2, 4, 6, "fitted"}
        Order of the gradient stencil, and of the band's Laplacian; or three points like those of
        order 6, with weights that fit the interface better (see `numerics.stencils`).
    laplacian : {"exact", "stencil"}
        Symbol of the "dct" solver's Laplacian: -k², or that of the second-difference stencil of
        `order`, which the band always has.
    walls : {"resolved", "stepped"}
        How a hard wall (a confinement whose `width` is 0) lies on the lattice: as a wall that the
        lattice resolves and that repels alike (see `physics.confinement_repulsion`), or, as
        published, as 0 or 1 at each lattice point. Other confinements are taken as they are.
    box_tolerance : float
        Largest |φ| allowed on the faces of a cell's box. The band, where gradients are evaluated
        and neighbours are felt, is where |φ| exceeds it.
    precision : {"single", "double"}
        Type of the fields, and of sums along a row of a box; rows are summed in double.
    transform : {"matrix", "pyfftw", "scipy"}
        Cosine transform of the "dct" solver: dense matrices through BLAS, FFTW or SciPy.
    threads : int
        Number of threads; 0 takes all the processors available, at most NUMBA_NUM_THREADS. The
        result does not depend on it.
    seed : int
        Seed of the motility noise, below 2⁶⁴.
    allow_coarse : bool
        Whether to run where the lattice does not resolve the interface.

    Raises
    ------
    ValueError
        A value is out of range; the message names it and what is allowed.
    """

    dt: float = 2.0
    tolerance: float | None = None
    S: float | None = None
    scheme: str = "bdf2"
    start_S: float | None = None
    solver: str = "dct"
    sweeps: int = 2
    spacing: float = 0.5
    order: int | str = 6
    laplacian: str = "exact"
    walls: str = "resolved"
    box_tolerance: float = 1e-3
    precision: str = "single"
    transform: str = "matrix"
    threads: int = 0
    seed: int = 0
    allow_coarse: bool = False

    def __post_init__(self) -> None:
        _validate.number("numerics.dt", self.dt, above=0)
        _validate.choice("numerics.scheme", self.scheme, SCHEMES)
        self._check_tolerance()
        for name in ("S", "start_S"):
            if getattr(self, name) is not None:
                _validate.number(f"numerics.{name}", getattr(self, name), least=0)
        choices = [name for name in SOLVERS if name not in SCHEMES]
        _validate.choice("numerics.solver", self.solver, choices)
        _validate.integer("numerics.sweeps", self.sweeps, least=2, most=MOST_SWEEPS)
        _validate.number("numerics.spacing", self.spacing, above=0)
        _validate.choice("numerics.order", self.order, ORDERS)
        _validate.choice("numerics.laplacian", self.laplacian, LAPLACIANS)
        if self.laplacian == "stencil" and self.order == FITTED:
            message = (
                "numerics.laplacian = 'stencil' is a Laplacian of order 2, 4 or 6, and "
                "numerics.order = 'fitted' has none; take laplacian = 'exact', or order = 6"
            )
            raise ValueError(message)
        _validate.choice("numerics.walls", self.walls, WALLS)
        _validate.number("numerics.box_tolerance", self.box_tolerance, above=0, most=0.1)
        _validate.choice("numerics.precision", self.precision, PRECISIONS)
        _validate.choice("numerics.transform", self.transform, TRANSFORMS)
        _validate.integer("numerics.threads", self.threads, least=0)
        _validate.integer("numerics.seed", self.seed, least=0, most=LARGEST_SEED)
        _validate.flag("numerics.allow_coarse", self.allow_coarse)

    def _check_tolerance(self) -> None:
        """Have "linearised" instead of "bdf2" where there is a tolerance; ValueError for others."""
        if self.tolerance is None:
            return
        _validate.number("numerics.tolerance", self.tolerance, above=0, most=LARGEST_TOLERANCE)
        if self.scheme not in ("bdf2", "linearised"):
            message = (
                f"numerics.tolerance = {self.tolerance:g} with scheme = {self.scheme!r}, whose "
                "steps are all of one length; take scheme = 'linearised', or no tolerance"
            )
            raise ValueError(message)
        object.__setattr__(self, "scheme", "linearised")

    @classmethod
    def preset(cls, name: str, **changes: Any) -> Self:
        """Numerics of a known accuracy and speed.

        Error of the eight-cell embryo's centroids (root mean square) at t = 480, and time of its
        whole course relative to "standard", measured by `benchmarks/accuracy.py --front`:

        - "draft": tolerance 50, h = 2/3 µm, box tolerance 3e-3; 52 nm, 0.2 times
        - "fast": tolerance 20, h = 0.55 µm, box tolerance 3e-3; 27 nm, 0.5 times
        - "standard": tolerance 10, h = 0.5 µm; 15 nm
        - "reference": tolerance 0.5, h = 1/3 µm; 2.3 nm, 7 times
        - "published": fixed steps of Eq. 9, δt = 2, S = 12, stepped walls, order 6, as the
          published program; 101 nm, 6 times

        All but the last have gradients fitted to the interface. Their tolerance gives way to a
        `dt` or a `scheme` that is given: steps are fixed then, and the solver is "band". The
        defaults, `Numerics()`, are no preset: Eq. 9 with fixed steps, solved exactly; 21 nm, 6
        times.

        Parameters
        ----------
        name : {"draft", "fast", "standard", "reference", "published"}
        **changes
            Values that differ from the preset.

        Raises
        ------
        ValueError
            The name is not known, or a value is out of range.
        """
        return cls(**preset_values(name, changes))

    @property
    def active_solver(self) -> str:
        """The solver at work: some schemes have one of their own."""
        return OWN_SOLVERS.get(self.scheme, self.solver)

    @property
    def tick(self) -> float:
        """*In silico* time of a tick, in which time is counted: δt, or δt / 64 with a tolerance."""
        return self.dt if self.tolerance is None else self.dt / PARTS

    @property
    def worker_count(self) -> int:
        """Number of threads to use: `threads`, or as many as this process can have."""
        return self.threads or automatic_threads()

    @property
    def step_text(self) -> str:
        """How long steps are, in words."""
        if self.tolerance is None:
            return f"δt = {self.dt:g}"
        return f"tolerance {self.tolerance:g} nm, δt from {self.tick:g} to {LONGEST * self.dt:g}"

    def ticks_to(self, time: float, what: str = "time") -> int:
        """Number of ticks that reach an *in silico* time.

        Raises
        ------
        ValueError
            They are more than any computer takes; `what` names the time.
        """
        if time > MOST_STEPS * self.dt:
            message = (
                f"{what} = {time:g} takes {time / self.dt:.3g} steps of numerics.dt = "
                f"{self.dt:g}; at most {MOST_STEPS:g} are allowed (at a thousand a second, three "
                "years). Take a shorter time, or a larger dt"
            )
            raise ValueError(message)
        ticks = time / self.tick
        return int(np.ceil(ticks - max(1e-9, 1e-15 * ticks)))
