"""Parsing of one line of another program's log: time, direction and bytes.

The notations are those of libmodbus and mbpoll, pymodbus, minimalmodbus, modbus_tk, QModMaster, Modbus Poll, serial
monitors of Windows, interceptty, strace, and others that print hexadecimal with a word for the direction.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from drivecomm.capture.printed_bytes import bytes_of, unescaped
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.capture.pieces import Source

_LONGEST = 20_000
_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_CLOCK = r"\d{1,2}:[0-5]\d:[0-5]\d(?:[.,:]\d{1,9})?(?:\s*[AP]M\b)?(?![\w:])"
_DATE = r"\b(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{4})"
_TIME = re.compile(rf"{_DATE}[T ]+{_CLOCK}|(?<![\w:.]){_CLOCK}", re.IGNORECASE)
_PARTS = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})(?:[.,:](\d+))?(?:\s*([AP])M)?$", re.IGNORECASE)
_SECONDS = re.compile(r"^\s*[\[(]?\s*(\d{1,10}\.\d{3,9})\s*(?:s|[\])])?(?=\s)")
"""Seconds at the start of a line, as `strace -ttt`, `dmesg` and `ts` print them."""

_STRACE = re.compile(
    r"\b(?P<call>write|read|send|recv|sendto|recvfrom|pwrite64|pread64)\(\d+(?:<[^>]*>)?,\s*"
    r'"(?P<bytes>(?:[^"\\]|\\.)*)"(?P<cut>\.\.\.)?.*\)\s*=\s*(?P<result>-?\d+)'
)
_SENT = r"\btxd?\b|\bsend(?:ing)?\b|\bsent\b|\bwrit(?:e|ing|ten)\b|\bwrote\b|\brequest\b|\bquery\b|\bout\b|-+>|>>|→"
_RECEIVED = (
    r"\brxd?\b|\brecv\w*|\breceiv\w*|\bread(?:ing)?\b|\bresp(?:onse)?\b|\brepl(?:y|ied)\b|\banswer\b|\bin\b|<-+|<<|←"
)
_MARK = re.compile(rf"(?P<sent>{_SENT})|(?P<received>{_RECEIVED})", re.IGNORECASE)
_BEFORE = re.compile(r"\b(?:extra data|old_data):")
"""Words after which pymodbus repeats earlier bytes."""

_ONE_BYTE = re.compile(r"^\s*([<>])\s+0x([0-9a-fA-F]{2})\b")
"""Line of interceptty: > to the device, < from the device, one byte and its character."""

_BYTES = (
    re.compile(r"(?:\[[0-9a-fA-F]{2}\]\s*)+"),
    re.compile(r"(?:<[0-9a-fA-F]{2}>\s*)+"),
    re.compile(r"<Buffer(?:\s[0-9a-fA-F]{2})+>"),
    re.compile(r"(?:\b0x[0-9a-fA-F]{1,2}\b[\s,;]*)+"),
    re.compile(r"(?:\b[0-9a-fA-F]{2}[hH]\b[\s,;]*)+"),
    re.compile(r"(?<![\w.:-])[0-9a-fA-F]{2}(?:(?:\s+|[:,-]\s*)[0-9a-fA-F]{2})+(?![\w:-])"),
    re.compile(r"(?<![\w.-])(?:[0-9a-fA-F]{2}){4,}(?![\w.-])"),
    re.compile(r"\bb?(?:'(?:[^'\\]|\\.)*\\(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\\(?:[^\"\\]|\\.)*\")"),
    re.compile(r"(?:\\x[0-9a-fA-F]{2})+"),
    re.compile(r"[\[(]?(?<![\w.])\d{1,3}(?:(?:\s*,\s*|-|\s+)\d{1,3}){3,}(?![\w.])[\])]?"),
    re.compile(r"(?<![\w.])[0-9a-fA-F]{1,2}(?:\s[0-9a-fA-F]{1,2}){3,}(?![\w.])"),
)
"""Notations of bytes in a line. The longest match is used, the earlier of two equally long ones."""

_DUMP = re.compile(
    r"\s*(?:([0-9a-fA-F]{4,8}):?\s+((?:(?:[0-9a-fA-F]{2}){1,4}\s){1,16})(?:\s+\S.*)?|()((?:[0-9a-fA-F]{2}\s){1,16})\s+\S.*)"
)
"""Line of a hex dump: offset, up to 16 bytes, and their characters; either offset or characters may be missing."""

Mark = Literal["sent", "received", ""]


_ARROWS: Mapping[str, Mark] = {">": "sent", "<": "received"}
_SIGNS_AROUND = " \t:;,.-#>|{}()[]"


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedLine:
    """Content of one line.

    time_s: by the clock of the log, None if it has none. mark: direction, "" if unknown. data: its bytes. style: set if
    the bytes may continue those of the line before (libmodbus splits replies over lines, interceptty prints one byte
    per line, dumps have several lines). begins: whether a dump begins here. reason: why apparent bytes were not read;
    "" if there are none.
    """

    time_s: float | None = None
    mark: Mark = ""
    data: bytes = b""
    style: Literal["", "brackets", "byte", "dump"] = ""
    begins: bool = False
    reason: str = ""

    @property
    def source(self) -> Source:
        """Sender, if the program that printed the log was the master."""
        return "master" if self.mark == "sent" else "drive" if self.mark == "received" else "unknown"


def printed_lines(line: str) -> list[PrintedLine]:
    """Return the content of one line of a log; two entries if it has bytes of both directions."""
    if len(line) > _LONGEST:
        return [PrintedLine(reason=f"it is longer than {_LONGEST} characters")]
    text = _ANSI.sub("", line).rstrip()
    if strace := _STRACE.search(text):
        return [_of_strace(strace, _time(text[: strace.start()])[0])]
    if one := _ONE_BYTE.match(text):
        return [PrintedLine(mark="sent" if one[1] == ">" else "received", data=bytes.fromhex(one[2]), style="byte")]
    time_s, text = _time(_BEFORE.split(text)[0])
    if dump := _DUMP.fullmatch(f"{text} "):
        begins = bool(dump[1]) and not int(dump[1], 16)
        return [PrintedLine(time_s=time_s, data=bytes.fromhex(dump[2] or dump[4]), style="dump", begins=begins)]
    return [_part(each, time_s) for each in _parts(text)]


def _parts(text: str) -> list[str]:
    """Split a line at each direction word that has bytes both before and after it."""
    begun = 0
    parts = []
    for mark in _MARK.finditer(text):
        if _longest(text[begun : mark.start()]) and _longest(text[mark.start() :]):
            parts.append(text[begun : mark.start()])
            begun = mark.start()
    return [*parts, text[begun:]]


def _longest(text: str) -> re.Match[str] | None:
    return max((each for form in _BYTES for each in form.finditer(text)), key=_length, default=None)


def _part(text: str, time_s: float | None) -> PrintedLine:
    found = _longest(text)
    before = text if found is None else text[: found.start()]
    marks = list(_MARK.finditer(before))
    mark: Mark = "" if not marks else "sent" if marks[-1]["sent"] else "received"
    if found is None:
        return PrintedLine(time_s=time_s, mark=mark)
    shown = found[0].strip()
    bracketed: Literal["", "brackets"] = "brackets" if shown[:1] in "[<" and text.strip() == shown else ""
    if bracketed and not mark:
        # libmodbus prints sent bytes in square brackets and received bytes in angle brackets.
        mark = "sent" if shown.startswith("[") else "received"
    elif not mark and before.rstrip()[-1:] in _ARROWS:
        mark = _ARROWS[before.rstrip()[-1:]]
    try:
        data = _unpadded(shown) or bytes_of(shown)
    except UsageError:
        return PrintedLine(time_s=time_s, mark=mark, reason=f"{shown[:40]!r} could be decimal or hexadecimal")
    if not mark and text.strip(_SIGNS_AROUND) != shown.strip(_SIGNS_AROUND):
        return PrintedLine(time_s=time_s, reason="the line does not say who sent these bytes, or whether it holds any")
    return PrintedLine(time_s=time_s, mark=mark, data=data, style=bracketed)


def _length(found: re.Match[str]) -> int:
    return len(re.findall(r"0x[0-9a-fA-F]{1,2}|[0-9a-fA-F]{2}|\b\d\b", found[0]))


def _unpadded(shown: str) -> bytes:
    """Return hexadecimal bytes in which leading zeros may be missing, b"" if they may be decimal."""
    words = shown.split()
    if all(re.fullmatch(r"[0-9a-fA-F]{1,2}", word) for word in words) and re.search(r"[a-fA-F]", shown):
        return bytes(int(word, 16) for word in words)
    return b""


def _of_strace(found: re.Match[str], time_s: float | None) -> PrintedLine:
    mark: Mark = "sent" if found["call"].startswith(("write", "send", "pwrite")) else "received"
    length = int(found["result"])
    if length <= 0:
        return PrintedLine(time_s=time_s)
    try:
        data = unescaped(found["bytes"])
    except ValueError:
        return PrintedLine(time_s=time_s, mark=mark, reason="strace does not print such characters")
    if found["cut"] and len(data) < length:
        return PrintedLine(time_s=time_s, mark=mark, reason="strace cut the bytes off; record with -s 300")
    return PrintedLine(time_s=time_s, mark=mark, data=data[:length])


def _time(text: str) -> tuple[float | None, str]:
    """Return the time in a line, by the clock of its log, and the line without the time."""
    if seconds := _SECONDS.match(text):
        return float(seconds[1]), text[seconds.end() :]
    found = _TIME.search(text)
    parts = _PARTS.search(found[0]) if found else None
    if found is None or parts is None or int(parts[1]) > 23:
        return None, text
    afternoon = (parts[5] or "").upper() == "P" and int(parts[1]) < 12
    time_s = (int(parts[1]) + 12 * afternoon) * 3600 + int(parts[2]) * 60 + int(parts[3]) + float(f"0.{parts[4] or 0}")
    return time_s, f"{text[: found.start()]} {text[found.end() :]}"
