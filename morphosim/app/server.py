"""The web server of the application."""

import asyncio
import logging
import socket
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from morphosim import _import_path
from morphosim.app.access import PARAMETER, Access, listening_host
from morphosim.app.form import SOURCE_KEYS
from morphosim.app.lower import STATE as LOWER_STATE
from morphosim.app.lower import Lower
from morphosim.app.routes import Streams, add_routes
from morphosim.app.source import NO_CODE
from morphosim.app.store import Store
from morphosim.app.upper import STATE as UPPER_STATE
from morphosim.app.upper import Upper

_log = logging.getLogger(__name__)
STATIC = Path(__file__).with_name("static")
ANYWHERE = {"0.0.0.0": "127.0.0.1", "::": "::1"}
"""Hosts that listen at all addresses of this machine, and one of these."""
LOST = """
<div class="lost">
  <h1>MorphoSim does not answer</h1>
  <p>It has been ended, or the connection is lost. What it had saved is in its folder, a run that
  went on too. This page comes back as soon as it answers here again.</p>
</div>
"""
"""What the page shows where the connection is lost."""
Tell = Callable[[str], None]


class Application:
    """The application: its state, its two halves, and its page.

    Parameters
    ----------
    store : Store
        Folder that it reads and writes.
    access : Access
        Who may ask.
    """

    def __init__(self, store: Store, access: Access) -> None:
        from trame.app import get_server

        self.server = get_server(f"morphosim-{id(self)}", client_type="vue3")
        self.store, self.access, self.streams = store, access, Streams()
        state = self.server.state
        state.update(UPPER_STATE | LOWER_STATE | {"folder": str(store.root)})
        state.update({"trame__title": "MorphoSim", "trame__template_error": LOST})
        self.lower = Lower(state, store, self.streams)
        self.upper = Upper(state, store, self.streams, self.lower.run_ended)
        self._tasks: set[asyncio.Task[None]] = set()
        self._connect()
        self._build()

    def serve(self, host: str, port: int, tell: Tell, open_browser: bool = False) -> None:
        """Serve until Ctrl-C; a run that goes on then is saved.

        Parameters
        ----------
        host : name or address to listen at
        port : number; 0 takes a free one
        tell : told the page's address
        open_browser : whether to open it there
        """
        self._told, self._open, self._host = tell, open_browser, host
        with _no_arguments(), _no_alarm():
            try:
                self.server.start(
                    port=port, host=host, open_browser=False, show_connection_info=False,
                    timeout=0, disable_logging=True,
                )  # fmt: skip
            finally:
                self.upper.close()
                self.lower.close()

    def address(self, host: str = "") -> str:
        """Address of the page as seen from `host`, with the token if there is one."""
        host = host or self._host
        host = f"[{host}]" if ":" in host else host
        token = f"?{PARAMETER}={self.access.token}" if self.access.token else ""
        return f"http://{host}:{self.server.port}/{token}"

    def _connect(self) -> None:
        controller = self.server.controller
        controller.on_server_bind.add(self._bound)
        controller.on_server_ready.add(self._ready)
        self.server.state.change(*SOURCE_KEYS)(_call(self.upper.form.compare))
        self.server.state.change("cells")(_call(self.upper.form.show_attraction))
        self.server.trigger("viewer_said")(self._viewer_said)
        self.server.trigger("uploaded")(self._uploaded)

    def _bound(self, web_server: Any) -> None:
        """Guard the server before it answers anything."""
        if web_server.host != self._host:
            message = f"the server would listen at {web_server.host!r}, not {self._host!r}; unset "
            message += "TRAME_ARGS and TRAME_DEFAULT_HOST"
            raise ValueError(message)
        add_routes(web_server.app, self.access, self.store, self.streams)

    def _ready(self, **_: Any) -> None:
        everywhere = self._host in ANYWHERE  # which is no address that a browser could open
        self._told(self.address(socket.gethostname() if everywhere else ""))
        if self._open:
            import webbrowser

            webbrowser.open(self.address(ANYWHERE.get(self._host, "")))
        self._start(self.upper.start)
        self._start(self.lower.start)

    def background(self, work: Callable[[], Awaitable[None]]) -> Callable[..., None]:
        """Handler that starts `work` and returns at once: the page's next message is heard."""

        def handle(*_: Any) -> None:
            self._start(work)

        return handle

    def _start(self, work: Callable[[], Awaitable[None]]) -> None:
        task = asyncio.ensure_future(_logged(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _viewer_said(self, viewer: str, kind: str, value: Any) -> None:
        if viewer == "run":
            self._start(lambda: self.lower.viewer_said(kind, value))

    def _uploaded(self, field: str, well: bool, text: str) -> None:
        with self.server.state as state:
            state[field if well else "form_error"] = text
        self._start(lambda: self.upper.form.uploaded(field if well else ""))

    def _build(self) -> None:
        from trame.ui.vuetify3 import VAppLayout
        from trame.widgets import html
        from trame.widgets import vuetify3 as v3

        from morphosim.app import lower_page, upper_page

        self.server.enable_module(
            {
                "serve": {"__morphosim": str(STATIC)},
                "scripts": ["__morphosim/bridge.js"],
                "styles": ["__morphosim/app.css"],
            }
        )
        with VAppLayout(self.server), v3.VMain(), v3.VContainer(fluid=True, classes="page"):
            with html.Header():
                html.H1("MorphoSim")
                html.Span("{{ folder }}", classes="note")
            upper_page.build(self.upper, self.background)
            v3.VDivider(classes="my-4")
            lower_page.build(self.lower, self.upper, self.background)


def _call(action: Callable[[], None]) -> Callable[..., None]:
    """Handler of changes of the state that does not look at it."""
    return lambda **_: action()


async def _logged(work: Callable[[], Awaitable[None]]) -> None:
    try:
        await work()
    except Exception:
        _log.exception("the application failed at something")
        raise


@contextmanager
def _no_arguments() -> Iterator[None]:
    """Hide the command line's arguments, which trame would read as its own."""
    kept = sys.argv
    sys.argv = kept[:1]
    try:
        yield
    finally:
        sys.argv = kept


@contextmanager
def _no_alarm() -> Iterator[None]:
    """Answer requests that are no HTTP without a traceback for each."""
    from aiohttp.http import HttpProcessingError

    def of_ours(record: logging.LogRecord) -> bool:
        return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))

    logger = logging.getLogger("aiohttp.server")
    logger.addFilter(of_ours)
    try:
        yield
    finally:
        logger.removeFilter(of_ours)


def serve(
    folder: Path,
    host: str,
    port: int,
    tell: Tell,
    open_browser: bool = False,
    token: bool = False,
    allow_code: bool = False,
) -> None:
    """Serve the application of a folder until Ctrl-C.

    Parameters
    ----------
    folder : path
        It reads and writes nothing outside of it.
    host : str
        Where to listen. Anything but loopback takes a token, which is made anew and is part of the
        address.
    port : int
        0 takes a free one.
    tell : callable
        Told the page's address.
    open_browser : bool
        Whether to open it.
    token : bool
        Whether to ask for a token in any case.
    allow_code : bool
        Whether scene files, which may come from the browser, may name code that is imported.

    Raises
    ------
    FileNotFoundError
        The folder does not exist.
    ValueError, OSError
        There is no such host or port, or another process listens there.
    """
    store = Store(Path(folder))
    host = listening_host(host, port)
    with nullcontext() if allow_code else _import_path.refusing(NO_CODE):
        Application(store, Access.of_host(host, token)).serve(host, port, tell, open_browser)
