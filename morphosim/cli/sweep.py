"""The command `sweep`: many runs of one scene."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from morphosim.cli.app import INTERRUPTED, RUN_ERROR, command, note, voice
from morphosim.progress import tell_line

if TYPE_CHECKING:
    import xarray as xr


@command()
def sweep(
    file: Annotated[Path, typer.Argument(help="sweep file: scene, axes, figures")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="directory of the scan; the same to go on")
    ],
    workers: Annotated[
        int | None, typer.Option(help="processes of this machine; by default all cores")
    ] = None,
    threads_per_member: Annotated[
        int | None, typer.Option(help="threads of one member; by default no core idles")
    ] = None,
    address: Annotated[
        str | None, typer.Option(help="Dask scheduler to use instead, as tcp://host:8786")
    ] = None,
    retry: Annotated[
        bool, typer.Option("--retry", help="run members again whose result is an error")
    ] = False,
) -> None:
    """Run a scene for all values of some parameters; goes on where it was stopped."""
    from morphosim.sweeps.run import sweep as scan
    from morphosim.sweeps.sweepfile import read_sweep

    settings = read_sweep(file)
    try:
        result = scan(
            **settings, directory=output, workers=workers, threads_per_member=threads_per_member,
            address=address, retry=retry, progress=not voice.quiet,
        )  # fmt: skip
    except KeyboardInterrupt:
        tell_line(
            f"interrupted; finished members are kept. Go on with: morphosim sweep {file} "
            f"-o {output}"
        )
        raise typer.Exit(INTERRUPTED) from None
    failed = _report(result)
    note(f"written to {output / 'sweep.nc'}")
    raise typer.Exit(RUN_ERROR if failed else 0)


def _report(result: "xr.Dataset") -> int:
    """Tell what came of the members; number of those that failed."""
    errors = result["error"].values.ravel()
    failed = [text for text in errors.tolist() if text]
    sizes = " x ".join(f"{name} {result.sizes[name]}" for name in result["error"].dims)
    note(f"{len(errors)} members ({sizes}), {float(result['seconds'].sum()):.0f} s in all")
    for text in dict.fromkeys(failed):
        tell_line(f"{failed.count(text)} failed: {text}")
    return len(failed)
