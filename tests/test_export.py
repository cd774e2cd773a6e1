"""Exports: other programs' readers get back what the simulation had."""

import sys
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tifffile

from morphosim import export
from morphosim.exports.stl import TRIANGLE, file_names
from morphosim.importers.labels.image_file import read_labels
from morphosim.measure.surfaces import cell_surface

from .run_by_hand import NAMES, H, Run, Save, images_only, make_run, simulated, with_contact_list


@pytest.fixture(scope="module")
def saves() -> list[Save]:
    return simulated()


@pytest.fixture
def run(saves: list[Save]) -> Run:
    return make_run(saves)


@pytest.fixture
def vtk() -> Any:
    """Readers of VTK."""
    pytest.importorskip("pyvista", reason="the extra vtk is not installed")
    return import_module("vtkmodules.vtkIOXML")


def read(reader: Any, path: Path) -> Any:
    """What a reader of VTK makes of a file."""
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    return reader.GetOutputDataObject(0)


def collection(path: Path) -> dict[float, Path]:
    """Time and file of every entry of a ParaView collection."""
    entries = ElementTree.parse(path).getroot().findall("Collection/DataSet")
    return {
        float(entry.attrib["timestep"]): path.parent / entry.attrib["file"] for entry in entries
    }


def test_paraview_gets_a_named_block_per_cell(run: Run, tmp_path: Path, vtk: Any) -> None:
    import pyvista as pv

    written = export(run.data, tmp_path, "vtk")
    assert sorted(written) == sorted(p for p in tmp_path.rglob("*") if p.is_file())
    series = collection(tmp_path / "cells.pvd")
    assert list(series) == [save.time for save in run.saves]
    for save, file in zip(run.saves, series.values(), strict=True):
        blocks = pv.wrap(read(vtk.vtkXMLMultiBlockDataReader(), file))
        assert blocks.keys() == NAMES
        for k, name in enumerate(NAMES):
            if name not in save.fields:
                assert blocks[k] is None
                continue
            expected = cell_surface(save.fields[name], H)
            mesh = blocks[k]
            np.testing.assert_allclose(mesh.points, expected.vertices, atol=1e-5)
            np.testing.assert_array_equal(mesh.regular_faces, expected.faces)
            assert mesh.volume == pytest.approx(expected.volume, rel=1e-4)
            assert set(mesh.cell_data["label"]) == {k + 1}
            assert set(mesh.cell_data["type"]) == {["", "soft", "stiff"].index(save.types[name])}
            assert set(mesh.cell_data["surface_area"]) == {expected.area}
            assert set(mesh.cell_data["volume"]) == {save.values["volume"][name]}
            assert mesh.field_data["name"].tolist() == [name]
            assert mesh.field_data["type"].tolist() == [save.types[name]]


def test_paraview_gets_label_images_in_place(run: Run, tmp_path: Path, vtk: Any) -> None:
    import pyvista as pv

    export(run.data, tmp_path, "vtk", times=[20, 11])
    series = collection(tmp_path / "labels.pvd")
    assert list(series) == [10, 20]
    image = pv.wrap(read(vtk.vtkXMLImageDataReader(), series[20]))
    expected = run.data.morpho.labels(20)
    assert image.dimensions == expected.shape
    assert image.spacing == (H, H, H)
    assert image.origin == tuple(float(expected[axis][0]) for axis in "xyz")
    labels = image.point_data["label"].reshape(image.dimensions, order="F")
    np.testing.assert_array_equal(labels, expected.values)
    assert image.field_data["name"].tolist() == NAMES
    assert b'compressor="vtkZLibDataCompressor"' in series[20].read_bytes()
    # The reader of collections that PyVista has finds the same.
    reader = pv.get_reader(str(tmp_path / "labels.pvd"))
    assert reader.time_values == [10, 20]


def test_any_cell_name_reaches_paraview(run: Run, tmp_path: Path, vtk: Any) -> None:
    import pyvista as pv

    names = ['α/"<é>&', "b 1", "b.1", "B 1"]
    export(run.data.assign_coords(cell=names), tmp_path, "vtk", times=[20])
    blocks = pv.wrap(read(vtk.vtkXMLMultiBlockDataReader(), tmp_path / "cells" / "0002.vtm"))
    assert blocks.keys() == names
    assert blocks[0].field_data["name"].tolist() == names[:1]


def test_cells_too_far_apart_for_a_label_image(run: Run, tmp_path: Path, vtk: Any) -> None:
    far = run.data.copy(deep=False)
    moved = far["box_origin"].values + 4000 * (far["box_cell"].values == 0)[:, None]
    far["box_origin"] = ("box", "axis"), moved
    low = far["box_low"].values.copy()
    low[:, 0] += 2000
    far["box_low"] = ("time", "cell", "axis"), low
    with pytest.warns(UserWarning, match=r"labels.pvd is not written") as told:
        export(far, tmp_path / "vtk", "vtk", times=[0])
    assert told[0].filename == __file__
    assert {p.name for p in (tmp_path / "vtk").iterdir()} == {"cells", "cells.pvd"}
    with pytest.raises(ValueError, match=r"points, which holds the boxes of all 1 saves"):
        export(far, tmp_path / "tiff", "ome-tiff", times=[0])


def test_stl_has_the_surface_of_every_cell(run: Run, tmp_path: Path) -> None:
    written = export(run.data, tmp_path, "stl")
    assert sorted(written) == [tmp_path / "t_26" / f"{n}.stl" for n in ("a", "b1", "b2")]
    raw = written[0].read_bytes()
    expected = cell_surface(run.saves[3].fields["a"], H)
    assert not raw.startswith(b"solid")
    assert int.from_bytes(raw[80:84], "little") == len(expected.faces)
    triangles = np.frombuffer(raw, TRIANGLE, offset=84)
    np.testing.assert_allclose(triangles["corners"], expected.vertices[expected.faces], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(triangles["normal"], axis=1), 1, atol=1e-5)
    outward = triangles["corners"].mean(axis=1) - expected.vertices.mean(axis=0)
    assert ((triangles["normal"] * outward).sum(axis=1) > 0).all()


def test_stl_reads_back(run: Run, tmp_path: Path, vtk: Any) -> None:
    import pyvista as pv

    export(run.data, tmp_path, "stl", times=[0, 20])
    assert {p.name for p in tmp_path.iterdir()} == {"t_0", "t_20"}
    mesh = pv.read(tmp_path / "t_20" / "b2.stl")
    expected = cell_surface(run.saves[2].fields["b2"], H)
    assert mesh.volume == pytest.approx(expected.volume, rel=1e-4)
    assert mesh.area == pytest.approx(expected.area, rel=1e-4)


def test_file_names_differ_on_every_system() -> None:
    names = ["a", "A", "a-2", "b/c", "b:c", "..", "α", "MS.1"]
    assert file_names(names) == ["a", "A-2", "a-2-2", "b_c", "b_c-2", "_", "α", "MS.1"]


def test_ome_tiff_is_the_labels_on_one_lattice(run: Run, tmp_path: Path) -> None:
    written = export(run.data, tmp_path, "ome-tiff", times=[0, 10, 20])
    with tifffile.TiffFile(written[0]) as file:
        series = file.series[0]
        assert file.is_ome
        assert (series.axes, series.dtype) == ("TZYX", np.uint16)
        stack = series.asarray()
        pixels = pixels_of(file.ome_metadata)
    assert {key: pixels[key] for key in ("SizeX", "SizeY", "SizeZ", "SizeC", "SizeT")} == {
        "SizeX": str(stack.shape[3]), "SizeY": str(stack.shape[2]), "SizeZ": str(stack.shape[1]),
        "SizeC": "1", "SizeT": "3",
    }  # fmt: skip
    for axis in "XYZ":
        assert float(pixels[f"PhysicalSize{axis}"]) == H
        assert pixels.get(f"PhysicalSize{axis}Unit", "µm") == "µm"
    assert float(pixels["TimeIncrement"]) == 10
    images = [run.data.morpho.labels(save.time) for save in run.saves[:3]]
    low = {axis: min(float(image[axis][0]) for image in images) for axis in "xyz"}
    for image, frame in zip(images, stack, strict=True):
        whole = np.zeros_like(frame)
        x, y, z = (round((float(image[axis][0]) - low[axis]) / H) for axis in "xyz")
        nx, ny, nz = image.shape
        whole[z : z + nz, y : y + ny, x : x + nx] = image.values.transpose()
        np.testing.assert_array_equal(frame, whole)
    assert stack.max() == 4
    assert pd.read_csv(written[1]).to_dict("list") == {"label": [1, 2, 3, 4], "cell": NAMES}


def pixels_of(xml: str) -> dict[str, str]:
    """Attributes of `Pixels` in OME metadata, with the channel's name and the planes' times."""
    space = "{http://www.openmicroscopy.org/Schemas/OME/2016-06}"
    pixels = ElementTree.fromstring(xml).find(f"{space}Image/{space}Pixels")
    assert pixels is not None
    channel = pixels.find(f"{space}Channel")
    assert channel is not None
    planes = " ".join(plane.attrib["DeltaT"] for plane in pixels.iter(f"{space}Plane"))
    return pixels.attrib | {"channel": channel.attrib["Name"], "planes": planes}


@pytest.mark.parametrize(
    ("times", "increment"), [([0, 10, 20, 26], None), ([10, 20], "10.0"), ([20], None)]
)
def test_ome_tiff_has_the_time_of_every_plane(
    run: Run, tmp_path: Path, times: list[float], increment: str | None
) -> None:
    image, _ = export(run.data, tmp_path, "ome-tiff", times)
    with tifffile.TiffFile(image) as file:
        pixels = pixels_of(file.ome_metadata)
    assert pixels.get("TimeIncrement") == increment
    assert pixels["channel"] == "cells"
    expected = np.repeat(times, int(pixels["SizeZ"]))
    np.testing.assert_allclose([float(t) for t in pixels["planes"].split()], expected)


def test_an_exported_label_image_comes_back_to_its_place(run: Run, tmp_path: Path) -> None:
    image, _ = export(run.data, tmp_path, "ome-tiff", [10])
    labels = run.data.morpho.labels(10)
    found = read_labels(image)
    np.testing.assert_allclose(found.origin, [float(labels[axis][0]) for axis in "xyz"])
    assert any(found.origin)
    np.testing.assert_allclose(found.spacing, H)
    np.testing.assert_array_equal(found.labels, labels.values)


def test_a_position_without_a_unit_of_length_is_no_position(tmp_path: Path) -> None:
    planes = {"PositionX": [3.0] * 2, "PositionY": [2.0] * 2, "PositionYUnit": ["mm"] * 2}
    sizes = {f"PhysicalSize{axis}": 0.5 for axis in "XYZ"}
    tifffile.imwrite(
        tmp_path / "a.ome.tif",
        np.ones((2, 3, 4), np.uint8),
        photometric="minisblack",
        metadata={"axes": "ZYX", "Plane": planes} | sizes,
    )
    assert list(read_labels(tmp_path / "a.ome.tif").origin) == [0, 2000, 0]


def test_ome_tiff_reads_one_save_at_a_time(run: Run, tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    export(run.data, tmp_path, "ome-tiff", tell=lambda k, n: done.append((k, n)))
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    stops = np.cumsum([sum(f.phi.size for f in save.fields.values()) for save in run.saves])
    assert [(r.start, r.stop) for r in run.reads] == list(pairwise([0, *stops]))


def test_label_images_of_a_run_without_fields(run: Run, tmp_path: Path) -> None:
    fields = export(run.data, tmp_path / "fields", "ome-tiff")[0]
    images = export(images_only(run), tmp_path / "images", "ome-tiff")[0]
    np.testing.assert_array_equal(tifffile.imread(fields), tifffile.imread(images))
    with pytest.raises(ValueError, match="no fields"):
        export(images_only(run), tmp_path / "stl", "stl")


def test_tables_hold_what_the_run_holds(run: Run, tmp_path: Path) -> None:
    written = export(run.data, tmp_path, "csv")
    assert [path.name for path in written] == ["cells.csv", "contacts.csv", "times.csv"]
    cells, contacts, times = (pd.read_csv(path, keep_default_na=False) for path in written)
    rows = [(save, name) for save in run.saves for name in save.fields]
    assert list(zip(cells["time"], cells["cell"], strict=True)) == [(s.time, n) for s, n in rows]
    assert cells["type"].tolist() == [s.types[n] for s, n in rows]
    assert cells["parent"].tolist() == ["b" if n in ("b1", "b2") else "" for _, n in rows]
    assert cells["volume"].tolist() == [s.values["volume"][n] for s, n in rows]
    for k, axis in enumerate("xyz"):
        expected = [s.values["centroid"][n][k] for s, n in rows]
        assert cells[f"centroid_{axis}"].tolist() == expected
        expected = [s.values["semi_axes"][n][k] for s, n in rows]
        assert cells[f"semi_axes_{k}"].tolist() == expected
    pairs = [(s.time, a, b, area) for s in run.saves for (a, b), area in s.contacts.items()]
    found = list(contacts.itertuples(index=False, name=None))
    assert [row[:3] for row in found] == [row[:3] for row in pairs]
    np.testing.assert_allclose([row[3] for row in found], [row[3] for row in pairs], rtol=1e-6)
    assert times.to_dict("list") == {
        "time": [0, 10, 20, 26], "step": [0, 5, 10, 15], "stage": ["grow"] * 4,
    }  # fmt: skip


def test_tables_are_the_same_with_contacts_as_a_list(run: Run, tmp_path: Path) -> None:
    export(run.data, tmp_path / "matrix", "csv")
    export(with_contact_list(run.data), tmp_path / "list", "csv")
    for name in ("cells", "contacts", "times"):
        one, other = ((tmp_path / form / f"{name}.csv").read_text() for form in ("matrix", "list"))
        assert one == other


def test_a_table_without_contacts_has_its_header(run: Run, tmp_path: Path) -> None:
    alone = run.data.assign(contact_area=run.data["contact_area"] * 0)
    export(alone, tmp_path, "csv")
    assert (tmp_path / "contacts.csv").read_text().strip() == "time,cell,neighbour,area"


def test_unknown_format(run: Run, tmp_path: Path) -> None:
    message = "to = 'ome-tif' is not known; allowed are 'vtk', .*; did you mean 'ome-tiff'"
    with pytest.raises(ValueError, match=message):
        export(run.data, tmp_path / "out", "ome-tif")
    assert not (tmp_path / "out").exists()


def test_a_directory_with_files_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    for place in (tmp_path, tmp_path / "mine.txt"):
        with pytest.raises(FileExistsError, match="choose another"):
            export(run.data, place, "csv")
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_what_is_wrong_is_said_before_anything_is_written(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match="times is empty"):
        export(run.data, tmp_path / "out", "csv", times=[])
    with pytest.raises(ValueError, match="'contact_area'"):
        export(run.data.drop_vars("contact_area"), tmp_path / "out", "csv")
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(
        ImportError, match=r"pip install '\.\[vtk\]'; with a wheel: pip install 'FILE.whl\[vtk\]'"
    ):
        export(run.data, tmp_path / "out", "vtk")
    assert not list(tmp_path.rglob("*.*"))
