"""How long an inverter may take, by what it is asked: section 10 of the specification; tables.toml has the slow writes.

The times are those in use for the family; none of them stands on a page that was read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from drivecomm_fuji.tables import TABLES

if TYPE_CHECKING:
    from drivecomm_fuji.options import FujiOptions

QUICK_TIMEOUT_S = 0.1
"""For R, E, a-k, m, A, and W of S codes."""

GAP_S = 0.010
"""The least time before the host's next request: FVR-E11S manual 9-13. No manual of a later series demands it."""


class SlowWrite(NamedTuple):
    """A write that takes its time. timeout: the option that says how long to wait for its reply."""

    needs_s: float
    timeout: str


def slow_write(function: str, data: int) -> SlowWrite | None:
    """Return what is known about writing this, None when it is done at once."""
    if function[0] == "S":
        return None
    rows = TABLES["slow_writes"]
    known = rows.get(f"{function}={data}") or (rows.get(function) if data else None) or rows["others"]
    return SlowWrite(float(known["needs_s"]), known["timeout"])


def reply_timeout(options: FujiOptions, write: SlowWrite | None) -> float | None:
    """Return how long to wait for a reply, None for the drive's own reply time."""
    if write is not None:
        timeout: float = getattr(options, write.timeout)
        return timeout + options.response_interval_s
    return QUICK_TIMEOUT_S + options.response_interval_s if options.response_interval_s else None
