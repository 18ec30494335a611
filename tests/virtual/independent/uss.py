"""A virtual drive and a master of USS, written from the published description alone, like those of `drives`.

They import nothing of the project. Telegrams have a variable parameter area and two process words, which are 0: bit 10
of the control word decides, and is off, so nothing moves. The drive accepts a telegram only after a silence, and is not
always ready: it then sends no result (AK 0), or repeats its previous reply.

Sources: USS specification E20125-D0001-S302-A1-7600 (09.94), A-3 to A-9, C-11 to C-24; MICROMASTER 420 Reference Manual
p. 44-49; SINAMICS CU240S Operating Instructions 11/2006 p. 8-31.
"""

from __future__ import annotations

import struct
from decimal import Decimal
from typing import TYPE_CHECKING

from masters import DamagedError, NoAnswerError, RefusedError, Settings

if TYPE_CHECKING:
    from collections.abc import Sequence
    from random import Random

    from masters import Line

_PROCESS = bytes(4)
_READY = b"\x0b\x31\x00\x00"
_BITS = {(1082, 0): 32, (1120, 0): 32, (1121, 0): 32, (2000, 0): 32, (2014, 0): 16, (2014, 1): 16}
_ARRAYS = frozenset({2014})


def _with_check(content: bytes) -> bytes:
    telegram = bytes([2, len(content) + 1]) + content
    check = 0
    for byte in telegram:
        check ^= byte
    return telegram + bytes([check])


def _sound(telegram: bytes) -> bool:
    return _with_check(telegram[2:-1]) == telegram


def _area(identifier: int, number: int, index: int, words: bytes) -> bytes:
    # From 2000 on, the index word holds the page of the number; its lowest bit is bit 15.
    page, rest = divmod(number, 2000)
    return (identifier << 12 | rest).to_bytes(2, "big") + bytes([0x80 * page, index]) + words


class UssDrive:
    """MICROMASTER 4. hesitates: share of the tasks to which it is not ready to reply immediately."""

    character_s = 11 / 38400
    delay_s = 0.003
    gap_s = 0.003

    def __init__(self, address: int, random: Random, hesitates: float = 0.03) -> None:
        self.address = address
        self.values = dict.fromkeys(_BITS, 0x41200000) | {(2014, 0): 100, (2014, 1): 200}
        self.hesitated = 0
        self._random, self._hesitates = random, hesitates
        self._before = bytes(6)
        self._heard = b""

    def holds(self, parameter: str) -> Decimal:
        """Return the value: floats in hundredths, times in milliseconds."""
        number, _, index = parameter.rstrip("]").partition("[")
        value = self.values[int(number), int(index or 0)]
        if int(number) in _ARRAYS:
            return Decimal(value)
        (real,) = struct.unpack(">f", value.to_bytes(4, "big"))
        return Decimal(round(100 * real))

    def silence(self) -> None:
        """Discard an unfinished telegram; a telegram begins only after a silence."""
        self._heard = b""

    def hear(self, data: bytes) -> bytes:
        """Answer a sound telegram for this address; ignore anything else."""
        self._heard += data
        telegram = self._heard
        if telegram[:1] != b"\x02" or len(telegram) < 4 or len(telegram) != telegram[1] + 2:
            return b""
        self._heard = b""
        if not _sound(telegram) or telegram[2] != self.address or len(telegram) not in (14, 16):
            return b""
        if self._random.random() < self._hesitates:
            self.hesitated += 1
            area = self._random.choice((bytes(6), self._before))
        else:
            area = self._before = self._answered(telegram[3:-5])
        return _with_check(bytes([self.address]) + area + _READY)

    def _answered(self, area: bytes) -> bytes:
        task, number = area[0] >> 4, int.from_bytes(area[:2], "big") & 0x7FF
        number += 2000 * (area[2] >> 7)
        place = number, area[3]
        if task == 0:
            return bytes(6)
        if place not in _BITS:
            return self._no(place, 3 if number in _ARRAYS else 0)
        bits, array = _BITS[place], number in _ARRAYS
        if task in (6, 7, 8, 11, 12) and not array:
            return self._no(place, 4)
        if task in (2, 3, 7, 8):
            if (task in (3, 8)) is not (bits == 32) or len(area) < 4 + bits // 8:
                return self._no(place, 5)
            self.values[place] = int.from_bytes(area[4 : 4 + bits // 8], "big")
        elif task not in (1, 6):
            return self._no(place, 106)
        words = self.values[place].to_bytes(bits // 8, "big")
        return _area((4 if array else 1) + (bits == 32), number, area[3], words)

    @staticmethod
    def _no(place: tuple[int, int], code: int) -> bytes:
        return _area(7, *place, code.to_bytes(2, "big"))


class UssMaster:
    """MICROMASTER 4: a task is sent until its own reply comes, which must name the same parameter and element."""

    _settings = Settings(9600, 8, "E", 1)
    _pause_s = 0.004
    _reply_s = 0.1
    _attempts = 5

    def __init__(self, line: Line, address: int) -> None:
        self.name = f"uss {address}"
        # Quarters, which a float holds exactly.
        quarters = [Decimal(number) / 4 for number in range(4, 2600, 7)]
        self.writable: dict[str, Sequence[Decimal]] = {
            "1082": quarters,
            "1120": quarters,
            "2014[0]": [Decimal(number) for number in range(0, 9000, 13)],
            "2014[1]": [Decimal(number) for number in range(0, 9000, 17)],
        }
        self.unknown, self.unknown_code = "3999", 0
        self.repeats = 0
        self._line = line
        self._address = bytes([address])

    def read(self, parameter: str) -> Decimal:
        """Read the value, or the element of an array."""
        number, _, index = parameter.rstrip("]").partition("[")
        return self._task(6 if index else 1, int(number), int(index or 0), b"\x00\x00")

    def write(self, parameter: str, value: Decimal) -> None:
        """Write to RAM; the reply holds the new value of the parameter."""
        number, _, index = parameter.rstrip("]").partition("[")
        words = struct.pack(">H", int(value)) if index else struct.pack(">f", float(value))
        for _ in range(self._attempts):
            if self._task(7 if index else 3, int(number), int(index or 0), words) == value:
                return
            # The reply belongs to an earlier task for the same parameter.
            self.repeats += 1
        raise NoAnswerError(f"{self.name}: {parameter} does not take {value}")

    def _task(self, task: int, number: int, index: int, words: bytes) -> Decimal:
        area = _area(task, number, index, words)
        request = _with_check(self._address + area + _PROCESS)
        for _ in range(self._attempts):
            try:
                return self._value(task, area, self._ask(request)[3:-5])
            except DamagedError:
                self.repeats += 1
                self._line.fall_silent()
        raise NoAnswerError(f"{self.name}: no answer to {request.hex(' ')}")

    def _ask(self, request: bytes) -> bytes:
        times = {"pause_s": self._pause_s, "reply_s": self._reply_s}
        reply = self._line.ask(request, self._settings, missing=self._missing, **times)
        if not _sound(reply):
            raise DamagedError("wrong check")
        if reply[2:3] != self._address:
            raise DamagedError("another drive answers")
        return reply

    @staticmethod
    def _missing(came: bytes) -> int:
        if len(came) < 2:
            return 2 - len(came)
        if came[0] != 2 or came[1] not in (12, 14):
            raise DamagedError("no head of a reply")
        return max(0, came[1] + 2 - len(came))

    @staticmethod
    def _value(task: int, asked: bytes, area: bytes) -> Decimal:
        identifier = area[0] >> 4
        if area[0] & 7 != asked[0] & 7 or area[1:4] != asked[1:4]:
            raise DamagedError("about another parameter, or no reply yet")
        if identifier == 7:
            raise RefusedError(int.from_bytes(area[4:6], "big"))
        if identifier == (4 if task in (6, 7) else 1) and task != 3:
            return Decimal(int.from_bytes(area[4:6], "big"))
        if identifier == 2 and task in (1, 3) and len(area) == 8:
            (real,) = struct.unpack(">f", area[4:8])
            return Decimal(str(real))
        raise DamagedError(f"reply {identifier} to task {task}")
