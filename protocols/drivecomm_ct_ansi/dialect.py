"""Parameters of a Control Techniques drive in ANSI telegrams: menu and parameter, and values as decimal text.

The number of a place is 100 times the menu plus the parameter. A drive sends the decimals itself (Unidrive SP Advanced
User Guide p. 402). It silently cuts off received decimals beyond its own, so only those of the model are sent.
"""

from __future__ import annotations

import re
from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UnexpectedReplyError, ValueRefusedError
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal
from drivecomm.protocol import Ask, difference
from drivecomm_ct_ansi.telegrams import MOST, CtReply, CtRequest

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.profiles import RegisterParameter
    from drivecomm.protocol import Damaged, Message, Model

LEAST = Decimal("0.001")
"""Finest step of a parameter that no model lists."""
_ADDRESS = re.compile(r"([0-9]{1,2})\.([0-9]{2})", re.ASCII)
_UNKNOWN, _NAK = 0x04, 0x15
_STEPS = {"repeat": 0, "next": 1, "previous": -1}


class CtDialect(Dialect):
    """The parameters of one drive, and, in a virtual one, the drive and parameter to which short commands refer."""

    title = "Control Techniques ANSI"
    broadcast_address, types, probe, continues = 0, ("s32",), RegisterPlace("", 1040), True
    refusals = {  # noqa: RUF012 - never changed
        _UNKNOWN: "there is no such parameter",
        _NAK: "the parameter is unknown or read only, the value is too long or out of range, or it came damaged",
    }
    codes = {"unknown": _UNKNOWN, "read only": _NAK, "running": _NAK, "limits": _NAK}  # noqa: RUF012
    advice = "the terminal ENABLE, 06.43 = 1, and 01.14 = 01.15 = 0 for the reference 01.21"

    def __init__(self, address: int, options: Any, model: Model | None) -> None:
        super().__init__(address, options, model)
        self.shared_addresses = {0, address // 10 * 10}  # of all drives, and of the drive's group (Mentor MP p. 209)
        known = model.parameters.values() if model else ()
        self._factors = {self.place_of(each.address).start: each.factor for each in known}
        self.forget()

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of a parameter. Raises ParameterAddressError."""
        found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
        if not found:
            raise ParameterAddressError(f"{address!r} is not a parameter; write menu and parameter, 01.21 or 1.21")
        return RegisterPlace("", int(found[1]) * 100 + int(found[2]))

    def address_at(self, place: RegisterPlace) -> str:
        """Return a parameter's address as manuals print it."""
        return "{:02}.{:02}".format(*divmod(place.start, 100))

    def target(self, parameter: str, type: str = "") -> RegisterParameter:
        """Return the parameter to read or write; every value is a signed decimal number."""
        found = super().target(parameter, type)
        return found if found.info else replace(found, format=replace(found.format, scale=LEAST))

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the read request for a parameter.

        A reply with a value names the parameter and no drive; EOT names neither.
        """
        return self._ask(place, kind="read")

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the write request for a parameter; the replies ACK and NAK name neither parameter nor drive."""
        data = self._data(words[0], place)
        if place.start not in self._factors:
            data, _, decimals = data.partition(".")
            if decimals.strip("0"):
                raise ValueRefusedError(
                    f"{self.address_at(place)} is in no model; write a whole number, or list it there"
                )
        return self._ask(place, kind="write", data=data)

    def _ask(self, place: RegisterPlace, **fields: Any) -> Ask:
        (group, unit), (menu, parameter) = divmod(self.address, 10), divmod(place.start, 100)
        request = CtRequest(group=group, unit=unit, menu=menu, parameter=parameter, **fields)
        return Ask(message=request, nameless=True, anonymous=True)

    def words(self, reply: Any, place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the value of a parameter. Raises UnexpectedReplyError for decimals that the model does not have."""
        steps = self._steps(reply.data, place)
        if steps is None or steps % 1:
            raise UnexpectedReplyError(
                f"{self.address_at(place)} is {reply.data}, with other decimals; check the model"
            )
        return (int(steps) & 0xFFFFFFFF,)

    def _steps(self, data: str, place: RegisterPlace) -> Decimal | None:
        """Return a value in steps of its parameter; None for too many steps, and for X if a step is not 1."""
        step = self._factors.get(place.start, LEAST)
        if data[0] == "X":
            number = int(data[1:], 16)
            return Decimal(number - (number >> 31 << 32)) if step == 1 else None
        steps = Decimal(data.strip()) / step
        return steps if -(1 << 31) <= steps < 1 << 31 else None

    def _data(self, word: int, place: RegisterPlace) -> str:
        """Return sign, digits and decimal point of a value, with the decimals of its parameter's step."""
        return f"{(word - (word >> 31 << 32)) * self._factors.get(place.start, LEAST):+f}"

    def refusal(self, reply: Any) -> int | None:
        """Return the refusal code of a reply; None if it does not refuse."""
        return {"unknown": _UNKNOWN, "nak": _NAK}.get(reply.kind)

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return the possible kinds of reply to a request."""
        return ("ack", "nak") if request.kind in ("write", "rewrite") else ("value", "unknown")

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the first field in which a reply does not belong to a request; a reply names at most the parameter."""
        if reply.kind not in self.reply_kinds_of(request):
            return "kind"
        return "" if None in (reply.menu, request.menu) else difference(request, reply, "menu", "parameter")

    def complete_request(self, request: Any) -> Any:
        """Return a request of this drive as a full one; a short one refers to the drive and parameter named last."""
        group, unit = divmod(self.address, 10)
        if request.address is not None:
            self._is_addressed = request.address == self.address
        elif self._is_addressed and request.kind == "rewrite":
            return replace(request, kind="write", group=group, unit=unit)
        elif self._is_addressed and self._last is not None:
            menu, parameter = divmod(self._last, 100)
            return CtRequest(kind="read", group=group, unit=unit, menu=menu, parameter=parameter + _STEPS[request.kind])
        return request

    def forget(self) -> None:
        """Forget the drive and parameter that were named last."""
        self._is_addressed = False
        self._last: int | None = None

    def access_of(self, request: Any) -> Access:
        """Return the effect of a request. Raises RegisterRefusal for an invalid parameter number or value."""
        if request.menu is None:
            return Access(place=self.probe)
        if not 0 <= request.parameter < 100:
            raise RegisterRefusal("unknown")
        place = RegisterPlace("", request.menu * 100 + request.parameter)
        if request.kind == "read":
            return Access(place=place)
        steps = self._steps(request.data, place)
        if steps is None and self.model is not None:
            raise RegisterRefusal("limits")
        # The drive cuts off decimals that the parameter does not have (Unidrive SP p. 402).
        return Access(place=place, words=(int(steps or 0) & 0xFFFFFFFF,))

    def read_reply(self, request: Any, words: Sequence[int]) -> CtReply:
        """Return the reply with a value."""
        place = self.access_of(request).place
        self._last = place.start
        data = self._data(words[0], place)[:MOST]
        return CtReply(kind="value", menu=request.menu, parameter=request.parameter, data=data)

    def write_reply(self, request: Any) -> CtReply:
        """Return ACK."""
        self._last = self.access_of(request).place.start
        return CtReply(kind="ack")

    def refusal_reply(self, request: Any, code: int) -> CtReply:
        """Return EOT for a read of an unknown parameter, otherwise NAK."""
        return CtReply(kind="unknown" if request.kind == "read" and code == _UNKNOWN else "nak")

    def damage_reply(self, find: Damaged) -> Message | None:
        """Return NAK for a write that arrived damaged (UD p. 6-10); a read request has no check character."""
        group, unit = divmod(self.address, 10)
        is_mine = find.data[:6] == b"\x04%d%d%d%d\x02" % (group, group, unit, unit)
        return CtReply(kind="nak") if is_mine and find.error.category in ("checksum", "field") else None
