"""Commands that make scenes of other files: `import-matlab`, `import-labels`, `import-lineage`."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from morphosim.cli.app import Overwrite, command, note, progress, remark

if TYPE_CHECKING:
    from morphosim.scene.scene import Scene


@command("import-matlab")
def import_matlab(
    masks: Annotated[Path, typer.Argument(help=".mat file with Mask or phi_save")],
    table: Annotated[Path, typer.Option(help="names and attraction: .xls, .xlsx or .csv")],
    output: Annotated[Path, typer.Option("-o", "--output", help="directory of the scene")],
    shell: Annotated[Path | None, typer.Option(help=".mat file with PhiShell")] = None,
    open_space: Annotated[bool, typer.Option("--open", help="no confinement")] = False,
    target_masks: Annotated[
        Path | None, typer.Option(help="masks that give the target volumes of a saved state")
    ] = None,
    spacing: Annotated[float, typer.Option(help="voxel size, um")] = 0.5,
    overwrite: Overwrite = False,
) -> None:
    """Turn the published MATLAB program's files into a scene that `run` takes."""
    from morphosim.geometry.eggshell import EGGSHELL
    from morphosim.importers.matlab.scene import import_matlab as read

    _check_free(output, overwrite)
    scene = read(
        masks, table, shell=shell, confinement=None if open_space else EGGSHELL,
        spacing=spacing, masks_for_volume=target_masks,
    )  # fmt: skip
    file = _save(scene, output)
    note(f"{len(scene.cells)} cells: {', '.join(scene.names)}")
    note(f"scene in {file}")


@command("import-labels")
def import_labels(
    image: Annotated[Path, typer.Argument(help="label image: .tif, .npy, .npz or .nc")],
    output: Annotated[Path, typer.Option("-o", "--output", help="directory of the scene")],
    spacing: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="voxel size x y z, um; by default what the file says"),
    ] = None,
    origin: Annotated[
        tuple[float, float, float] | None, typer.Option(help="first voxel's centre x y z, um")
    ] = None,
    axes: Annotated[str | None, typer.Option(help="order of the file's axes, as zyx")] = None,
    key: Annotated[
        str | None, typer.Option(help="array of an .npz, variable of a .nc, image of a .tif")
    ] = None,
    time_index: Annotated[int | None, typer.Option(help="which time, from 0")] = None,
    table: Annotated[
        Path | None,
        typer.Option(help=".csv, .xls or .xlsx: label, name, type, parent, volume, gamma, frozen"),
    ] = None,
    frozen: Annotated[str, typer.Option(help="cells that do not move: A,B")] = "",
    active: Annotated[str, typer.Option(help="the only cells that move: A,B")] = "",
    shell: Annotated[
        bool, typer.Option("--shell/--open", help="a wall around all cells, or open space")
    ] = False,
    volumes: Annotated[
        str,
        typer.Option(
            help="cells keep their size: surface; a free ball's formula: ball; the voxels': voxels"
        ),
    ] = "surface",
    sigma: Annotated[float, typer.Option(help="attraction between all cells")] = 0.0,
    least_voxels: Annotated[int | None, typer.Option(help="refuse smaller labels")] = None,
    background: Annotated[int, typer.Option(help="label of the background, besides 0")] = 0,
    relax: Annotated[
        float, typer.Option(help="first run all cells for this time; 10 suits frozen cells")
    ] = 0.0,
    overwrite: Overwrite = False,
) -> None:
    """Turn a segmented image into a scene that `run` takes."""
    from morphosim.importers.labels.image_file import read_labels
    from morphosim.importers.labels.scene import import_labels as read
    from morphosim.physics.parameters import Physics
    from morphosim.simulation.compilation import compilation_told
    from morphosim.simulation.relaxation import relaxed

    _check_free(output, overwrite)
    labels = read_labels(
        image, axes=axes, spacing=spacing, origin=origin, key=key, time_index=time_index
    )
    with progress() as tell, compilation_told(remark, lambda: nullcontext(tell)):
        scene = read(
            labels, names=table, frozen=_names(frozen), active=_names(active) if active else None,
            confinement="image" if shell else None, physics=Physics(sigma=sigma), volumes=volumes,
            least_voxels=least_voxels, background=background, name=image.name.partition(".")[0],
            tell=lambda done, of: tell("settling", done, of),
        )  # fmt: skip
        if relax:
            scene = relaxed(scene, relax, lambda done, of: tell("relaxing", done, of))
    file = _save(scene, output)
    still = sum(cell.frozen for cell in scene.cells)
    note(f"{len(scene.cells)} cells, {still} of them frozen: {', '.join(scene.names)}")
    note(f"scene in {file}")


@command("import-lineage")
def import_lineage(
    table: Annotated[
        Path,
        typer.Argument(
            help=".csv, .xls or .xlsx: name, parent, volume_um3, axis_x, axis_y, axis_z, group"
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="directory of the scene")],
    shell: Annotated[
        tuple[float, float, float], typer.Option(help="semi-axes x y z of the shell around 0, um")
    ],
    cut: Annotated[
        float, typer.Option(help="half-width along z beyond which the shell is flat, um")
    ] = float("inf"),
    groups: Annotated[int | None, typer.Option(help="division groups; by default all")] = None,
    limit: Annotated[float, typer.Option(help="longest in silico time of a stage")] = 1000.0,
    overwrite: Overwrite = False,
) -> None:
    """Turn a lineage table into a scene: an embryo from its first cell on, group after group."""
    from morphosim.geometry.confinement import EllipsoidShell
    from morphosim.importers.lineage import read_lineage
    from morphosim.importers.lineage.scene import lineage_scene

    _check_free(output, overwrite)
    walls = EllipsoidShell(center=(0, 0, 0), semi_axes=shell, cut=(float("inf"),) * 2 + (cut,))
    scene = lineage_scene(
        read_lineage(table), walls, (0, 0, 0), groups=groups, limit=limit, name=table.stem
    )
    file = _save(scene, output)
    note(f"{len(scene.stages)} stages: {', '.join(stage.name for stage in scene.stages)}")
    note(f"scene in {file}")


def _check_free(folder: Path, overwrite: bool) -> None:
    """Raise FileExistsError if a scene cannot be written to a folder, before any work."""
    from morphosim.runs.directory import RunDirectory

    RunDirectory(folder).check_free(overwrite)


def _save(scene: "Scene", folder: Path) -> Path:
    """Write a scene to a folder, which is made; the scene's file."""
    from morphosim.runs.directory import SCENE
    from morphosim.scene.file import save_scene

    folder.mkdir(parents=True, exist_ok=True)
    save_scene(scene, folder / SCENE)
    return folder / SCENE


def _names(text: str) -> list[str]:
    """Names separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]
