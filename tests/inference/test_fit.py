"""`fit` from images to its answer, and what it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from morphosim import Cell, Numerics, Physics, RunWriter, Scene, Simulation, Sphere, fit, open_run
from morphosim.importers.labels.label_image import LabelImage
from morphosim.inference.observation import photographed
from morphosim.inference.store import Store

pytest.importorskip("distributed")
TENSIONS, SIGMA = {"a": 0.3, "b": 0.2}, 0.6
NUMERICS = Numerics.preset("standard", threads=1)


def scene_of(**physics) -> Scene:
    cells = [
        Cell(name=name, shape=Sphere(center=(x, 0.3, -0.2), radius=5), gamma=TENSIONS[name])
        for name, x in (("a", -4.4), ("b", 4.4))
    ]
    return Scene(
        cells=cells, physics=Physics(sigma=SIGMA, **physics), numerics=NUMERICS, duration=1600,
        save_every=40,
    )  # fmt: skip


def picture(simulation: Simulation, voxel: float = 0.4) -> LabelImage:
    shape = np.ceil(np.array([28.0, 18.0, 18.0]) / voxel).astype(int)
    blank = LabelImage(labels=np.zeros(shape, np.int32), spacing=voxel, origin=(-14, -9, -9))
    return photographed(list(simulation.fields), simulation.spacing, blank)


@pytest.fixture(scope="module")
def still() -> LabelImage:
    simulation = Simulation(scene_of())
    simulation.run(until=1600)  # unlike cells take long to come to rest
    return picture(simulation)


GIVEN = {
    "names": {1: "a", 2: "b"}, "numerics": NUMERICS, "progress": False, "workers": 1,
    "resamples": 2,
}  # fmt: skip
BASE = replace(
    scene_of(), physics=Physics(gamma=0.25, sigma=0.5),
    cells=[replace(cell, gamma=None) for cell in scene_of().cells],
)  # fmt: skip


@pytest.fixture(scope="module")
def answer(still, tmp_path_factory) -> tuple[xr.Dataset, Path]:
    place = tmp_path_factory.mktemp("fit") / "out"
    return fit(still, scene=BASE, directory=place, **GIVEN), place


def test_a_softer_cell_and_the_attraction_are_found(answer):
    found, _ = answer
    assert list(found["unknown"].values) == ["gamma a", "gamma b", "sigma a-b"]
    estimate = found["estimate"]
    assert float(estimate[:2].mean()) == pytest.approx(0.25)
    assert "mean of gamma is held" in found.attrs["held"]
    ratio = float(estimate.sel(unknown="gamma a") / estimate.sel(unknown="gamma b"))
    assert ratio == pytest.approx(1.5, rel=0.2)
    assert float(estimate.sel(unknown="sigma a-b")) == pytest.approx(SIGMA, abs=0.1)
    assert found["told"].all()
    assert (found["sd"] > 0).all()
    assert np.allclose(np.diag(found["correlation"]), 1)
    assert float(found["cell_residual"].max()) < 0.1


def test_the_answer_is_kept_with_the_best_run_and_pictures(answer):
    found, place = answer
    with xr.open_dataset(place / "fit.nc") as kept:
        assert kept["estimate"].equals(found["estimate"])
    with open_run(place / "run") as run:
        assert sorted(run["cell"].values) == ["a", "b"]
        assert run["time"].values[-1] == found.attrs["time"]
    assert (place / "fit.png").stat().st_size > 10_000


def test_a_fit_that_is_stopped_goes_on_to_the_same_bits(answer, still, tmp_path, monkeypatch):
    found, _ = answer
    save, calls = Store.save, []

    def stopping(self, *args):
        save(self, *args)
        calls.append(args)
        if len(calls) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(Store, "save", stopping)
    with pytest.raises(KeyboardInterrupt):
        fit(still, scene=BASE, directory=tmp_path / "out", **GIVEN)
    monkeypatch.undo()
    again = fit(still, scene=BASE, directory=tmp_path / "out", **GIVEN)
    for name in ("estimate", "sd", "residual", "history"):
        assert again[name].identical(found[name]), name
    with pytest.raises(ValueError, match="holds another fit: sigma is pair there and all here"):
        fit(still, scene=BASE, sigma="all", directory=tmp_path / "out", **GIVEN)


def test_a_run_in_motion_tells_the_attraction(tmp_path):
    """A series needs no rest: cells that draw together do so as fast as their attraction says."""
    simulation = Simulation(scene_of())
    simulation.run(until=80, observers=[RunWriter(tmp_path / "run", every=40)])
    found = fit(
        tmp_path / "run", gamma=None, sigma="all", times=[40, 80], progress=False, workers=1,
        resamples=0,
    )  # fmt: skip
    assert found["estimate"].values == pytest.approx([SIGMA], abs=0.06)
    assert found.attrs["held"] == ""


def refused(image, match, **options):
    with pytest.raises((ValueError, TypeError, FileNotFoundError), match=match):
        fit(image, **(GIVEN | options))


def test_what_cannot_be_fitted_is_refused_before_the_first_run(still, tmp_path):
    cut = replace(still, labels=still.labels[:, :, : still.labels.shape[2] // 2])
    refused(cut, "labels 1, 2 touch the border")
    torn = still.labels.copy()
    torn[torn == 2] = 1
    torn[30:40] = 0
    refused(replace(still, labels=torn), "labels in several pieces")
    apart = still.labels.copy()
    x = np.asarray(still.origin)[0] + 0.4 * np.arange(len(apart))
    apart[np.abs(x) < 2] = 0
    refused(replace(still, labels=apart), "sigma is asked for, but no two cells touch")
    refused(still, "nothing is asked for", gamma=None, sigma=None)
    refused(still, "gamma must be one of|gamma = ", gamma="cells")
    refused(still, "target volumes are not known", M=True)
    refused(still, "a single image tells no motion", kappa=True)
    refused([still, still], "2 images and no times")
    refused([still, still], "do not rise", times=[4, 4])
    refused([still, still], "one time for each", times=[0, 1, 2])
    other = replace(still, labels=np.where(still.labels == 2, 0, still.labels))
    refused([still, other], "label 2 is not in both image 1 and image 2", times=[0, 20])
    refused(tmp_path / "none.tif", "does not exist")
    refused(tmp_path, "there is no run", names=None)
    refused(still, "confinement", confinement="box")
    refused(still, "time", time=-1.0)
    refused(still, "resamples", resamples=-1)
