"""Small parts that both halves of the page are made of."""

from collections.abc import Awaitable, Callable
from typing import Any

from trame.widgets import html
from trame.widgets import vuetify3 as v3

Background = Callable[[Callable[[], Awaitable[None]]], Callable[..., None]]
"""Makes of a coroutine function a handler that starts it and returns at once."""


def field(label: str, name: str, **options: Any) -> None:
    """Text field of a value of the state."""
    v3.VTextField(
        v_model=(name,), label=label, density="compact", variant="outlined", hide_details=True,
        **options,
    )  # fmt: skip


KEEPS = '@keydown.delete.capture="$event.target.value || $event.stopImmediatePropagation()"'
"""Of a list: keys that delete change what is searched for, but do not empty the choice."""


def choice(label: str, name: str, items: str, clearable: bool = False, **options: Any) -> None:
    """Choice of a value of the state out of `items`, with search; of none, if it is `clearable`.

    The chosen one is shown by a slot, and so also when it is another page that chooses.
    """
    shown = v3.VAutocomplete(
        v_model=(name,), items=(items,), label=label, density="compact", variant="outlined",
        hide_details=True, persistent_placeholder=True, clearable=clearable,
        raw_attrs=[] if clearable else [KEEPS], **options,
    )  # fmt: skip
    with shown, html.Template(v_slot_selection="{ item }"):
        html.Span("{{ item.title ?? item }}", classes="v-autocomplete__selection-text")


def plain_input(**options: Any) -> None:
    """<input> with attributes that trame does not know by itself."""
    known = [("aria_label", "aria-label"), ("data_uploads", "data-uploads"), "multiple"]
    html.Input(__properties=known, **options)


def entry(place: str, within: str, **options: Any) -> None:
    """<input> of a value within a list of the state, such as "cells[j].name" within "cells".

    What is typed is kept at once: whatever else of the page is drawn anew meanwhile leaves it.
    """
    plain_input(
        value=(place,), input=f"{place} = $event.target.value", change=f"flushState('{within}')",
        **options,
    )  # fmt: skip


def alert(name: str, kind: str) -> None:
    """Text of the state, shown where it is not empty."""
    v3.VAlert(
        f"{{{{ {name} }}}}", v_if=(name,), type=kind, density="compact", classes="my-2", id=name,
        variant="tonal",
    )  # fmt: skip


def alerts(name: str, kind: str, text: str) -> v3.VAlert:
    """Alert for `each` item of a list of the state; `text` says what of it is shown."""
    with html.Div(v_for=f"(each, k) in {name}", key="k"):
        shown = v3.VAlert(type=kind, density="compact", variant="tonal", classes=f"mb-2 {name}")
        with shown:
            html.Div(f"{{{{ {text} }}}}")
    return shown


def upload(name: str, accept: str, several: bool = False) -> None:
    """Button that sends a file to the folder and chooses it for a value of the state.

    It may take `several`: the first, by ending, and others that it names.
    """
    with html.Label(classes="upload"):
        html.Span("Upload")
        plain_input(type="file", accept=accept, data_uploads=name, multiple=several)
