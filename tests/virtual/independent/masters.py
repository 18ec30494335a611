"""Masters of four drive protocols, written from the published descriptions alone.

These programs import nothing of the project: they have their own telegrams, check characters and timing, and need only
pyserial. They report every value that differs from the one written.

Sources: short description of VABus, sections 4 to 7, and Agile VABus manual p. 25-41; Danfoss FC 101 Design Guide
MG18C502 p. 82 and VLT 5000 Design Guide MG.52.B2.02 p. 85-99; VLT Series 3500 manual p. 85-92; FVR-E11S manual p. 9-13
to 9-20.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple, Protocol

import serial

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from random import Random


class NoAnswerError(Exception):
    """No acceptable reply came in any attempt."""


class RefusedError(Exception):
    """The drive refuses; code: the reason, in the numbers of the protocol."""

    def __init__(self, code: int) -> None:
        super().__init__(f"refused with code {code}")
        self.code = code


class DamagedError(Exception):
    """No reply, or a reply that does not fit the request; the text gives the reason."""


class Settings(NamedTuple):
    """Format of characters on the wire."""

    baudrate: int
    bytesize: int
    parity: str
    stopbits: int

    def seconds(self, characters: int) -> float:
        """Return the duration of this number of characters."""
        bits = 1 + self.bytesize + (self.parity != "N") + self.stopbits
        return characters * bits / self.baudrate


class Line:
    """A port that several masters use in turns."""

    def __init__(self, url: str) -> None:
        # ser2net in front of a pseudo-terminal cannot set DTR, so it never confirms DTR.
        options = "?ign_set_control" if url.startswith("rfc2217:") else ""
        self._port = serial.serial_for_url(url + options, timeout=0.1)
        # Raw TCP has no line settings, and a pseudo-terminal refuses settings that it cannot apply.
        self._has_settings = url.startswith("rfc2217:")
        self._settings: Settings | None = None
        self._quiet_since = time.monotonic()
        self.heard: list[tuple[str, bytes]] = []
        """Latest telegrams in both directions, for the texts of failures."""

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def tell(self, data: bytes, settings: Settings, pause_s: float) -> None:
        """Send a telegram that has no reply."""
        self._send(data, settings, pause_s)
        self._quiet_since = time.monotonic() + settings.seconds(len(data))

    def ask(
        self, request: bytes, settings: Settings, *, pause_s: float, reply_s: float, missing: Callable[[bytes], int]
    ) -> bytes:
        """Send a request, and return its reply.

        missing: least number of characters to come after these. reply_s: time from the last character of the request to
        the last of the reply, without its time on the wire. Raises DamagedError.
        """
        self._send(request, settings, pause_s)
        came = b""
        wait_s = reply_s + settings.seconds(len(request) + 32)
        try:
            while wanted := missing(came):
                self._port.timeout = wait_s
                more = self._port.read(wanted)
                came += more
                _expect(len(more) == wanted, f"{wanted - len(more)} characters are missing" if came else "silence")
                # A gap within a reply is short, but a serial server may split the reply.
                wait_s = 0.05 + settings.seconds(32)
        except DamagedError:
            self._note("cut", came)
            raise
        self._quiet_since = time.monotonic()
        self._note("reply", came)
        return came

    def _send(self, data: bytes, settings: Settings, pause_s: float) -> None:
        if self._has_settings and settings != self._settings:
            self._port.apply_settings(settings._asdict())
            self._settings = settings
        left = self._quiet_since + pause_s - time.monotonic()
        if left > 0:
            time.sleep(left)
        self._port.timeout = 0
        if stale := self._port.read(1024):
            self._note("stale", stale)
        self._note("sent", data)
        self._port.write(data)

    def fall_silent(self) -> None:
        """Before a retry, wait until the line is silent for some time, for a second at most."""
        until = time.monotonic() + 1
        self._port.timeout = 0.05
        while time.monotonic() < until and (stale := self._port.read(1)):
            self._note("stale", stale)
        self._quiet_since = time.monotonic()

    def _note(self, what: str, data: bytes) -> None:
        self.heard.append((what, data))
        del self.heard[:-24]


class Master(Protocol):
    """Interface of every master here to its drive."""

    name: str
    writable: dict[str, Sequence[Decimal]]
    """Parameters that hold the values written to them, with the values to choose from."""
    unknown: str
    """A parameter that no drive has."""
    unknown_code: int
    """Code of the refusal of `unknown`."""
    repeats: int

    def read(self, parameter: str) -> Decimal:
        """Return the value. Raises NoAnswerError, RefusedError."""
        ...

    def write(self, parameter: str, value: Decimal) -> None:
        """Set the value without storing it.

        Raises NoAnswerError, RefusedError; the value may be set in spite of the error.
        """
        ...


_ATTEMPTS = 3


def _numbers(low: int, high: int, step: int = 1, decimals: int = 0) -> list[Decimal]:
    return [Decimal(number).scaleb(-decimals) for number in range(low, high + 1, step)]


def _exclusive_or(data: bytes) -> int:
    check = 0
    for byte in data:
        check ^= byte
    return check


def _hexadecimal(text: bytes) -> int:
    if not text or any(character not in b"0123456789ABCDEF" for character in text):
        raise DamagedError(f"{text!r} is no hexadecimal number")
    return int(text, 16)


def _decimal(text: bytes) -> int:
    if not text or any(character not in b"0123456789" for character in text):
        raise DamagedError(f"{text!r} is no decimal number")
    return int(text)


def _signed(number: int, bits: int) -> int:
    return number - (1 << bits) if number >> (bits - 1) else number


def _expect(condition: object, otherwise: str) -> None:
    if not condition:
        raise DamagedError(otherwise)


class VabusMaster:
    """Bonfiglioli Vectron: enquiry and select with EOT, block check, error register 11.

    dataset: 0, or 5 for drives that write to RAM only.
    """

    _settings = Settings(19200, 7, "E", 1)
    _pause_s = 0.002
    _reply_s = 0.5
    # Number of digits, and whether there is a sign.
    _types = {"480": (8, True), "481": (8, True), "520": (4, True), "372": (4, False), "11": (4, False)}  # noqa: RUF012

    def __init__(self, line: Line, node: int, *, dataset: int = 5) -> None:
        self.name = f"vabus {node}"
        self.writable: dict[str, Sequence[Decimal]] = {
            "480": _numbers(0, 5000, 7),
            "481": _numbers(0, 5000, 11),
            "520": _numbers(-5000, 5000, 13),
            "372": _numbers(100, 3000, 3),
        }
        self.unknown, self.unknown_code = "999", 11
        self.repeats = 0
        self._line = line
        self._address = bytes([0x40 + node])
        self._dataset = dataset

    def read(self, parameter: str) -> Decimal:
        """Read by enquiry; after a refusal read the error register."""
        refused = 0
        for _ in range(_ATTEMPTS):
            try:
                return Decimal(self._enquire(parameter))
            except DamagedError:
                self._repeat()
            except RefusedError:
                refused = self._believed(refused)
        raise NoAnswerError(f"{self.name}: no answer to an enquiry for {parameter}")

    def write(self, parameter: str, value: Decimal) -> None:
        """Write by select; after a refusal read the error register."""
        digits, _ = self._types[parameter]
        text = b"0%d%03d%02d%0*X\x03" % (self._dataset, int(parameter), digits, digits, int(value) % 16**digits)
        request = b"\x04" + self._address + b"\x02" + text + bytes([_exclusive_or(text)])
        refused = 0
        for _ in range(_ATTEMPTS):
            try:
                reply = self._ask(request, lambda came: max(0, 2 - len(came)))
                _expect(reply[:1] == self._address, "another drive answers")
                if reply == self._address + b"\x06":
                    return
                _expect(reply[1:] == b"\x15", "neither ACK nor NAK")
            except DamagedError:
                self._repeat()
                continue
            refused = self._believed(refused)
        raise NoAnswerError(f"{self.name}: no answer to a select of {parameter}")

    def _believed(self, before: int) -> int:
        """Read the reason of a refusal and return it; raise RefusedError if the previous reason was the same.

        An enquiry has no check character, so a damaged enquiry can request a missing parameter. Its refusal may get
        lost, and then the next select is refused for the same reason. A refusal names no parameter.
        """
        code = self._refusal()
        if code == before and code > 0 and code not in (12, 13):
            raise RefusedError(code)
        self.repeats += 1
        return code

    def _enquire(self, parameter: str) -> int:
        asked = b"00%03d" % int(parameter)
        reply = self._ask(b"\x04" + self._address + asked + b"\x05", self._missing)
        _expect(reply[:1] == self._address, "another drive answers")
        if reply[1:] == b"\x15":
            raise RefusedError(-1)
        text, check = reply[2:-1], reply[-1]
        _expect(max(reply) < 0x80, "a character has eight bits")
        _expect(text[-1:] == b"\x03", "no ETX")
        _expect(_exclusive_or(text) == check, "wrong block check")
        _expect(text[:5] == asked, f"the answer is about {text[:5]!r}")
        digits, has_sign = self._types.get(parameter, (len(text) - 8, False))
        _expect(len(text) == 8 + digits, f"{len(text) - 8} digits")
        number = _hexadecimal(text[7:-1])
        return _signed(number, 4 * digits) if has_sign else number

    def _refusal(self) -> int:
        """Read the reason of a refusal; 0 if the drive has none recorded, -1 if it refuses the enquiry."""
        for _ in range(_ATTEMPTS):
            try:
                return self._enquire("11")
            except DamagedError:
                self._repeat()
            except RefusedError:
                return -1
        raise NoAnswerError(f"{self.name}: a refusal, and no answer to the enquiry for its reason")

    def _repeat(self) -> None:
        self.repeats += 1
        self._line.fall_silent()

    def _ask(self, request: bytes, missing: Callable[[bytes], int]) -> bytes:
        try:
            return self._line.ask(
                request, self._settings, pause_s=self._pause_s, reply_s=self._reply_s, missing=missing
            )
        finally:
            self._line.tell(b"\x04", self._settings, self._pause_s)

    @staticmethod
    def _missing(came: bytes) -> int:
        if len(came) < 2:
            return 2 - len(came)
        if came[1:2] == b"\x15":
            return 0
        _expect(came[1:2] == b"\x02", "neither STX nor NAK")
        if len(came) < 9:
            return 9 - len(came)
        return max(0, 11 + _decimal(came[7:9]) - len(came))


class DanfossMaster:
    """Danfoss FC: STX, LGE, ADR, parameter block, exclusive-or; the control word is never valid, so nothing moves."""

    _settings = Settings(9600, 8, "E", 1)
    _pause_s = 0.003
    _reply_s = 0.1
    # Parameter number, index, and number of bits, negative for values with a sign.
    _numbers_of = {  # noqa: RUF012
        "3-41": (341, 0, 32),
        "3-42": (342, 0, 32),
        "3-10[0]": (310, 0, -16),
        "3-10[2]": (310, 2, -16),
    }

    def __init__(self, line: Line, address: int) -> None:
        self.name = f"danfoss {address}"
        self.writable: dict[str, Sequence[Decimal]] = {
            "3-41": _numbers(100, 360000, 1001),
            "3-42": _numbers(100, 360000, 997),
            "3-10[0]": _numbers(-10000, 10000, 17),
            "3-10[2]": _numbers(-10000, 10000, 19),
        }
        self.unknown, self.unknown_code = "39-99", 0
        self.repeats = 0
        self._line = line
        self._address = 0x80 + address

    def read(self, parameter: str) -> Decimal:
        """Read by command 1."""
        number, index, bits = self._numbers_of.get(parameter, (3999, 0, 16))
        value = self._repeated(self._block(1, number, index, 0), number, index, (1, 2))
        return Decimal(_signed(value & 0xFFFF, 16) if bits < 0 else value)

    def write(self, parameter: str, value: Decimal) -> None:
        """Write to RAM by command 2, or 3 for double words."""
        number, index, bits = self._numbers_of[parameter]
        command = 2 if abs(bits) == 16 else 3
        raw = int(value) % (1 << abs(bits))
        self._repeated(self._block(command, number, index, raw), number, index, (command - 1,), confirmed=raw)

    def _block(self, command: int, number: int, index: int, value: int) -> bytes:
        words = (command << 12 | number).to_bytes(2, "big") + index.to_bytes(2, "big") + value.to_bytes(4, "big")
        telegram = bytes([2, 14, self._address]) + words + bytes(4)
        return telegram + bytes([_exclusive_or(telegram)])

    def _repeated(
        self, request: bytes, number: int, index: int, answers: tuple[int, ...], *, confirmed: int | None = None
    ) -> int:
        # The late reply to a read differs from the confirmation of a write only in the value.
        for _ in range(_ATTEMPTS):
            try:
                reply = self._line.ask(
                    request, self._settings, pause_s=self._pause_s, reply_s=self._reply_s, missing=self._missing
                )
                _expect(_exclusive_or(reply) == 0, "wrong check byte")
                _expect(reply[:3] == request[:3], "another drive answers, or another block")
                head = int.from_bytes(reply[3:5], "big")
                command, found = head >> 12, head & 0xFFF
                _expect(found == number and int.from_bytes(reply[5:7], "big") == index, "about another parameter")
                value = int.from_bytes(reply[7:11], "big")
                if command == 7:
                    raise RefusedError(value & 0xFFFF)
                _expect(command in answers, f"response {command} is none to this")
                value = value if command == 2 else value & 0xFFFF
                _expect(confirmed in (None, value), "another value is confirmed")
            except DamagedError:
                self._repeat()
            else:
                return value
        raise NoAnswerError(f"{self.name}: no answer to {request.hex(' ')}")

    def _repeat(self) -> None:
        self.repeats += 1
        self._line.fall_silent()

    @staticmethod
    def _missing(came: bytes) -> int:
        if len(came) < 2:
            return 2 - len(came)
        _expect(came[0] == 2, "no STX")
        _expect(came[1] == 14, f"length {came[1]}")
        return max(0, 16 - len(came))


class Vlt3500Master:
    """Danfoss VLT 3500: 22 characters in each direction; the control word is idle, so nothing moves."""

    _settings = Settings(9600, 8, "N", 1)
    _pause_s = 0.01
    _reply_s = 0.25

    def __init__(self, line: Line, address: int) -> None:
        self.name = f"vlt3500 {address}"
        self.writable: dict[str, Sequence[Decimal]] = {
            "215": _numbers(10, 3600, 7, 1),
            "216": _numbers(10, 3600, 11, 1),
            "516": _numbers(-10000, 10000, 31, 2),
        }
        self.unknown, self.unknown_code = "999", 0
        self.repeats = 0
        self._line = line
        self._address = b"%02d" % address

    def read(self, parameter: str) -> Decimal:
        """Read by R."""
        return self._repeated(b"R", parameter, b"+000000")

    def write(self, parameter: str, value: Decimal) -> None:
        """Write by U; the reply holds the value that the drive has taken."""
        decimals = max(0, -int(value.as_tuple().exponent))
        digits = abs(int(value.scaleb(decimals)))
        text = b"%s%05d%d" % (b"-" if value < 0 else b"+", digits, decimals)
        self._repeated(b"U", parameter, text, confirmed=value)

    def _repeated(self, kind: bytes, parameter: str, data: bytes, *, confirmed: Decimal | None = None) -> Decimal:
        text = self._address + kind + b"@@@@" + b"%04d" % int(parameter) + data
        request = b"<" + text + b"%02d>" % (sum(text) % 100)
        for _ in range(_ATTEMPTS):
            try:
                reply = self._line.ask(
                    request,
                    self._settings,
                    pause_s=self._pause_s,
                    reply_s=self._reply_s,
                    missing=lambda came: 22 - len(came),
                )
                _expect(reply[:1] == b"<" and reply[21:] == b">", "no brackets")
                _expect(_decimal(reply[19:21]) == sum(reply[1:19]) % 100, "wrong sum")
                _expect(reply[1:4] == request[1:4], "another drive answers, or to another request")
                _expect(all(0x40 <= character <= 0x4F for character in reply[4:8]), "no status word")
                _expect(reply[8:12] == request[8:12], "about another parameter")
                _expect(reply != request, "an echo")
                decimals, digits = _decimal(reply[18:19]), _decimal(reply[13:18])
                if decimals == 9:
                    raise RefusedError(digits % 100)
                _expect(decimals <= 5, f"{decimals} decimals")
                value = Decimal(digits).scaleb(-decimals)
                value = -value if reply[12:13] == b"-" else value
                _expect(confirmed in (None, value), "another value is confirmed")
            except DamagedError:
                self._repeat()
            else:
                return value
        raise NoAnswerError(f"{self.name}: no answer to {request!r}")

    def _repeat(self) -> None:
        self.repeats += 1
        self._line.fall_silent()


class FujiMaster:
    """Fuji: standard telegrams of 16 characters, and the short ones that set a frequency."""

    _settings = Settings(9600, 8, "N", 1)
    _pause_s = 0.01
    _reply_s = 0.1
    _stored_reply_s = 0.5

    def __init__(self, line: Line, station: int) -> None:
        self.name = f"fuji {station}"
        self.writable: dict[str, Sequence[Decimal]] = {
            "S05": _numbers(0, 5000, 7),
            "S08": _numbers(1, 36000, 101),
            "S09": _numbers(1, 36000, 103),
            "C05": _numbers(0, 5000, 11),
        }
        self.unknown, self.unknown_code = "F99", 78
        self.repeats = 0
        self._line = line
        self._station = b"%02d" % station
        self._short = False

    def read(self, parameter: str) -> Decimal:
        """Read by R."""
        return Decimal(_hexadecimal(self._standard(b"R", parameter, b"0000", self._reply_s)[9:13]))

    def write(self, parameter: str, value: Decimal) -> None:
        """Write by W; S05 also by the short telegram, every other time."""
        data = b"%04X" % int(value)
        if parameter == "S05":
            self._short = not self._short
            if self._short:
                self._short_write(b"e", data)
                return
        self._standard(b"W", parameter, data, self._reply_s if parameter[0] == "S" else self._stored_reply_s)

    def _standard(self, command: bytes, parameter: str, data: bytes, reply_s: float) -> bytes:
        request = self._framed(command + parameter.encode() + b" " + data)
        for _ in range(_ATTEMPTS):
            try:
                reply = self._checked(request, 16, reply_s)
                _expect(reply[4:8] == request[4:8], "about another function")
                if reply[3] == 0x15:
                    raise RefusedError(_hexadecimal(reply[11:13]))
                # The data in the reply to a write is not defined.
                _expect(reply[8:9] == b" " or command != b"R", "a sign where none belongs")
                if command == b"R":
                    _hexadecimal(reply[9:13])
            except DamagedError:
                self._repeat()
            else:
                return reply
        raise NoAnswerError(f"{self.name}: no answer to {request!r}")

    def _short_write(self, command: bytes, data: bytes) -> None:
        request = self._framed(command + data)
        for _ in range(_ATTEMPTS):
            try:
                reply = self._checked(request, 8, self._reply_s)
                _expect(reply[4:5] == command, "about another command")
                if reply[3] == 0x15:
                    raise RefusedError(-1)
            except DamagedError:
                self._repeat()
            else:
                return
        raise NoAnswerError(f"{self.name}: no answer to {request!r}")

    def _framed(self, content: bytes) -> bytes:
        summed = self._station + b"\x05" + content + b"\x03"
        return b"\x01" + summed + b"%02X" % (sum(summed) & 0xFF)

    def _checked(self, request: bytes, length: int, reply_s: float) -> bytes:
        reply = self._line.ask(
            request,
            self._settings,
            pause_s=self._pause_s,
            reply_s=reply_s,
            missing=lambda came: length - len(came),
        )
        _expect(reply[0] == 1 and reply[-3] == 3, "no SOH or no ETX")
        _expect(reply[-2:] == b"%02X" % (sum(reply[1:-2]) & 0xFF), "wrong sum")
        _expect(reply[1:3] == self._station, "another inverter answers")
        _expect(reply[3] in (6, 0x15), "neither ACK nor NAK")
        return reply

    def _repeat(self) -> None:
        self.repeats += 1
        self._line.fall_silent()


@dataclass
class Talk:
    """Long talk of a master with its drive: it writes, reads, and compares the values read with the possible ones.

    An unconfirmed write may have been carried out or not, so several values are possible until one of them is read.
    wrong: impossible values read, with the latest telegrams.
    """

    master: Master
    line: Line
    random: Random
    exchanges: int = 0
    failed: int = 0
    refused: int = 0
    wrong: list[str] = field(default_factory=list)
    possible: dict[str, set[Decimal]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the master."""
        return self.master.name

    @property
    def repeats(self) -> int:
        """Number of retries of the master."""
        return self.master.repeats

    def turn(self) -> None:
        """Make one random exchange."""
        self.exchanges += 1
        chosen = self.random.random()
        parameter = self.random.choice(list(self.master.writable))
        try:
            if chosen < 0.05:
                self._unknown()
            elif chosen < 0.45:
                self._write(parameter, self.random.choice(self.master.writable[parameter]))
            else:
                self._read(parameter)
        except NoAnswerError:
            self.failed += 1

    def _write(self, parameter: str, value: Decimal) -> None:
        before = self.possible.get(parameter, set())
        # If anything fails from here on, both values are possible.
        self.possible[parameter] = before | {value} if before else set()
        try:
            self.master.write(parameter, value)
        except RefusedError as refusal:
            self._say(f"{parameter} := {value} was {refusal}")
            return
        self.possible[parameter] = {value}

    def _read(self, parameter: str) -> None:
        try:
            found = self.master.read(parameter)
        except RefusedError as refusal:
            self._say(f"reading {parameter} was {refusal}")
            return
        possible = self.possible.get(parameter)
        if possible and found not in possible:
            self._say(f"{parameter} is {found}, and can be {sorted(possible)} only")
        self.possible[parameter] = {found}

    def _unknown(self) -> None:
        try:
            found = self.master.read(self.master.unknown)
        except RefusedError as refusal:
            self.refused += 1
            if refusal.code != self.master.unknown_code:
                self._say(f"a parameter that is not there was {refusal}")
        else:
            self._say(f"a parameter that is not there is {found}")

    def _say(self, text: str) -> None:
        heard = "; ".join(f"{what} {data.hex(' ')}" for what, data in self.line.heard)
        self.wrong.append(f"{self.name}: {text} ({heard})")
