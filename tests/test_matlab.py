"""Import of the published MATLAB program's files: small made ones, then the published ones."""

import csv
import struct
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pytest
from scipy.io import savemat

from morphosim import Field, Mask
from morphosim.geometry.eggshell import EGGSHELL
from morphosim.importers.matlab.scene import import_matlab
from morphosim.physics.parameters import Physics

SHARED = Path(__file__).resolve().parents[2] / "shared"
EXAMPLE = SHARED / "matlab_example"
MASKS, SHELL = EXAMPLE / "Example_8Cell.mat", EXAMPLE / "Example_Eggshell.mat"
TABLES = [EXAMPLE / f"Example_CellName&AttractionMatrix_{k}.xls" for k in (1, 2)]
STATE = SHARED / "reference" / "state_weak_t100.mat"

NAMES = ["A", "B", "C"]
TABLE = [["", *NAMES], ["A", 0, 0.1, 0.2], ["B", 0.3, 0, 0.4], ["C", 0.5, 0.6, 0]]
SIGMA = np.array([row[1:] for row in TABLE[1:]])
CORNERS = [(1, 2, 3), (4, 2, 0), (8, 1, 1)]
"""First voxel (x, y, z) of the box that is each small cell."""
GRID = (12, 8, 6)

needs_example = pytest.mark.skipif(
    not EXAMPLE.is_dir(), reason="the published example (../shared/matlab_example) is absent"
)
needs_state = pytest.mark.skipif(
    not STATE.is_file(), reason="the reference state (../shared/reference) is absent"
)


# --- small files -------------------------------------------------------------------------------


def boxes() -> list[np.ndarray]:
    """Three boxes of 2 x 3 x 2 voxels on a grid with axes x, y, z."""
    images = []
    for x, y, z in CORNERS:
        image = np.zeros(GRID, np.uint8)
        image[x : x + 2, y : y + 3, z : z + 2] = 1
        images.append(image)
    return images


def fields() -> list[np.ndarray]:
    """The boxes as fields, with a faint background of 1e-7 that is to be cropped."""
    return [np.where(image, 0.9, 1e-7) for image in boxes()]


def write_v5(path: Path, cells: dict[str, list], arrays: dict[str, Any], **options: Any) -> Path:
    """MAT-file v5 with cell arrays and arrays, axes y, x, z."""
    content = dict(arrays)
    for name, images in cells.items():
        content[name] = np.empty((len(images), 1), object)
        for k, image in enumerate(images):
            content[name][k, 0] = image
    savemat(path, content, **options)
    return path


def write_v7(path: Path, cells: dict[str, list], arrays: dict[str, Any]) -> Path:
    """MAT-file v7, which is a compressed v5."""
    return write_v5(path, cells, arrays, do_compression=True)


def write_v73(path: Path, cells: dict[str, list], arrays: dict[str, Any]) -> Path:
    """MAT-file v7.3 as MATLAB writes it: HDF5 behind a block of 512 bytes, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, images in cells.items():
            kept = [put(file, f"#refs#/{name}{k}", image) for k, image in enumerate(images)]
            data = np.array([[item.ref for item in kept]], h5py.ref_dtype)
            file.create_dataset(name, data=data).attrs["MATLAB_class"] = np.bytes_("cell")
        for name, array in arrays.items():
            put(file, name, np.atleast_2d(array))
        file.create_group("SimParameters").attrs["MATLAB_class"] = np.bytes_("struct")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def put(file: h5py.File, name: str, array: np.ndarray) -> h5py.Dataset:
    """One array with the attributes that MATLAB gives it."""
    empty = array.size == 0
    data = np.array(array.shape, np.uint64) if empty else array.T
    item = file.create_dataset(name, data=data)
    item.attrs["MATLAB_class"] = np.bytes_({"u": "uint8"}.get(array.dtype.kind, "double"))
    if empty:
        item.attrs["MATLAB_empty"] = np.uint8(1)
    return item


WRITERS = {"v5": write_v5, "v7": write_v7, "v7.3": write_v73}


def matlab_axes(images: list[np.ndarray]) -> list[np.ndarray]:
    """Axes y, x, z instead of x, y, z."""
    return [image.transpose(1, 0, 2) for image in images]


def write_masks(path: Path, images: list[np.ndarray] | None = None) -> Path:
    return write_v5(path, {"Mask": matlab_axes(boxes() if images is None else images)}, {})


def write_csv(path: Path, rows: list[list] = TABLE, delimiter: str = ",") -> Path:
    with path.open("w", newline="", encoding="utf-8-sig") as file:
        csv.writer(file, delimiter=delimiter).writerows(rows)
    return path


def write_xlsx(path: Path, rows: list[list] = TABLE) -> Path:
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append([None if value == "" else value for value in row])
    book.save(path)
    return path


def write_xls(path: Path, cells: dict[tuple[int, int], Any]) -> Path:
    """Workbook of the oldest .xls kind, BIFF2: texts, numbers and bytes (an error's code)."""
    data = struct.pack("<HHHH", 0x09, 4, 2, 0x10)
    for (row, column), value in cells.items():
        at = struct.pack("<HHxxx", row, column)
        if isinstance(value, str):
            kind, body = 0x04, bytes([len(value)]) + value.encode()
        elif isinstance(value, bytes):
            kind, body = 0x05, value + b"\x01"
        else:
            kind, body = 0x03, struct.pack("<d", value)
        data += struct.pack("<HH", kind, len(at + body)) + at + body
    path.write_bytes(data + struct.pack("<HH", 0x0A, 0))
    return path


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    return write_masks(tmp_path / "start.mat")


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return write_csv(tmp_path / "table.csv")


def centroid(shape: Mask | Field) -> np.ndarray:
    """Mean position in µm, weighted with the values."""
    values = np.asarray(shape.mask if isinstance(shape, Mask) else shape.phi, float)
    index = np.indices(values.shape).reshape(3, -1)
    return np.asarray(shape.origin) + (index * values.ravel()).sum(1) / values.sum() * shape.spacing


# --- cells -------------------------------------------------------------------------------------


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_masks_of_every_version(tmp_path: Path, table: Path, write: Any) -> None:
    path = write(tmp_path / "start.mat", {"Mask": matlab_axes(boxes())}, {})
    scene = import_matlab(path, table, spacing=0.25)
    assert scene.names == NAMES
    assert scene.name == "start"
    for cell, corner in zip(scene.cells, CORNERS, strict=True):
        assert isinstance(cell.shape, Mask)
        assert cell.shape.mask.shape == (2, 3, 2)
        assert cell.shape.mask.all()
        middle = np.array(corner) + np.array([0.5, 1, 0.5])
        np.testing.assert_allclose(centroid(cell.shape), 0.25 * middle)
        assert cell.target_volume(0) == pytest.approx(12 * 0.25**3)


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_saved_state_of_every_version(tmp_path: Path, table: Path, write: Any) -> None:
    state = {"phi_save": matlab_axes([fields()[2], fields()[0]])}
    path = write(tmp_path / "state.mat", state, {"CellIdx": np.array([[3.0], [1.0]])})
    scene = import_matlab(path, table)
    assert scene.names == ["C", "A"]
    np.testing.assert_array_equal(
        scene.physics.attraction.matrix(scene.names), [[0, 0.5], [0.2, 0]]
    )
    for cell, corner in zip(scene.cells, (CORNERS[2], CORNERS[0]), strict=True):
        assert isinstance(cell.shape, Field)
        assert cell.shape.phi.shape == (2, 3, 2)
        np.testing.assert_allclose(cell.shape.origin, 0.5 * np.array(corner))
        assert cell.target_volume(0) == pytest.approx(12 * 0.9 * 0.125)


def test_files_are_those_of_the_present_folder(
    tmp_path: Path, masks: Path, table: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process that reads them has begun in another."""
    import_matlab(masks, table)
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        Path(f"{name}.mat").write_bytes(masks.read_bytes())
        assert import_matlab(f"{name}.mat", table).names == NAMES


def test_targets_from_a_second_file_of_masks(tmp_path: Path, masks: Path, table: Path) -> None:
    state = {"phi_save": matlab_axes(fields()[1:])}
    path = write_v5(tmp_path / "state.mat", state, {"CellIdx": np.array([2, 3])})
    scene = import_matlab(path, table, masks_for_volume=masks)
    assert scene.names == ["B", "C"]
    assert [cell.volume for cell in scene.cells] == [1.5, 1.5]


def test_confinement_physics_and_name(masks: Path, table: Path) -> None:
    scene = import_matlab(masks, table)
    assert scene.confinement is EGGSHELL
    assert scene.with_physics(sigma=0.0).physics == Physics()
    scene = import_matlab(masks, table, confinement=None, name="three")
    assert scene.confinement is None
    assert scene.name == "three"


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_shell(tmp_path: Path, masks: Path, table: Path, write: Any) -> None:
    outside = np.ones(GRID)
    outside[2:9, 1:5, 3:] = 0
    path = write(tmp_path / "shell.mat", {}, {"PhiShell": outside.transpose(1, 0, 2)})
    walls = import_matlab(masks, table, shell=path, spacing=0.25).confinement
    points = np.meshgrid(*(0.25 * np.arange(n) for n in GRID), indexing="ij")
    np.testing.assert_array_equal(walls.field(*points), outside)


# --- tables ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["csv", "semicolon", "tab", "xlsx", "xls"])
def test_tables(tmp_path: Path, masks: Path, kind: str) -> None:
    if kind == "xlsx":
        path = write_xlsx(tmp_path / "table.XLSX")
    elif kind == "xls":
        cells = {(j, i): v for j, row in enumerate(TABLE) for i, v in enumerate(row) if v != ""}
        path = write_xls(tmp_path / "table.xls", cells)
    else:
        path = write_csv(
            tmp_path / "table.csv", delimiter={"semicolon": ";", "tab": "\t"}.get(kind, ",")
        )
    sigma = import_matlab(masks, path).physics.attraction
    np.testing.assert_array_equal(sigma.matrix(NAMES), SIGMA)


def test_columns_in_another_order(tmp_path: Path, masks: Path) -> None:
    rows = [[row[k] for k in (0, 3, 1, 2)] for row in TABLE]
    scene = import_matlab(masks, write_csv(tmp_path / "table.csv", rows))
    assert scene.names == NAMES
    np.testing.assert_array_equal(scene.physics.attraction.matrix(NAMES), SIGMA)


def test_empty_rows_columns_and_diagonal(tmp_path: Path, masks: Path) -> None:
    rows = [
        ["", *TABLE[0], ""],
        [],
        ["", "A", "", 0.1, 0.2],
        ["", *TABLE[2]],
        ["", *TABLE[3]],
        [""],
    ]
    sigma = import_matlab(masks, write_csv(tmp_path / "table.csv", rows)).physics.attraction
    np.testing.assert_array_equal(sigma.matrix(NAMES), SIGMA)


def test_numbers_as_names(tmp_path: Path, masks: Path) -> None:
    rows = [["", 1, 2, 10], [1, 0, 1, 1], [2, 1, 0, 1], [10, 1, 1, 0]]
    for path in (write_csv(tmp_path / "t.csv", rows), write_xlsx(tmp_path / "t.xlsx", rows)):
        assert import_matlab(masks, path).names == ["1", "2", "10"]


@pytest.mark.parametrize("heading", ["volume", "Volume (um^3)", "VOLUME [µm³]", "volume_μm3"])
@pytest.mark.parametrize("place", [1, 2, 4])
def test_volumes_in_the_table(tmp_path: Path, masks: Path, heading: str, place: int) -> None:
    column = [heading, 10, 20.5, 30]
    rows = [[*row[:place], v, *row[place:]] for row, v in zip(TABLE, column, strict=True)]
    scene = import_matlab(masks, write_xlsx(tmp_path / "table.xlsx", rows))
    assert [cell.target_volume(0) for cell in scene.cells] == [10, 20.5, 30]
    np.testing.assert_array_equal(scene.physics.attraction.matrix(NAMES), SIGMA)


def test_tables_without_attraction(tmp_path: Path, masks: Path) -> None:
    scene = import_matlab(masks, write_csv(tmp_path / "a.csv", [[name] for name in NAMES]))
    assert scene.names == NAMES
    assert not scene.physics.attraction.matrix(NAMES).any()
    rows = [["", "volume"], ["A", 1], ["B", 2], ["C", 3]]
    scene = import_matlab(masks, write_csv(tmp_path / "b.csv", rows))
    assert [cell.volume for cell in scene.cells] == [1, 2, 3]
    assert not scene.physics.attraction.matrix(NAMES).any()


# --- errors ------------------------------------------------------------------------------------


def changed(row: int, column: int, value: Any) -> list[list]:
    """The small table with one other entry."""
    rows = [list(r) for r in TABLE]
    rows[row][column] = value
    return rows


BAD_TABLES = {
    "text": (changed(1, 2, "strong"), "attraction from 'A' (row) to 'B' (column) = 'strong'"),
    "empty": (changed(3, 1, ""), "attraction from 'C' (row) to 'A' (column) = '' is not a number"),
    "negative": (changed(2, 3, -1), "attraction from 'B' (row) to 'C' (column) = -1.0"),
    "nan": (changed(2, 3, "NaN"), "attraction from 'B' (row) to 'C' (column) = nan"),
    "logical": (changed(2, 3, True), "attraction from 'B' (row) to 'C' (column) = 'True'"),
    "row twice": (changed(2, 0, "A"), "row 'A' occurs twice"),
    "column twice": (changed(0, 3, "A"), "column 'A' occurs twice"),
    "no row name": (changed(2, 0, ""), "a row (number 2) has no name"),
    "no column name": (changed(0, 2, ""), "a column (number 2) has no name"),
    "other name": (changed(0, 2, "X"), "a row 'X', rows without a column 'B'"),
    "other unit": (changed(0, 3, "volume (pl)"), "without a row 'volume (pl)'"),
    "no rows": ([["", "A", "B"]], "a row has no name"),
    "nothing": ([[""], []], "is empty"),
    "fewer": ([["A"], ["B"]], "has 3 cells, but the table has 2 names ('A' to 'B')"),
    "two volumes": (
        [["", "volume", "Volume (um3)"], *([name, 1, 1] for name in NAMES)],
        "2 columns headed volume",
    ),
    "volume": ([["", "volume"], ["A", 1], ["B", 0], ["C", 1]], "volume of cell 'B' = 0.0"),
}


@pytest.mark.parametrize(("rows", "text"), BAD_TABLES.values(), ids=BAD_TABLES)
@pytest.mark.parametrize("kind", ["csv", "xlsx"])
def test_bad_tables(tmp_path: Path, masks: Path, rows: list[list], text: str, kind: str) -> None:
    write = write_csv if kind == "csv" else write_xlsx
    path = write(tmp_path / f"table.{kind}", rows)
    with pytest.raises(ValueError, match="table") as error:
        import_matlab(masks, path)
    assert text in str(error.value)


def test_error_values_of_xls_are_not_numbers(tmp_path: Path, masks: Path) -> None:
    path = write_xls(tmp_path / "t.xls", {(0, 1): "A", (1, 0): "A", (1, 1): b"\x2a"})
    with pytest.raises(ValueError, match=r"t\.xls: attraction from 'A' .* = '#N/A' is not a num"):
        import_matlab(masks, path)


def test_numbers_with_a_decimal_comma(tmp_path: Path, masks: Path) -> None:
    path = write_csv(tmp_path / "t.csv", changed(1, 2, "0,5"), delimiter=";")
    assert import_matlab(masks, path).physics.attraction.matrix(NAMES)[0, 1] == 0.5


def with_nan() -> list[np.ndarray]:
    images = fields()
    images[1][0, 0, 0] = np.nan
    return images


BAD_CELLS = {
    "empty": ("Mask", [*boxes()[:2], np.zeros(GRID)], "Mask of cell 'C' is empty"),
    "shapes": ("Mask", [*boxes()[:2], boxes()[2][1:]], "cell 'C' has shape (11, 8, 6)"),
    "count": ("Mask", boxes()[:2], "has 2 cells, but the table has 3 names"),
    "none": ("Mask", [], "has 0 cells"),
    "nan": ("phi_save", with_nan(), "phi_save{2} (cell 'B') holds 1 values that are not finite"),
    "low": ("phi_save", [*fields()[:2], 0.5 * fields()[2]], "cell 'C' has no value above 0.5"),
}


@pytest.mark.parametrize(("variable", "images", "text"), BAD_CELLS.values(), ids=BAD_CELLS)
def test_bad_cells(
    tmp_path: Path, table: Path, variable: str, images: list[np.ndarray], text: str
) -> None:
    path = write_v5(tmp_path / "bad.mat", {variable: matlab_axes(images)}, {})
    with pytest.raises(ValueError, match=r"bad\.mat") as error:
        import_matlab(path, table)
    assert text in str(error.value)


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
@pytest.mark.parametrize(
    ("array", "text"),
    [
        (np.ones((8, 12)), r"Mask\{2\} \(cell 'B'\) has shape \(8, 12\)"),
        (np.zeros((0, 0)), r"Mask\{2\} \(cell 'B'\) has shape \(0, 0\)"),
    ],
)
def test_images_that_are_not_3d(
    tmp_path: Path, table: Path, write: Any, array: np.ndarray, text: str
) -> None:
    first, _, third = matlab_axes(boxes())
    path = write(tmp_path / "bad.mat", {"Mask": [first, array, third]}, {})
    with pytest.raises(ValueError, match=text):
        import_matlab(path, table)


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_missing_or_unfit_variables(tmp_path: Path, table: Path, masks: Path, write: Any) -> None:
    cells, path = {"Mask": matlab_axes(boxes())}, tmp_path / "bad.mat"
    write(path, {"Cells": cells["Mask"]}, {"dx": np.array([0.5])})
    with pytest.raises(ValueError, match=r"no variable Mask or phi_save; it holds .*'Cells'.*'dx'|"
                       r"no variable Mask or phi_save; it holds .*'dx'.*'Cells'"):  # fmt: skip
        import_matlab(path, table)
    with pytest.raises(ValueError, match="no variable PhiShell; it holds 'Mask'"):
        import_matlab(masks, table, shell=masks)
    write(path, {}, {"Mask": np.ones((3, 3))})
    with pytest.raises(ValueError, match="Mask is not a cell array"):
        import_matlab(path, table)
    write(path, cells | {"phi_save": matlab_axes(fields())}, {})
    with pytest.raises(ValueError, match="holds both Mask and phi_save"):
        import_matlab(path, table)


@pytest.mark.parametrize(
    ("index", "text"),
    [
        ([1, 2], "CellIdx has 2 numbers for 3 cells"),
        ([1, 2, 4], "CellIdx holds 4; allowed are rows 1 to 3"),
        ([0, 1, 2], "CellIdx holds 0"),
        ([1, 1.5, 2], "CellIdx holds 1.5"),
        ([1, 3, 3], "cell in CellIdx 'C' occurs twice"),
    ],
)
def test_bad_cell_numbers(tmp_path: Path, table: Path, index: list[float], text: str) -> None:
    cells = {"phi_save": matlab_axes(fields())}
    path = write_v5(tmp_path / "state.mat", cells, {"CellIdx": np.array(index)})
    with pytest.raises(ValueError, match=text):
        import_matlab(path, table)


def test_bad_shells(tmp_path: Path, masks: Path, table: Path) -> None:
    for shape, text in (((4, 5, 6), r"shape \(5, 4, 6\) \(x, y, z\)"), ((8, 12, 6), "no inside")):
        shell = write_v5(tmp_path / "shell.mat", {}, {"PhiShell": np.ones(shape)})
        with pytest.raises(ValueError, match=text):
            import_matlab(masks, table, shell=shell)


def test_bad_volume_sources(tmp_path: Path, masks: Path, table: Path) -> None:
    rows = [[*row, v] for row, v in zip(TABLE, ["volume", 1, 2, 3], strict=True)]
    volumes = write_csv(tmp_path / "volumes.csv", rows)
    with pytest.raises(ValueError, match="give one only"):
        import_matlab(masks, volumes, masks_for_volume=masks)
    part = {"Mask": matlab_axes(boxes()[:2])}
    path = write_v5(tmp_path / "part.mat", part, {"CellIdx": np.array([1, 3])})
    with pytest.raises(ValueError, match="has no mask of the cells 'B'"):
        import_matlab(masks, table, masks_for_volume=path)


def test_bad_paths(tmp_path: Path, masks: Path, table: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.mat does not exist"):
        import_matlab(tmp_path / "absent.mat", table)
    with pytest.raises(FileNotFoundError, match=r"absent\.csv does not exist"):
        import_matlab(masks, tmp_path / "absent.csv")
    with pytest.raises(ValueError, match=r"table\.ods = '\.ods' .* '\.xls', '\.xlsx', '\.csv'"):
        import_matlab(masks, tmp_path / "table.ods")
    with pytest.raises(ValueError, match=r"'\.npy' is not known; allowed are '\.mat'"):
        import_matlab(tmp_path / "masks.npy", table)
    with pytest.raises(ValueError, match="spacing = 0 is not allowed"):
        import_matlab(masks, table, spacing=0)


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
@pytest.mark.parametrize("kept", [0.0, 0.3, 0.9])
def test_damaged_mat_files(tmp_path: Path, table: Path, write: Any, kept: float) -> None:
    path = write(tmp_path / "bad.mat", {"Mask": matlab_axes(boxes())}, {})
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(ValueError, match=r"bad\.mat"):
        import_matlab(path, table)


@pytest.mark.parametrize("name", ["bad.xls", "bad.xlsx", "bad.csv", "bad.mat"])
def test_files_of_another_kind(tmp_path: Path, masks: Path, table: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"\xff\xd8\xff\xe0 a picture")
    start, names = (path, table) if path.suffix == ".mat" else (masks, path)
    text = "line 1 is not text in UTF-8" if path.suffix == ".csv" else "cannot be read as a"
    with pytest.raises(ValueError, match=rf"{name},? {text}"):
        import_matlab(start, names)


def test_a_damaged_byte_ends_the_reader_alone(tmp_path: Path, table: Path) -> None:
    path = write_masks(tmp_path / "bad.mat")
    whole = path.read_bytes()
    for place in (193, 233):  # a type within an array that is none: SciPy takes it as an index
        path.write_bytes(whole[:place] + b"\xed" + whole[place + 1 :])
        with pytest.raises(ValueError, match=r"bad\.mat cannot be read .* may be damaged"):
            import_matlab(path, table)
    path.write_bytes(whole)
    assert import_matlab(path, table).names == NAMES


@pytest.mark.parametrize(("package", "kind"), [("openpyxl", "xlsx"), ("xlrd", "xls")])
def test_missing_packages(
    tmp_path: Path, table: Path, monkeypatch: pytest.MonkeyPatch, package: str, kind: str
) -> None:
    masks = write_v73(tmp_path / "start.mat", {"Mask": matlab_axes(boxes())}, {})
    if kind == "xls":
        table = write_xls(tmp_path / "table.xls", {(0, 0): "A"})
    else:
        table = write_xlsx(tmp_path / "table.xlsx")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf"{package}; in a clone: pip install '.\[matlab\]'"):
        import_matlab(masks, table)


# --- published files ---------------------------------------------------------------------------

CELLS = ["ABal", "ABar", "ABpl", "ABpr", "MS", "E", "C", "P3"]
VOLUMES = [2879.625, 3107.875, 3104.75, 2807.5, 2498.75, 2199, 2371.375, 1129.75]


def published_sigma(abpl_e: float) -> np.ndarray:
    """0.5, but 0 between sisters and `abpl_e` between ABpl and E."""
    sigma = 0.5 * (1 - np.kron(np.eye(4), np.ones((2, 2))))
    sigma[2, 5] = sigma[5, 2] = abpl_e
    return sigma


@needs_example
@pytest.mark.parametrize(("table", "abpl_e"), [(TABLES[0], 0.5), (TABLES[1], 0.0)])
def test_published_example(table: Path, abpl_e: float) -> None:
    scene = import_matlab(MASKS, table)
    assert scene.names == CELLS
    assert [cell.target_volume(0) for cell in scene.cells] == VOLUMES
    sigma = scene.physics.attraction.matrix(CELLS)
    np.testing.assert_array_equal(sigma, published_sigma(abpl_e))
    for cell in scene.cells:
        depth = EGGSHELL.depth(*np.asarray(centroid(cell.shape)))
        assert depth > 3, f"{cell.name} is not inside the eggshell"


@needs_example
def test_published_names_without_attraction() -> None:
    scene = import_matlab(MASKS, EXAMPLE / "Example_CellName.xls", confinement=None)
    assert scene.names == CELLS
    assert not scene.physics.attraction.matrix(CELLS).any()


@needs_example
def test_published_shell_is_the_default_confinement() -> None:
    walls = import_matlab(MASKS, TABLES[0], shell=SHELL).confinement
    points = np.meshgrid(*(0.5 * np.arange(n) for n in (120, 80, 60)), indexing="ij")
    np.testing.assert_array_equal(walls.field(*points), EGGSHELL.field(*points))


@needs_example
@needs_state
def test_published_state() -> None:
    scene = import_matlab(STATE, TABLES[1], masks_for_volume=MASKS)
    assert [cell.volume for cell in scene.cells] == VOLUMES
    with (STATE.parent / "trajectory_weak.csv").open() as file:
        rows = {row["cell"]: row for row in csv.DictReader(file) if row["time"] == "100"}
    for cell in scene.cells:
        row, shape = rows[cell.name], cell.shape
        assert shape.volume == pytest.approx(float(row["volume_um3"]), rel=2e-4)
        above = Field(phi=np.where(shape.phi > 0.02, shape.phi, 0), origin=shape.origin)
        expected = [float(row[f"{axis}_um"]) for axis in "xyz"]
        np.testing.assert_allclose(centroid(above), expected, atol=2e-4)
