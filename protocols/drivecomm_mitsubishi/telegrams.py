"""Telegrams of the computer link (FR-E500 manual p. 102 and 103, FR-D700 p. 190, FR-A800 p. 578).

    request   ENQ  s s  c c  w  data of 0, 2, 4 or 6 digits  x x     formats B, A', A, A"
    request   ENQ  s s  F 0  w  t r  4 digits  4 digits  x x         multi command, A3 (A2 in F700 and A800 manuals)
    value     STX  s s  data of 4, 2, 6 or 20 characters  ETX  x x   formats E, E', E", E3
    value     STX  s s  4 digits  u u  ETX  x x                      Shihlin: with a unit (SE2 manual p. 59)
    value     STX  s s  t r  e e  4 digits  4 digits  ETX  x x       reply to a multi command, C1
    accepted  ACK  s s                                               format C, and G of the master
    refused   NAK  s s  e                                            format D; from the master without e, H

s: station. c: instruction code. w: waiting time, omitted unless Pr. 123 is 9999. t, r: which data is sent and
requested. e: error. x: sum of all characters behind the first, without ETX (FR-A500 manual p. 131). CR, or CR LF, may
follow.

Faults to expect: ACK and NAK have no sum; no reply names its request; the sum does not detect exchanged characters;
without CR only the sum distinguishes a write of four digits from the beginning of one of six.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, make_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import TelegramError, UsageError
from drivecomm.protocol import schema
from drivecomm.protocol.schema import CheckCharacters, Form, Telegrams, constant, hex_number, hex_text, wrong_field

if TYPE_CHECKING:
    from collections.abc import Sequence

STATIONS = range(32)
SHORT = ("6C", "73", "7A", "7F", "EC", "F3", "FA", "FF")
"""Codes with two digits of data (FR-E500 manual p. 101)."""
LONG = ("25", "6D", "6E", "6F", "A5", "ED", "EE")
"""Codes that may have six digits: speeds with Pr. 37 set and FF = 01, and Pr. 37 itself (FR-S500 manual p. 146)."""
_ENQ, _STX, _ETX, _ACK, _NAK = b"\x05", b"\x02", b"\x03", b"\x06", b"\x15"
_ENDS = {"": b"", "cr": b"\r", "crlf": b"\r\n"}


@dataclass(frozen=True, slots=True, kw_only=True)
class MitsubishiOptions:
    """Options of a Mitsubishi or Shihlin drive.

    dialect: `shihlin` if a value is followed by two characters for its unit, and all data has four digits. wait: the
    waiting time in a request, 0 to 15 in steps of 10 ms; false if requests have no such digit (Pr. 123 set).
    terminator: `cr` or `crlf` if each telegram ends with it (Pr. 124).
    """

    dialect: Literal["mitsubishi", "shihlin"] = "mitsubishi"
    wait: int | bool | None = 0
    terminator: Literal["", "cr", "crlf"] = ""

    def __post_init__(self) -> None:
        # False equals 0, and codecs are cached by options.
        object.__setattr__(self, "wait", None if self.wait is False else self.wait)
        digit = self.wait is not True and self.wait in (None, *range(16))
        if not digit or self.dialect not in ("mitsubishi", "shihlin") or self.terminator not in (*_ENDS,):
            raise UsageError(f"{self}: wait is 0 to 15 or false, dialect mitsubishi or shihlin, terminator cr or crlf")


def _message(kind: str, *names: str, optional: tuple[str, ...] = ()) -> type[Any]:
    """Return the class of a telegram with a station and these fields. optional: fields that it may omit."""
    given: list[Any] = [*((name, object) for name in ("station", *names)), *((each, object, None) for each in optional)]
    own = {"kind": kind, "address": property(lambda message: message.station), "__module__": __name__}
    return make_dataclass(kind.title(), given, frozen=True, slots=True, kw_only=True, namespace=own)


# code: two hexadecimal digits. data, data1, data2: digits as printed. error1, error2: of run command and frequency.
Read, Write = _message("read", "code", optional=("wait",)), _message("write", "code", "data", optional=("wait",))
Multi = _message("multi", "code", "send_type", "receive_type", "data1", "data2", optional=("wait",))
HasRead, HasNotRead = _message("ack"), _message("nak")
Data, Ack, Nak = _message("data", "data", optional=("unit",)), _message("ack"), _message("nak", "error_code")
MultiReply = _message("multi_reply", "send_type", "receive_type", "error1", "error2", "data1", "data2")


def _checked(data: Any) -> Any:
    """Return a valid value: 2, 4 or 6 hexadecimal digits, or a drive type of 20 characters. Raises TelegramError."""
    if len(data) not in (2, 4, 6, 20):
        raise TelegramError("length", f"{len(data)} characters are not a value; it has 2, 4, 6 or 20")
    if len(data) < 20 and not re.fullmatch("[0-9A-F]*", data):
        raise wrong_field("data", f"{data!r} is not made of the digits 0-9 and A-F")
    return data


def _check_request(message: Any) -> None:
    """Raise an error for requests that no master may send: erase all parameters, or run both ways."""
    if message.code == "FC":
        raise wrong_field("code", "FC erases the parameters of the drive")
    word = message.data1 if message.code == "F0" else message.data if message.code in ("FA", "F9") else ""
    if isinstance(word, str) and word[-1:] in (*"67EF",):
        raise wrong_field("data", "forward and reverse together")


@cache
def codec_for(options: MitsubishiOptions) -> Telegrams:
    """Return the codec for drives with these options."""
    station = "station" / hex_number(2, "station 00 to 1F", allowed=STATIONS)
    wait = ("wait" / hex_number(1, "waiting time, 10 ms"),) * (options.wait is not None)
    tail = (constant(_ENDS[options.terminator]),) * bool(options.terminator)
    types = ("send_type" / hex_number(1, "kind of data sent"), "receive_type" / hex_number(1, "kind of data wanted"))
    two = ("data1" / hex_text(4, "run command, or status"), "data2" / hex_text(4, "frequency, or special monitor"))
    errors = (f"error{each}" / hex_number(1, "F: none, or error") for each in (1, 2))
    reads, writes = ([f"{code:02X}" for code in range(start, start + 0x80)] for start in (0, 0x80))

    def short(message: type[Any], begin: bytes, *leaves: Any) -> Form[Any]:
        return Form(message, constant(begin), station, *leaves, *tail)

    def request(message: type[Any], codes: Sequence[str], *data: Any) -> Form[Any]:
        code = "code" / schema.deciding(schema.choice({each.encode(): each for each in codes}, "instruction code"))
        whole = (
            constant(_ENQ, "ENQ"),
            station,
            code,
            *wait,
            *data,
            CheckCharacters(2, 1, schema.hex_sum, meaning="sum"),
            *tail,
        )
        return Form(message, *whole, check=None if message is Read else _check_request)

    def write(digits: int, codes: Sequence[str]) -> Form[Any]:
        return request(Write, [each for each in codes if each in writes], "data" / hex_text(digits, "data"))

    def value(message: type[Any], *data: Any, **further: Any) -> Form[Any]:
        summed = CheckCharacters(
            2, 1, lambda covered: schema.hex_sum(covered[:-1]), meaning="sum behind STX, without ETX"
        )
        return Form(message, constant(_STX, "STX"), station, *data, constant(_ETX, "ETX"), summed, *tail, **further)

    requests = {"Read (B)": request(Read, reads)}
    requests |= {"Has read (G)": short(HasRead, _ACK), "Has not read (H)": short(HasNotRead, _NAK)}
    replies = {"Accepted (C)": short(Ack, _ACK), "Refused (D)": short(Nak, _NAK, "error_code" / hex_number(1, "error"))}
    if options.dialect == "shihlin":
        requests["Write (A)"] = write(4, writes)
        replies["Value with unit (E)"] = value(Data, "data" / hex_text(4, "value"), "unit" / schema.characters(2))
        return Telegrams(requests, replies, alike=options)
    requests["Write of 2 digits (A')"] = write(2, SHORT)
    requests["Write of 4 digits (A)"] = write(4, [each for each in writes if each not in (*SHORT, "F0")])
    requests["Multi command (A3)"] = request(Multi, ["F0"], *types, *two)
    text = "data" / schema.characters(schema.until(_ETX, least=2, most=20), meaning="2, 4, 6 digits, or 20 characters")
    replies["Value (E)"] = value(Data, text, reads={"data": _checked}, check=lambda message: _checked(message.data))
    done = {"Multi command done (C1)": value(MultiReply, *types, *errors, *two)}
    further = Telegrams({"Write of 6 digits (A'')": write(6, LONG)}, done)
    return schema.TelegramsByLength(requests, replies, further=further, alike=options)
