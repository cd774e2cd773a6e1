"""Fig. 3 of the paper: small free cells disappear, and what keeps them.

Run as `python examples/cell_disappearance.py [picture]`: about two minutes; needs matplotlib. A
free sphere of radius R is run until it vanishes or is steady; bisection finds the smallest radius
that is kept. It is compared with the smallest sphere that has a steady state, found from the
radial equation, and with the limit of a sharp interface, where the tension 2γ/R meets the pressure
M (V - v).
"""

import sys
from collections.abc import Callable
from functools import cache

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from morphosim import (
    Cell,
    CellVanishedError,
    DivergenceError,
    Numerics,
    Physics,
    Scene,
    Simulation,
    Sphere,
)

STRENGTHS = {"absolute": 0.0016, "relative": 8.0}  # M in 1/µm³, M'
C_VALUES = (0.5, 1.0, 2.0, 4.0, 8.0, 18.0)
M_VALUES = (0.0004, 0.0008, 0.0016, 0.0032, 0.0064)
STEADY = 1e-4  # largest relative change of volume in a time of CHECK
CHECK = 100
FINE = {"absolute": (0.5, 2.0), "relative": (0.1, 2.0)}  # dt, S; the relative form is stiffer
PUBLISHED = (2.0, 12.0)
TIMES = range(0, 121, 20)
GAMMA = Physics().gamma

LOST, BETWEEN, KEPT = "#c6dcef", "#efefef", "#fbeeb8"
COLORS = {"absolute": "#b3500c", "relative": "#0b4f8a"}
MARKERS = {"absolute": "s", "relative": "o"}


def free_cell(
    radius: float, c: float, form: str, M: float, dt_S: tuple[float, float], on_vanish: str = "stop"
) -> Simulation:
    """One sphere in open space; the spacing resolves the interface."""
    cell = Cell(name="cell", shape=Sphere(center=(0, 0, 0), radius=radius))
    numerics = Numerics(dt=dt_S[0], S=dt_S[1], spacing=min(0.5, (2 * c) ** -0.5), threads=1)
    physics = Physics(c=c, volume_constraint=form, M=M)
    return Simulation(Scene(cells=[cell], physics=physics, numerics=numerics, on_vanish=on_vanish))


def is_kept(
    radius: float, c: float, form: str, M: float, dt_S: tuple[float, float] | None = None
) -> bool:
    """Whether the cell comes to a steady state; False if it vanishes or its field runs away."""
    dt_S = dt_S or FINE[form]
    simulation = free_cell(radius, c, form, M, dt_S)
    change = np.inf
    while abs(change) > STEADY:
        before = simulation.volumes[0]
        try:
            simulation.run(until=simulation.time + CHECK)
        except CellVanishedError:
            return False
        except DivergenceError:
            print(f"  (R = {radius:.1f}, c = {c:g}, dt = {dt_S[0]:g}: diverged, counted as lost)")
            return False
        change = simulation.volumes[0] / before - 1
    return True


def bisect(works: Callable[[float], bool], low: float, high: float, width: float) -> float:
    """Smallest value that works, to `width`, between one that does not and one that does."""
    fails, holds = 0, round((high - low) / width)
    while holds - fails > 1:
        middle = (fails + holds) // 2
        if works(low + middle * width):
            holds = middle
        else:
            fails = middle
    return low + holds * width


def smallest_kept(c: float, form: str, M: float, dt_S: tuple[float, float] | None = None) -> float:
    """Smallest radius that is kept, to 0.1 µm."""
    low = round(1.5 / c**0.5, 1)
    return bisect(lambda R: is_kept(R, c, form, M, dt_S), low, 6.2, 0.1)


def strength_that_keeps(radius: float) -> float:
    """Smallest M of the absolute form that keeps a radius at c = 1, to 2 %."""
    log_M = bisect(
        lambda x: is_kept(radius, 1.0, "absolute", np.exp(x)), np.log(2e-4), np.log(6e-3), 0.02
    )
    return float(np.exp(log_M))


def shoot(center: float, q: float) -> tuple[bool, float]:
    """Solve φ" + 2φ'/x = W'(φ) - q |φ'| outwards: whether φ falls below 0, and ∫ φ."""

    def slope(x: float, y: np.ndarray) -> list[float]:
        phi, d = y[:2]
        return [d, 2 * phi * (1 - phi) * (1 - 2 * phi) - (2 / x - q) * d, 4 * np.pi * x**2 * phi]

    def below(x: float, y: np.ndarray) -> float:
        return y[0]

    def rises(x: float, y: np.ndarray) -> float:
        return y[1]

    below.terminal = rises.terminal = True
    start = [center, slope(1.0, np.array([center, 0.0]))[1] * 1e-3 / 3, 0.0]
    options = {"method": "LSODA", "rtol": 1e-8, "atol": 1e-12, "events": (below, rises)}
    solution = solve_ivp(slope, (1e-3, 60.0), start, **options)
    return bool(solution.t_events[0].size), float(solution.y[2, -1])


@cache
def steady_spheres() -> tuple[np.ndarray, np.ndarray]:
    """All steady spheres: pressure over γ√c, and volume times c^(3/2).

    In units of 1/√c they are one family, here by 1 - φ in the centre from 0.4 to 1e-10.
    """
    depths = np.linspace(np.log(0.4), np.log(1e-10), 40)
    pairs = []
    for depth in depths:
        center = 1 - np.exp(depth)
        q = bisect(lambda q, center=center: shoot(center, q)[0], 0.1, 1.8, 1e-7)
        pairs.append((q, shoot(center, q)[1]))
    fine = np.linspace(depths[0], depths[-1], 2000)
    q, volume = CubicSpline(depths[::-1], pairs[::-1])(fine).T
    return q, volume


def steady_limit(c: float, form: str, M: float) -> float:
    """Radius below which no steady sphere exists: the smallest V that one of them satisfies."""
    q, volume = steady_spheres()
    pressure, volume = GAMMA * c**0.5 * q, volume * c**-1.5
    targets = volume + pressure / M if form == "absolute" else volume / (1 - pressure / M)
    return float((3 * targets.min() / (4 * np.pi)) ** (1 / 3))


def sharp_limit(form: str, M: float | np.ndarray) -> float | np.ndarray:
    """The same where the interface has no width: M (V - v) = 2γ/R or M (1 - v/V) = 2γ/R."""
    if form == "absolute":
        return (2 * GAMMA * 4 ** (1 / 3) / (np.pi * M)) ** 0.25
    return 2 * GAMMA * 4 ** (4 / 3) / (3 * M)


def measure(form: str, c: float, M: float) -> float:
    """Smallest radius kept; prints a row of the table."""
    fine, published = smallest_kept(c, form, M), smallest_kept(c, form, M, PUBLISHED)
    print(
        f"{form:8} {c:6g} {M:8g} {fine:10.1f} {published:12.1f} "
        f"{steady_limit(c, form, M):12.2f} {sharp_limit(form, M):8.2f}",
        flush=True,
    )
    return fine


def draw_profiles(axes: Axes, radius: float) -> None:
    """φ through the centre, old form with c = 1."""
    simulation = free_cell(
        radius, 1.0, "absolute", STRENGTHS["absolute"], FINE["absolute"], "ignore"
    )
    colors = plt.get_cmap("viridis_r")(np.linspace(0.08, 1, len(TIMES)))
    for time, color in zip(TIMES, colors, strict=True):
        simulation.run(until=time)
        field = simulation.fields[0]
        x = (field.origin[0] + np.arange(field.phi.shape[0])) * simulation.scene.numerics.spacing
        line = field.phi[:, -field.origin[1], -field.origin[2]]
        axes.plot(x, line, color=color, label=f"t = {time}", lw=1.8)
        print(
            f"R = {radius:g} um, t = {time:3}: largest phi {line.max():.2f}, "
            f"volume {simulation.volumes[0]:5.1f} of {simulation.targets[0]:.1f} um3"
        )
    axes.axhline(0.5, color="0.5", ls=":", lw=1)
    axes.text(-8.8, 0.51, "lost below", va="bottom", fontsize=9)
    axes.set(xlabel="x (µm)", ylabel="φ", xlim=(-9, 9), ylim=(-0.03, 1.08))
    axes.set_xticks(range(-8, 9, 4))


def draw_over_c(axes: Axes, measured: dict[str, list[float]]) -> None:
    """Thresholds against c, both forms."""
    c = np.geomspace(0.4, 20, 60)
    limit = {f: np.array([steady_limit(x, f, M) for x in c]) for f, M in STRENGTHS.items()}
    axes.fill_between(c, 0, limit["relative"], color=LOST, lw=0)
    axes.fill_between(c, limit["relative"], limit["absolute"], color=BETWEEN, lw=0)
    axes.fill_between(c, limit["absolute"], 9, color=KEPT, lw=0)
    for form, values in measured.items():
        name = "M" if form == "absolute" else "M'"
        draw_measured(axes, C_VALUES, values, form, f"{form}, {name} = {STRENGTHS[form]:g}")
        axes.plot(c, limit[form], color=COLORS[form], lw=1.5)
    sharp = sharp_limit("absolute", STRENGTHS["absolute"])
    axes.axhline(sharp, color="0.25", ls="--", lw=1, label="absolute, sharp interface")
    axes.plot(2, 3, "*", color="k", ms=10)
    axes.annotate("R = 3 µm, c = 2", (2, 3), (7, -4), textcoords="offset points")
    for text, place in {
        "kept": (5, 4.6),
        "lost": (0.6, 1.2),
        "kept by the\nrelative form": (9.5, 2.1),
    }.items():
        axes.text(*place, text, ha="center", va="center")
    axes.set(xlabel="c", ylabel="R (µm)", xscale="log", xlim=(0.4, 20), ylim=(0, 7))
    axes.set_xticks(C_VALUES, [f"{x:g}" for x in C_VALUES])
    axes.minorticks_off()
    axes.legend(loc="upper right")


def draw_measured(axes: Axes, x: tuple, values: list[float], form: str, label: str) -> None:
    """Marks in the middle between the largest radius lost and the smallest kept."""
    middle = np.array(values) - 0.05
    axes.plot(x, middle, MARKERS[form], color=COLORS[form], mec="w", label=label)


def draw_over_m(axes: Axes, measured: list[float], between: tuple[float, float]) -> None:
    """Thresholds of the absolute form with c = 1 against M."""
    M = np.geomspace(3e-4, 8e-3, 60)
    limit = np.array([steady_limit(1.0, "absolute", x) for x in M])
    axes.fill_between(M, 0, limit, color=LOST, lw=0)
    axes.fill_between(M, limit, 9, color=KEPT, lw=0)
    draw_measured(axes, M_VALUES, measured, "absolute", "simulated threshold")
    axes.plot(M, limit, color=COLORS["absolute"], lw=1.5, label="steady state exists")
    axes.plot(M, sharp_limit("absolute", M), color="0.25", ls="--", lw=1, label="sharp interface")
    low, high = between
    axes.plot((low, high, high, low, low), (4, 4, 5, 5, 4), color="k", ls=":", lw=1.5)
    axes.text(1.06 * high, 4.6, "4 µm lost,\n5 µm kept", va="center")
    axes.set(xlabel="M (1/µm³)", ylabel="R (µm)", xscale="log", xlim=(3e-4, 8e-3), ylim=(2, 7))
    axes.set_xticks(M_VALUES, [f"{x:g}" for x in M_VALUES])
    axes.minorticks_off()
    axes.legend(loc="upper right")


def main(path: str) -> None:
    """Measure, print and draw."""
    plt.rcParams.update({"font.size": 10, "legend.fontsize": 9, "legend.framealpha": 1})
    figure, axes = plt.subplots(2, 2, figsize=(8, 6.6), layout="constrained")
    draw_profiles(axes[0, 0], 4.0)
    draw_profiles(axes[0, 1], 5.0)
    axes[0, 1].legend(loc="lower center")

    print("\nform          c        M  kept from  dt 2, S 12  steady from    sharp  (R in um)")
    over_c = {f: [measure(f, c, M) for c in C_VALUES] for f, M in STRENGTHS.items()}
    over_m = [measure("absolute", 1.0, M) for M in M_VALUES]
    between = strength_that_keeps(5.0), strength_that_keeps(4.0)
    print("\nabsolute, c = 1: 4 um lost and 5 um kept for M from {:.2g} to {:.2g}".format(*between))
    kept = is_kept(3.0, 2.0, "relative", STRENGTHS["relative"])
    print("relative, c = 2, M' = 8: a cell of 3 um is", "kept" if kept else "lost")

    draw_over_c(axes[1, 0], over_c)
    draw_over_m(axes[1, 1], over_m, between)
    titles = (
        "(a) R = 4 µm, absolute form, c = 1",
        "R = 5 µm, absolute form, c = 1",
        "(b) lost and kept, both forms",
        "(c) lost and kept, absolute form, c = 1",
    )
    for ax, title in zip(axes.flat, titles, strict=True):
        ax.set_title(title, loc="left")
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True})
    print("wrote", path)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "cell_disappearance.png")
