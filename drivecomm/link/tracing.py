"""Trace functions for `open_bus(trace=...)`, and trace events as text and as data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.protocol import fields_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from drivecomm.link.peer import TraceEvent
    from drivecomm.protocol import Message

ARROWS = {
    "sent": "->",
    "request": "->",
    "master": "->",
    "received": "<-",
    "reply": "<-",
    "drive": "<-",
    "echo": "=>",
    "stray": "<?",
    "damaged": "<!",
    "noise": "<~",
    "note": "  ",
}
"""Signs for trace events, for the direction of a telegram, and for the sender of bytes."""


def combine_traces(*traces: Callable[[TraceEvent], None] | None) -> Callable[[TraceEvent], None] | None:
    """Return a trace function that calls all of these in order; None if all of them are None."""
    listening = [trace for trace in traces if trace is not None]
    if len(listening) < 2:
        return listening[0] if listening else None

    def tell(event: TraceEvent) -> None:
        for trace in listening:
            trace(event)

    return tell


def trace_line(event: TraceEvent) -> str:
    """Return a trace event on one line: time, direction, drive, bytes, meaning."""
    meaning = fields_text(event.message) if event.message else ""
    remark = f"{event.what}: {event.detail}" if event.detail else "" if event.message else event.what
    parts = (event.drive, hex_text(event.data), meaning)
    return line_text(event.time, ARROWS[event.what], *parts, remarks=[remark] if remark else ())


def trace_data(event: TraceEvent) -> dict[str, Any]:
    """Return a trace event as data: time, drive, bytes in hexadecimal, fields, detail."""
    return {
        "time": round(event.time, 6),
        "drive": event.drive,
        "data": hex_text(event.data),
        "fields": fields_of(event.message) if event.message else None,
        "detail": event.detail,
    }


def line_text(time_s: float, arrow: str, *parts: str, remarks: Iterable[str] = ()) -> str:
    """Return one line of text about bytes on the wire; empty parts are left out, remarks stand in brackets."""
    shown = [f"{time_s:12.4f}", arrow, *parts, *[f"[{remark}]" for remark in remarks]]
    return "  ".join([part for part in shown if part])


def fields_text(message: Message) -> str:
    """Return a telegram's kind and fields on one line."""
    fields = fields_of(message)
    return " ".join([str(fields.pop("kind")), *[f"{name}={_short(name, value)}" for name, value in fields.items()]])


def hex_text(data: bytes) -> str:
    """Return bytes in readable hexadecimal: `04 41 30`."""
    return data.hex(" ").upper()


def _short(name: str, value: object) -> str:
    if isinstance(value, str):
        return repr(value)
    if ("word" in name or name == "ind") and isinstance(value, int) and not isinstance(value, bool):
        return f"0x{value:04X}"
    return str(value)
