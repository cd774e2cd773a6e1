"""Command that serves the application: `app`."""

from pathlib import Path
from typing import Annotated

import typer

from morphosim.cli.app import command, say


@command("app")
def application(
    folder: Annotated[
        Path, typer.Option(help="the application reads and writes nothing outside of it")
    ] = Path(),
    host: Annotated[
        str, typer.Option(help="where to listen; anything but this machine takes a token")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0 takes a free one")] = 0,
    open_browser: Annotated[
        bool, typer.Option("--open/--no-open", help="open it in the browser")
    ] = True,
    token: Annotated[
        bool, typer.Option("--token", help="ask for a token in any case; for shared machines")
    ] = False,
    allow_code: Annotated[
        bool, typer.Option("--allow-code", help="import the code that scene files name")
    ] = False,
) -> None:
    """Simulate and look at runs in the browser."""
    from morphosim._extras import need

    need("trame_vuetify", "the application", "app")
    from morphosim.app.server import serve

    def tell(address: str) -> None:
        say(f"MorphoSim: {address}")

    serve(folder, host, port, tell, open_browser, token, allow_code)
