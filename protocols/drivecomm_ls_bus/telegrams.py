"""Telegrams of LS bus (SV-iG5A manual p. 11-3 to 11-6; LSLV-S100 manual p. 236 to 240).

    request   ENQ  s s  R  address of 4  n              x x  EOT
    request   ENQ  s s  W  address of 4  n  n words     x x  EOT
    request   ENQ  s s  X  n  n addresses               x x  EOT    register for monitoring
    request   ENQ  s s  Y                               x x  EOT    read the registered addresses
    good      ACK  s s  R, W or Y        n words        x x  EOT
    good      ACK  s s  X                               x x  EOT
    refused   NAK  s s  command  error of 2             x x  EOT

s: station. n: 1 to 8. x: low byte of the sum of all characters between the first and itself (S100 p. 237). All numbers
are upper-case hexadecimal digits. No reply repeats the address. No drive answers station 255 (S100 p. 237).
"""

from __future__ import annotations

from dataclasses import field, make_dataclass
from typing import Any

from drivecomm.protocol import Direction, schema

STATIONS = range(1, 251)
"""Valid stations (S100 manual p. 231)."""
BROADCAST = 255
COUNTS = range(1, 9)
ERRORS = ("IF", "IA", "ID", "WM", "FE")
"""Unknown function, unknown address, value out of range, not writable now, wrong size or sum (SV-iG5A p. 11-6)."""


def _message(kind: str, *names: str) -> type[Any]:
    """Return the class of a telegram with a station and these fields.

    address: the station. first: the address of a parameter, which manuals and vectors call the address.
    """
    shown = {"address": "station", "first": "address"}
    given: list[Any] = [
        (name, object, field(metadata={"shown": shown.get(name, name)})) for name in ("address", *names)
    ]
    return make_dataclass(
        kind.title(), given, frozen=True, slots=True, kw_only=True, namespace={"kind": kind, "__module__": __name__}
    )


Read, Write = _message("read", "first", "count"), _message("write", "first", "count", "values")
Register, Monitor = _message("register", "count", "addresses"), _message("monitor")
Data, Written, Monitored = (_message(kind, "values") for kind in ("data", "written", "monitored"))
Registered, Nak = _message("registered"), _message("nak", "command", "error")


def _words(count: int, meaning: str) -> schema.Leaf:
    """Return a leaf of this many words, with four digits each."""

    def parse(found: bytes) -> tuple[int, ...]:
        return tuple(schema.hex_value(found[place : place + 4]) for place in range(0, len(found), 4))

    def write(words: Any) -> bytes:
        if len(words) != count or any(type(word) is not int or not 0 <= word <= 0xFFFF for word in words):
            raise ValueError(f"{words!r} are not {count} numbers of 0 to 65535")
        return b"".join(b"%04X" % word for word in words)

    return schema.Leaf(4 * count, parse, write, meaning=meaning, alphabet=b"0123456789ABCDEF")


def _form(message: type[Any], begin: bytes, *leaves: Any, to_all: bool = False, **further: Any) -> schema.Form[Any]:
    return schema.Form(
        message,
        schema.constant(begin),
        "address" / schema.hex_number(2, "station", allowed=(*STATIONS, BROADCAST) if to_all else STATIONS),
        *leaves,
        schema.CheckCharacters(2, 1, schema.hex_sum, meaning="sum"),
        schema.constant(b"\x04", "EOT"),
        **further,
    )


def _command(letter: bytes) -> schema.Leaf:
    """Return a leaf of this letter.

    Another letter is a wrong field, not a wrong frame, because drives answer IF to it (S100 p. 237).
    """
    command = schema.choice({letter: None}, "command")
    command.implied = True
    return schema.deciding(command)


def _count(count: int) -> Any:
    return "count" / schema.deciding(schema.choice({b"%d" % count: count}, "number of words"))


def _values(message: type[Any], command: bytes, count: int) -> schema.Form[Any]:
    def is_so(reply: Any) -> bool:
        return isinstance(reply.values, tuple) and len(reply.values) == count

    return _form(message, b"\x06", _command(command), "values" / _words(count, "values"), when=is_so)


class _Codec(schema.Telegrams):
    """Codec for the telegrams of all LS drives."""

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of a telegram with this beginning, even of a damaged one, because drives answer those.

        EOT ends any telegram: one of a wrong size is answered with FE (S100 p. 240). A command in lower case is
        answered with IF (S100 p. 237), so it has the same length as in upper case.
        """
        head = head[: head.find(b"\x04", 4) + 1 or None]
        asked = head[:3] + head[3:4].upper() + head[4:] if direction == "request" else head
        size = super().measure(asked, direction)
        return min(size, len(head)) if head[4:].endswith(b"\x04") else size


def _telegrams() -> schema.Telegrams:
    first = "first" / schema.hex_number(4, "address")
    read_count = "count" / schema.hex_number(1, "number of words, 1 to 8", allowed=COUNTS)
    requests = {"Read (R)": _form(Read, b"\x05", _command(b"R"), first, read_count)}
    requests["Read what is registered (Y)"] = _form(Monitor, b"\x05", _command(b"Y"))
    replies = {"Registered (X)": _form(Registered, b"\x06", _command(b"X"))}
    refused = "command" / schema.characters(1), "error" / schema.choice({each.encode(): each for each in ERRORS})
    replies["Refused"] = _form(Nak, b"\x15", *refused)
    for n in COUNTS:
        write = _command(b"W"), first, _count(n), "values" / _words(n, "values")
        requests[f"Write of {n} (W)"] = _form(Write, b"\x05", *write, to_all=True)
        register = _command(b"X"), _count(n), "addresses" / _words(n, "addresses")
        requests[f"Register {n} (X)"] = _form(Register, b"\x05", *register)
        for title, message, command in (
            ("Data", Data, b"R"),
            ("Written", Written, b"W"),
            ("Monitored", Monitored, b"Y"),
        ):
            replies[f"{title} of {n} ({command.decode()})"] = _values(message, command, n)
    return _Codec(requests, replies)


CODEC = _telegrams()
