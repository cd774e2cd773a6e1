"""Lower half of the page: its widgets."""

from trame.widgets import html
from trame.widgets import vuetify3 as v3

from morphosim.app.lower import Lower
from morphosim.app.routes import VIEWER
from morphosim.app.upper import Upper
from morphosim.app.widgets import Background, alert, choice


def build(lower: Lower, upper: Upper, background: Background) -> None:
    """Widgets of the lower half."""
    with v3.VRow(classes="half"):
        with v3.VCol(cols=12, lg=5):
            _choose(lower, upper, background)
            with html.Div(v_if=("opened",)):
                _cell(lower, background)
                _export(lower, background)
                html.H3("Contacts at t = {{ times[run_index] }}")
                html.Img(src=("matrix",), alt="Contact areas of all pairs of cells", id="matrix")
        with v3.VCol(cols=12, lg=7):
            html.Iframe(id="run-viewer", src=VIEWER.lstrip("/"), title="View of the opened run")
            with html.Div(v_if=("history",)):
                html.H3("{{ run_cell }} over time")
                html.Img(src=("history",), alt="Volume, surface, sphericity and contacts over time")


def _choose(lower: Lower, upper: Upper, background: Background) -> None:
    html.H2("Look")
    with html.Div(classes="line"):
        choice("Run", "look_name", "runs", update_menu=lower.list_runs)
        v3.VBtn("Open", color="primary", click=background(lower.open), disabled=("!look_name",))
    v3.VProgressLinear(v_if=("opening",), indeterminate=True, color="primary", height=3)
    alert("look_error", "error")
    with html.Div(v_if=("opened",), classes="line"):
        html.Strong("{{ opened }}")
        html.Span("{{ about }}", classes="note")
        v3.VBtn(
            "Resume", v_if=("can_resume",), size="small", variant="tonal",
            disabled=("status !== 'idle'",), click=background(lambda: upper.resume(lower.opened)),
        )  # fmt: skip


def _cell(lower: Lower, background: Background) -> None:
    choice(
        "Cell; or click one in the view", "run_cell", "run_cells", clearable=True,
        update_modelValue=background(lower.choose_cell),
    )  # fmt: skip
    figures = html.Table(v_if=("figures.length",), classes="figures")
    with figures, html.Tbody(), html.Tr(v_for="row in figures", key="row.name"):
        html.Th("{{ row.name }}")
        html.Td("{{ row.text }}")
    html.P(
        "{{ run_cell }} is not there at this time.",
        v_if=("run_cell && !figures.length",), classes="note",
    )  # fmt: skip


def _export(lower: Lower, background: Background) -> None:
    html.H3("Export")
    with html.Div(classes="line"):
        choice("Colours by", "colour_by", "colours")
        v3.VCheckbox(v_model=("mirror",), label="mirror z", density="compact", hide_details=True)
        _make("Picture", background(lower.make_picture))
        _make("Film", background(lower.make_film))
    with html.Div(classes="line"):
        choice("Data as", "format", "formats")
        _make("Write", background(lower.make_data))
    with html.Div(v_if=("making",), classes="line"):
        v3.VProgressCircular(indeterminate=True, size=18, width=2, color="primary")
        html.Span("{{ making }}", classes="note")
        v3.VBtn("Break off", size="small", variant="text", click=lower.break_off)
    with html.P(v_for="file in made", key="file.name", classes="note"):
        html.Span("{{ file.what }}: ")
        html.A("{{ file.name }}", href=("file.link",), download=True)


def _make(text: str, click: object) -> None:
    v3.VBtn(text, variant="tonal", disabled=("!!making",), click=click)
