"""The plant commands: controlling virtual drives that `drivecomm simulate` serves, from outside."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivecomm.cli.options import Json
from drivecomm.cli.output import emit, say, tell
from drivecomm.errors import UsageError
from drivecomm.tomlfile import read_text_file
from drivecomm.virtual import ControlClient

_Control = Annotated[
    str,
    typer.Option(
        "--control",
        "-c",
        metavar="PLACE",
        envvar="DRIVECOMM_CONTROL",
        help="The control socket that drivecomm simulate printed: HOST:PORT or unix:PATH.",
    ),
]
_Drive = Annotated[str, typer.Argument(metavar="DRIVE", help="Its name in the plant.")]


def trip(
    drive: _Drive,
    code: Annotated[int, typer.Argument(metavar="CODE", help="The drive's own fault code.")],
    control: _Control = "",
    json: Json = False,
) -> int:
    """Make a drive trip."""
    order = {**_order(control, "trip", drive=drive, code=code), "drive_name": drive}
    return _done(order, f"{drive} has tripped with code {code}", json)


def power(
    drive: _Drive,
    state: Annotated[str, typer.Argument(metavar="STATE", help="off, on, or factory: on with factory settings.")],
    control: _Control = "",
    json: Json = False,
) -> int:
    """Switch a drive's power off or on."""
    order = {**_order(control, "power", drive=drive, state=state), "drive_name": drive}
    return _done(order, f"power of {drive}: {state}", json)


def set_value(
    drive: _Drive,
    parameter: Annotated[str, typer.Argument(metavar="PARAMETER", help="Its address, or its name in the model.")],
    value: Annotated[str, typer.Argument(metavar="VALUE", help="The raw value: a whole number, or text.")],
    control: _Control = "",
    json: Json = False,
) -> int:
    """Set a parameter of a drive, as if at its keypad."""
    raw = int(value) if value.removeprefix("-").isdecimal() and value.isascii() else value
    answer = _order(control, "set", drive=drive, parameter=parameter, value=raw)
    return _done({**answer, "drive_name": drive}, f"{drive} {parameter} is {answer['value']}", json)


def inject(
    line: Annotated[str, typer.Argument(metavar="LINE", help="Its name in the plant.")],
    data: Annotated[str, typer.Argument(metavar="BYTES", help='In hexadecimal digits: "04 41 FF".')],
    control: _Control = "",
    json: Json = False,
) -> int:
    """Inject foreign bytes into a line."""
    return _done(_order(control, "inject", line=line, data=data), f"injected on {line}", json)


def fault(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A file with the keys of one [[fault]] of a plant file.")
    ],
    control: _Control = "",
    json: Json = False,
) -> int:
    """Add a fault to the script of a running plant."""
    text = read_text_file(file, "a fault")
    return _done(_order(control, "fault", text=text), "added", json)


def show(
    drive: Annotated[str, typer.Argument(metavar="[DRIVE]", help="What this drive holds; without, all drives.")] = "",
    parameter: Annotated[
        list[str] | None, typer.Argument(metavar="[PARAMETER]...", help="Parameters of the drive, by address.")
    ] = None,
    control: _Control = "",
    json: Json = False,
) -> int:
    """Show the states of all drives, or parameter values of one."""
    if drive:
        answer = _order(control, "show", drive=drive, parameters=parameter or [])
        lines = [f"{drive} {name} is {value}" for name, value in answer["values"].items()]
    else:
        answer = _order(control, "show")
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


def _order(control: str, order: str, **fields: Any) -> dict[str, Any]:
    if not control:
        raise UsageError("no control socket; give --control with the address that drivecomm simulate printed")
    with ControlClient(control) as connection:
        return connection.order(order, **fields)


def _done(answer: dict[str, Any], text: str, json: bool) -> int:
    tell(text, as_json=json, done=text, **answer)
    return 0
