"""Options of a line: declared once, and shown in the signature of every function that takes them."""

from __future__ import annotations

from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

from drivecomm.bus.stored_writes import ALLOWED
from drivecomm.errors import UsageError, suggestion

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from drivecomm.capture import Record
    from drivecomm.link import Echo, TraceEvent
    from drivecomm.protocol import Parity


F = TypeVar("F", bound="Callable[..., Any]")

_DEFAULTS = {"echo": "off", "guard_s": 0.005, "rs485": False, "stored_writes_per_hour": ALLOWED}
"""Defaults that are not None.

They repeat those of the classes that use them, because these classes are loaded only when a line is opened.
"""


class LineOptions(TypedDict, total=False):
    """Options of `open_bus`, `open_bus_async` and `open_plant`; None means not given.

    Line settings and timing apply to all drives of the line, instead of their protocols' defaults.

    baudrate, bytesize, parity, stopbits: the line settings. reply_timeout_s: time from the last character of a request
    to the first of the reply. attempts: maximum number of times that a request is sent, if repeating it is safe.
    deadline_s: maximum time of one whole call. gap_s, gap_characters: the longest pause inside a telegram, in seconds
    and in character times. turnaround_s, turnaround_characters: time from the end of a reply to the next request.
    tuned_turnaround_s: a shorter turnaround that was measured, used until errors rise. request_interval_s: time from
    one request to a drive to the next request to the same drive. broadcast_pause_s: time from the end of a broadcast to
    the next request. late_s: time after the reply timeout in which a late reply may still come. least_turnaround_s,
    least_reply_timeout_s: lower limits for tuning.

    echo: whether the adapter returns what it sends: "off", "expect" or True, "auto" to find out. guard_s: quiet time
    after a change of line settings. rs485: whether the driver of the port switches the transmitter. low_latency:
    whether a USB adapter passes bytes on immediately; None does so if the adapter supports it. trace: called with each
    `TraceEvent` of the line. record: a file that gets every byte sent and received, .jsonl or .pcapng, or an object
    with `add(piece)`. stored_writes_per_hour: maximum number of times that one parameter of a drive may be written to
    EEPROM within an hour.
    """

    baudrate: int | None
    bytesize: int | None
    parity: Parity | None
    stopbits: float | None
    reply_timeout_s: float | None
    attempts: int | None
    deadline_s: float | None
    gap_s: float | None
    gap_characters: float | None
    turnaround_s: float | None
    turnaround_characters: float | None
    tuned_turnaround_s: float | None
    request_interval_s: float | None
    broadcast_pause_s: float | None
    late_s: float | None
    least_turnaround_s: float | None
    least_reply_timeout_s: float | None
    echo: bool | Echo
    guard_s: float
    rs485: bool
    low_latency: bool | None
    trace: Callable[[TraceEvent], None] | None
    record: Record | None
    stored_writes_per_hour: int


def check_line_options(given: Iterable[str], also: Sequence[str] = ()) -> None:
    """Raise UsageError for a name that is not an option of a line. also: further options of the called function."""
    known = (*also, *LineOptions.__annotations__)
    if unknown := sorted(set(given) - set(known)):
        raise UsageError(f"unknown line setting {unknown[0]!r}; {suggestion(unknown[0], known, 'use one of')}")


def lists_line_options(opens: F) -> F:
    """Show each line option in the signature of a function that takes them, for help() and completion."""
    shown = signature(opens)
    listed = [each for each in shown.parameters.values() if each.kind is not each.VAR_KEYWORD]
    for name, kind in LineOptions.__annotations__.items():
        default = _DEFAULTS.get(name)
        listed.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind.__forward_arg__))
    opens.__signature__ = shown.replace(parameters=listed)  # type: ignore[attr-defined]
    return opens
