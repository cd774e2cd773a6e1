"""Upper half of the page: its widgets."""

from collections.abc import Callable

from trame.widgets import html
from trame.widgets import vuetify3 as v3

from morphosim.app.routes import VIEWER
from morphosim.app.upper import FILES, Upper
from morphosim.app.widgets import Background, alert, choice, field, plain_input, upload

SHOWN = "cells.length && (fits || (reading && source_kind === 'built-in'))"
"""Whether the form is shown: what it holds is of the chosen tab, or about to be."""
IDLE = "status === 'idle'"
TYPED = "cells.some(c => c.type)"
MATRIX = "cells.length > 1 && cells.length <= most_in_table"
PAIR_VALUE = (
    "(sigma[cells.findIndex(c => c.name === pair_from)] ?? [])"
    "[cells.findIndex(c => c.name === pair_to)]"
)


def build(upper: Upper, background: Background) -> None:
    """Widgets of the upper half."""
    with v3.VRow(classes="half"):
        with v3.VCol(cols=12, lg=5):
            _source(upper, background)
            with html.Div(
                v_if=(SHOWN,), classes=("{ stale: reading }",), inert=("reading",),
                __properties=["inert"],
            ):  # fmt: skip
                _cells()
                _pair(upper)
                _numbers()
                _start(upper, background)
        with v3.VCol(cols=12, lg=7):
            _progress(upper)
            html.Iframe(id="live-viewer", src=VIEWER.lstrip("/"), title="Live view of the run")


def _source(upper: Upper, background: Background) -> None:
    html.H2("Simulate")
    with v3.VBtnToggle(
        v_model=("source_kind",), mandatory=True, divided=True, density="compact", color="primary",
        variant="outlined", classes="tabs mb-3", update_modelValue=background(upper.choose_kind),
    ):  # fmt: skip
        v3.VBtn("Built-in scene", value="built-in")
        v3.VBtn("Masks and table", value="matlab")
        v3.VBtn("Label image", value="labels")
    read, list_files = background(upper.read_source), background(upper.list_files)
    with html.Div(v_if=("source_kind === 'built-in'",)):
        choice("Scene", "scene_name", "scene_names", update_modelValue=read)
    with html.Div(v_if=("source_kind === 'matlab'",)):
        _file(list_files, "Cells: masks or saved fields", "masks", "mask_files")
        _file(list_files, "Names and attraction", "table", "table_files")
        _file(list_files, "Eggshell; empty: the published one", "shell_file", "mask_files")
    with html.Div(v_if=("source_kind === 'labels'",)):
        _file(list_files, "Label image", "image", "image_files")
        _file(list_files, "Names and attraction; may be empty", "table", "table_files")
    with html.Div(v_if=("source_kind !== 'built-in'",), classes="line"):
        field(
            "Voxel, µm",
            "voxel",
            persistent_placeholder=True,
            placeholder=("source_kind === 'matlab' ? '0.5' : 'of the file'",),
        )
        v3.VBtn("Read files", color="primary", variant="tonal", click=read, loading=("reading",))
    alert("form_error", "error")
    html.P(
        "The cells are shown when the files are read.",
        v_if=("source_kind !== 'built-in' && !fits && !reading",), classes="note",
    )  # fmt: skip
    html.P(
        "{{ description }}",
        v_if=("description && fits && source_kind === 'built-in'",),
        classes="note",
    )


def _file(list_files: Callable[..., None], label: str, name: str, items: str) -> None:
    suffixes = FILES[items]
    with html.Div(classes="line"):
        choice(
            f"{label} ({', '.join(suffixes)})", name, items, clearable=True,
            update_menu=list_files,
        )  # fmt: skip
        upload(name, ",".join(suffixes))


def _cells() -> None:
    """Names, types, volumes and, of few cells, the attraction matrix: row pulls on column."""
    with html.H3("Cells of {{ loaded }}"):
        html.Span(" and attraction σ", v_if=(MATRIX,))
    with html.Div(classes="scroll"), html.Table(classes="cells"):
        with html.Thead(), html.Tr():
            html.Th("Name")
            html.Th("Type", v_if=(TYPED,))
            html.Th("µm³", title="Target volume")
            with html.Template(v_if=(MATRIX,)):
                html.Th("{{ cell.name }}", v_for="(cell, i) in cells", key="i")
        with html.Tbody(), html.Tr(v_for="(cell, j) in cells", key="j"):
            with html.Td():
                plain_input(
                    value=("cell.name",), disabled=("stages.length > 0",), classes="name",
                    aria_label=("'Name of cell ' + (j + 1)",),
                    change="cells[j].name = $event.target.value; flushState('cells')",
                )  # fmt: skip
            html.Td("{{ cell.type }}", v_if=(TYPED,))
            html.Td("{{ cell.volume }}")
            with html.Template(v_if=(MATRIX,)), html.Td(v_for="(value, i) in sigma[j]", key="i"):
                plain_input(
                    v_if=("i !== j",), value=("value",), inputmode="decimal",
                    aria_label=("'Attraction from ' + cell.name + ' to ' + cells[i].name",),
                    change="sigma[j][i] = $event.target.value; flushState('sigma')",
                )  # fmt: skip
    html.P(
        "Each row's cell pulls on the columns' cells with the strength σ.",
        v_if=(MATRIX,), classes="note",
    )  # fmt: skip
    html.P(
        "The scene's stages tell cells by name, so names stay.",
        v_if=("stages.length",), classes="note",
    )  # fmt: skip


def _pair(upper: Upper) -> None:
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
        v3.VBtn("Set", variant="tonal", click=upper.set_pair)


def _numbers() -> None:
    html.H3("Time and numerics")
    with html.Div(classes="line"):
        field("Time", "duration")
        field("Time step δt", "dt")
        field("Saving interval", "save_every")
    html.P(
        "The run ends with the scene's last stage.",
        v_if=("stages.length",), classes="note",
    )  # fmt: skip
    with html.Div(classes="line"):
        choice("Preset", "preset", "presets", update_modelValue="dt = String(dts[$event] ?? dt)")
        v3.VSwitch(
            v_model=("shell",), label="Shell", disabled=("!has_shell",), color="primary",
            density="compact", hide_details=True,
        )  # fmt: skip


def _start(upper: Upper, background: Background) -> None:
    with html.Div(classes="line"):
        field("Name of the run: a folder to make", "run_name")
        v3.VBtn("Run", color="primary", click=background(upper.run), disabled=(f"!({IDLE})",))


def _progress(upper: Upper) -> None:
    alert("run_error", "error")
    alert("run_note", "success")
    with html.Div(v_for="(text, k) in warnings", key="k"):
        v3.VAlert("{{ text }}", type="warning", density="compact", variant="tonal", classes="mb-2")
    with html.Div(v_if=("run_title",), classes="line progress"):
        html.Strong("{{ run_title }}")
        _command("Pause", upper.pause, "status === 'running'")
        _command("Go on", upper.go_on, "status === 'paused'")
        _command("Stop", upper.stop, "status === 'running' || status === 'paused'")
        html.Span("{{ status === 'idle' ? run_end : status }}", classes="note", id="status")
    v3.VProgressLinear(
        v_if=("run_title",), model_value=("progress",), color="primary", height=6,
        indeterminate=("status === 'starting'",), rounded=True,
    )  # fmt: skip
    html.P("{{ progress_text }}", v_if=("run_title",), classes="note", id="progress")


def _command(text: str, action: Callable[[], None], shown: str) -> None:
    v3.VBtn(text, v_if=(shown,), click=action, size="small", variant="tonal")
