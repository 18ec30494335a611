"""Commands on a line: made from a function whose argument `line` takes all the options of a line together."""

from __future__ import annotations

import inspect
from copy import copy
from dataclasses import fields
from functools import partial, wraps
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from drivecomm.cli.argument_values import Command
from drivecomm.cli.line_options import WITHOUT_EFFECT, LineOptions
from drivecomm.cli.stops_from_others import StopsFromOthers
from drivecomm.link import Echo

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_line = partial(typer.Option, rich_help_panel="Line")
_plant = partial(typer.Option, rich_help_panel="Plant")

_OPTIONS: Mapping[str, Any] = {
    "port": _line(
        "--port", "-p", envvar="DRIVECOMM_PORT", help="/dev/ttyUSB0, COM3, socket://host:port, rfc2217://host:port."
    ),
    "baudrate": _line(help="Bits per second."),
    "bytesize": _line(help="Data bits, 7 or 8."),
    "parity": _line(help="N, E, O, M or S."),
    "stopbits": _line(help="1, 1.5 or 2."),
    "timeout": _line(help="Seconds to wait for a reply."),
    "attempts": _line(help="Attempts per request at most."),
    "echo": _line(help="Whether the adapter echoes what it sends; --echo alone is expect, auto detects it."),
    "rs485": _line("--rs485", help="Let the port's driver switch the transmitter."),
    "low_latency": _line(help="Let a USB adapter deliver bytes at once; by default where it can."),
    "trace": _line("--trace", help="Show every telegram, decoded, with its time."),
    "record": _line("--record", help="Record every byte sent and received: .jsonl or .pcapng."),
    "plant": _plant(
        "--plant",
        metavar="FILE",
        help="Plant file that names the drives. Default without --port: $DRIVECOMM_PLANT or plant.toml here.",
    ),
    "arm": _plant("--arm", help="Command a drive that is not armed in the plant file."),
    "json": typer.Option("--json", help="One JSON object per line."),
}
"""How each of the line options is written, and what it is for. `stop --all` is quicker without them."""

STOPPING = frozenset({"stop"})
"""What no file that is there keeps from being carried out: a recording replaces it then."""

# Modules that must be quick to load import typer for their annotations only.
_TYPER: Mapping[str, Any] = {"typer": typer}


class LineCommand(Command):
    """A command with the line options: lets `--echo` stand alone, as it did before it had a value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give a lone `--echo` its value."""
        modes = get_args(Echo)
        ends = args.index("--") if "--" in args else len(args)
        given = []
        for place, word in enumerate(args):
            given.append(word)
            if word == "--echo" and place < ends and (place + 1 == len(args) or args[place + 1] not in modes):
                given.append("expect")
        return super().parse_args(ctx, given)


def on_a_line(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the line options; it receives them together as its argument `line`.

    An option that the command has itself, such as one with room for several values, is its own alone.
    """
    hints = get_type_hints(LineOptions)
    signature = inspect.signature(command, eval_str=True, locals=_TYPER)
    own = [parameter for name, parameter in signature.parameters.items() if name != "line"]
    shared = [field for field in fields(LineOptions) if field.name in _OPTIONS.keys() - signature.parameters.keys()]
    idle = WITHOUT_EFFECT.get(command.__name__, {})
    added = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=field.default,
            annotation=Annotated[hints[field.name], _option(field.name, hidden=field.name in idle)],
        )
        for field in shared
    ]

    @wraps(command)
    def with_line(context: typer.Context, **arguments: Any) -> Any:
        given = frozenset(name for name in _OPTIONS if _is_written(context, name))
        said = {field.name: arguments.pop(field.name) for field in shared}
        line = LineOptions(**said, given=given, stops=StopsFromOthers(f"drivecomm {command.__name__}"))
        for name, why in idle.items():
            line.refuse(f"{command.__name__} {why}", name)
        if line.record is not None and command.__name__ not in STOPPING:
            from drivecomm.cli.written_files import must_be_new  # noqa: PLC0415 - for those who record

            must_be_new(line.record)
        return command(line=line, **arguments)

    context = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
    parameters = [context, *(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own), *added]
    with_line.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    with_line.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    del with_line.__wrapped__
    return with_line


def _is_written(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _option(name: str, *, hidden: bool) -> Any:
    """Return an option; a hidden one is known to be one, and not offered."""
    option = copy(_OPTIONS[name])
    option.hidden = hidden
    return option
