"""The records in a history: values, events, commands, and the fault logs of drives.

No I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import timedelta
from decimal import Decimal
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.plant.value_log import BEGINNING, LogRow

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.line import ResultQuality
    from drivecomm.protocol import Value
    from drivecomm.server import Event

_LARGEST_WHOLE = 2**63 - 1


class StoredQuantity(NamedTuple):
    """One quantity of one drive, in one unit.

    address: address of the parameter, empty if only failed readings are known.
    """

    drive: str
    name: str
    address: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PastValue:
    """A value of a drive at a time, or the absence of one.

    row: number that increases through the whole history, whatever the clock does. time_s: when the reply arrived; for
    quality stale and bad, when the value was found missing. value: exact, with all its decimals; None if absent.
    source_s: when a stale value was read. note: a remark on the value, or why it is absent.
    """

    row: int
    time_s: float
    drive: str
    name: str
    address: str = ""
    value: Value | None = None
    unit: str = ""
    raw: int | str | None = None
    text: str = ""
    quality: ResultQuality = "good"
    note: str = ""
    source_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PastEvent:
    """An event with its row. Rows increase through the whole history, event numbers only within one run."""

    row: int
    event: Event


@dataclass(frozen=True, slots=True, kw_only=True)
class PastCommand:
    """A command with its outcome. time_s, done_s: when it was received, and answered. text: why it was not done."""

    row: int
    time_s: float
    done_s: float
    id: str
    who: str
    door: str
    drive: str
    verb: str
    arguments: Mapping[str, Any] = field(default_factory=dict, hash=False)
    outcome: str
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultLogEntry:
    """An entry of a drive's fault log. place: 1 for the newest. time_s: when the log was read."""

    row: int
    time_s: float
    drive: str
    place: int
    address: str
    value: str
    text: str = ""


def log_row(value: PastValue) -> LogRow:
    """Return the row of a value log for this value."""
    return LogRow(
        time=BEGINNING + timedelta(milliseconds=round(value.time_s * 1000)),
        drive=value.drive,
        name=value.name,
        address=value.address,
        value="" if value.value is None else str(value.value),
        unit=value.unit,
        text=value.text,
        raw="" if value.raw is None else str(value.raw),
        quality=value.quality,
        note=value.note,
    )


def whole_and_exponent(value: Value) -> tuple[int | str, int | None]:
    """Return a number as an integer and its power of ten: 12.50 is 1250 and -2; a text as it is, and None.

    So numbers stay exact, with their trailing zeros, and need little space in the file. A number that does not fit this
    form becomes a text.
    """
    if isinstance(value, str):
        return value, None
    if isinstance(value, int):
        whole, exponent = int(value), 0
    else:
        text = str(value)
        before, _, behind = text.partition(".")
        try:
            whole, exponent = int(before + behind), -len(behind)
        except ValueError:
            # A number such as 1E+3, or NaN and infinity.
            sign, digits, power = value.as_tuple()
            if not isinstance(power, int):
                return text, None
            whole, exponent = int(("-" if sign else "") + "".join(map(str, digits))), power
    return (whole, exponent) if -_LARGEST_WHOLE <= whole <= _LARGEST_WHOLE else (str(value), None)


def value_of(whole: int | str | None, exponent: int | None) -> Value | None:
    """Return the value for the result of `whole_and_exponent`; an integer with the power 0 stays an int."""
    if whole is None or isinstance(whole, str) or not exponent:
        return whole
    return Decimal(whole).scaleb(exponent)
