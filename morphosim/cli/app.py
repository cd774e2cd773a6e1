"""The application that commands belong to, and the codes it exits with."""

import typer

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, add_completion=False)
INPUT_ERROR, RUN_ERROR, INTERRUPTED = 2, 1, 130
