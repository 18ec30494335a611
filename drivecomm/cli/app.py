"""The application: its commands, each from the module of its group."""

from __future__ import annotations

from typing import Annotated

import typer

from drivecomm.cli import drives, telegrams
from drivecomm.cli.cohabit import cohabit
from drivecomm.cli.conformance import conformance
from drivecomm.cli.demo import demo
from drivecomm.cli.doctor import doctor
from drivecomm.cli.forecast import forecast
from drivecomm.cli.help_text import let_flow
from drivecomm.cli.line_options import LineCommand, on_a_line
from drivecomm.cli.models import models
from drivecomm.cli.models_grow import grow
from drivecomm.cli.parameter_sets import backup, compare, restore
from drivecomm.cli.plant import plant
from drivecomm.cli.plot import plot
from drivecomm.cli.poll import poll
from drivecomm.cli.replay import replay
from drivecomm.cli.scan import scan
from drivecomm.cli.simulate import simulate
from drivecomm.cli.sniff.command import sniff
from drivecomm.cli.stats import stats
from drivecomm.cli.status import status
from drivecomm.cli.vectors import check, from_capture
from drivecomm.cli.wait import wait
from drivecomm.cli.watch import watch
from drivecomm.version import __version__

app = typer.Typer(
    name="drivecomm",
    help="Variable-frequency drives of different makers over serial lines: scan, read, write, command, simulate.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
vectors = typer.Typer(name="vectors", help="Test vectors: the packaged ones and a stranger's.", no_args_is_help=True)
vectors.command("check")(check)
vectors.command("from-capture")(from_capture)

_NEGATIVE_NUMBERS = {"ignore_unknown_options": True}


def _version(value: bool) -> None:
    if value:
        typer.echo(f"drivecomm {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Variable-frequency drives of different makers over serial lines."""


app.command(cls=LineCommand)(on_a_line(demo))
app.command()(telegrams.protocols)
app.command(context_settings=_NEGATIVE_NUMBERS)(telegrams.decode)
app.command()(telegrams.encode)
app.command(cls=LineCommand)(on_a_line(scan))
app.command(cls=LineCommand)(on_a_line(doctor))
app.command(cls=LineCommand)(on_a_line(stats))
app.command(cls=LineCommand)(on_a_line(drives.read))
app.command(cls=LineCommand, context_settings=_NEGATIVE_NUMBERS)(on_a_line(drives.write))
app.command(cls=LineCommand)(on_a_line(status))
app.command(cls=LineCommand)(on_a_line(drives.start))
app.command(cls=LineCommand)(on_a_line(drives.stop))
app.command(cls=LineCommand)(on_a_line(drives.reset))
app.command(cls=LineCommand, context_settings=_NEGATIVE_NUMBERS)(on_a_line(drives.reference))
app.command(cls=LineCommand)(on_a_line(wait))
app.command(cls=LineCommand)(on_a_line(drives.call))
app.command(cls=LineCommand)(on_a_line(backup))
app.command(cls=LineCommand)(on_a_line(compare))
app.command(cls=LineCommand)(on_a_line(restore))
app.command(cls=LineCommand)(on_a_line(poll))
app.command(cls=LineCommand)(on_a_line(watch))
app.command()(plot)
app.command(cls=LineCommand)(on_a_line(forecast))
app.command()(cohabit)
app.command()(simulate)
app.command(cls=LineCommand)(on_a_line(replay))
app.command()(sniff)
app.add_typer(plant)
models.command("grow", cls=LineCommand)(on_a_line(grow))
app.add_typer(models)
app.command()(conformance)
app.add_typer(vectors)
let_flow(app)
