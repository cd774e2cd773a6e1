"""Commands that draw saved runs: `plot`, `film`, `show`."""

from pathlib import Path
from typing import Annotated

import typer

from morphosim._files import check_free
from morphosim.cli.app import Overwrite, command, note, progress

Run = Annotated[Path, typer.Argument(help="directory or packed file of a run")]
By = Annotated[
    str,
    typer.Option(
        help="what colours tell: cell, type, volume (its error), stage or lineage, or a number "
        "of each cell such as pressure, age or sphericity"
    ),
]
Cut = Annotated[
    str | None,
    typer.Option(
        help="cut away the half at that end of an axis: z, -z, or z=12.5 for what is above 12.5 µm "
        "(-z=12.5: below); x and y likewise"
    ),
]
Shell = Annotated[bool, typer.Option(help="draw the shell, or the edges of the box")]
Mirror = Annotated[
    bool, typer.Option("--mirror", help="reverse z: the built-in embryos are left-handed")
]


@command()
def plot(
    directory: Run,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="picture to write: .png, .jpg, .pdf, .svg, ...")
    ],
    time: Annotated[float | None, typer.Option(help="nearest save; the last by default")] = None,
    by: By = "cell",
    view: Annotated[
        list[str] | None,
        typer.Option(help="x, y, z, -x, -y, -z or corner; repeatable; by default z, x and y"),
    ] = None,
    names: Annotated[bool, typer.Option(help="write the names on the cells")] = True,
    shell: Shell = True,
    matrix: Annotated[bool, typer.Option(help="add the contact matrix")] = True,
    mirror: Mirror = False,
    cut: Cut = None,
    overwrite: Overwrite = False,
) -> None:
    """Draw the cells of a run at one time, in several views."""
    from morphosim.accessor import open_run
    from morphosim.pictures.plot import plot as write

    check_free(output, overwrite)
    with open_run(directory) as data:
        write(
            data, time, by=by, views=view or "three", names=names, shell=shell, matrix=matrix,
            mirror=mirror, cut=cut, path=output,
        )  # fmt: skip
    note(f"{output}: {output.stat().st_size / 1e6:.1f} MB")


@command()
def film(
    directory: Run,
    output: Annotated[Path, typer.Option("-o", "--output", help="film to write: .mp4 or .gif")],
    by: By = "cell",
    view: Annotated[str, typer.Option(help="x, y, z, -x, -y, -z or corner")] = "z",
    turn: Annotated[float, typer.Option(help="degrees by which the camera goes around")] = 0.0,
    fps: Annotated[float, typer.Option(help="frames per second, 0.01 to 1000")] = 12.0,
    names: Annotated[bool, typer.Option(help="write the names on the cells")] = False,
    shell: Shell = True,
    mirror: Mirror = False,
    cut: Cut = None,
    overwrite: Overwrite = False,
) -> None:
    """Make a film of a run, one frame per save."""
    from morphosim.accessor import open_run
    from morphosim.pictures.film import film as write

    check_free(output, overwrite)
    with open_run(directory) as data, progress() as tell:
        write(
            data, output, by=by, view=view, turn=turn, fps=fps, names=names, shell=shell,
            mirror=mirror, cut=cut, tell=lambda done, of: tell("film", done, of),
        )  # fmt: skip
    note(f"{output}: {output.stat().st_size / 1e6:.1f} MB")


@command()
def show(
    directory: Run,
    output: Annotated[Path, typer.Option("-o", "--output", help="HTML file to write")] = Path(
        "view.html"
    ),
    times: Annotated[
        int | None, typer.Option(min=1, help="so many saves, evenly spread; by default all")
    ] = None,
    by: By = "cell",
    cut: Cut = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a 3-D view of a run as one HTML file, which needs no network."""
    from morphosim.accessor import open_run
    from morphosim.pictures.show import save_page

    check_free(output, overwrite)
    with open_run(directory) as data, progress() as tell:
        save_page(data, output, times, tell=lambda done, of: tell("view", done, of), by=by, cut=cut)
    note(f"{output}: {output.stat().st_size / 1e6:.1f} MB")
