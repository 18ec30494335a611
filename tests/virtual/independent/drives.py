"""Virtual drives of four protocols, from published descriptions alone, and a line for them; see also `uss`.

These drives import nothing of the project. A drive parses what it receives and answers its own requests; a line is a
pseudo-terminal or a TCP port in real time, with faults: silence, damage, and late replies.

Sources: short description of VABus, sections 4 to 9, and Agile VABus manual p. 25-41; Danfoss FC 101 Design Guide
MG18C502 p. 82 and VLT 5000 Design Guide MG.52.B2.02 p. 85-99; VLT Series 3500 manual p. 85-92; FVR-E11S manual p. 9-13
to 9-20.
"""

from __future__ import annotations

import os
import select
import socket
import threading
import time
import tty
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, Protocol, Self

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from random import Random
    from types import TracebackType


class Drive(Protocol):
    """Interface of a drive to its line.

    character_s: duration of a character on the wire. delay_s: time before a reply. gap_s: a silence of this length ends
    any unfinished telegram.
    """

    character_s: float
    delay_s: float
    gap_s: float

    def hear(self, data: bytes) -> bytes:
        """Receive bytes of the line; return the reply, empty if there is none."""
        ...

    def silence(self) -> None:
        """Handle a silence of the length of the gap."""
        ...

    def holds(self, parameter: str) -> Decimal:
        """Return the value that a master must read."""
        ...


def _exclusive_or(data: bytes) -> int:
    check = 0
    for byte in data:
        check ^= byte
    return check


class _Ear:
    """Received bytes that are not parsed yet.

    A telegram begins with a start character, and its head gives its length.
    """

    def __init__(self, start: int) -> None:
        self._start = start
        self._heard = b""

    def hear(self, data: bytes) -> None:
        self._heard += data

    def forget(self) -> None:
        self._heard = b""

    def telegrams(self, length_of: _Length) -> Iterator[tuple[bytes, bool]]:
        """Yield each whole telegram, and whether bytes follow it; bytes that form no telegram lose only their start."""
        while True:
            at = self._heard.find(self._start)
            self._heard = self._heard[at:] if at >= 0 else b""
            if not self._heard:
                return
            length = length_of(self._heard)
            if length == 0:
                self._heard = self._heard[1:]
            elif length > len(self._heard):
                return
            else:
                telegram, self._heard = self._heard[:length], self._heard[length:]
                yield telegram, bool(self._heard)


class _Length(Protocol):
    def __call__(self, heard: bytes) -> int:
        """Return the length of the telegram with this head, as far as it is known; 0 if it is not a telegram."""
        ...


_NUMERAL = frozenset(b"0123456789")
_HEXADECIMAL = frozenset(b"0123456789ABCDEF")


class VabusDrive:
    """Bonfiglioli Vectron.

    Parameters have four data sets; after an error, writes are refused until 11 has been read.
    """

    character_s = 10 / 19200
    delay_s = 0.01
    gap_s = 0.05
    _digits = {"480": 8, "481": 8, "520": 4, "372": 4}  # noqa: RUF012
    _signed = frozenset({"480", "481", "520"})

    def __init__(self, node: int) -> None:
        self.address = node
        self.values: dict[str, list[int]] = {name: [number] * 4 for number, name in enumerate(self._digits, 100)}
        self.error = 0
        self._ear = _Ear(0x04)

    def holds(self, parameter: str) -> Decimal:
        """Return the value of data set 0."""
        return Decimal(self.values[parameter][0])

    def silence(self) -> None:
        """Discard an unfinished telegram."""
        self._ear.forget()

    def hear(self, data: bytes) -> bytes:
        """Answer the last request if it is for this node and no bytes follow it."""
        self._ear.hear(data)
        answer = b""
        for telegram, more in self._ear.telegrams(self._length):
            answer = self._answered(telegram) if telegram[1] == 0x40 + self.address else b""
            answer = b"" if more else answer
        return answer

    @staticmethod
    def _length(heard: bytes) -> int:
        if len(heard) < 3:
            # Each EOT begins a new telegram.
            return 0 if heard[1:2] == b"\x04" else 3
        if not 0x41 <= heard[1] <= 0x60 or max(heard) > 0x7F:
            return 0
        if heard[2] != 0x02:
            if len(heard) < 8:
                return 8
            return 8 if heard[7] == 0x05 else 0
        if len(heard) < 10:
            return 10
        if not _NUMERAL.issuperset(heard[8:10]) or heard[8:10] == b"00":
            return 0
        return 12 + int(heard[8:10])

    def _answered(self, telegram: bytes) -> bytes:
        if len(telegram) == 8:
            return self._enquired(telegram)
        text, check = telegram[3:-1], telegram[-1]
        if text[-1] != 0x03:
            return b""
        if _exclusive_or(text) != check:
            return self._no(12)
        return self._selected(text)

    def _enquired(self, telegram: bytes) -> bytes:
        system, dataset, name = telegram[2:3], telegram[3:4], telegram[4:7].decode("latin-1")
        if system != b"0" or dataset not in (b"0", b"1", b"2", b"3", b"4"):
            return self._no(2)
        if name == "011":
            value, self.error = b"%04X" % self.error, 0
            return self._block(telegram[2:7], value)
        if name not in self.values:
            return self._no(11)
        sets = self.values[name]
        if dataset == b"0" and len(set(sets)) > 1:
            return self._no(9)
        digits = self._digits[name]
        return self._block(telegram[2:7], b"%0*X" % (digits, sets[max(0, int(dataset) - 1)] % 16**digits))

    def _selected(self, text: bytes) -> bytes:
        if self.error:
            return bytes([0x40 + self.address, 0x15])
        system, dataset, name, data = text[:1], text[1:2], text[2:5].decode("latin-1"), text[7:-1]
        if system != b"0" or not _NUMERAL.issuperset(dataset):
            return self._no(2)
        if name not in self.values:
            return self._no(11)
        if len(data) != self._digits[name]:
            return self._no(14)
        if not _HEXADECIMAL.issuperset(data):
            return self._no(13)
        value = int(data, 16)
        if name in self._signed and value >= 16 ** len(data) // 2:
            value -= 16 ** len(data)
        if abs(value) > 99999:
            return self._no(1)
        chosen = int(dataset) % 5
        for number in range(4):
            if chosen in (0, number + 1):
                self.values[name][number] = value
        return bytes([0x40 + self.address, 0x06])

    def _block(self, head: bytes, value: bytes) -> bytes:
        text = head + b"%02d" % len(value) + value + b"\x03"
        return bytes([0x40 + self.address, 0x02]) + text + bytes([_exclusive_or(text)])

    def _no(self, code: int) -> bytes:
        self.error = code
        return bytes([0x40 + self.address, 0x15])


class DanfossDrive:
    """Danfoss FC, addresses of one byte above 80H. It stands still: bit 10 of the control word decides, and is off."""

    character_s = 11 / 9600
    delay_s = 0.004
    gap_s = 0.004
    _bits = {(341, 0): 32, (342, 0): 32, (310, 0): 16, (310, 2): 16}  # noqa: RUF012
    _names = {"3-41": (341, 0), "3-42": (342, 0), "3-10[0]": (310, 0), "3-10[2]": (310, 2)}  # noqa: RUF012
    _arrays = frozenset({310})

    def __init__(self, address: int) -> None:
        self.address = address
        self.values = dict.fromkeys(self._bits, 300)
        self._ear = _Ear(0x02)

    def holds(self, parameter: str) -> Decimal:
        """Return the value; the indexed one has a sign."""
        place = self._names[parameter]
        value = self.values[place]
        return Decimal(value - 0x10000 if place[0] in self._arrays and value > 0x7FFF else value)

    def silence(self) -> None:
        """Discard an unfinished telegram."""
        self._ear.forget()

    def hear(self, data: bytes) -> bytes:
        """Answer a sound telegram for this address; ignore anything else."""
        self._ear.hear(data)
        answer = b""
        for telegram, more in self._ear.telegrams(self._length):
            mine = telegram[2] == 0x80 + self.address and _exclusive_or(telegram) == 0
            answer = self._answered(telegram) if mine and not more else b""
        return answer

    @staticmethod
    def _length(heard: bytes) -> int:
        if len(heard) < 2:
            return 2
        return heard[1] + 2 if heard[1] in (6, 14) else 0

    def _answered(self, telegram: bytes) -> bytes:
        if len(telegram) == 8:
            return self._telegram(b"")
        head, index = int.from_bytes(telegram[3:5], "big"), int.from_bytes(telegram[5:7], "big") & 0xFF
        command, number, value = head >> 12, head & 0xFFF, int.from_bytes(telegram[7:11], "big")
        if command == 0:
            return self._telegram(bytes(8))
        place = (number, index)
        if place not in self._bits:
            if any(number == known for known, _ in self._bits):
                return self._no(number, telegram[5:7], 3 if number in self._arrays else 4)
            return self._no(number, telegram[5:7], 0)
        bits = self._bits[place]
        if command in (2, 3, 13, 14):
            if (command in (3, 13)) is not (bits == 32):
                return self._no(number, telegram[5:7], 5)
            self.values[place] = value if bits == 32 else value & 0xFFFF
        elif command != 1:
            return self._no(number, telegram[5:7], 18)
        return self._words(2 if bits == 32 else 1, number, telegram[5:7], self.values[place])

    def _no(self, number: int, index: bytes, code: int) -> bytes:
        return self._words(7, number, index, code)

    def _words(self, response: int, number: int, index: bytes, value: int) -> bytes:
        return self._telegram((response << 12 | number).to_bytes(2, "big") + index + value.to_bytes(4, "big"))

    def _telegram(self, parameter: bytes) -> bytes:
        telegram = bytes([2, len(parameter) + 6, 0x80 + self.address]) + parameter + b"\x06\x03\x00\x00"
        return telegram + bytes([_exclusive_or(telegram)])


class Vlt3500Drive:
    """Danfoss VLT 3500: 22 characters. Values keep the decimals with which they were written."""

    character_s = 10 / 9600
    delay_s = 0.01
    gap_s = 0.05

    def __init__(self, address: int) -> None:
        self.address = address
        self.values = {"215": Decimal("10.0"), "216": Decimal("10.0"), "516": Decimal("0.00")}
        self._ear = _Ear(ord("<"))

    def holds(self, parameter: str) -> Decimal:
        """Return the value."""
        return self.values[parameter]

    def silence(self) -> None:
        """Discard an unfinished telegram."""
        self._ear.forget()

    def hear(self, data: bytes) -> bytes:
        """Answer a sound telegram for this address; ignore anything else."""
        self._ear.hear(data)
        answer = b""
        for telegram, more in self._ear.telegrams(self._length):
            answer = self._answered(telegram) if telegram[1:3] == b"%02d" % self.address and not more else b""
        return answer

    @staticmethod
    def _length(heard: bytes) -> int:
        if len(heard) < 22:
            return 22
        check = heard[19:21] == b"%02d" % (sum(heard[1:19]) % 100)
        return 22 if heard[21] == ord(">") and check and heard[3] in b"URCI" else 0

    def _answered(self, telegram: bytes) -> bytes:
        kind, name = telegram[3:4], str(int(telegram[8:12])) if telegram[8:12].isdigit() else ""
        data = telegram[12:19]
        if kind == b"C":
            return self._telegram(kind, telegram[8:12], data)
        if kind == b"I":
            return self._telegram(kind, telegram[8:12], b"+000%02d9" % (3 if name in self.values else 0))
        if name not in self.values:
            return self._telegram(kind, telegram[8:12], b"+000009")
        if kind == b"U":
            if not data[1:].isdigit() or data[6:] not in (b"0", b"1", b"2", b"3", b"4", b"5"):
                return self._telegram(kind, telegram[8:12], b"+000079")
            value = Decimal(int(data[1:6])).scaleb(-int(data[6:]))
            self.values[name] = -value if data[:1] == b"-" else value
        value = self.values[name]
        decimals = max(0, -int(value.as_tuple().exponent))
        sign = b"-" if value < 0 else b"+"
        return self._telegram(kind, telegram[8:12], b"%s%05d%d" % (sign, abs(int(value.scaleb(decimals))), decimals))

    def _telegram(self, kind: bytes, parameter: bytes, data: bytes) -> bytes:
        # Ready, enabled, control by the bus; stopped.
        text = b"%02d%sGBB@%s%s" % (self.address, kind, parameter, data)
        return b"<%s%02d>" % (text, sum(text) % 100)


class FujiDrive:
    """Fuji: standard telegrams R, W and E, short ones a, e, f, m and g to k; telegrams with a wrong sum are ignored."""

    character_s = 10 / 9600
    delay_s = 0.01
    gap_s = 0.05
    _short_writes = {b"a": "S01", b"e": "S05", b"f": "S06", b"m": ""}  # noqa: RUF012
    _short_reads = {b"g": "M06", b"h": "M07", b"j": "M09", b"k": "M14"}  # noqa: RUF012

    def __init__(self, station: int) -> None:
        self.address = station
        self.values = dict.fromkeys(("S01", "S05", "S06", "S08", "S09", "C05", "H30", "M26", "M06", "M07"), 0)
        self.values |= {"M09": 0, "M14": 0x1028, "F03": 60}
        self._ear = _Ear(0x01)

    def holds(self, parameter: str) -> Decimal:
        """Return the value, without a sign."""
        return Decimal(self.values[parameter])

    def silence(self) -> None:
        """Discard an unfinished telegram."""
        self._ear.forget()

    def hear(self, data: bytes) -> bytes:
        """Answer a sound telegram for this station; refuse or ignore a wrong one, as the manual says."""
        self._ear.hear(data)
        answer = b""
        for telegram, more in self._ear.telegrams(self._length):
            mine = telegram[1:3] == b"%02d" % self.address
            sound = telegram[-2:] == b"%02X" % (sum(telegram[1:-2]) & 0xFF)
            answer = self._answered(telegram) if mine and sound and not more else b""
        return answer

    @staticmethod
    def _length(heard: bytes) -> int:
        if len(heard) < 5:
            return 5
        if heard[3] != 0x05:
            return 0
        if heard[4:5] in (b"R", b"W", b"A", b"E"):
            return 16
        if heard[4:5] in (b"a", b"b", b"c", b"d", b"e", b"f", b"m"):
            return 12
        return 8 if heard[4:5] in (b"g", b"h", b"i", b"j", b"k") else 0

    def _answered(self, telegram: bytes) -> bytes:
        command = telegram[4:5]
        if telegram[-3] != 0x03:
            return self._no(command, telegram, 74)
        if len(telegram) == 16:
            return self._standard(command, telegram)
        if len(telegram) == 12:
            name = self._short_writes.get(command)
            if name is None or not _HEXADECIMAL.issuperset(telegram[5:9]):
                return self._no(command, telegram, 75 if name is None else 80)
            if name:
                self.values[name] = int(telegram[5:9], 16)
            return self._framed(b"\x06" + command)
        name = self._short_reads.get(command)
        if name is None:
            return self._no(command, telegram, 75)
        return self._framed(b"\x06" + command + b"%04X" % self.values[name])

    def _standard(self, command: bytes, telegram: bytes) -> bytes:
        if command == b"E":
            return self._framed(b"\x06" + telegram[4:9] + b"    ")
        name = telegram[5:8].decode("latin-1")
        if name not in self.values:
            return self._no(command, telegram, 78)
        if command == b"R":
            return self._framed(b"\x06" + telegram[4:9] + b"%04X" % self.values[name])
        if name[0] == "M":
            return self._no(command, telegram, 79)
        if not _HEXADECIMAL.issuperset(telegram[9:13]):
            return self._no(command, telegram, 80)
        self.values[name] = int(telegram[9:13], 16)
        return self._framed(b"\x06" + telegram[4:13])

    def _no(self, command: bytes, telegram: bytes, code: int) -> bytes:
        self.values["M26"] = code
        if len(telegram) == 16:
            return self._framed(b"\x15" + telegram[4:8] + b"   %02X" % code)
        return self._framed(b"\x15" + command + (b"    " if len(telegram) == 8 else b""))

    def _framed(self, content: bytes) -> bytes:
        summed = b"%02d" % self.address + content + b"\x03"
        return b"\x01" + summed + b"%02X" % (sum(summed) & 0xFF)


@dataclass(kw_only=True)
class Mischief:
    """Random faults of replies.

    silent, damaged, late: shares of the replies. late_s: longest delay. A damaged reply has one or two wrong bits in
    one character, or lacks a character, or its end: damage that the check characters of these protocols must detect.
    """

    random: Random
    silent: float = 0.0
    damaged: float = 0.0
    late: float = 0.0
    late_s: float = 0.0
    happened: dict[str, int] = field(default_factory=dict)

    @property
    def number(self) -> int:
        """Number of replies disturbed so far."""
        return sum(self.happened.values())

    def with_answer(self, answer: bytes) -> tuple[float, bytes]:
        """Return the extra delay of the reply in seconds, and the bytes left of it."""
        drawn = self.random.random()
        if drawn < self.silent:
            return self._noted("silent", 0.0, b"")
        if drawn < self.silent + self.damaged:
            return self._noted("damaged", 0.0, self._damaged(answer))
        if drawn < self.silent + self.damaged + self.late:
            return self._noted("late", self.random.uniform(0, self.late_s), answer)
        return 0.0, answer

    def _noted(self, what: str, delay_s: float, answer: bytes) -> tuple[float, bytes]:
        self.happened[what] = self.happened.get(what, 0) + 1
        return delay_s, answer

    def _damaged(self, answer: bytes) -> bytes:
        at, way = self.random.randrange(len(answer)), self.random.randrange(3)
        if way == 0:
            wrong = 1 << self.random.randrange(8) | 1 << self.random.randrange(8)
            return answer[:at] + bytes([answer[at] ^ wrong]) + answer[at + 1 :]
        return answer[:at] + (answer[at + 1 :] if way == 1 else b"")


class DriveLine:
    """Drives behind a pseudo-terminal or a TCP port; a context manager that serves them in a separate thread.

    url: address for the master. A drive that prepares a reply receives nothing, as its receiver is off while it sends.
    """

    def __init__(self, drives: Sequence[Drive], mischief: Mischief, *, where: str) -> None:
        self.drives = drives
        self.mischief = mischief
        self.answered = 0
        self.error: BaseException | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"drives at {where}", daemon=True)
        self._terminal: tuple[int, int] | None = None
        self._door: socket.socket | None = None
        if where == "pty":
            self._terminal = os.openpty()
            tty.setraw(self._terminal[1])
            self.url = os.ttyname(self._terminal[1])
        elif where == "tcp":
            self._door = socket.create_server(("127.0.0.1", 0))
            self.url = f"socket://127.0.0.1:{self._door.getsockname()[1]}"
        else:
            raise ValueError(f"a line is at a pty or at tcp, not at {where!r}")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(10)
        for descriptor in self._terminal or ():
            os.close(descriptor)
        if self._door is not None:
            self._door.close()

    def _serve(self) -> None:
        try:
            if self._terminal is not None:
                self._attend(self._terminal[0])
            while not self._stop.is_set() and self._door is not None:
                if not select.select([self._door], [], [], 0.1)[0]:
                    continue
                master, _ = self._door.accept()
                with master:
                    master.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._attend(master.fileno())
        except BaseException as error:  # noqa: BLE001 - the test checks any error
            self.error = error

    def _attend(self, port: int) -> None:
        """Serve one master until it disconnects."""
        gap = min(drive.gap_s for drive in self.drives)
        last = time.monotonic()
        while not self._stop.is_set():
            if not select.select([port], [], [], 0.1)[0]:
                continue
            try:
                data = os.read(port, 4096)
            except ConnectionResetError:
                return
            if not data:
                return
            quiet = time.monotonic() - last
            for drive in self.drives:
                if quiet > max(gap, drive.gap_s):
                    drive.silence()
            answers = [(drive, answer) for drive in self.drives if (answer := drive.hear(data))]
            for drive, answer in answers:
                self._answer(port, drive, answer, len(data))
            last = time.monotonic()

    def _answer(self, port: int, drive: Drive, answer: bytes, asked: int) -> None:
        late_s, sent = self.mischief.with_answer(answer)
        pause = drive.delay_s + (asked + len(answer)) * drive.character_s + late_s
        if self._stop.wait(pause):
            return
        if select.select([port], [], [], 0)[0]:
            # Bytes sent in the meantime are lost.
            os.read(port, 4096)
        self.answered += 1
        if sent:
            os.write(port, sent)
            for other in self.drives:
                if other is not drive:
                    other.hear(sent)
