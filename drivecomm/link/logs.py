"""Line events as records of the standard library's logging.

Telegrams and echo are logged at DEBUG, notes about the line at INFO, and errors on the line (damage, strays, noise) at
WARNING. Each record has these attributes besides its text:

    drive       the drive of the exchange, such as "vabus:1"
    what        sent, received, echo, stray, damaged, noise or note
    data        the bytes, in hexadecimal
    fields      the fields of the decoded telegram, by name; None if nothing was decoded
    detail      the reason for strays and damage; the text of a note
    line_time   the time on the line's clock, in seconds from an arbitrary zero
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from drivecomm.link.tracing import hex_text, trace_data

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link.peer import TraceEvent, What

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
    """Return a trace function that writes to this logger, or to "drivecomm.line" if none is given.

    Levels are looked up for each event, so they may be changed while the bus is open.
    """
    chosen = logging.getLogger(LOGGER_NAME) if logger is None else logger

    def log(event: TraceEvent) -> None:
        level = _LEVELS[event.what]
        # Decoding the fields for a disabled level would cost more than the telegram itself.
        if chosen.isEnabledFor(level):
            kind = "" if event.message is None else event.message.kind
            parts = (event.drive, event.what, hex_text(event.data), kind, f"({event.detail})" if event.detail else "")
            data = trace_data(event)
            chosen.log(
                level,
                "%s",
                " ".join(part for part in parts if part),
                extra={"what": event.what, "line_time": data.pop("time"), **data},
            )

    return log
