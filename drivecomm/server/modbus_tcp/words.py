"""Values as register words: two for a number, one each for quality and age. Only current values are shown."""

from __future__ import annotations

import struct
from enum import IntEnum
from math import isfinite
from typing import TYPE_CHECKING

from drivecomm.protocol import DriveState as Motion

if TYPE_CHECKING:
    from drivecomm.protocol import DriveStatus, Value
    from drivecomm.server import CurrentValue, DriveSnapshot
    from drivecomm.server.modbus_tcp.layout import NumberType

_EXACT = 2**24
"""Largest number up to which float32 holds every whole number."""
_WORD = 0xFFFF
NO_AGE = 0xFFFF
"""Age word of a missing value."""
_NOT_TOLD = 0xFFFF
NOTHING: dict[NumberType, tuple[int, int]] = {"float32": (0x7FC0, 0), "uint32": (_WORD, _WORD)}
"""Words in place of a value that is not current: NaN, or all bits set for a type without NaN."""


class Quality(IntEnum):
    """Trustworthiness of a value, numbered as in OPC. Below 64 there is no value."""

    BAD = 0
    """The drive does not provide the value, or reports that it does not exist."""
    UNAVAILABLE = 4
    """The plant file does not poll the value, or the register cannot hold it, such as a text."""
    STALE = 24
    """The last value is too old, or the drive has fallen silent."""
    WAITING = 32
    """The value is polled, but has not arrived yet."""
    UNCERTAIN = 64
    """The value is current but in doubt, for example because of another master on the line."""
    GOOD = 192

    @property
    def is_current(self) -> bool:
        """Whether there is a current value."""
        return self >= Quality.UNCERTAIN


_OF = {"good": Quality.GOOD, "uncertain": Quality.UNCERTAIN, "stale": Quality.STALE, "bad": Quality.BAD}


def quality_of(value: CurrentValue | None, now_s: float, *, polled: bool) -> Quality:
    """Return the present quality of a value. polled: whether the plant file polls it."""
    if value is None:
        return Quality.WAITING if polled else Quality.UNAVAILABLE
    return _OF[value.quality_at(now_s)]


def age_word(value: CurrentValue | None, now_s: float) -> int:
    """Return the age of a value in 0.1 s, at most 65534; 65535 without a value."""
    if value is None or value.source_s is None:
        return NO_AGE
    return max(0, min(NO_AGE - 1, int((now_s - value.source_s) * 10)))


def number_words(value: Value, number: NumberType) -> tuple[int, int] | None:
    """Return a value as two words, the higher first; None if they cannot hold it."""
    if isinstance(value, str):
        return None
    if number == "uint32":
        # All bits set mean that there is no value.
        fits = 0 <= value < 2**32 - 1 and value == int(value)
        return (int(value) >> 16, int(value) & _WORD) if fits else None
    try:
        packed = struct.pack(">f", float(value))
    except OverflowError:
        return None
    told = struct.unpack(">f", packed)[0]
    is_rounded = isinstance(value, int) and abs(value) > _EXACT and told != value
    if is_rounded or not isfinite(told):
        return None
    high, low = struct.unpack(">HH", packed)
    return high, low


def state_word(state: DriveSnapshot, status: DriveStatus | None) -> int:
    """Return the state word of a drive. status: None if there is no current status."""
    bits = [False] * 10 if status is None else _status_bits(status)
    bits[1] = state.reachability == "answers"
    bits += [bool(state.kept), state.lease is not None, state.standing_stop is not None]
    return sum(bit << place for place, bit in enumerate(bits))


def _status_bits(status: DriveStatus) -> list[bool]:
    return [
        True,
        False,
        status.state is Motion.READY,
        status.running,
        bool(status.at_reference),
        status.fault,
        bool(status.warning),
        bool(status.reverse),
        status.state is Motion.STOPPING,
        bool(status.remote),
    ]


def fault_word(status: DriveStatus | None) -> int:
    """Return the number of the active fault; 0 without a fault, 65535 if the number is unknown."""
    if status is None:
        return _NOT_TOLD
    if not status.fault:
        return 0
    code = status.fault_code
    return code if code is not None and 0 <= code < _NOT_TOLD else _NOT_TOLD
