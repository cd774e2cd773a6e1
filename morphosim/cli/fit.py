"""The command `fit`: tensions and attractions from images."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from morphosim.cli.app import INTERRUPTED, command, note, say, voice
from morphosim.progress import tell_line

if TYPE_CHECKING:
    import xarray as xr

NONE = "none"


@command()
def fit(
    observed: Annotated[
        list[Path], typer.Argument(help="label image, several in the order of time, or a run")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="directory of the fit; the same to go on")
    ],
    scene: Annotated[
        str | None, typer.Option(help="what is given: a scene file or the name of a scene")
    ] = None,
    gamma: Annotated[str, typer.Option(help="tensions asked for: cell, type or none")] = "cell",
    sigma: Annotated[
        str, typer.Option(help="attractions asked for: pair, type, all or none")
    ] = "pair",
    m_prime: Annotated[
        bool, typer.Option("--M", help="ask for the strength of the volume constraint")
    ] = False,
    kappa: Annotated[
        bool, typer.Option("--kappa", help="ask for the strength of motility; needs a series")
    ] = False,
    table: Annotated[
        Path | None, typer.Option(help="table of labels, as import-labels takes it")
    ] = None,
    times: Annotated[str, typer.Option(help="in silico time of each image: 0,20,40")] = "",
    time: Annotated[
        float | None,
        typer.Option(help="in silico time for which a single image is run: 80, 40 if not at rest"),
    ] = None,
    spacing: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="voxel size x y z, um; by default what the file says"),
    ] = None,
    walls: Annotated[
        str | None, typer.Option(help="walls found around all cells: image or ellipsoid")
    ] = None,
    preset: Annotated[str | None, typer.Option(help="numerics of the runs")] = None,
    resamples: Annotated[int, typer.Option(help="images of the best fit fitted again")] = 8,
    workers: Annotated[
        int | None, typer.Option(help="processes of this machine; by default all cores")
    ] = None,
    address: Annotated[
        str | None, typer.Option(help="Dask scheduler to use instead, as tcp://host:8786")
    ] = None,
) -> None:
    """Find tensions and attractions from images; goes on where it was stopped."""
    from morphosim.inference.run import fit as fitted
    from morphosim.numerics.parameters import Numerics

    run = len(observed) == 1 and observed[0].is_dir()
    try:
        answer = fitted(
            observed[0] if run else observed, scene=scene, names=table,
            gamma=None if gamma == NONE else gamma, sigma=None if sigma == NONE else sigma,
            M=m_prime, kappa=kappa, times=_numbers(times), time=time, spacing=spacing,
            confinement=walls, numerics=None if preset is None else Numerics.preset(preset),
            resamples=resamples, directory=output, workers=workers, address=address,
            progress=not voice.quiet,
        )  # fmt: skip
    except KeyboardInterrupt:
        tell_line(f"interrupted; rounds that are done are kept in {output}: give the command again")
        raise typer.Exit(INTERRUPTED) from None
    _report(answer)
    written = [str(path) for path in (output / "fit.nc", output / "fit.png") if path.exists()]
    note(f"written to {' and '.join(written)}; the best run: {output / 'run'}")


def _numbers(text: str) -> list[float] | None:
    """Numbers separated by commas; None of an empty text."""
    if not text.strip():
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        message = f"--times {text!r} is not numbers separated by commas, such as 0,20,40"
        raise ValueError(message) from None


def _report(answer: "xr.Dataset") -> None:
    """Print each estimate, and what holds of all."""
    values = (answer[name].values.tolist() for name in ("unknown", "estimate", "sd", "told"))
    for name, value, sd, told in zip(*values, strict=True):
        say(f"{name:20s} {value:8.4f} ± {sd:.4f}{'' if told else '  (the images do not tell it)'}")
    if "kappa" in answer.attrs:
        say(f"{'kappa':20s} {answer.attrs['kappa']:8.4f} ± {answer.attrs['kappa_sd']:.4f}")
    for text in (answer.attrs["held"], answer.attrs["warning"]):
        if text:
            note(text)
    seconds, runs = answer.attrs["seconds"], answer.attrs["runs"]
    note(f"{runs} runs, {answer.attrs['rounds']} rounds, {seconds:.0f} s")
