"""The form in the page: its widgets."""

from collections.abc import Callable
from typing import Any

from trame.widgets import html
from trame.widgets import vuetify3 as v3

from morphosim.app.form import FILES, Form
from morphosim.app.widgets import Background, alert, alerts, choice, entry, field, upload

FITS = "fits === source_kind"
"""Whether the form holds what the chosen tab says."""
MATRIX = "cells.length > 1 && cells.length <= most_in_table"
PAIR_VALUE = (
    "(sigma[cells.findIndex(c => c.name === pair_from)] ?? [])"
    "[cells.findIndex(c => c.name === pair_to)]"
)
MEANT = "(numerics[preset] ?? {})"
"""What the chosen preset means."""
WALL_CHOICES = (
    f"[{{title: 'preset: ' + {MEANT}.walls, value: ''}},"
    " ...wall_kinds.map(kind => ({title: kind, value: kind}))]"
)


def source(form: Form, background: Background) -> None:
    """Where the scene comes from."""
    with v3.VBtnToggle(
        v_model=("source_kind",), mandatory=True, divided=True, density="compact", color="primary",
        variant="outlined", classes="tabs mb-3", update_modelValue=background(form.choose_kind),
    ):  # fmt: skip
        v3.VBtn("Built-in scene", value="built-in")
        v3.VBtn("Masks and table", value="matlab")
        v3.VBtn("Label image", value="labels")
        v3.VBtn("Scene file", value="file")
    read, list_files = background(form.read_source), background(form.list_files)
    with html.Div(v_if=("source_kind === 'built-in'",)):
        choice("Scene", "scene_name", "scene_names", update_modelValue=read)
    with html.Div(v_if=("source_kind === 'matlab'",)):
        _file(list_files, "Cells: masks or saved fields", "masks", "mask_files")
        _file(list_files, "Names and attraction", "table", "table_files")
        _file(list_files, "Eggshell; empty: the published one", "shell_file", "mask_files")
    with html.Div(v_if=("source_kind === 'labels'",)):
        _file(list_files, "Label image", "image", "image_files")
        _image()
        _file(list_files, "Names and attraction; may be empty", "table", "table_files")
        _file(list_files, "Known of labels; may be empty", "about", "table_files")
    with html.Div(v_if=("source_kind === 'file'",)):
        _file(
            list_files, "Scene file", "scene_file", "scene_files", beside=(".npz",),
            update_modelValue=read,
        )  # fmt: skip
    with html.Div(v_if=("source_kind !== 'built-in'",), classes="line"):
        field(
            "Voxel, µm",
            "voxel",
            v_if=("source_kind !== 'file'",),
            persistent_placeholder=True,
            placeholder=("source_kind === 'matlab' ? '0.5' : 'of the file'",),
        )
        v3.VBtn("Read files", color="primary", variant="tonal", click=read, loading=("reading",))
    alert("form_error", "error")
    alerts("form_warnings", "warning", "each")
    html.P(
        "The cells are shown when the files are read.",
        v_if=(f"source_kind !== 'built-in' && !({FITS}) && !reading",), classes="note",
    )  # fmt: skip
    html.P("{{ description }}", v_if=(f"description && {FITS}",), classes="note")


def _file(
    list_files: Callable[..., None], label: str, name: str, items: str,
    beside: tuple[str, ...] = (), **options: Any,
) -> None:  # fmt: skip
    """Choice of a file of the folder, or one to upload, perhaps with others that it names."""
    suffixes = FILES[items]
    with html.Div(classes="line"):
        choice(
            f"{label} ({', '.join(suffixes)})", name, items, clearable=True,
            update_menu=list_files, **options,
        )  # fmt: skip
        upload(name, ",".join([*suffixes, *beside]), several=bool(beside))


def _image() -> None:
    """What of a label image is meant, where its file does not say it."""
    with html.Div(classes="line"):
        _shown("Time index, from 0", "time_index", "'the only one'")
        _shown("Axes, as tzyx", "axes", "'of the file'")
        _shown("Array (key)", "array", "'the only one'")
        _shown("Background label", "background", "'0'")
    with html.Div(classes="line"):
        choice("Target volumes", "image_volumes", "volume_kinds")
        _shown("Frozen: names or labels", "frozen", "'none'")
        _shown("Least voxels of a label", "least_voxels", "'27 lattice points'")


def _shown(label: str, name: str, placeholder: str, **options: Any) -> None:
    """Text field that shows, while it is empty, what holds then."""
    field(label, name, persistent_placeholder=True, placeholder=(placeholder,), **options)


def values(form: Form) -> None:
    """What of the scene can be changed."""
    _cells()
    _pair(form)
    _numbers(form)


def _cells() -> None:
    """Names, types, volumes and, of few cells, the attraction matrix: row pulls on column."""
    with html.H3("Cells of {{ loaded }}"):
        html.Span(" and attraction σ", v_if=(MATRIX,))
    with html.Div(classes="scroll"), html.Table(classes="cells"):
        with html.Thead(), html.Tr():
            html.Th("Name")
            html.Th("Type")
            html.Th("µm³", title="Target volume")
            html.Th("γ", title="Surface tension")
            with html.Template(v_if=(MATRIX,)):
                html.Th("{{ cell.name }}", v_for="(cell, i) in cells", key="i")
        with html.Tbody(), html.Tr(v_for="(cell, j) in cells", key="j"):
            _cell("Name of cell ", "j + 1", "name", classes="name", disabled=("stages.length > 0",))
            _cell("Type of ", "cell.name", "type", classes="type")
            _cell(
                "Target volume of ", "cell.name", "volume", placeholder=("cell.own_volume",),
                inputmode="decimal", classes="volume",
            )  # fmt: skip
            _cell(
                "Surface tension of ", "cell.name", "gamma", inputmode="decimal",
                placeholder=("cell.own_gamma || gamma || own_gamma",),
            )  # fmt: skip
            with html.Template(v_if=(MATRIX,)), html.Td(v_for="(value, i) in sigma[j]", key="i"):
                entry(
                    "sigma[j][i]", "sigma", v_if=("i !== j",), inputmode="decimal",
                    aria_label=("'Attraction from ' + cell.name + ' to ' + cells[i].name",),
                )  # fmt: skip
    html.P("An empty field takes what it shows in grey, which the scene says.", classes="note")
    html.P(
        "Each row's cell pulls on the columns' cells with the strength σ.",
        v_if=(MATRIX,), classes="note",
    )  # fmt: skip
    html.P(
        "The scene's stages tell cells by name, so names stay.",
        v_if=("stages.length",), classes="note",
    )  # fmt: skip


def _cell(what: str, of: str, key: str, **options: Any) -> None:
    """Value of a cell, which may show while it is empty what the scene says."""
    with html.Td():
        entry(f"cells[j].{key}", "cells", aria_label=(f"'{what}' + ({of})",), **options)


def _pair(form: Form) -> None:
    """Attraction of one pair, where the matrix would be too large to show."""
    with html.Div(v_if=("cells.length > most_in_table",), classes="line"):
        names = "cells.map(c => c.name)"
        choice("σ: pull of", "pair_from", names)
        choice("on", "pair_to", names)
        html.Span("{{ " + PAIR_VALUE + " }} →", classes="note")
        field("to", "pair_value")
        v3.VCheckbox(
            v_model=("pair_both",), label="both ways", density="compact", hide_details=True
        )
        v3.VBtn("Set", variant="tonal", click=form.set_pair)


def _numbers(form: Form) -> None:
    html.H3("Time and numerics")
    with html.Div(classes="line"):
        field("Time", "duration")
        _shown("Time step δt", "dt", f"{MEANT}.dt")
        _shown("Tolerance, nm", "tolerance", "'fixed steps'")
        field("Saving interval", "save_every")
    html.P(
        "The run ends with the scene's last stage.",
        v_if=("stages.length",), classes="note",
    )  # fmt: skip
    with html.Div(classes="line"):
        choice("Preset", "preset", "presets", update_modelValue=form.show_preset)
        v3.VSwitch(
            v_model=("shell",), label="Shell", disabled=("!has_shell",), color="primary",
            density="compact", hide_details=True,
        )  # fmt: skip
    html.P(f"{{{{ {MEANT}.text }}}}", classes="note", id="preset_means")
    with html.Div(classes="line"):
        _shown("S", "S", f"{MEANT}.S")
        choice("Walls", "walls", WALL_CHOICES)
        _shown("Surface tension γ", "gamma", "own_gamma")


def save(form: Form, background: Background) -> None:
    """Write the scene as a file."""
    with html.Div(classes="line"):
        field("Scene file to write", "save_name")
        v3.VBtn(
            "Save scene", variant="tonal", click=background(form.save), loading=("saving",),
        )  # fmt: skip
    alert("save_error", "error")
    with html.P(v_for="file in saved", key="file.name", classes="note"):
        html.Span("Scene: ")
        html.A("{{ file.name }}", href=("file.link",), download=True)
