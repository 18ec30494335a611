"""What happens on the line as records of the standard library's logging: for `open_bus(trace=log_events())`.

Telegrams and echo are told at DEBUG, notes about the line at INFO, and what should not be there (damage, strays, noise)
at WARNING. Each record has these attributes besides its text:

    drive       the drive that the exchange is with, such as "vabus:1"
    what        sent, received, echo, stray, damaged, noise or note
    data        the bytes, in hexadecimal
    fields      the decoded telegram by the names of its fields, None where there is none
    detail      why, for strays and damage; the text of a note
    line_time   the time on the line's clock, in seconds; its beginning means nothing
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from drivecomm.protocol import fields_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link.link import TraceEvent, What

LOGGER_NAME = "drivecomm.line"

_LEVELS: dict[What, int] = {
    "sent": logging.DEBUG,
    "received": logging.DEBUG,
    "echo": logging.DEBUG,
    "note": logging.INFO,
    "stray": logging.WARNING,
    "damaged": logging.WARNING,
    "noise": logging.WARNING,
}


def log_events(logger: logging.Logger | None = None) -> Callable[[TraceEvent], None]:
    """Return a trace function that writes to this logger, "drivecomm.line" if absent.

    Levels are looked up for each event, so they may be changed while the bus is open.
    """
    chosen = logging.getLogger(LOGGER_NAME) if logger is None else logger

    def log(event: TraceEvent) -> None:
        level = _LEVELS[event.what]
        # Decoding the fields for nobody would cost more than the telegram itself.
        if chosen.isEnabledFor(level):
            chosen.log(level, "%s", _text(event), extra=_attributes(event))

    return log


def _text(event: TraceEvent) -> str:
    kind = "" if event.message is None else event.message.kind
    detail = f"({event.detail})" if event.detail else ""
    return " ".join(part for part in (event.drive, event.what, event.data.hex(" ").upper(), kind, detail) if part)


def _attributes(event: TraceEvent) -> dict[str, object]:
    return {
        "drive": event.drive,
        "what": event.what,
        "data": event.data.hex(" ").upper(),
        "fields": None if event.message is None else fields_of(event.message),
        "detail": event.detail,
        "line_time": round(event.time, 6),
    }
