"""Commands on a line: they get the options of a line, and receive them together as the argument `line`."""

from __future__ import annotations

from copy import copy
from typing import Any, get_args

import click

from drivecomm.cli.commands import CliCommand
from drivecomm.cli.line_options import WITHOUT_EFFECT, LineArguments
from drivecomm.cli.stops_from_others import StopsFromOthers
from drivecomm.cli.values import FILE, NUMBER, WHOLE_NUMBER, OneOf
from drivecomm.link import Echo


class LineSetting(click.Option):
    """Option in the section "Line" of the help."""

    section = "Line"


class PlantSetting(click.Option):
    """Option in the section "Plant" of the help."""

    section = "Plant"


_OPTIONS = (
    LineSetting(
        ["--port", "-p"],
        metavar="PORT",
        envvar="DRIVECOMM_PORT",
        show_envvar=True,
        help="/dev/ttyUSB0, COM3, socket://host:port, rfc2217://host:port, modbus-tcp://host.",
    ),
    LineSetting(["--baudrate"], type=WHOLE_NUMBER, help="Bits per second."),
    LineSetting(["--bytesize"], type=WHOLE_NUMBER, help="Data bits, 7 or 8."),
    LineSetting(["--parity"], metavar="LETTER", help="N, E, O, M or S."),
    LineSetting(["--stopbits"], type=NUMBER, help="1, 1.5 or 2."),
    LineSetting(["--timeout"], type=NUMBER, metavar="SECONDS", help="Seconds to wait for a reply."),
    LineSetting(["--attempts"], type=WHOLE_NUMBER, help="Maximum number of attempts per request."),
    LineSetting(
        ["--echo"],
        type=OneOf(get_args(Echo)),
        default="off",
        help="Whether the adapter echoes what it sends; --echo alone is expect, auto detects it.",
    ),
    LineSetting(["--rs485"], is_flag=True, help="Let the port's driver switch the transmitter."),
    LineSetting(
        ["--low-latency/--no-low-latency"],
        default=None,
        help="Set a USB adapter to low latency. Default: if it can.",
    ),
    LineSetting(["--trace"], is_flag=True, help="Show every telegram, decoded, with its time."),
    LineSetting(["--record"], type=FILE, help="Record every byte sent and received: .jsonl or .pcapng."),
    PlantSetting(
        ["--plant"],
        type=FILE,
        help="Plant file that names the drives. Default without --port: $DRIVECOMM_PLANT or plant.toml here.",
    ),
    PlantSetting(["--arm"], is_flag=True, help="Command a drive that is not armed in the plant file."),
    click.Option(["--json"], is_flag=True, help="One JSON object per line."),
)
"""Click options of a line. `stop --all` does without them, because that is faster."""

STOPPING = frozenset({"stop"})
"""Commands that run even if the recording file already exists; the recording then replaces the file."""


class LineCommand(CliCommand):
    """Command with the line options, except those that it defines itself, such as an option for several values."""

    def __init__(self, name: str, *, params: list[click.Parameter], **settings: Any) -> None:
        own = {parameter.name for parameter in params}
        self._idle = WITHOUT_EFFECT.get(name, {})
        self._shared = [_hidden(each) if each.name in self._idle else each for each in _OPTIONS if each.name not in own]
        super().__init__(name, params=[*params, *self._shared], **settings)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Add the value of a bare `--echo`, because click would take the next word for the value."""
        modes = get_args(Echo)
        ends = args.index("--") if "--" in args else len(args)
        given = []
        for place, word in enumerate(args):
            given.append(word)
            if word == "--echo" and place < ends and (place + 1 == len(args) or args[place + 1] not in modes):
                given.append("expect")
        return super().parse_args(ctx, given)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command with its line. Raises UsageError for an option without effect."""
        said = {each.name: ctx.params.pop(each.name) for each in self._shared}
        given = frozenset(each.name for each in _OPTIONS if _is_written(ctx, each.name))
        line = LineArguments(**said, given=given, stops=StopsFromOthers(f"drivecomm {self.name}"))
        for name, why in self._idle.items():
            line.refuse(f"{self.name} {why}", name)
        if line.record is not None and self.name not in STOPPING:
            from drivecomm.cli.output_files import must_be_new

            must_be_new(line.record)
        ctx.params["line"] = line
        return super().invoke(ctx)


def _hidden(option: click.Option) -> click.Option:
    """Return an option that is accepted but not shown in the help."""
    idle = copy(option)
    idle.hidden = True
    return idle


def _is_written(ctx: click.Context, name: str) -> bool:
    source = ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
