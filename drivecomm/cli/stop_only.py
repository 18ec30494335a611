"""The application with nothing but `stop` in it: the other commands need not be loaded before a motor is stopped."""

from __future__ import annotations

import typer

from drivecomm.cli.drives import stop
from drivecomm.cli.line_options import LineCommand, on_a_line

app = typer.Typer(
    name="drivecomm",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def common() -> None:
    """Keep the command's name, which a single one would lose."""


app.command(cls=LineCommand)(on_a_line(stop))
