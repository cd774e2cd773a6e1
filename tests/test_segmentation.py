"""Scenes from label images: reading them, cells and walls, and how well shapes come through."""

import re
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import tifffile
import xarray as xr

from morphosim import Division, Duration, EllipsoidShell, MaskWalls, Sphere, Stage
from morphosim.importers.labels.image_axes import check_memory
from morphosim.importers.labels.image_file import read_labels
from morphosim.importers.labels.label_image import LabelImage, SegmentationWarning
from morphosim.importers.labels.resampling import walls_around
from morphosim.importers.labels.scene import import_labels
from morphosim.measure.label_image import label_image
from morphosim.measure.surfaces import cell_surface
from morphosim.numerics.parameters import Numerics
from morphosim.physics.parameters import Physics
from morphosim.scene.cell import Cell
from morphosim.scene.file import load_scene, save_scene
from morphosim.scene.scene import Scene
from morphosim.scene.stability import chosen_S, least_S
from morphosim.simulation.relaxation import relaxed
from morphosim.simulation.simulation import Simulation

LABELS = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
"""Axes x, y, z; every voxel differs."""
TIMES = np.stack([LABELS, LABELS + 100])
SPACING = (0.2, 0.3, 0.6)
CENTRES = np.array([(-5.5, 0, 0), (5.5, 0, 0), (0, 8, 1.5)])
RADII = (6.5, 6.5, 5.5)


# --- made images -------------------------------------------------------------------------------


def embryo(x: Any, y: Any, z: Any) -> np.ndarray:
    """Labels at points of three balls that press each other flat."""
    squares = [
        sum((p - o) ** 2 for p, o in zip((x, y, z), centre, strict=True)) - radius**2
        for centre, radius in zip(CENTRES, RADII, strict=True)
    ]
    nearest = np.argmin(np.broadcast_arrays(*squares), axis=0)
    return np.where(np.min(np.broadcast_arrays(*squares), axis=0) < 0, nearest + 1, 0)


def photographed(spacing: Any = 0.5, shape: Any = embryo, reach: float = 16.0) -> LabelImage:
    """Label image of what a function says at each voxel."""
    steps = np.broadcast_to(spacing, 3)
    axes = [np.arange(-reach, reach, s) for s in steps]
    labels = shape(*np.meshgrid(*axes, indexing="ij", sparse=True))
    return LabelImage(labels=labels, spacing=steps, origin=[-reach] * 3)


def blocks(*places: tuple[int, ...], shape: Any = (30, 20, 20)) -> LabelImage:
    """Blocks of 6 x 8 x 8 voxels of 0.5 µm with labels 3, 4, ... from these voxels on."""
    labels = np.zeros(shape, np.int32)
    for label, (x, y, z) in enumerate(places, start=3):
        labels[x : x + 6, y : y + 8, z : z + 8] = label
    return LabelImage(labels=labels, spacing=0.5)


TWO = ((4, 6, 6), (18, 6, 6))


# --- files -------------------------------------------------------------------------------------


def assert_same(image: LabelImage, spacing: Any = SPACING, labels: np.ndarray = LABELS) -> None:
    np.testing.assert_array_equal(image.labels, labels)
    np.testing.assert_allclose(image.spacing, spacing)


def write_tiff(path: Path, values: np.ndarray, **options: Any) -> Path:
    tifffile.imwrite(path, values, photometric="minisblack", **options)
    return path


def write_ome(path: Path, values: np.ndarray, axes: str, **sizes: Any) -> Path:
    return write_tiff(path, values, ome=True, metadata={"axes": axes, **sizes})


def test_tiff(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "a.TIFF", LABELS.T, compression="zlib")
    assert_same(read_labels(path, spacing=SPACING))
    other = write_tiff(tmp_path / "b.tif", LABELS)
    assert_same(read_labels(other, spacing=SPACING, axes="XYZ"))


def test_tiff_with_times(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "t.tif", TIMES.transpose(0, 3, 2, 1))
    with pytest.raises(ValueError, match=r"t\.tif holds 2 times; choose one by time_index, 0 to 1"):
        read_labels(path, spacing=1)
    assert_same(read_labels(path, spacing=1, time_index=0), 1)
    assert_same(read_labels(path, spacing=1, time_index=-1), 1, TIMES[1])
    with pytest.raises(ValueError, match=r"time_index = 2, but .* holds 2 times \(0 to 1\)"):
        read_labels(path, spacing=1, time_index=2)
    with pytest.raises(ValueError, match="time_index = -3"):
        read_labels(path, spacing=1, time_index=-3)


def test_ome_tiff(tmp_path: Path) -> None:
    sizes = {"PhysicalSizeX": 200, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 0.3,
             "PhysicalSizeZ": 0.6, "PhysicalSizeZUnit": "µm"}  # fmt: skip
    path = write_ome(tmp_path / "a.ome.tif", LABELS.T, "ZYX", **sizes)
    assert_same(read_labels(path))
    assert_same(read_labels(path, spacing=0.5), 0.5)
    path = write_ome(tmp_path / "t.ome.tif", TIMES.transpose(3, 0, 2, 1), "ZTYX", **sizes)
    assert_same(read_labels(path, time_index=1), labels=TIMES[1])


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("nm", 1e-9), ("µm", 1e-6), ("micron", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)],
)
def test_units_of_length(tmp_path: Path, unit: str, metres: float) -> None:
    sizes = {}
    for axis in "XYZ":
        sizes |= {f"PhysicalSize{axis}": 0.5e-6 / metres, f"PhysicalSize{axis}Unit": unit}
    path = write_ome(tmp_path / "a.ome.tif", LABELS.T, "ZYX", **sizes)
    assert_same(read_labels(path), 0.5)


def test_ome_tiff_that_does_not_say_all(tmp_path: Path) -> None:
    path = write_ome(tmp_path / "a.ome.tif", LABELS.T, "ZYX", PhysicalSizeX=0.2, PhysicalSizeY=0.2)
    with pytest.raises(ValueError, match=r"size of its voxels along z; give spacing"):
        read_labels(path)
    unit = {"PhysicalSizeX": 2, "PhysicalSizeXUnit": "pixel"}
    path = write_ome(tmp_path / "b.ome.tif", LABELS.T, "ZYX", **unit)
    with pytest.raises(ValueError, match=r"does not say the size of its voxels along x, y, z"):
        read_labels(path)
    path = write_ome(tmp_path / "c.ome.tif", LABELS.T, "ZYX", **unit | {"PhysicalSizeXUnit": "ly"})
    with pytest.raises(ValueError, match=r"unit of .*PhysicalSizeX = 'ly' is not known"):
        read_labels(path)


def test_channels_are_no_label_image(tmp_path: Path) -> None:
    path = write_ome(tmp_path / "c.ome.tif", TIMES.transpose(0, 3, 2, 1), "CZYX")
    with pytest.raises(
        ValueError, match=r"shape \(2, 4, 3, 2\), with axes CZYX.*the channel of the labels alone"
    ):
        read_labels(path, spacing=1)


@pytest.mark.parametrize(
    ("axes", "text"),
    [
        ("TYX", r"axes TYX \(4 times\).*if these are z planes after all, give axes = 'zyx'"),
        ("CYX", r"axes CYX \(4 channels\).*save the channel of the labels alone"),
        ("TCYX", r"axes TCYX \(2 times, 2 channels\)"),
        ("YX", r"axes YX \(one plane\): expected x, y, z"),
    ],
)
@pytest.mark.parametrize("kind", ["imagej", "ome", "plain"])
def test_axes_that_a_tiff_file_states_hold(tmp_path: Path, kind: str, axes: str, text: str) -> None:
    shape = {"TYX": (4, 3, 2), "CYX": (4, 3, 2), "TCYX": (2, 2, 3, 2), "YX": (12, 2)}[axes]
    options = {} if kind == "plain" else {kind: True}
    path = tmp_path / "a.tif"
    write_tiff(path, LABELS.T.reshape(-1)[:np.prod(shape)].reshape(shape),
               metadata={"axes": axes}, **options)  # fmt: skip
    with pytest.raises(ValueError, match=text):
        read_labels(path, spacing=1)
    if len(axes) == 3:
        assert_same(read_labels(path, spacing=1, axes="zyx"), 1)


@pytest.mark.parametrize("shape", [(3, 2, 3), (4, 3, 2, 3), (2, 4, 3, 2, 4)])
def test_colour_images_are_no_labels(tmp_path: Path, shape: tuple[int, ...]) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.zeros(shape, np.uint8), photometric="rgb")
    for time_index in (None, 0):
        with pytest.raises(ValueError, match=r"is a colour image: axes Q*YXS, shape"):
            read_labels(tmp_path / "a.tif", spacing=1, time_index=time_index)


@pytest.mark.parametrize("unit", ["micron", "um", "\\u00B5m", "µm", "nm"])
def test_stacks_of_imagej_say_their_voxels(tmp_path: Path, unit: str) -> None:
    scale = 1000 if unit == "nm" else 1
    name = "um" if unit == "µm" else unit  # tifffile writes ASCII
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, LABELS.T, imagej=True, resolution=(5 / scale, 1 / (0.3 * scale)),
        metadata={"axes": "ZYX", "spacing": 0.6 * scale, "unit": name},
    )  # fmt: skip
    if unit == "µm":  # as Fiji does in Latin-1
        path.write_bytes(path.read_bytes().replace(b"unit=um", b"unit=\xb5m"))
    assert_same(read_labels(path))


def test_stacks_of_imagej_without_scale(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", LABELS.T, imagej=True, metadata={"axes": "ZYX"})
    with pytest.raises(ValueError, match="size of its voxels along x, y, z; give spacing"):
        read_labels(tmp_path / "a.tif")
    tifffile.imwrite(tmp_path / "b.tif", LABELS.T, imagej=True, resolution=(5, 5),
                     metadata={"axes": "ZYX", "unit": "parsec", "spacing": 1})  # fmt: skip
    with pytest.raises(ValueError, match=r"unit of .*b\.tif = 'parsec' is not known"):
        read_labels(tmp_path / "b.tif")
    assert_same(read_labels(tmp_path / "b.tif", spacing=1), 1)


def test_one_of_several_images_of_a_tiff_file(tmp_path: Path) -> None:
    path = tmp_path / "a.ome.tif"
    with tifffile.TiffWriter(path) as file:
        for name, step, values in (("raw", 1.0, LABELS + 9), ("labels", 0.5, LABELS)):
            sizes = {f"PhysicalSize{axis}": step for axis in "XYZ"}
            file.write(values.T, photometric="minisblack",
                       metadata={"axes": "ZYX", "Name": name} | sizes)  # fmt: skip
    text = r"holds 2 images: 0 'raw' \(ZYX, shape \(4, 3, 2\)\), 1 'labels' .*choose one by key"
    with pytest.raises(ValueError, match=text):
        read_labels(path)
    for key in ("labels", "1"):
        assert_same(read_labels(path, key=key), 0.5)
    with pytest.raises(ValueError, match=r"image of .* = 'lables' is not known.*mean 'labels'"):
        read_labels(path, key="lables")


@pytest.mark.parametrize("kind", ["plain", "imagej", "ome", "zlib", "pages"])
def test_tiff_files_cut_short_are_called_that(tmp_path: Path, kind: str) -> None:
    values = np.random.default_rng(0).integers(0, 9, (6, 20, 20)).astype(np.uint16)
    options = {"imagej": {"imagej": True}, "ome": {"ome": True}, "zlib": {"compression": "zlib"}}
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path, **(options.get(kind, {}) if kind != "zlib" else {})) as file:
        for part in values if kind == "pages" else [values]:
            file.write(part, photometric="minisblack", contiguous=False,
                       metadata=None if kind == "pages" else {"axes": "ZYX"},
                       compression="zlib" if kind == "zlib" else None)  # fmt: skip
    whole = path.read_bytes()
    assert_same(read_labels(path, spacing=1), 1, values.T)
    for kept in np.linspace(4, len(whole) - 20, 12).astype(int):  # some end in spare bytes
        path.write_bytes(whole[:kept])
        with pytest.raises(ValueError, match=r"a\.tif is cut short, or damaged: it ends at byte"):
            read_labels(path, spacing=1)


def test_numpy_files(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", LABELS)
    assert_same(read_labels(tmp_path / "a.npy", spacing=SPACING))
    np.save(tmp_path / "t.npy", TIMES)
    assert_same(read_labels(tmp_path / "t.npy", spacing=1, time_index=1), 1, TIMES[1])
    np.savez(tmp_path / "one.npz", seg=LABELS.T)
    assert_same(read_labels(tmp_path / "one.npz", spacing=SPACING, axes="zyx"))
    np.savez(tmp_path / "two.npz", seg=LABELS, raw=LABELS)
    assert_same(read_labels(tmp_path / "two.npz", spacing=SPACING, key="seg"))
    with pytest.raises(ValueError, match="2 could be the labels; choose one by key out of 'seg'"):
        read_labels(tmp_path / "two.npz", spacing=1)
    with pytest.raises(ValueError, match=r"'sag' is not known.*did you mean 'seg'"):
        read_labels(tmp_path / "two.npz", spacing=1, key="sag")
    with pytest.raises(ValueError, match=r"key = 'seg', but .* holds one array"):
        read_labels(tmp_path / "a.npy", spacing=1, key="seg")


def huge_header(dtype: str = "<u2") -> bytes:
    """An .npy file that says it holds 10¹⁵ values."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': (100000, 100000, 100000), }}"
    text = text.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + bytes(99)


def test_numpy_files_that_say_too_much(tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(huge_header())
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("seg.npy", huge_header())
    for name in ("a.npy", "a.npz"):
        with pytest.raises(ValueError, match=r"cut short, or damaged: its header says 2000000000"):
            read_labels(tmp_path / name, spacing=1)
    with pytest.raises(ValueError, match=r"x says that it holds 1e\+09 GB.*GB of memory"):
        check_memory("x", 10**18)


def test_pickles_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "embryo_seg.npy"
    np.save(path, {"masks": LABELS}, allow_pickle=True)
    with pytest.raises(ValueError, match=r"holds Python objects.*cellpose's _seg\.npy, save its m"):
        read_labels(path, spacing=1)
    np.savez(tmp_path / "a.npz", masks=np.array([LABELS, None], object))
    with pytest.raises(ValueError, match=r"a\.npz: masks holds Python objects"):
        read_labels(tmp_path / "a.npz", spacing=1)


def write_netcdf(path: Path, **changes: Any) -> Path:
    """Labels with axes z, time, y, x and coordinates, beside a variable that has no labels."""
    coordinates = {
        "x": ("x", [7.0, 7.2], {"units": "µm"}),
        "y": ("y", [0.0, 300.0, 600.0], {"units": "nm"}),
        "z": ("z", [-1.2, -0.6, 0.0, 0.6]),
    }
    data = xr.Dataset(
        {
            "label": (("z", "time", "y", "x"), TIMES.transpose(3, 0, 2, 1)),
            "intensity": (("z", "y", "x"), np.zeros((4, 3, 2))),
        },
        coords=coordinates | changes,
    )
    data.to_netcdf(path)
    return path


def test_netcdf(tmp_path: Path) -> None:
    image = read_labels(write_netcdf(tmp_path / "a.nc"), time_index=1)
    assert_same(image, labels=TIMES[1])
    np.testing.assert_allclose(image.origin, (7, 0, -1.2))
    moved = read_labels(tmp_path / "a.nc", time_index=0, key="label", origin=(1, 2, 3), spacing=2)
    assert_same(moved, 2)
    np.testing.assert_array_equal(moved.origin, (1, 2, 3))
    with pytest.raises(ValueError, match=r"a\.nc: label holds 2 times"):
        read_labels(tmp_path / "a.nc")


def test_netcdf_with_other_names(tmp_path: Path) -> None:
    xr.Dataset({"seg": (("lon", "lat", "height"), LABELS)}).to_netcdf(tmp_path / "a.nc")
    assert_same(read_labels(tmp_path / "a.nc", spacing=SPACING))
    xr.Dataset({"a": (("x", "y", "z"), LABELS), "b": (("x", "y", "z"), LABELS)}).to_netcdf(
        tmp_path / "b.nc"
    )
    with pytest.raises(ValueError, match="2 could be the labels"):
        read_labels(tmp_path / "b.nc", spacing=1)
    data = xr.Dataset({"seg": (("x", "y", "z"), LABELS)})
    data.to_netcdf(tmp_path / "c.nc", group="cells")
    with pytest.raises(ValueError, match=r"c\.nc holds groups alone, 'cells', which are not read"):
        read_labels(tmp_path / "c.nc", spacing=1)


@pytest.mark.parametrize(
    "encoding",
    [
        {"dtype": "i2", "_FillValue": -1},
        {"dtype": "i4", "_FillValue": 0},
        {"dtype": "f4", "_FillValue": np.nan},
        {"dtype": "f8", "_FillValue": 1e20},
        {"dtype": "i2", "scale_factor": 0.1, "add_offset": 7.0, "_FillValue": -999},
        {"dtype": "f4", "missing_value": -5.0},
    ],
)
def test_netcdf_values_are_unpacked_and_missing_ones_are_background(
    tmp_path: Path, encoding: dict[str, Any]
) -> None:
    values = np.where(LABELS == 0, np.nan, LABELS)
    data = xr.Dataset({"seg": (("x", "y", "z"), values), "raw": (("x", "y"), LABELS[..., 0])})
    data.to_netcdf(tmp_path / "a.nc", encoding={"seg": encoding})
    assert_same(read_labels(tmp_path / "a.nc", spacing=1), 1)


@pytest.mark.parametrize("kind", ["NETCDF3_CLASSIC", "NETCDF3_64BIT", "NETCDF4"])
def test_netcdf_files_cut_short(tmp_path: Path, kind: Any) -> None:
    path = tmp_path / "a.nc"
    data = xr.Dataset({"a": (("x", "y", "z"), LABELS.astype(np.int32))})
    data.to_netcdf(path, format=kind, unlimited_dims=["x"] if kind == "NETCDF3_64BIT" else [])
    assert_same(read_labels(path, spacing=1), 1)
    whole = path.read_bytes()
    text = "may be damaged" if kind == "NETCDF4" else "cut short, or damaged"
    for kept in (len(whole) - 3, len(whole) // 2, 100):
        path.write_bytes(whole[:kept])
        with pytest.raises(ValueError, match=text):
            read_labels(path, spacing=1)


def test_netcdf_that_says_too_much(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as file:
        for axis in "xyz":
            file.createDimension(axis, 200_000)
        file.createVariable("a", "i4", ("x", "y", "z"), chunksizes=(10, 10, 10))
    with pytest.raises(ValueError, match=r"a\.nc: a says that it holds 3\.2e\+07 GB"):
        read_labels(tmp_path / "a.nc", spacing=1)


def test_tiff_that_says_too_much(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "a.tif", LABELS.T, metadata=None)
    with tifffile.TiffFile(path, mode="r+") as file:
        for page in file.pages:
            for tag in ("ImageWidth", "ImageLength"):
                page.tags[tag].overwrite(2_000_000)
    with pytest.raises(ValueError, match=r"a\.tif says that it holds 3\.2e\+04 GB"):
        read_labels(path, spacing=1)


def test_netcdf_dimensions_in_part(tmp_path: Path) -> None:
    def written(*dims: str, **coords: Any) -> Path:
        path = tmp_path / f"{'-'.join(dims)}.nc"
        xr.Dataset({"seg": (dims, LABELS)}, coords=coords).to_netcdf(path)
        return path

    axes = {
        name: (name, range(n), {"axis": axis})
        for name, n, axis in zip("abc", (2, 3, 4), "XYZ", strict=True)
    }
    assert_same(read_labels(written("a", "b", "c", **axes), spacing=1), 1)
    assert_same(read_labels(written("x", "y", "plane"), spacing=1), 1)
    with pytest.raises(ValueError, match=r"axes XYT \(4 times\)"):
        read_labels(written("x", "y", "time"), spacing=1)
    with pytest.raises(ValueError, match=r"axes QYC \(4 channels\)"):
        read_labels(written("w", "y", "channel"), spacing=1)


def test_netcdf_coordinates_that_are_no_grid(tmp_path: Path) -> None:
    path = write_netcdf(tmp_path / "a.nc", z=("z", [0.0, 0.6, 1.3, 1.9]))
    text = "z has steps from 0.6 to 0.7 µm; expected even steps"
    with pytest.raises(ValueError, match=re.escape(text)):
        read_labels(path, time_index=0)


@pytest.mark.parametrize("options", [{}, {"spacing": SPACING}])
def test_netcdf_coordinates_that_fall_are_turned_round(tmp_path: Path, options: dict) -> None:
    path = write_netcdf(tmp_path / "a.nc", z=("z", [1.8, 1.2, 0.6, 0.0]), y=("y", [0.9, 0.6, 0.3]))
    image = read_labels(path, time_index=1, **options)
    assert_same(image, labels=TIMES[1][:, ::-1, ::-1])
    np.testing.assert_allclose(image.origin, (7, 0.3, 0), atol=1e-12)


@pytest.mark.parametrize("name", ["a.tif", "a.npy", "a.npz", "a.nc"])
def test_spacing_must_be_known(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if path.suffix == ".tif":
        write_tiff(path, LABELS)
    elif path.suffix == ".nc":
        xr.Dataset({"seg": (("x", "y", "z"), LABELS)}).to_netcdf(path)
    else:
        (np.save if path.suffix == ".npy" else np.savez)(path, LABELS)
    with pytest.raises(ValueError, match=rf"{name} does not say the size .* x, y, z; give spacing"):
        read_labels(path)


@pytest.mark.parametrize("name", ["a.tif", "a.npy", "a.npz", "a.nc"])
def test_damaged_files(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\xff\xd8\xff\xe0 a picture")
    with pytest.raises(ValueError, match=rf"{name} cannot be read as a"):
        read_labels(tmp_path / name, spacing=1)


def test_bad_paths(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.tif does not exist"):
        read_labels(tmp_path / "absent.tif")
    with pytest.raises(ValueError, match=r"'\.lif' is not known; allowed are '\.tif'"):
        read_labels(tmp_path / "a.lif")
    with pytest.raises(ValueError, match="axes = 'zy': expected the letters x, y, z"):
        read_labels(tmp_path / "a.tif", axes="zy")


def test_compression_that_needs_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:  # as tifffile does where the package is not installed
        message = "<COMPRESSION.LZW: 5> requires the 'imagecodecs' package"
        raise ValueError(message)

    path = write_tiff(tmp_path / "a.tif", LABELS)
    monkeypatch.setattr(tifffile.TiffPageSeries, "asarray", fail)
    with pytest.raises(ImportError, match=r"a\.tif: .*in a clone: pip install '\.\[images\]'"):
        read_labels(path, spacing=1)


def test_compression_of_images(tmp_path: Path) -> None:
    pytest.importorskip("imagecodecs", reason="imagecodecs is not installed")
    tifffile.imwrite(tmp_path / "a.tif", LABELS, compression="lzw", photometric="minisblack")
    np.testing.assert_array_equal(
        read_labels(tmp_path / "a.tif", axes="xyz", spacing=1).labels, LABELS
    )


def test_labels_of_other_types() -> None:
    assert_same(LabelImage(labels=LABELS.astype(float), spacing=1), 1)
    assert LabelImage(labels=LABELS > 0, spacing=1).labels.max() == 1


@pytest.mark.parametrize(
    ("labels", "text"),
    [
        (LABELS + 0.5, "numbers that are not whole"),
        (np.where(LABELS > 3, np.nan, LABELS), "numbers that are not whole"),
        (LABELS.astype(int) - 1, "labels hold -1; expected 0"),
        (LABELS[0], r"shape \(3, 4\); expected three axes"),
        (LABELS.astype(str), "expected whole numbers"),
    ],
)
def test_labels_that_are_none(labels: np.ndarray, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        LabelImage(labels=labels, spacing=1)


# --- cells -------------------------------------------------------------------------------------


def centroid(scene: Scene, k: int) -> np.ndarray:
    """Mean position of the voxels of a cell's mask, µm."""
    shape = scene.cells[k].shape
    return np.argwhere(shape.mask).mean(axis=0) * shape.spacing + shape.origin


def test_blocks_become_cells() -> None:
    scene = import_labels(blocks(*TWO), volumes="voxels")
    assert scene.names == ["cell3", "cell4"]
    assert [cell.target_volume(0) for cell in scene.cells] == [6 * 8 * 8 / 8] * 2
    assert not any(cell.frozen for cell in scene.cells)
    assert scene.confinement is None
    for k, first in enumerate(TWO):
        expected = 0.5 * (np.array(first) + np.array((2.5, 3.5, 3.5)))
        np.testing.assert_allclose(centroid(scene, k), expected, atol=0.01)
        assert scene.cells[k].shape.volume == pytest.approx(48, rel=0.03)


def ball(radius: float) -> Any:
    return lambda x, y, z: (x**2 + y**2 + z**2 < radius**2).astype(int)


@pytest.mark.parametrize("spacing", [0.5, (0.25, 0.25, 1.0), (0.2, 0.2, 0.6), (0.3, 0.4, 2.0)])
def test_any_voxels_become_cubes(spacing: Any) -> None:
    image = photographed(spacing, ball(6.0), reach=8.0)
    cell = import_labels(image, volumes="voxels").cells[0]
    voxels = np.count_nonzero(image.labels) * image.voxel
    assert cell.target_volume(0) == pytest.approx(voxels)
    assert cell.shape.volume == pytest.approx(voxels, rel=0.01)
    axes = [o + np.arange(n) * cell.shape.spacing for n, o in
            zip(cell.shape.mask.shape, cell.shape.origin, strict=True)]  # fmt: skip
    mine, true = cell.shape.mask, ball(6.0)(*np.meshgrid(*axes, indexing="ij")).astype(bool)
    assert np.count_nonzero(mine & true) / np.count_nonzero(mine | true) > 0.93


def test_volumes_of_a_free_ball() -> None:
    image = photographed(0.25, ball(4.0), reach=6.0)
    physics = Physics(c=3.0)
    cell = import_labels(image, physics=physics, volumes="ball").cells[0]
    depth = 4.0 - np.linalg.norm(np.indices((41,) * 3) * 0.3 - 6.0, axis=0)
    integral = 0.5 * (1 + np.tanh(physics.interface_scale * depth)).sum() * 0.3**3
    pressure = 2 * physics.gamma / 4.0
    assert cell.shape.volume == pytest.approx(integral, rel=0.01)
    assert cell.target_volume(0) * (1 - pressure / 8) == pytest.approx(integral, rel=0.01)
    absolute = Physics(c=3.0, volume_constraint="absolute")
    cell = import_labels(image, physics=absolute, volumes="ball").cells[0]
    assert cell.target_volume(0) - pressure / 0.0016 == pytest.approx(integral, rel=0.01)


def doublet(x: Any, y: Any, z: Any) -> np.ndarray:
    left, right = ((x + o) ** 2 + y**2 + z**2 < 25 for o in (4, -4))
    return np.where(x < 0, left, 2 * right)


def prolate(x: Any, y: Any, z: Any) -> np.ndarray:
    return ((x / 8) ** 2 + (y / 4.5) ** 2 + (z / 4.5) ** 2 < 1).astype(int)


@pytest.mark.parametrize(
    ("shape", "sigma", "confinement"),
    [
        (ball(5.0), 0.0, None),
        (ball(8.0), 0.0, "image"),
        (doublet, 0.5, "image"),
        (prolate, 0.0, None),
    ],
    ids=["small", "large in walls", "two in walls", "long"],
)
def test_cells_keep_their_size(shape: Any, sigma: float, confinement: str | None) -> None:
    image = photographed(0.5, shape, reach=11.0)
    scene = import_labels(image, confinement=confinement, physics=Physics(sigma=sigma))
    simulation = Simulation(scene)
    simulation.run(until=40)
    sizes = [cell_surface(field, 0.5).volume for field in simulation.fields]
    measured = np.bincount(image.labels.ravel())[1:] * image.voxel
    np.testing.assert_allclose(sizes, measured, rtol=5e-3)


def test_settling_is_told() -> None:
    told: list[tuple[int, int]] = []
    import_labels(blocks(*TWO), tell=lambda *rounds: told.append(rounds))
    assert told[0] == (1, 20)
    assert told[-1] == (20, 20)


def test_volumes_of_the_table_and_of_free_cells_are_not_changed(tmp_path: Path) -> None:
    path = tmp_path / "cells.csv"
    path.write_text("label,volume\n3,70\n", encoding="utf-8")
    cells = import_labels(blocks(*TWO), names=path).cells
    assert cells[0].target_volume(0) == 70
    assert cells[1].target_volume(0) > 48
    free = Physics(volume_constraint="none")
    scenes = [import_labels(blocks(*TWO), physics=free, volumes=v) for v in ("surface", "ball")]
    assert [c.volume for c in scenes[0].cells] == [c.volume for c in scenes[1].cells]


def test_smoothing_suits_the_image() -> None:
    assert import_labels(blocks(*TWO), volumes="ball").cells[0].shape.smoothing == 2
    assert (
        import_labels(photographed((0.5, 0.5, 1.5)), volumes="ball").cells[0].shape.smoothing == 3
    )
    assert import_labels(blocks(*TWO), smoothing=0.0, volumes="ball").cells[0].shape.smoothing == 0


def test_an_image_without_background_or_without_cells() -> None:
    image = blocks(*TWO, shape=(30, 20, 20))
    marked = LabelImage(labels=np.where(image.labels, image.labels, 7), spacing=0.5)
    with pytest.raises(ValueError, match=r"no voxel .* is 0.* label 7 reaches all.*background = 7"):
        import_labels(marked)
    assert import_labels(marked, background=7, volumes="ball").names == ["cell3", "cell4"]
    with pytest.raises(ValueError, match="background = 8, but no voxel"):
        import_labels(marked, background=8)
    halves = LabelImage(labels=np.repeat([[[1]], [[2]]], 10, axis=0), spacing=0.5)
    halves = LabelImage(labels=np.broadcast_to(halves.labels, (20, 10, 10)), spacing=0.5)
    with pytest.warns(SegmentationWarning) as told:
        assert import_labels(halves, volumes="ball").names == ["cell1", "cell2"]
    assert "all of it is taken as 2 cells" in str(told[0].message)
    assert "cells at the border" in str(told[1].message)
    assert {warning.filename for warning in told} == {__file__}


def test_holes_within_cells_are_filled() -> None:
    image = blocks(*TWO)
    image.labels[6:8, 8:10, 8:10] = 0  # a nucleus that was left out
    image.labels[20:22, 8:11, 8:11] = 5  # a cell within a cell
    with pytest.warns(
        SegmentationWarning, match=r"holes within labels are filled.*: 3 \(8\)$"
    ) as told:
        cells = import_labels(image, volumes="voxels", least_voxels=8).cells
    assert told[0].filename == __file__
    assert [cell.target_volume(0) for cell in cells] == [48, 48 - 18 / 8, 18 / 8]


def test_an_image_without_cells() -> None:
    with pytest.raises(ValueError, match="no labels: all voxels are 0"):
        import_labels(LabelImage(labels=np.zeros((9, 9, 9), int), spacing=0.5))


def test_path_and_names(tmp_path: Path) -> None:
    path = write_ome(tmp_path / "embryo.ome.tif", blocks(*TWO).labels.T.astype(np.uint8), "ZYX")
    scene = import_labels(path, spacing=0.5, names={3: "E", 9: "MS"})
    assert scene.name == "embryo"
    assert scene.names == ["E", "cell4"]
    with pytest.raises(ValueError, match="spacing = 1, but the LabelImage has its own"):
        import_labels(blocks(*TWO), spacing=1)
    with pytest.raises(ValueError, match="labels 1, but the image holds 3, 4"):
        import_labels(blocks(*TWO), names={1: "E"})


def test_table(tmp_path: Path) -> None:
    path = tmp_path / "cells.csv"
    path.write_text(
        "\ufeffLabel;name;type;volume;gamma;frozen;parent\n4;E;endo;50.5;0.3;yes;EMS\n\n3;MS;;;;;\n",
        encoding="utf-8",
    )
    ms, e = import_labels(blocks(*TWO), names=path, volumes="voxels").cells
    assert (ms.name, ms.type, ms.gamma, ms.frozen) == ("MS", "", None, False)
    assert ms.target_volume(0) == 48
    assert (e.name, e.type, e.gamma, e.frozen) == ("E", "endo", 0.3, True)
    assert (e.target_volume(0), e.parent) == (50.5, "EMS")
    assert e.shape.volume == pytest.approx(48, rel=0.03)
    path.write_text("label,cell\n3,MS\n", encoding="utf-8")
    assert import_labels(blocks(*TWO), names=path).names == ["MS", "cell4"]


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("label,size\n3,1\n", "column of .* = 'size' is not known"),
        ("name\nE\n", "has no column 'label'; has 'name'"),
        ("label,name\n,E\n", "row 2: label is missing; expected a whole number above 0"),
        ("label,name\nE,3\n", "row 2: label = 'E' is not a number"),
        ("label,name\n0,E\n", "row 2: label = 0 is not allowed: it must be >= 1"),
        ("label,name\n3,A\n3,B\n", "row 3: label 3 occurs twice"),
        ("label,name\n3,A\n4,A\n", "'A' occurs twice"),
        ("label,volume\n3,big\n", "row 2: volume = 'big' is not a number"),
        ("label,volume\n3,0\n", "row 2: volume = 0.0 is not allowed"),
        ("label,frozen\n3,maybe\n", "row 2: frozen = 'maybe' is not known"),
    ],
)
def test_bad_tables(tmp_path: Path, text: str, error: str) -> None:
    (tmp_path / "cells.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=error):
        import_labels(blocks(*TWO), names=tmp_path / "cells.csv")


NAMES = {3: "MS", 4: "E"}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"frozen": ["E"]}, [False, True]),
        ({"frozen": [3]}, [True, False]),
        ({"active": ["4"]}, [True, False]),
        ({"active": ["MS", 4]}, [False, False]),
    ],
)
def test_region_of_interest(options: dict, expected: list[bool]) -> None:
    scene = import_labels(blocks(*TWO), names=NAMES, volumes="ball", **options)
    assert [cell.frozen for cell in scene.cells] == expected


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"frozen": ["E"], "active": ["MS"]}, "give one of them"),
        ({"active": ["EE"]}, "cell in active = 'EE' is not known; .*did you mean 'E'"),
        ({"frozen": [5]}, "cell in frozen = 5 is not known; allowed are 'MS', 'E'"),
        ({"active": []}, "all 2 cells are frozen"),
        ({"volumes": "area"}, "volumes = 'area' is not known"),
        ({"confinement": "shell"}, "confinement = 'shell' is not known; allowed are 'image'"),
    ],
)
def test_bad_options(options: dict, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        import_labels(blocks(*TWO), names=NAMES, **options)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"frozen": "E"}, "frozen = 'E' is not a list of names or labels"),
        ({"names": {"4": "E"}}, "label in names = '4' is not a whole number"),
        ({"physics": 3}, "physics = 3 is not of type Physics"),
        ({"numerics": "draft"}, "numerics = 'draft' is not of type Numerics"),
        ({"image": None}, "image = None is neither a LabelImage nor a path"),
    ],
)
def test_options_of_another_type(options: dict, text: str) -> None:
    with pytest.raises(TypeError, match=text):
        import_labels(**{"image": blocks(*TWO), "names": NAMES} | options)


def test_cells_at_the_border() -> None:
    image = blocks((0, 6, 6), (14, 6, 12), (22, 6, 4))
    with pytest.warns(SegmentationWarning, match="may cut them off: MS, E. Freeze"):
        import_labels(image, names=NAMES, volumes="ball")
    assert len(import_labels(image, frozen=[3, 4], volumes="ball").cells) == 3  # without a warning


def test_loose_voxels_are_left_out() -> None:
    image = blocks(*TWO)
    image.labels[0, 0, 0] = 3  # so far out that it is at the border
    image.labels[10, 14, 14] = 3  # shares a corner with the block
    with pytest.warns(SegmentationWarning, match=r"left out: 3 \(1\)") as told:
        scene = import_labels(image, volumes="voxels")
    assert told[0].filename == __file__
    assert scene.cells[0].target_volume(0) == (6 * 8 * 8 + 1) / 8
    assert scene.cells[0].shape.bounds()[0].min() > 1


def test_labels_in_pieces() -> None:
    image = blocks(*TWO)
    image.labels[0:4, 0:4, 0:2] = 4
    with pytest.raises(ValueError, match=r"several pieces, .* largest: 4 \(32\)\. Give each cell"):
        import_labels(image)


def test_small_labels() -> None:
    image = blocks(*TWO)
    image.labels[0, 0, :20] = 1
    with pytest.raises(ValueError, match=r"fewer than 27 voxels: 1 \(20\)\. Set them to 0"):
        import_labels(image)
    with pytest.raises(ValueError, match=r"fewer than 400 voxels: 1 \(20\), 3 \(384\), 4 \(384\)"):
        import_labels(image, least_voxels=400)
    with pytest.raises(ValueError, match="fewer than 422 voxels"):  # of 0.2 µm, for h = 0.5 µm
        import_labels(LabelImage(labels=image.labels, spacing=0.2))
    finer = LabelImage(labels=image.labels[:, 1:], spacing=0.2)
    assert len(import_labels(finer, numerics=Numerics(spacing=0.4), volumes="ball").cells) == 2


# --- walls -------------------------------------------------------------------------------------


def test_walls_around_the_image() -> None:
    centres = np.array([(-6.0, 0, 0), (6.0, 0, 0)])

    def pair(x: Any, y: Any, z: Any) -> np.ndarray:
        left, right = ((x - o[0]) ** 2 + y**2 + z**2 < 25 for o in centres)
        return left + 2 * right

    image = photographed((0.25, 0.25, 1.0), pair, reach=12.0)
    walls = import_labels(image, confinement="image", volumes="ball").confinement
    assert isinstance(walls, MaskWalls)
    x = np.array([0.0, 11.4, 12.2, 6.0, 6.0, 0.0, 0.0])
    z = np.array([0.0, 0.0, 0.0, 5.0, 6.2, 2.0, 5.5])
    np.testing.assert_array_equal(walls.field(x, 0 * x, z), [0, 0, 1, 0, 1, 0, 1])


@pytest.mark.parametrize("first", [0.3, 0.37, 0.05])
@pytest.mark.parametrize("voxel", [0.1, 0.2, 0.5])
def test_walls_before_flat_faces(voxel: float, first: float) -> None:
    size = round(6 / voxel)
    labels = np.ones((size, size, size), np.uint8)
    image = LabelImage(labels=labels, spacing=voxel, origin=np.full(3, first))
    walls = walls_around(image, 0.5, clearance=1.0, closing=0.5)
    low, high = first - voxel / 2, first + 6 - voxel / 2  # outer faces of the labels
    for axis in range(3):
        along = walls.origin[axis] + 0.5 * np.flatnonzero(
            walls.inside.any(axis=tuple(a for a in range(3) if a != axis))
        )
        assert low - 1.6 < along[0] < low - 0.4
        assert high + 0.4 < along[-1] < high + 1.6


def test_walls_come_with_stable_numerics() -> None:
    scene = import_labels(blocks(*TWO), confinement="image")
    simulation = Simulation(scene)
    assert simulation.S > 15
    simulation.step(60)  # would warn; with S = 14 these small cells diverge
    large = import_labels(photographed(shape=ball(8.0)), confinement="image", volumes="ball")
    assert 13 < chosen_S(large) < 16
    chosen = Numerics(dt=1.0, S=6.0)
    with pytest.warns(
        SegmentationWarning, match="the scene fails while they settle: .*diverged"
    ) as told:
        given = import_labels(blocks(*TWO), confinement="image", numerics=chosen)
    assert told[0].filename == __file__
    assert given.numerics == chosen


@pytest.fixture(scope="module")
def walled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scene file of two cells with walls from the image."""
    path = tmp_path_factory.mktemp("walled") / "scene.toml"
    image = photographed(0.5, doublet, reach=11.0)
    save_scene(import_labels(image, confinement="image", volumes="ball"), path)
    return path


@pytest.mark.parametrize(
    "numerics",
    [
        {"solver": "dct"}, {"solver": "band"}, {"dt": 4.0, "spacing": 2 / 3}, {"preset": "draft"},
        {"preset": "fast"}, {"preset": "standard"},
    ],
)  # fmt: skip
def test_walls_of_an_image_get_what_they_need(walled: Path, numerics: dict[str, Any]) -> None:
    """Eq. 9 a larger S; with a tolerance their own derivative is implicit, and they need none."""
    given = {f"numerics.{key}": value for key, value in (numerics | {"threads": 1}).items()}
    scene = load_scene(walled, given)
    simulation = Simulation(replace(scene, duration=1000.0))
    assert least_S(scene) <= simulation.S
    assert (least_S(scene) > 6) == (scene.numerics.tolerance is None)
    simulation.step(40)  # would warn; Eq. 9 with S = 6 diverges at the fourth step
    assert load_scene(walled, given | {"numerics.S": 7.0}).numerics.S == 7


# --- simulations -------------------------------------------------------------------------------

SHELL = EllipsoidShell(center=(0, 2.5, 0), semi_axes=(14.5, 14.5, 14.5))


def adhering(*active: int, spacing: Any = 0.5, volumes: str = "surface") -> Scene:
    """The embryo of an image of such voxels, of which these cells move; all if none is named."""
    return imported(active, spacing, volumes)


@cache
def imported(active: tuple[int, ...], spacing: Any, volumes: str) -> Scene:
    return import_labels(
        photographed(spacing), active=active or None, physics=Physics(sigma=0.5),
        confinement=SHELL, volumes=volumes,
    )  # fmt: skip


def overlaps(simulation: Simulation) -> list[float]:
    """IoU of each cell with what was photographed, at the points of the lattice."""
    origin, labels = label_image(simulation.fields)
    h = simulation.scene.numerics.spacing
    axes = [(o + np.arange(n)) * h for o, n in zip(origin, labels.shape, strict=True)]
    true = embryo(*np.meshgrid(*axes, indexing="ij", sparse=True))
    return [
        np.count_nonzero((labels == k) & (true == k))
        / np.count_nonzero((labels == k) | (true == k))
        for k in (1, 2, 3)
    ]


@pytest.mark.parametrize("spacing", [0.5, (0.25, 0.25, 1.0)])
@pytest.mark.parametrize(("volumes", "least"), [("voxels", 0.9), ("surface", 0.96)])
def test_shapes_come_through(spacing: Any, volumes: str, least: float) -> None:
    simulation = Simulation(adhering(spacing=spacing, volumes=volumes))
    simulation.run(until=20)
    assert min(overlaps(simulation)) > least


def test_only_the_region_of_interest_moves(tmp_path: Path) -> None:
    save_scene(adhering(3), tmp_path / "scene.toml")
    simulation = Simulation(load_scene(tmp_path / "scene.toml"))
    before = simulation.centroids
    simulation.run(until=20)
    moved = np.linalg.norm(simulation.centroids - before, axis=1)
    assert (moved[:2] == 0).all()
    assert moved[2] > 0.01


def test_a_relaxed_scene_starts_from_what_a_free_one_becomes() -> None:
    free = Simulation(adhering())
    free.run(until=10)
    scene = adhering(3)
    start = relaxed(scene)
    assert [cell.frozen for cell in start.cells] == [True, True, False]
    assert [cell.volume for cell in start.cells] == [cell.volume for cell in scene.cells]
    np.testing.assert_allclose(Simulation(start).centroids, free.centroids, atol=1e-3)
    assert min(overlaps(Simulation(start))) > 0.96


def test_a_scene_is_relaxed_without_its_stages() -> None:
    cells = [Cell(name="a", shape=Sphere(center=(0, 0, 0), radius=4))]
    division = Division(cell="a", daughters=("b", "c"), axis=(1, 0, 0))
    stages = [Stage(name="s", end=Duration(4), events=[division], physics={"gamma": 0.5})]
    plain, staged = Scene(cells=cells), Scene(cells=cells, stages=stages)
    np.testing.assert_array_equal(
        relaxed(staged).cells[0].shape.phi, relaxed(plain).cells[0].shape.phi
    )
    assert relaxed(staged).stages == staged.stages


def test_frozen_neighbours_push_less_when_relaxed() -> None:
    rough = adhering(3)
    free, smooth = relaxed(adhering()), relaxed(rough)
    ends = []
    for scene in (free, smooth, rough):
        simulation = Simulation(scene)
        simulation.run(until=60)
        ends.append(simulation.centroids[2])
    assert np.linalg.norm(ends[1] - ends[0]) < 0.5 * np.linalg.norm(ends[2] - ends[0])
