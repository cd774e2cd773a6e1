"""Figures: what may be asked of a run, and what is refused."""

import threading

import numpy as np
import pytest
import xarray as xr

from morphosim.sweeps.figures import Figure, make_figures


def run() -> xr.Dataset:
    """A run in which a cell divides."""
    volume = np.array([[8.0, np.nan, np.nan], [np.nan, 4.0, 3.0]])
    return xr.Dataset(
        {"volume": (("time", "cell"), volume, {"units": "um3"})},
        {"time": [0.0, 5.0], "cell": ["mother", "a", "b"]},
    )


def test_the_last_value_is_of_the_cells_there_are() -> None:
    found = Figure("v", "volume").of(run())
    assert found.to_series().to_dict() == {"a": 4.0, "b": 3.0}
    assert found.attrs["units"] == "um3"


def test_all_values_are_of_all_cells() -> None:
    xr.testing.assert_identical(Figure("v", "volume(time)").of(run()), run()["volume"])


def test_functions_give_numbers_or_arrays() -> None:
    assert Figure("n", lambda r: r.sizes["cell"]).of(run()).item() == 3
    assert Figure("n", f"{__name__}:total").of(run()).item() == 15
    with pytest.raises(TypeError, match="'n' is an array without names"):
        Figure("n", lambda r: r["volume"].values).of(run())


def total(run: xr.Dataset) -> float:
    return float(run["volume"].sum())


def test_names_of_figures() -> None:
    made = make_figures(["volume", "rms_speed(time)", f"{__name__}:total", run])
    assert [figure.name for figure in made] == ["volume", "rms_speed", "total", "run"]
    assert [figure.name for figure in make_figures({"v": "volume"})] == ["v"]


LOCK = threading.Lock()


@pytest.mark.parametrize(
    ("figures", "error", "expected"),
    [
        ([], ValueError, "figures is empty"),
        (["volum"], ValueError, "did you mean 'volume'"),
        (["phi"], ValueError, "not known"),
        (["volume", "volume(time)"], ValueError, "occurs twice"),
        (["no.such:thing"], ImportError, "cannot be loaded"),
        (["math:pi"], ValueError, "not a function"),
        ([3], TypeError, "not a text"),
        ([lambda run, lock=LOCK: lock], TypeError, "cannot be sent"),
    ],
)
def test_what_is_no_figure_is_refused(figures: list, error: type, expected: str) -> None:
    with pytest.raises(error, match="figure") as caught:
        make_figures(figures)
    assert expected in str(caught.value)
