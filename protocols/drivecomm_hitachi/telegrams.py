"""Telegrams of Hitachi's ASCII protocol (SJ300 manual NB613X, p. B-5 to B-18; SJ700-2 manual, p. 4-116 to 4-128).

    request   STX node command data BCC CR
    reply     STX node ACK BCC CR              to 00 01 02 12 07 0A 0B
              STX node ACK data BCC CR         to 06 (8 characters) and 09 (2)
              STX node data BCC CR             to 03 (104 characters), 04 (8) and 05 (440)
              STX node NAK code BCC CR         to all

STX is 02H, ACK 06H, NAK 15H. The node is 01 to 32, or FF for all drives, which none answers (p. B-5). BCC is the
exclusive-or of all characters between STX and itself, in two hexadecimal digits (SJ700-2 p. 4-128). No reply names its
request: only its length and its ACK or NAK can be checked, and a late reply can be mistaken for the next one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from drivecomm.protocol import Direction, schema

ADDRESSES = range(1, 33)
BROADCAST = 255
MONITORED, TERMINALS, RECORDED = range(1, 14), frozenset({5, 6}), range(55)
"""Numbers of the eight-character values in a reply to 03, of the hexadecimal terminals among them, and of 05.

05 returns the number of trips, and nine values of each of six (SJ300 p. B-9, B-11).
"""
REQUESTS = {
    "run": "00", "frequency": "01", "terminals": "02", "further_terminals": "12", "monitor": "03", "status": "04",
    "history": "05", "read": "06", "write": "07", "initialise": "08", "check": "09", "store": "0A", "recalculate": "0B",
}  # fmt: skip
"""Commands by kind of request (SJ300 p. B-5; 12: SJ700 p. B-7)."""

_FOR_ALL = frozenset({"run", "frequency", "terminals", "further_terminals", "initialise", "recalculate"})
_NODES = {b"%02d" % node: node for node in ADDRESSES}


@dataclass(frozen=True, slots=True, kw_only=True)
class Telegram:
    """One telegram.

    node: the address, 255 for all drives. address: the same, by the name that all protocols use. value: the value
    commanded or written. parameter: its letter and three digits. data: the data in a reply. error: code of a refusal.
    """

    kind: str
    node: int | None = None
    address: int | None = None
    value: int | None = None
    parameter: str | None = None
    data: str | None = None
    error: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, *(("node", self.address) if self.address is not None else ("address", self.node)))


class Request(Telegram):
    """A telegram of the master."""


class Reply(Telegram):
    """A reply of a drive: ack, ack_data, data or nak."""


def _form(message: type[Any], *leaves: Any, nodes: dict[bytes, int] = _NODES, **further: Any) -> schema.Form[Any]:
    reads = {"address": lambda node: node, **further.pop("reads", {})}
    return schema.Form(
        message,
        schema.constant(b"\x02", "STX"),
        "node" / schema.choice(nodes, "node, FF for all" if b"FF" in nodes else "node"),
        *leaves,
        schema.CheckCharacters(
            2, 1, lambda covered: b"%02X" % schema.xor_byte(covered)[0], meaning="BCC: all behind STX"
        ),
        schema.constant(b"\r", "CR"),
        reads=reads,
        **further,
    )


def _text(size: int, pattern: str, meaning: str) -> schema.Leaf:
    """Return a leaf of characters that match a regular expression."""
    allowed = re.compile(pattern)

    def parse(found: bytes) -> str:
        text = found.decode("ascii")
        if not allowed.fullmatch(text):
            raise ValueError(f"{text!r} is not {meaning}")
        return text

    def write(text: str) -> bytes:
        return parse(text.encode("ascii")).encode("ascii")

    return schema.Leaf(size, parse, write, meaning=meaning, alphabet=bytes(range(0x20, 0x7F)))


def _request(kind: str) -> schema.Form[Any]:
    command = REQUESTS[kind]
    kinds = "kind" / schema.deciding(schema.choice({command.encode(): kind}, f"{command}: {kind}"))
    parameter = "parameter" / _text(4, "[A-Za-z][0-9]{3}", "the letter of a parameter and three digits")
    leaves = {
        "run": ["value" / schema.choice({b"0": 0, b"1": 1, b"2": 2}, "0 stop, 1 forward, 2 reverse")],
        "frequency": ["value" / schema.decimal_number(6, meaning="0.01 Hz")],
        "terminals": ["value" / schema.hex_number(16, "terminals, a bit each")],
        "further_terminals": ["value" / schema.hex_number(16, "further terminals, a bit each")],
        "read": [parameter],
        "write": [parameter, "value" / schema.decimal_number(8, meaning="value, without its point")],
    }
    nodes = {**_NODES, b"FF": BROADCAST} if kind in _FOR_ALL else _NODES
    check = _never if kind == "initialise" else None
    return _form(Request, kinds, *leaves.get(kind, ()), nodes=nodes, check=check)


def _never(message: Request) -> None:
    raise schema.wrong_field("kind", f"{message.kind} is the factory reset, and is never sent from here")


def _reply(kind: str, *before: Any, data: schema.Leaf | None = None) -> schema.Form[Any]:
    def is_so(reply: Reply) -> bool:
        return reply.kind == kind and (data is None or len(str(reply.data)) == data.size)

    def check(reply: Reply) -> None:
        if reply.kind != kind:
            raise schema.wrong_field("kind", f"no reply of a drive is {reply.kind!r}")

    leaves = before if data is None else (*before, "data" / data)
    return _form(Reply, *leaves, reads={"kind": lambda: kind}, when=is_so, check=check)


class _Codec(schema.Telegrams):
    """Codec for the telegrams of all Hitachi drives."""

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of a telegram with this beginning.

        CR ends any telegram, also a reply that a drive overhears.
        """
        size, end = super().measure(head, direction), head.find(b"\r") + 1
        return end if 0 < end < size else size


_ACK = schema.constant(b"\x06", "ACK")
CODEC = _Codec(
    {kind.replace("_", " ").capitalize(): _request(kind) for kind in REQUESTS},
    {
        "Done": _reply("ack", _ACK),
        "Parameter": _reply("ack_data", _ACK, data=_text(8, "[0-9]*", "a value in decimal digits, without its point")),
        "Storable": _reply("ack_data", _ACK, data=_text(2, "0[01]", "01, if values can be stored, or 00")),
        "States": _reply("data", data=_text(8, "[0-9]*", "states A, B and C, and 00")),
        "Monitored": _reply("data", data=_text(104, "[0-9]{32}[0-9A-F]{16}[0-9]*", "13 values, terminals hexadecimal")),
        "Trips": _reply("data", data=_text(440, "[0-9]{8}([0-9A-F]{32}[0-9]{40})*", "the number of trips, six trips")),
        "Refused": _reply("nak", schema.constant(b"\x15", "NAK"), "error" / _text(2, "[0-9]*", "a code of two digits")),
    },
)
