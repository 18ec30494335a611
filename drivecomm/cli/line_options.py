"""The options that every command on a line has, declared once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import wraps
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from drivecomm.bus import open_bus
from drivecomm.cli.output import sentence, trace_as_json, trace_to_standard_error
from drivecomm.errors import DriveCommError, UsageError

if TYPE_CHECKING:
    from drivecomm.bus import Bus
    from drivecomm.link import TraceEvent

_LINE = "Line"


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
    echo: Annotated[bool, typer.Option("--echo", rich_help_panel=_LINE, help="The adapter echoes.")] = False
    trace: Annotated[
        bool, typer.Option("--trace", rich_help_panel=_LINE, help="Show every telegram, decoded, with its time.")
    ] = False
    json: Annotated[bool, typer.Option("--json", help="One JSON object per line.")] = False

    @contextmanager
    def bus(self, listener: Callable[[TraceEvent], None] | None = None) -> Iterator[Bus]:
        """Open the bus for the time of the block; errors then name the port. listener: also told the trace."""
        if self.port is None:
            raise UsageError("no port: give --port, or set DRIVECOMM_PORT")
        try:
            with open_bus(
                self.port,
                baudrate=self.baudrate,
                bytesize=self.bytesize,
                parity=self.parity.upper() if self.parity else None,  # type: ignore[arg-type]
                stopbits=self.stopbits,
                reply_timeout_s=self.timeout,
                attempts=self.attempts,
                echo=self.echo,
                trace=self._tracer(listener),
            ) as bus:
                yield bus
        except DriveCommError as error:
            error.args = (sentence(str(error), where=self.port), *error.args[1:])
            raise

    def _tracer(self, listener: Callable[[TraceEvent], None] | None) -> Callable[[TraceEvent], None] | None:
        if not self.trace:
            return listener
        show = trace_as_json if self.json else trace_to_standard_error
        if listener is None:
            return show

        def both(event: TraceEvent) -> None:
            show(event)
            listener(event)

        return both


def on_a_line(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the line options; it receives them together as its argument `line`."""
    hints = get_type_hints(LineOptions, include_extras=True)
    added = [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
        )
        for field in fields(LineOptions)
    ]
    signature = inspect.signature(command, eval_str=True)
    own = [parameter for name, parameter in signature.parameters.items() if name != "line"]

    @wraps(command)
    def with_line(**arguments: Any) -> Any:
        line = LineOptions(**{field.name: arguments.pop(field.name) for field in fields(LineOptions)})
        return command(line=line, **arguments)

    parameters = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own] + added
    with_line.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    with_line.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    del with_line.__wrapped__
    return with_line
