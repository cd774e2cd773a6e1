"""`fit`: from label images to tensions and attractions."""

import hashlib
import json
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from morphosim import _validate
from morphosim._files import replacing
from morphosim.geometry.confinement import Confinement
from morphosim.inference.estimate import Misfit
from morphosim.inference.observed import Image, Names, Observed, read_images, read_run
from morphosim.inference.pool import Pool, pool
from morphosim.inference.replicates import Replica, mismatch, replicated
from morphosim.inference.result import Answer, dataset
from morphosim.inference.scatter import scatter_strength
from morphosim.inference.search import LEAST_ROUNDS, MOST_ROUNDS, TIMES, Search, State, intervals_of
from morphosim.inference.store import Store
from morphosim.inference.trial import SETTLING, Frame, Interval, Model
from morphosim.inference.unknowns import unknowns_of
from morphosim.numerics.parameters import Numerics
from morphosim.progress import progress_line, silent
from morphosim.provenance import check_memory
from morphosim.runs.writer import RunWriter
from morphosim.scene.fingerprint import settings
from morphosim.scene.scene import Scene
from morphosim.simulation.compilation import compilation_told
from morphosim.simulation.simulation import Simulation
from morphosim.simulation.warming import warm_first
from morphosim.sweeps.scheduler import need_dask

if TYPE_CHECKING:
    import xarray as xr

RESAMPLES = 8
COPIES = 8
"""Matrices of all patches with all others, while uncertainties are found."""
UNSETTLED = (
    f"the estimates still changed after {MOST_ROUNDS} rounds: the model may not be able to hold "
    "cells as they are seen (see the residuals), or too much is asked for"
)


def fit(
    observed: Image | Sequence[Image],
    *,
    gamma: str | None = "cell",
    sigma: str | None = "pair",
    M: bool = False,
    kappa: bool = False,
    scene: Scene | str | Path | None = None,
    names: Names | None = None,
    times: Sequence[float] | None = None,
    time: float | None = None,
    spacing: ArrayLike | None = None,
    confinement: Confinement | str | None = None,
    numerics: Numerics | None = None,
    resamples: int = RESAMPLES,
    directory: str | Path | None = None,
    workers: int | None = None,
    address: str | None = None,
    progress: bool = True,
) -> "xr.Dataset":
    """Tensions and attractions with which cells stay as an image shows them, or move as several do.

    Cells start from the image and are run with what is tried; all unknowns are varied, and improved
    by least squares of how far surfaces end from where they are seen, until they change no more.
    Then images of the best fit are fitted again, to see how far errors of voxels and of the
    segmentation take the answer. A fit that is stopped or killed goes on when it is called again
    with the same directory.

    Parameters
    ----------
    observed : LabelImage, path, a sequence of them in the order of time, or the directory of a run
        Cells are the labels above 0, the same ones in all images. Of a run, its last save is
        looked at, or those at `times`.
    gamma : {"cell", "type"} or None
        Whether the surface tension of each cell is asked for, or of each type. Of a single image
        the mean of all cells is held, where `sigma` is asked for too.
    sigma : {"pair", "type", "all"} or None
        Whether the attraction of each pair of cells that touch is asked for, of each pair of types,
        or one for all.
    M : bool
        Whether the strength of the volume constraint is asked for; needs target volumes.
    kappa : bool
        Whether the strength of the motility noise is asked for; needs a series.
    scene : Scene, name of a built-in scene, or path of a scene file, optional
        What is given: the physics, the confinement and, of cells of the same names, their types,
        target volumes and tensions. Where they are asked for, tensions begin at their mean, and
        attractions at the default one.
    names : mapping from label to name, or path of a table, optional
        See `import_labels`.
    times : sequence of float, optional
        *In silico* time of each image.
    time : float, optional
        *In silico* time that cells of a single image are run for. By default 80, or 40 where cells
        turn out not to be at rest: more tells more, less is better where cells move.
    spacing : float or (3,) µm, optional
        Size of a voxel, where `observed` is a path; see `read_labels`.
    confinement : Confinement, "image" or "ellipsoid", optional
        Walls, if not those of the scene; "image" and "ellipsoid" are found around all labels.
    numerics : Numerics, optional
        By default the preset "standard", and of a run its own.
    resamples : int
        How many images of the best fit are fitted again.
    directory : path, optional
        Where all is kept: the answer as fit.nc, the best run, what goes on when killed.
    workers : int, optional
        Processes of this machine; by default as many as there are cores.
    address : str, optional
        Of a Dask scheduler, see `sweep`.
    progress : bool
        Whether to tell how many runs have been made.

    Returns
    -------
    xarray.Dataset
        `estimate` and its standard deviation `sd` of each `unknown`, `correlation`, whether the
        images tell it (`told`), and what is left over of each patch of surface, cell and contact.

    Raises
    ------
    ValueError
        An image does not do, nothing or something impossible is asked for, or the directory holds
        another fit; the message says what to do.
    FileExistsError
        The directory holds something else, or the fit is running there.
    ImportError
        Dask is not installed.

    Examples
    --------
    >>> from morphosim import fit
    >>> answer = fit("embryo.tif", scene="celegans-8")  # doctest: +SKIP
    >>> answer["estimate"].sel(unknown="sigma ABpl-E")  # doctest: +SKIP
    """
    need_dask()
    _validate.integer("resamples", resamples, least=0)
    _validate.flag("M", M)
    _validate.flag("kappa", kappa)
    if time is not None:
        _validate.number("time", time, above=0)
    seen = _seen(
        observed, scene=scene, names=names, times=times, spacing=spacing, confinement=confinement,
        numerics=numerics,
    )  # fmt: skip
    asked: dict[str, Any] = {"gamma": gamma, "sigma": sigma, "M": M}
    _check_asked(seen, M=M, kappa=kappa)
    if kappa:  # cells without noise are compared with
        still_cells = seen.scene.with_physics(kappa=0.0, kappa_by_type={})
        seen = replace(seen, scene=still_cells)
    model, frames = _model(seen, TIMES[0] if time is None else time, **asked)
    still = len(frames) == 1
    compared = frames if still else frames[1:]
    misfit = Misfit(
        patches=tuple(frame.patches for frame in compared), unknowns=model.unknowns,
        open_space=still and model.scene.confinement is None,
    )  # fmt: skip
    count = len(misfit.weight)
    advice = "fit fewer cells, or an image with a larger part of them as background"
    check_memory(f"a fit with {count} patches of surface", COPIES * 8.0 * count**2, advice)
    with ExitStack() as stack:
        place = directory or stack.enter_context(tempfile.TemporaryDirectory(prefix="morphosim-"))
        store = Store(Path(place).resolve())
        stack.enter_context(store.locked())
        choices = {"kappa": kappa, "time": time, "resamples": resamples}
        store.begin(_description(seen, model, asked | choices))
        tell = stack.enter_context(progress_line()) if progress else silent
        with compilation_told(silent, lambda: nullcontext(tell)):
            warm_first(model.scene)
        work = _Work(store, model, frames, misfit)
        before = store.load(model.unknowns.names, len(frames))
        runs = 0 if before is None else before[1]
        with pool(workers, address, tell, runs) as workers_at:
            return work.answered(
                before, workers_at, given=time is not None, resamples=resamples, kappa=kappa
            )


def _seen(
    what: Image | Sequence[Image], *, scene: Scene | str | Path | None, names: Names | None,
    spacing: ArrayLike | None, **choices: Any,
) -> Observed:  # fmt: skip
    """What is observed, of images or a run."""
    if not isinstance(what, str | Path) or not Path(what).is_dir():
        return read_images(what, scene=scene, names=names, spacing=spacing, **choices)
    for option, value in (("names", names), ("spacing", spacing), ("scene", scene)):
        if value is not None:
            message = f"{option} is given, but {what} is a run, which has its own; leave it out"
            raise ValueError(message)
    return read_run(Path(what), **choices)


def _model(
    seen: Observed, time: float, *, gamma: str | None, sigma: str | None, M: bool
) -> tuple[Model, list[Frame]]:
    """What trials share, and what they are compared with."""
    scene, names = seen.scene, seen.scene.names
    frames = [
        Frame.of(when, image, names) for when, image in zip(seen.times, seen.images, strict=True)
    ]
    contacts = sorted({pair for frame in frames for pair in frame.surfaces.contacts})
    unknowns = unknowns_of(
        names, scene.types, scene.tensions, scene.physics, contacts, gamma=gamma, sigma=sigma, M=M,
        still=len(frames) == 1,
    )  # fmt: skip
    longest = max([time, SETTLING, *np.diff(seen.times).tolist()])
    numerics = replace(scene.numerics, threads=1)
    scene = replace(scene, numerics=numerics, duration=longest, save_every=longest)
    return Model(scene=scene, unknowns=unknowns, time=time), frames


def _check_asked(seen: Observed, *, M: bool, kappa: bool) -> None:
    """Raise ValueError if what is observed cannot tell what is asked for."""
    still = len(seen.images) == 1
    if M and not seen.volumes_given:
        message = (
            "M is asked for, but target volumes are not known: how far cells are pressed below "
            "them is all that tells M; give them in the scene, or in the table as volume"
        )
        raise ValueError(message)
    if M and not seen.scene.physics.constraint.present:
        message = "M is asked for, but the physics have no volume constraint; leave out M"
        raise ValueError(message)
    if kappa and still:
        message = "kappa is asked for, but a single image tells no motion; give a series with times"
        raise ValueError(message)


def _description(seen: Observed, model: Model, choices: Mapping[str, Any]) -> dict[str, Any]:
    """What tells one fit from another."""
    images = hashlib.sha256()
    for image in seen.images:
        images.update(np.ascontiguousarray(image.labels).tobytes())
        images.update(repr((image.labels.shape, image.steps.tolist())).encode())
        images.update(repr(np.asarray(image.origin).tolist()).encode())
    scene = json.dumps(settings(model.scene), sort_keys=True, default=str)
    return {
        "images": images.hexdigest(), "times": list(seen.times), **choices,
        "scene": hashlib.sha256(scene.encode()).hexdigest(), "cells": list(model.unknowns.names),
    }  # fmt: skip


@dataclass(frozen=True)
class _Work:
    """A fit that has been checked, and where it is kept."""

    store: Store
    model: Model
    frames: Sequence[Frame]
    misfit: Misfit

    def answered(
        self, before: tuple[State, int, float] | None, workers: Pool, *, given: bool,
        resamples: int, kappa: bool,
    ) -> "xr.Dataset":  # fmt: skip
        """Search on from where it was, resample, and write the answer."""
        begun = perf_counter() - (0.0 if before is None else before[2])
        search = Search(model=self.model, frames=self.frames, misfit=self.misfit, pool=workers)
        state = self._first(given) if before is None else before[0]
        while not state.done:
            workers.expected = workers.runs + self._left(state, resamples)
            state = search.advanced(state)
            self.store.save(state, workers.runs, perf_counter() - begun)
        final = search.varied(search.settled(state))
        off = self._resampled(search.timed(final), final, workers, resamples)
        facts: dict[str, Any] = {"warning": "" if state.change <= 1 else UNSETTLED}
        intervals = intervals_of(self.frames, final.starts)
        if kappa:
            found = scatter_strength(self.model, intervals, final.vector, workers)
            facts |= dict(zip(("kappa", "kappa_sd"), found, strict=True))
        ended = self._best_run(intervals[-1], final)
        facts |= {"runs": workers.runs, "seconds": perf_counter() - begun}
        answer = Answer(
            unknowns=self.model.unknowns, misfit=self.misfit, frames=self.frames, state=final,
            off=off, facts=facts,
        )  # fmt: skip
        table = dataset(answer, ended.fields, self.model.spacing)
        with replacing(self.store.result) as partial:
            table.to_netcdf(partial, engine="netcdf4")
        with suppress(ImportError):  # of the extra `figures`
            from morphosim.inference.page import draw_page

            image = self.frames[-1].image
            draw_page(self.store.picture, table, image, ended.fields, self.model.spacing)
        return table

    def _first(self, given: bool) -> State:
        return State(
            round=0, vector=self.model.unknowns.start, starts=[None] * len(self.frames),
            time=self.model.time, given=given,
        )  # fmt: skip

    def _left(self, state: State, resamples: int) -> int:
        """Runs that are still to be made, if it takes as many rounds as it may take at least."""
        frames = len(self.frames)
        each = frames * (len(state.vector) + 3)
        return max(LEAST_ROUNDS - state.round, 1) * each + each + resamples

    def _resampled(
        self, model: Model, state: State, workers: Pool, resamples: int
    ) -> NDArray[np.float64]:
        """(R, n) by how much replicates are off."""
        known = self.store.replicates()
        starts = [start for start in state.starts if start is not None]
        flips = [
            mismatch(frame, start.fields, self.model.spacing)
            for frame, start in zip(self.frames, starts, strict=True)
        ]
        replica = Replica(
            model=model, misfit=self.misfit, frames=self.frames, starts=starts,
            vector=state.vector, slopes=state.slopes, flips=flips,
        )  # fmt: skip
        seeds = [seed for seed in range(resamples) if seed not in known]
        found = workers.map(replicated, replica, seeds)
        for seed, off in zip(seeds, found, strict=True):
            self.store.save_replicate(seed, off)
        each = known | dict(zip(seeds, found, strict=True))
        return np.array([each[seed] for seed in range(resamples)]).reshape(-1, len(state.vector))

    def _best_run(self, interval: Interval, state: State) -> Simulation:
        """The run with what has been found, written to the fit's directory."""
        start, lapse = interval.start, state.time
        if interval.before is not None:
            before, start = interval.before
            lapse = interval.frame.time - before.time
        simulation = self.model.simulation(start.fields, start.targets, state.vector)
        writer = RunWriter(self.store.run, every=lapse, overwrite=True)
        simulation.run(until=lapse, observers=[writer])
        return simulation
