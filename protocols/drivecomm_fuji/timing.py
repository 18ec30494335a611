"""How long an inverter may take, by what it is asked: section 10 of the specification.

The times are those in use for the family; none of them stands on a page that was read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm_fuji.options import FujiOptions

QUICK_TIMEOUT_S = 0.1
"""For R, E, a-k, m, A, and W of S codes."""

GAP_S = 0.010
"""The least time before the host's next request: FVR-E11S manual 9-13. No manual of a later series demands it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowWrite:
    """Writes that take their time. functions: None for all others. data: None for every value but 0, or the value."""

    functions: frozenset[str] | None
    data: int | None
    needs_s: float
    timeout_option: str


SLOW_WRITES = (
    SlowWrite(functions=frozenset(["P04", "A13"]), data=None, needs_s=20.0, timeout_option="tuning_timeout_s"),
    SlowWrite(functions=frozenset(["H03"]), data=1, needs_s=5.0, timeout_option="initialise_timeout_s"),
    SlowWrite(functions=frozenset(["H03"]), data=2, needs_s=0.5, timeout_option="motor_data_timeout_s"),
    SlowWrite(functions=frozenset(["P02"]), data=None, needs_s=0.5, timeout_option="motor_data_timeout_s"),
    SlowWrite(functions=None, data=None, needs_s=0.1, timeout_option="write_timeout_s"),
)


def slow_write(function: str, data: int) -> SlowWrite | None:
    """Return what is known about writing this, None when it is done at once."""
    if function[0] == "S":
        return None
    for row in SLOW_WRITES:
        if row.functions is None or (function in row.functions and (data if row.data is None else data == row.data)):
            return row
    raise AssertionError  # pragma: no cover - the last row holds for every function


def reply_timeout(options: FujiOptions, write: SlowWrite | None) -> float | None:
    """Return how long to wait for a reply, None for the drive's own reply time."""
    if write is not None:
        timeout: float = getattr(options, write.timeout_option)
        return timeout + options.response_interval_s
    return QUICK_TIMEOUT_S + options.response_interval_s if options.response_interval_s else None
