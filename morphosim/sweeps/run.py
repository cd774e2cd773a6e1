"""`sweep`: a scan from its axes to its Dataset."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from morphosim import _validate
from morphosim.library.built_in import find_scene
from morphosim.library.synnotch import SCENES as RANDOM
from morphosim.progress import TellWhat, progress_line, silent
from morphosim.provenance import processor, versions
from morphosim.scene.file import save_scene
from morphosim.scene.scene import Scene
from morphosim.scene.stability import refuse
from morphosim.simulation.compilation import compilation_told
from morphosim.simulation.warming import warm_first
from morphosim.sweeps.axes import SEED, Plan, make_plan
from morphosim.sweeps.figures import Figure, make_figures
from morphosim.sweeps.members import Task
from morphosim.sweeps.result import RESERVED, assembled
from morphosim.sweeps.scheduler import cluster_client, local_client, need_dask, results, shares
from morphosim.sweeps.store import Store

if TYPE_CHECKING:
    import xarray as xr

KEEP = ("figures", "runs")


@dataclass(frozen=True, slots=True)
class _Setup:
    """A scan that has been checked."""

    plan: Plan
    figures: Sequence[Figure]
    scene: Scene
    name: str


def sweep(
    scene: Scene | str | Path,
    axes: Mapping[str, Any],
    *,
    figures: Sequence[Any] | Mapping[str, Any] = ("volume", "contact_area"),
    replicates: int = 1,
    samples: int | None = None,
    sampling: str = "sobol",
    sample_seed: int = 0,
    overrides: Mapping[str, Any] | None = None,
    directory: str | Path | None = None,
    keep: str = "figures",
    retry: bool = False,
    workers: int | None = None,
    threads_per_member: int | None = None,
    address: str | None = None,
    progress: bool = True,
) -> "xr.Dataset":
    """Run a scene for all values of some parameters, many members at a time.

    A scan that is stopped or killed goes on when it is called again with the same directory: what
    is finished is not run again, and a member that was under way goes on from its last save.

    Parameters
    ----------
    scene : Scene, name of a built-in scene, or path of a scene file
    axes : mapping
        By dotted key, such as "physics.gamma" or "numerics.dt": a list of values, an `Axis`, or a
        `Range`, which is sampled.
    figures : sequence or mapping
        What to take of each member: a variable of its run at the last save ("volume"), or at all
        ("volume(time)"); a function of the run's Dataset, or its name as "module:name". A mapping
        names them.
    replicates : int
        Runs of each member, with the seeds `numerics.seed`, + 1, …
    samples : int, optional
        Number of points at which ranges are sampled.
    sampling : {"sobol", "latin"}
        Scrambled Sobol sequence (`samples` a power of two), or Latin hypercube.
    sample_seed : int
        Seed of the sampling.
    overrides : mapping, optional
        Values by dotted key that hold for all members.
    directory : path, optional
        Where results are kept; by default a temporary place, and the scan cannot go on later.
    keep : {"figures", "runs"}
        Whether the runs of the members stay too, in `directory`/runs.
    retry : bool
        Whether members whose result is an error are run again.
    workers : int, optional
        Processes of this machine; by default as many as the cores allow.
    threads_per_member : int, optional
        By default one, or more where there are fewer members than cores.
    address : str, optional
        Of a Dask scheduler, as "tcp://host:8786". Its workers must see `directory`, and have one
        Dask thread each.
    progress : bool
        Whether to draw a progress bar.

    Returns
    -------
    xarray.Dataset
        Dimensions are the axes, `sample` (with the ranges as coordinates), `replicate` (with
        `seed`), and those of the figures. Besides the figures it has `error`, `warning`, `seconds`
        and `end_time`. It is also in `directory`/sweep.nc.

    Raises
    ------
    ValueError
        An axis, figure or other choice is not allowed, or the directory holds another scan.
    FileExistsError
        The directory holds something else, or the scan is running there.
    ImportError
        Dask is not installed.

    Examples
    --------
    >>> from morphosim import sweep
    >>> found = sweep("celegans-8", {"physics.gamma": [0.2, 0.3]})  # doctest: +SKIP
    >>> found["volume"].sel({"physics.gamma": 0.3, "cell": "E"})  # doctest: +SKIP
    """
    need_dask()
    _validate.choice("keep", keep, KEEP)
    chosen = make_figures(figures)
    setup = _checked(
        scene, axes, chosen, overrides or {}, replicates=replicates, samples=samples,
        sampling=sampling, sample_seed=sample_seed,
    )  # fmt: skip
    if directory is None and keep == "runs":
        message = "keep = 'runs' needs a directory to keep them in"
        raise ValueError(message)
    if address is not None and workers is not None:
        message = f"workers = {workers}: a cluster has its own; leave out workers, or address"
        raise ValueError(message)
    with ExitStack() as stack:
        place = directory or stack.enter_context(tempfile.TemporaryDirectory(prefix="morphosim-"))
        store = Store(Path(place).resolve())
        stack.enter_context(store.locked())
        _begin(store, setup, keep)
        if retry:
            for number in store.failed():
                store.forget(number)
        finished = store.finished()
        todo = [member for member in setup.plan.members if member.number not in finished]
        count, threads = _resources(len(todo), workers, threads_per_member, address)
        task = Task(
            directory=store.path, scene=setup.name, figures=chosen, threads=threads,
            keep_runs=keep == "runs",
        )  # fmt: skip
        tell = stack.enter_context(progress_line()) if progress else silent
        lost = _run(task, todo, len(finished), tell, count, address) if todo else {}
        return _written(store, setup, threads, lost)


def _checked(
    scene: Scene | str | Path,
    axes: Mapping[str, Any],
    figures: Sequence[Figure],
    overrides: Mapping[str, Any],
    **choices: Any,
) -> _Setup:
    """Plan whose every value a run accepts; ValueError or TypeError names axis and value."""
    _validate.instance("overrides", overrides, Mapping)
    random = isinstance(scene, str) and scene in RANDOM and not Path(scene).is_dir()
    base = scene if isinstance(scene, Scene) else find_scene(str(scene))
    seed = overrides.get(SEED, base.numerics.seed)
    fixed = dict(overrides)
    if _validate.integer("replicates", choices["replicates"], least=1) > 1:
        fixed.pop(SEED, None)
    plan = make_plan(axes, seed=seed, fixed=fixed, **choices)
    for name in (*axes, *(figure.name for figure in figures)):
        if "/" in name:
            message = f"name {name!r} has a '/', which no variable of a file may have"
            raise ValueError(message)
    for figure in figures:
        if figure.name in RESERVED:
            message = f"figure {figure.name!r}: the Dataset has a variable or dimension of this "
            message += "name; give figures as a mapping from another name"
            raise ValueError(message)
    taken = {*RESERVED, *(figure.name for figure in figures)}
    for name in axes:
        if name in taken:
            message = f"axis {name!r}: a figure or a dimension has this name; name the axis "
            message += f"otherwise and say sets = {name!r}"
            raise ValueError(message)
    setup = _Setup(plan, figures, base, str(scene) if random else "")
    with tempfile.TemporaryDirectory() as folder:
        _try(setup, Path(folder))
    return setup


def _try(setup: _Setup, folder: Path) -> None:
    """Make a scene of every value of every axis."""
    save_scene(setup.scene, Store(folder).scene)
    task = Task(
        directory=folder, scene=setup.name, figures=setup.figures, threads=1, keep_runs=False
    )
    _attempt(partial(task.scene_of, setup.plan.fixed), "overrides")
    moving = bool(setup.name)
    for name, value, settings in setup.plan.trials():
        scene = _attempt(partial(task.scene_of, settings), f"axis {name!r} = {value!r}")
        moving = moving or _has_noise(scene)
    if setup.plan.replicates > 1 and not moving:
        message = (
            f"replicates = {setup.plan.replicates} would all be the same: they differ by the seed, "
            "which nothing in this scene uses. Take replicates = 1, or physics.kappa > 0"
        )
        raise ValueError(message)


def _attempt(make: Callable[[], Scene], where: str) -> Scene:
    try:
        scene = make()
        scene.rehearsed()
        refuse(scene)
    except (ValueError, TypeError) as error:
        message = f"{where}: {error}"
        raise type(error)(message) from error
    return scene


def _has_noise(scene: Scene) -> bool:
    """Whether cells move at random, now or in a stage; own events may always."""
    return any(term.random for physics in scene.courses for term in physics.active_terms)


def _begin(store: Store, setup: _Setup, keep: str) -> None:
    """Write what the scan is, or check that the directory holds the same."""
    description = setup.plan.description() | {
        "scene": setup.name or setup.scene.name,
        "figures": {figure.name: figure.description for figure in setup.figures},
        "keep": keep,
    }
    with tempfile.TemporaryDirectory() as folder:
        staged = Store(Path(folder))
        save_scene(setup.scene, staged.scene)
        store.begin(description, staged)


def _resources(
    members: int, workers: int | None, threads: int | None, address: str | None
) -> tuple[int, int]:
    """Local processes, and threads per member."""
    if address is None:
        return shares(members, workers, threads)
    return 0, 1 if threads is None else _validate.integer("threads_per_member", threads, least=1)


def _run(
    task: Task, todo: Sequence[Any], finished: int, tell: TellWhat, workers: int,
    address: str | None,
) -> dict[int, str]:  # fmt: skip
    """Run members; why some have no result, by number."""
    lost: dict[int, str] = {}
    total = finished + len(todo)
    if address is None:
        with compilation_told(silent, lambda: nullcontext(tell)):
            warm_first(task.scene_of({}))
    client = local_client(workers) if address is None else cluster_client(address)
    with client as running:
        tell("members", finished, total)
        for done, (member, error) in enumerate(results(running, task, todo), finished + 1):
            if error:
                lost[member.number] = error
            tell("members", done, total)
    return lost


def _written(store: Store, setup: _Setup, threads: int, lost: Mapping[int, str]) -> "xr.Dataset":
    """The Dataset, also written to the scan's directory."""
    from morphosim._files import replacing

    result = assembled(store, setup.plan, lost)
    result.attrs = {
        "title": f"scan of {setup.name or setup.scene.name}",
        "source": f"MorphoSim {versions()['morphosim']}",
        "threads_per_member": threads,
        "machine": processor(),
    }
    with replacing(store.result) as partial:
        result.to_netcdf(partial, engine="netcdf4")
    return result
