"""Codes of a Lenze drive in LECOM telegrams.

The number of a place is its code, plus 65536 times its subcode. The kind is the format, the column "Format" of the
manuals' attribute tables (8200 motec EDB82MV752 p. 14-51), which a model gives as the type: `s32` is VD, decimal;
`u16`, `s16` and `u32` are VH, hexadecimal; `string` is VS, a text, or VO, octets (L p. 8-18, 8-19).
"""

from __future__ import annotations

import re
from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UnexpectedReplyError, UsageError, ValueRefusedError
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal
from drivecomm.protocol import Ask, difference
from drivecomm_lecom.telegrams import CODES, Reply, Request

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.profiles import RegisterParameter
    from drivecomm.protocol import Damaged, Model

LEAST = Decimal("0.0001")
"""Resolution of the drives, which calculate with four decimals (9200 manual p. 60, 8615E manual p. 113)."""
_KINDS = {"s32": "", "u16": "h", "s16": "h", "u32": "l", "string": "s"}
_ADDRESS = re.compile(r"C([0-9]{1,5})(?:/([0-9]{1,3}))?|P([0-9]{3})", re.ASCII)
_SUBCODES, _MENU, _SOFTWARE = 1 << 16, 1000, 200
_REFUSALS = {"fault": 0x3F, "unknown": 0x04, "nak": 0x15}


class LecomDialect(Dialect):
    """The codes of one Lenze drive, and the telegrams for them."""

    title = "LECOM"
    broadcast_address, joins = 0, True
    probe = RegisterPlace("", 9)
    refusals = {  # noqa: RUF012 - never changed
        0x3F: "the request came damaged", 0x04: "there is no such code",
        0x15: "the code cannot be written, or not now, the value is outside its range, or it came damaged",
    }  # fmt: skip
    codes = {"unknown": 0x04, "read only": 0x15, "running": 0x15, "limits": 0x15, "not set up": 0x15}  # noqa: RUF012

    def __init__(self, address: int, options: Any, model: Model | None) -> None:
        super().__init__(address, options, model)
        self.shared_addresses = {0, address // 10 * 10}  # of all drives, and of the drive's group (L p. 6-3)
        known = {_number(each.address): each for each in (model.parameters.values() if model else ())}
        self._types = {_SOFTWARE: "string"} | {number: each.type or "s32" for number, each in known.items()}
        self._factors = {number: each.factor for number, each in known.items()}
        self.identity = {"software": "C0200", **(model.control.get("identity", {}) if model else {})}

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of a code. Raises ParameterAddressError."""
        return self._place(_number(address))

    def _place(self, number: int) -> RegisterPlace:
        return RegisterPlace(_KINDS[self._types.get(number, "s32")], number)

    def address_at(self, place: RegisterPlace) -> str:
        """Return the code of a place as manuals print it."""
        subcode, code = divmod(place.start, _SUBCODES)
        return f"C{code:04d}" + (f"/{subcode}" if subcode else "")

    def target(self, parameter: str, type: str = "") -> RegisterParameter:
        """Return the target of a read or write; a code unknown to the model is decimal unless `type` is given."""
        info = self.model.find(parameter) if self.model else None
        number = _number(info.address if info else parameter)
        kind = type or self._types.get(number, "s32")
        if kind not in _KINDS:
            raise UsageError(f"{kind!r} is not a type of a LECOM code; types are {', '.join(_KINDS)}")
        found = replace(super().target(parameter, kind), place=RegisterPlace(_KINDS[kind], number), wide=True)
        return replace(found, format=replace(found.format, scale=LEAST)) if kind == "s32" else found

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the request for a code; the answer names the code but no drive, and a NAK names neither."""
        return self._ask(place, kind="receive")

    def writing(self, place: RegisterPlace, words: Sequence[Any], /) -> Ask:
        """Return the telegram that writes a code; ACK and NAK name neither code nor drive (L p. 8-20)."""
        if place.kind == "s":
            raise ValueRefusedError(f"{self.address_at(place)} is a text, and drives take none over LECOM")
        return self._ask(place, kind="send", data=self._data(words[0], place))

    def _ask(self, place: RegisterPlace, **fields: Any) -> Ask:
        subcode, code = divmod(place.start, _SUBCODES)
        is_long = subcode > 0 or code not in CODES  # two characters cannot express this code (L p. 8-16, 8-18)
        request = Request(address=self.address, code=code, subcode=subcode, extended=is_long, **fields)
        return Ask(message=request, nameless=True, anonymous=True)

    def words(self, reply: Any, place: RegisterPlace, /) -> tuple[Any, ...]:
        """Return the value of a code. Raises UnexpectedReplyError for a value in another format."""
        word = self._word(reply.data, place)
        if word is None:
            fits = [
                each for each, kind in _KINDS.items() if self._word(reply.data, replace(place, kind=kind)) is not None
            ]
            hint = f"read it with type={fits[0]}" if fits else "it has more decimals than the model says"
            raise UnexpectedReplyError(f"{self.address_at(place)} is {reply.data}, in another format; {hint}")
        return (word,)

    def _word(self, data: str, place: RegisterPlace) -> Any:
        """Return the unsigned number or the text in a telegram; None for a value in another format."""
        if data[0] in "SO":
            return data[1:] if place.kind == "s" else None
        if data[0] == "H":
            return int(data[1:], 16) if place.kind == "l" or (place.kind == "h" and len(data) <= 5) else None
        steps = Decimal(data) / self._factors.get(place.start, LEAST)
        return int(steps) & 0xFFFFFFFF if not place.kind and steps == int(steps) else None

    def _data(self, word: Any, place: RegisterPlace) -> str:
        if place.kind:
            return f"S{word or ' '}" if place.kind == "s" else f"H{word:0{8 if place.kind == 'l' else 4}X}"
        text = f"{(word - (word >> 31 << 32)) * self._factors.get(place.start, LEAST):f}"
        return text.rstrip("0").rstrip(".") if "." in text else text

    def refusal(self, reply: Any) -> int | None:
        """Return the code of a refusal; None for any other answer."""
        return _REFUSALS.get(reply.kind)

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return the kinds of answer to a request; SMV p. 15 also has NAK for an invalid read."""
        return ("ack", "nak") if request.kind == "send" else ("value", "unknown", "fault", "nak")

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the first field in which an answer does not belong to a request; an answer names at most the code."""
        if reply.kind not in self.reply_kinds_of(request):
            return "kind"
        return "" if reply.code is None else difference(request, reply, "code", "subcode", "extended")

    def access_of(self, request: Any) -> Access:
        """Return the access that a request makes.

        Raises RegisterRefusal for a value in another format than that of the code.
        """
        place = self._place(request.subcode * _SUBCODES + request.code)
        if request.kind == "receive":
            return Access(place=place)
        word = self._word(request.data, place)
        if word is None and self.model is not None:
            raise RegisterRefusal("limits")
        return Access(place=place, words=(word,))

    def read_reply(self, request: Any, words: Sequence[Any]) -> Reply:
        """Return the answer with a value."""
        return self._reply(request, kind="value", data=self._data(words[0], self.access_of(request).place))

    def write_reply(self, request: Any) -> Reply:  # noqa: ARG002 - ACK is the same for all requests
        """Return ACK."""
        return Reply(kind="ack")

    def refusal_reply(self, request: Any, code: int) -> Reply:
        """Return the refusal of a request: "unknown" if a read names a code that does not exist, otherwise NAK."""
        is_asked = request.kind == "receive" and code == _REFUSALS["unknown"]
        return self._reply(request, kind="unknown") if is_asked else Reply(kind="nak")

    def _reply(self, request: Any, **fields: Any) -> Reply:
        return Reply(code=request.code, subcode=request.subcode, extended=request.extended, **fields)

    def damage_reply(self, find: Damaged) -> Reply | None:
        """Return NAK for a damaged value (L p. 8-20); a read request has no check characters."""
        is_mine = find.data[:4] == b"\x04%02d\x02" % self.address
        return Reply(kind="nak") if is_mine and find.error.category in ("checksum", "field") else None


def _number(address: str) -> int:
    found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
    code, subcode = (int(found[1] or _MENU + int(found[3] or 0)), int(found[2] or 0)) if found else (-1, 0)
    if code not in range(_SUBCODES) or subcode not in range(256):
        raise ParameterAddressError(
            f"{address!r} is not a code of a Lenze drive; write C0046, C0410/3 with a subcode, or P103 of an SMV"
        )
    return subcode * _SUBCODES + code
