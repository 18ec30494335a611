"""The options that every command on a line has, declared once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, fields, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand

from drivecomm import bus as buses
from drivecomm.cli.drive_names import known_plant, parse_drive, placed
from drivecomm.cli.output import sentence, trace_as_json, trace_to_standard_error
from drivecomm.echo import Echo
from drivecomm.errors import DriveCommError, FileFormatError, UsageError
from drivecomm.tracing import tell_all

if TYPE_CHECKING:
    from drivecomm.bus import Bus
    from drivecomm.cli.drive_names import DriveName
    from drivecomm.link import TraceEvent
    from drivecomm.plant import PlantLine, PlantLinkLoss
    from drivecomm.runners.port import Port

_LINE = "Line"
_PLANT = "Plant"


@dataclass(frozen=True, slots=True, kw_only=True)
class LineOptions:
    """Port, line settings and output of one call; absent settings are the protocol's own."""

    port: Annotated[
        str | None,
        typer.Option(
            "--port",
            "-p",
            envvar="DRIVECOMM_PORT",
            rich_help_panel=_LINE,
            help="/dev/ttyUSB0, COM3, socket://host:port, rfc2217://host:port.",
        ),
    ] = None
    baudrate: Annotated[int | None, typer.Option(rich_help_panel=_LINE, help="Bits per second.")] = None
    bytesize: Annotated[int | None, typer.Option(rich_help_panel=_LINE, help="Data bits, 7 or 8.")] = None
    parity: Annotated[str | None, typer.Option(rich_help_panel=_LINE, help="N, E, O, M or S.")] = None
    stopbits: Annotated[float | None, typer.Option(rich_help_panel=_LINE, help="1, 1.5 or 2.")] = None
    timeout: Annotated[float | None, typer.Option(rich_help_panel=_LINE, help="Reply time in seconds.")] = None
    attempts: Annotated[int | None, typer.Option(rich_help_panel=_LINE, help="How often to ask at most.")] = None
    echo: Annotated[
        Echo,
        typer.Option(
            rich_help_panel=_LINE,
            help="Whether the adapter hands back what it sends; --echo alone is expect, auto sees by itself.",
        ),
    ] = "off"
    rs485: Annotated[
        bool, typer.Option("--rs485", rich_help_panel=_LINE, help="The port's driver switches the transmitter.")
    ] = False
    low_latency: Annotated[
        bool | None,
        typer.Option(rich_help_panel=_LINE, help="A USB adapter hands bytes over at once; where it can, if absent."),
    ] = None
    trace: Annotated[
        bool, typer.Option("--trace", rich_help_panel=_LINE, help="Show every telegram, decoded, with its time.")
    ] = False
    record: Annotated[
        Path | None,
        typer.Option(
            "--record", rich_help_panel=_LINE, help="A file for every byte sent and received: .jsonl or .pcapng."
        ),
    ] = None
    plant: Annotated[
        Path | None,
        typer.Option(
            "--plant",
            metavar="FILE",
            rich_help_panel=_PLANT,
            help="Plant file in which drives have names; also $DRIVECOMM_PLANT, or plant.toml here, without --port.",
        ),
    ] = None
    arm: Annotated[
        bool, typer.Option("--arm", rich_help_panel=_PLANT, help="Command a drive that the plant does not arm.")
    ] = False
    json: Annotated[bool, typer.Option("--json", help="One JSON object per line.")] = False

    def reaching(self, text: str) -> tuple[LineOptions, DriveName]:
        """Return the line of a drive and the drive, which is named as PROTOCOL:ADDRESS or as the plant names it.

        What the plant says of a line goes before the port that is given, and what is given before its settings; its
        drives are read-only unless it arms them, or --arm is given. Raises UsageError.
        """
        place = placed(text, self.plant, port_given=self.port is not None, arm=self.arm)
        if place is None:
            return self, parse_drive(text)
        port = self.port_of(place.line, place.file)
        echo: Echo = "expect" if place.line.echo and self.echo == "off" else self.echo
        settings = {key: value for key, value in place.line.settings.items() if getattr(self, key) is None}
        return replace(self, port=port, echo=echo, **settings), place.name

    def link_loss_of(self, text: str) -> PlantLinkLoss | None:
        """Return what the plant says that a drive's motor shall do when its master falls silent, None for nothing."""
        place = placed(text, self.plant, port_given=self.port is not None, arm=self.arm)
        return place.drive.link_loss if place else None

    def port_of(self, line: PlantLine, file: str) -> str:
        """Return the port of a line of the plant, the one that is given where the plant names none."""
        port = line.reached_at or self.port
        if not port:
            raise UsageError(f'{file}: line {line.name} has no port; write port = "/dev/ttyUSB0" there, or give --port')
        return port

    def at(self, port: str) -> LineOptions:
        """Return the options for another port; where the plant says that its line has an echo, there is one."""
        known = known_plant(self.plant, port_given=self.port is not None)
        lines = known.plant.lines if known else ()
        echoes = self.echo == "off" and any(line.echo for line in lines if line.reached_at == port)
        return replace(self, port=port, echo="expect" if echoes else self.echo)

    @contextmanager
    def bus(self, listener: Callable[[TraceEvent], None] | None = None) -> Iterator[Bus]:
        """Open the bus for the time of the block; errors then name the port. listener: also told the trace."""
        with self._recorded(), self._named_in_errors(), self._open_bus(self.named_port, listener) as bus:
            yield bus

    @contextmanager
    def opened(self) -> Iterator[Port]:
        """Open the port alone for the time of the block; errors then name it."""
        if self.record is not None:
            raise UsageError("this command uses the port itself and records nothing; leave --record out")
        with self._named_in_errors():
            port = buses.port_opener(self.named_port, rs485=self.rs485, low_latency=self.low_latency)()
            try:
                yield port
            finally:
                port.close()

    @property
    def named_port(self) -> str:
        """The port that is given, or that of the plant's only line. Raises UsageError when there is none."""
        if self.port is not None:
            return self.port
        known = known_plant(self.plant, port_given=False)
        if known is None:
            raise UsageError("no port: give --port, or set DRIVECOMM_PORT")
        if len(known.plant.lines) > 1:
            ports = ", ".join(f"{line.reached_at or 'no port'} ({line.name})" for line in known.plant.lines)
            raise UsageError(f"no port: give --port; {known.file} has {ports}")
        return self.port_of(known.plant.lines[0], known.file)

    @property
    def facts(self) -> dict[str, Any]:
        """The line facts for all drives, as keywords of `open_bus`; None for those that are not given."""
        return {
            "baudrate": self.baudrate,
            "bytesize": self.bytesize,
            "parity": self.parity.upper() if self.parity else None,
            "stopbits": self.stopbits,
            "reply_timeout_s": self.timeout,
            "attempts": self.attempts,
        }

    @property
    def shown_trace(self) -> Callable[[TraceEvent], None] | None:
        """What shows the trace, where it is wanted."""
        if not self.trace:
            return None
        return trace_as_json if self.json else trace_to_standard_error

    def _recorded(self) -> AbstractContextManager[None]:
        if self.record is None:
            return nullcontext()
        # What records is for those who do.
        from drivecomm.cli.recording_option import recorded  # noqa: PLC0415

        return recorded(self.record, as_json=self.json)

    @contextmanager
    def _named_in_errors(self) -> Iterator[None]:
        where = self.named_port
        try:
            yield
        except FileFormatError:
            # It names its file, and no port is at fault.
            raise
        except DriveCommError as error:
            error.args = (sentence(str(error), where=where), *error.args[1:])
            raise

    @property
    def opening(self) -> dict[str, Any]:
        """All keywords of `open_bus`."""
        return {
            "echo": self.echo,
            "rs485": self.rs485,
            "low_latency": self.low_latency,
            "trace": self.shown_trace,
            "record": self.record,
            **self.facts,
        }

    def _open_bus(self, port: str, listener: Callable[[TraceEvent], None] | None) -> Bus:
        return buses.open_bus(port, **{**self.opening, "trace": tell_all(self.shown_trace, listener)})


class LineCommand(TyperCommand):
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
    hints = get_type_hints(LineOptions, include_extras=True)
    signature = inspect.signature(command, eval_str=True)
    own = [parameter for name, parameter in signature.parameters.items() if name != "line"]
    shared = [field for field in fields(LineOptions) if field.name not in signature.parameters]
    added = [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
        )
        for field in shared
    ]

    @wraps(command)
    def with_line(**arguments: Any) -> Any:
        line = LineOptions(**{field.name: arguments.pop(field.name) for field in shared})
        return command(line=line, **arguments)

    parameters = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own] + added
    with_line.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    with_line.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    del with_line.__wrapped__
    return with_line
