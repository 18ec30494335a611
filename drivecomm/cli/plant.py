"""Commands `plant ...`: control of the virtual drives that `drivecomm simulate` serves, from another process."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.commands import NEGATIVE_NUMBERS, CliCommand
from drivecomm.cli.output import emit, say, tell
from drivecomm.cli.values import FILE, WHOLE_NUMBER
from drivecomm.errors import UsageError
from drivecomm.tomlfile import read_text_file
from drivecomm.virtual import ControlClient

if TYPE_CHECKING:
    from pathlib import Path

control_option = click.option(
    "--control",
    "-c",
    show_default=False,
    metavar="PLACE",
    default="",
    envvar="DRIVECOMM_CONTROL",
    show_envvar=True,
    help="The control socket that drivecomm simulate printed: HOST:PORT or unix:PATH.",
)
_drive_argument = click.argument("drive", help="Its name in the plant.")


@click.command(cls=CliCommand)
@_drive_argument
@click.argument("code", type=WHOLE_NUMBER, help="The drive's own fault code.")
@control_option
@options.json
def trip(*, drive: str, code: int, control: str, json: bool) -> int:
    """Make a drive trip."""
    order = {**given_order(control, "trip", drive=drive, code=code), "drive_name": drive}
    return _done(order, f"{drive} has tripped with code {code}", json)


@click.command(cls=CliCommand)
@_drive_argument
@click.argument("state", help="off, on, or factory: on with factory settings.")
@control_option
@options.json
def power(*, drive: str, state: str, control: str, json: bool) -> int:
    """Switch a drive's power off or on."""
    order = {**given_order(control, "power", drive=drive, state=state), "drive_name": drive}
    return _done(order, f"power of {drive}: {state}", json)


@click.command("set", cls=CliCommand, context_settings=NEGATIVE_NUMBERS)
@_drive_argument
@click.argument("parameter", help="Its address, or its name in the model.")
@click.argument("value", help="The raw value: a whole number, or text.")
@control_option
@options.json
def set_value(*, drive: str, parameter: str, value: str, control: str, json: bool) -> int:
    """Set a parameter of a drive, as if at its keypad."""
    raw = int(value) if value.removeprefix("-").isdecimal() and value.isascii() else value
    answer = given_order(control, "set", drive=drive, parameter=parameter, value=raw)
    return _done({**answer, "drive_name": drive}, f"{drive} {parameter} is {answer['value']}", json)


@click.command(cls=CliCommand)
@click.argument("line", help="Its name in the plant.")
@click.argument("data", metavar="BYTES", help='In hexadecimal digits: "04 41 FF".')
@control_option
@options.json
def inject(*, line: str, data: str, control: str, json: bool) -> int:
    """Inject foreign bytes into a line."""
    return _done(given_order(control, "inject", line=line, data=data), f"injected on {line}", json)


@click.command(cls=CliCommand)
@click.argument("file", type=FILE, help="A file with the keys of one [[fault]] of a plant file.")
@control_option
@options.json
def fault(*, file: Path, control: str, json: bool) -> int:
    """Add a fault to the script of a running plant."""
    text = read_text_file(file, "a fault")
    return _done(given_order(control, "fault", text=text), "added", json)


@click.command(cls=CliCommand)
@click.argument("drive", default="", help="Show the parameters of this drive. Default: the states of all drives.")
@click.argument("parameter", nargs=-1, help="Parameters of the drive, by address.")
@control_option
@options.json
def show(*, drive: str, parameter: tuple[str, ...], control: str, json: bool) -> int:
    """Show the states of all drives, or parameter values of one."""
    if drive:
        answer = given_order(control, "show", drive=drive, parameters=list(parameter))
        lines = [f"{drive} {name} is {value}" for name, value in answer["values"].items()]
    else:
        answer = given_order(control, "show")
        lines = [_state_line(state) for state in answer["drives"]]
    if json:
        for state in answer.get("drives", ()):
            state["drive_name"] = state["name"]
        emit(**answer, **({"drive_name": drive} if drive else {}))
    else:
        for line in lines:
            say(line)
    return 0


def _state_line(state: dict[str, Any]) -> str:
    if not state["powered"]:
        how = "without power"
    elif state["fault"]:
        how = f"tripped, code {state['fault']}"
    else:
        how = f"running at {state['output_hz']:.2f} Hz" if state["running"] else "stopped"
    return f"{state['name']}  {state['drive']} on {state['line']}  {how}"


def given_order(control: str, order: str, **fields: Any) -> dict[str, Any]:
    """Send an order to a running plant and return its response. Raises UsageError without a control socket."""
    if not control:
        raise UsageError("no control socket; give --control with the address that drivecomm simulate printed")
    with ControlClient(control) as connection:
        return connection.order(order, **fields)


def _done(answer: dict[str, Any], text: str, json: bool) -> int:
    tell(text, as_json=json, done=text, **answer)
    return 0
