"""Upper half of the page: its widgets."""

from collections.abc import Callable

from trame.widgets import html
from trame.widgets import vuetify3 as v3

from morphosim.app import form_page
from morphosim.app.routes import VIEWER
from morphosim.app.upper import Upper
from morphosim.app.widgets import Background, alert, alerts, field

SHOWN = (
    f"cells.length && ({form_page.FITS} || (reading && ['built-in', 'file'].includes(source_kind)))"
)
"""Whether the form is shown: what it holds is of the chosen tab, or about to be."""
IDLE = "status === 'idle'"


def build(upper: Upper, background: Background) -> None:
    """Widgets of the upper half."""
    with v3.VRow(classes="half"):
        with v3.VCol(cols=12, lg=5):
            html.H2("Simulate")
            form_page.source(upper.form, background)
            with html.Div(
                v_if=(SHOWN,), classes=("{ stale: reading }",), inert=("reading",),
                __properties=["inert"],
            ):  # fmt: skip
                form_page.values(upper.form)
                _start(upper, background)
                form_page.save(upper.form, background)
        with v3.VCol(cols=12, lg=7):
            _progress(upper)
            html.Iframe(id="live-viewer", src=VIEWER.lstrip("/"), title="Live view of the run")


def _start(upper: Upper, background: Background) -> None:
    with html.Div(classes="line"):
        field("Name of the run: a folder to make", "run_name")
        v3.VBtn("Run", color="primary", click=background(upper.run), disabled=(f"!({IDLE})",))


def _progress(upper: Upper) -> None:
    alert("run_error", "error")
    alert("run_note", "success")
    _concerns(upper, "warnings", "warning")
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
    _concerns(upper, "remarks", "info")


def _concerns(upper: Upper, name: str, kind: str) -> None:
    """What was told of a run, with a button that takes the preset without such a concern."""
    with alerts(name, kind, "each.text"):
        v3.VBtn(
            "Take {{ cure }}", v_if=("each.cured",), click=upper.form.take_cure, size="small",
            variant="outlined", classes="mt-1",
        )  # fmt: skip


def _command(text: str, action: Callable[[], None], shown: str) -> None:
    v3.VBtn(text, v_if=(shown,), click=action, size="small", variant="tonal")
