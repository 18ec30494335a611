"""Parameters of a drive in EI Bisynch telegrams: mnemonics of two characters, and values as text.

The kind of a place is the format of its values (590+ manual p. A-12). `w`, which is `u16` in a model, is BOOL, WORD or
ENUM, hexadecimal after `>`. No kind, which is `s32` in a model, is INT or TAG, decimal with a point.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UnexpectedReplyError, UsageError, ValueRefusedError
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal
from drivecomm.protocol import Ask, difference
from drivecomm_ei_bisynch.telegrams import EiAnswer, EiEnquiry, EiSelection, EiValue, is_value

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.profiles import RegisterParameter
    from drivecomm.protocol import Damaged, Message, Model

LEAST = Decimal("0.0001")
"""Finest step of INT, and of a parameter that no model lists."""
NO_ERROR, CHECKSUM, OVERRUN, INVALID = 0x00C0, 0x02C2, 0x03C2, 0x07C8
"""Error codes in EE to which this package reacts."""
_KINDS = {"s32": "", "u16": "w"}
_REFUSALS = {"nak": 0x15, "end": 0x04}


def number_of(mnemonic: str) -> int:
    """Return the number of the place with this mnemonic."""
    return ord(mnemonic[0]) * 128 + ord(mnemonic[1])


ERRORS = RegisterPlace("w", number_of("EE"))
"""Place of the error register (590 manual p. 14-10, P65 p. 25)."""


class EiDialect(Dialect):
    """The parameters of one drive."""

    title = "EI Bisynch"
    types = ("s32", "u16")
    probe = RegisterPlace("w", number_of("II"))
    identity = {"instrument": "II"}  # noqa: RUF012 - never changed
    refusals = {  # noqa: RUF012 - never changed
        0x15: "it was not taken, and EE was not read", 0x04: "no such parameter, or an error, and EE was not read",
        NO_ERROR: "EE reports no error", 0x01C7: "invalid mnemonic",
        CHECKSUM: "wrong check character; if only some writes fail so, try the option lift=true",
        OVERRUN: "framing error or overrun", 0x04C8: "it can only be written", 0x05C8: "it can only be read",
        0x07C7: "invalid message format", INVALID: "invalid data", 0x08C8: "out of range",
    }  # fmt: skip
    reason, damage = ERRORS, (CHECKSUM, OVERRUN)
    codes = {  # noqa: RUF012 - never changed
        "unknown": 0x01C7, "read only": 0x05C8, "running": INVALID, "limits": 0x08C8,
        "checksum": CHECKSUM, "field": INVALID,
    }  # fmt: skip

    def __init__(self, address: int, options: Any, model: Model | None) -> None:
        super().__init__(address, options, model)
        self.shared_addresses = ()
        known = {number_of(each.address): each for each in (model.parameters.values() if model else ())}
        self._types = {ERRORS.start: "u16", self.probe.start: "u16"} | {each: it.type for each, it in known.items()}
        self._factors = {each: it.factor for each, it in known.items()}
        self._is_bool = {each for each, it in known.items() if it.maximum == 1}

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of a parameter. Raises ParameterAddressError."""
        if not isinstance(address, str) or len(address) != 2 or not all("!" <= each <= "~" for each in address):
            raise ParameterAddressError(f"{address!r} is not a mnemonic of two characters, such as II or 0F")
        number = number_of(address)
        return RegisterPlace(_KINDS[self._types.get(number) or "s32"], number)

    def address_at(self, place: RegisterPlace) -> str:
        """Return the mnemonic of a place."""
        return "".join(map(chr, divmod(place.start, 128)))

    def is_wide(self, place: RegisterPlace, type: str) -> bool:  # noqa: ARG002 - the type decides alone
        """Return whether one place holds 32 bits, which is so for a decimal number in steps of its factor."""
        return type == "s32"

    def target(self, parameter: str, type: str = "") -> RegisterParameter:
        """Return the parameter to read or write; one that no model lists is decimal unless `type` says otherwise."""
        info = self.model.find(parameter) if self.model else None
        place = self.place_of(info.address if info else parameter)
        kind = type or self._types.get(place.start) or "s32"
        if kind not in _KINDS:
            raise UsageError(f"{kind!r} is not a type of an EI Bisynch parameter; types are {', '.join(_KINDS)}")
        found = replace(super().target(parameter, kind), place=RegisterPlace(_KINDS[kind], place.start))
        return found if found.info or kind != "s32" else replace(found, format=replace(found.format, scale=LEAST))

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the read request for a parameter.

        A reply with a value names the parameter and no drive; EOT names neither.
        """
        return self._ask(EiEnquiry, place)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the write request for a parameter. Raises ValueRefusedError for too many digits.

        A value has at most five digits before the point, and four after it.
        """
        data = self._data(words[0], place)
        if not is_value(data):
            raise ValueRefusedError(
                f"{data} for {self.address_at(place)} has more than five digits before the point, or four behind it"
            )
        return self._ask(EiSelection, place, data=data)

    def _ask(self, message: Any, place: RegisterPlace, **fields: Any) -> Ask:
        group, unit = divmod(self.address, 16)
        request = message(group=group, unit=unit, mnemonic=self.address_at(place), **fields)
        return Ask(message=request, nameless=True, anonymous=True)

    def words(self, reply: Any, place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the value of a parameter. Raises UnexpectedReplyError for a value in another format."""
        word = self._word(reply.data, place)
        if word is None:
            kind = "u16" if reply.data[0] == ">" else "s32"
            hint = "it has more decimals than the model says" if _KINDS[kind] == place.kind else f"read it as {kind}"
            raise UnexpectedReplyError(f"{self.address_at(place)} is {reply.data}, in another format; {hint}")
        return (word,)

    def _word(self, data: str, place: RegisterPlace) -> int | None:
        """Return the unsigned number for a value in a telegram; None for a value of another format."""
        if data[0] == ">":
            return int(data[1:], 16) if place.kind else None
        steps = Decimal(data) / self._factors.get(place.start, LEAST)
        return int(steps) & 0xFFFFFFFF if not place.kind and steps == int(steps) else None

    def _data(self, word: int, place: RegisterPlace) -> str:
        if place.kind:
            return f">{word:0{2 if place.start in self._is_bool else 4}X}"
        text = f"{(word - (word >> 31 << 32)) * self._factors.get(place.start, LEAST):f}"
        return text.rstrip("0") if "." in text else f"{text}."

    def refusal(self, reply: Any) -> int | None:
        """Return the refusal code of a reply, None if it does not refuse; the register EE gives the reason."""
        return _REFUSALS.get(reply.kind)

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return the possible kinds of reply to a request."""
        return ("ack", "nak") if request.kind == "selection" else ("value", "end")

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the first field in which a reply does not belong to a request; a reply names at most the parameter."""
        if reply.kind not in self.reply_kinds_of(request):
            return "kind"
        return difference(request, reply, "mnemonic") if reply.kind == "value" else ""

    def access_of(self, request: Any) -> Access:
        """Return the effect of a request. Raises RegisterRefusal for a value in another format than the parameter's."""
        place = self.place_of(request.mnemonic)
        if request.kind == "enquiry":
            return Access(place=place)
        if place == ERRORS:
            return Access(place=place, words=(NO_ERROR,))  # any write to it has this effect
        word = self._word(request.data, place)
        if word is None and self.model is not None:
            raise RegisterRefusal("limits")
        return Access(place=place, words=(word or 0,))

    def read_reply(self, request: Any, words: Sequence[int]) -> Message:
        """Return the reply with a value."""
        return EiValue(mnemonic=request.mnemonic, data=self._data(words[0], self.place_of(request.mnemonic)))

    def write_reply(self, request: Any) -> Message:  # noqa: ARG002 - ACK names nothing
        """Return ACK."""
        return EiAnswer(kind="ack")

    def refusal_reply(self, request: Any, code: int) -> Message:  # noqa: ARG002 - EE holds the code
        """Return EOT to an enquiry, and NAK to a selection."""
        return EiAnswer(kind="end" if request.kind == "enquiry" else "nak")

    def damage_reply(self, find: Damaged) -> Message | None:
        """Return NAK for a write to this drive that arrived damaged; an enquiry has no check character."""
        head = "\x04{0}{0}{1:X}{1:X}\x02".format(*divmod(self.address, 16)).encode()
        is_mine = find.data[:6] == head and find.error.category in self.codes
        return EiAnswer(kind="nak") if is_mine else None
