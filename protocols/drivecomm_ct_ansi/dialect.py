"""How the parameters of a Control Techniques drive stand in ANSI telegrams: menu and parameter, decimal text.

The number of a place is 100 times the menu and the parameter. A drive tells the decimals itself (Unidrive SP Advanced
User Guide p. 402), and cuts off silently what it is sent beyond its own, so that none are sent but those of the model.
"""

from __future__ import annotations

import re
from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UnexpectedReplyError, UsageError, ValueRefusedError
from drivecomm.profiles import Access, Dialect, Place, RegisterRefusal, VirtualRegisterDrive
from drivecomm.protocol import Ask, Framed, difference
from drivecomm_ct_ansi.telegrams import MOST, Reply, Request

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.profiles import Target
    from drivecomm.protocol import Damaged, Message, Model, VirtualReply

LEAST = Decimal("0.001")
"""The finest step of a parameter that no model lists."""
_ADDRESS = re.compile(r"([0-9]{1,2})\.([0-9]{2})", re.ASCII)
_UNKNOWN, _NAK = 0x04, 0x15
_STEPS = {"repeat": 0, "next": 1, "previous": -1}


class CtDialect(Dialect):
    """The parameters of one drive, and, in a virtual one, what short commands refer to."""

    title = "Control Techniques ANSI"
    broadcast_address, joins = 0, True
    probe = Place("", 1040)
    refusals = {  # noqa: RUF012 - never changed
        _UNKNOWN: "there is no such parameter",
        _NAK: "the parameter is unknown or read only, the value is too long or out of range, or it came damaged",
    }
    codes = {"unknown": _UNKNOWN, "read only": _NAK, "running": _NAK, "limits": _NAK}  # noqa: RUF012
    advice = "the terminal ENABLE, 06.43 = 1, and 01.14 = 01.15 = 0 for the reference 01.21"

    def __init__(self, address: int, options: Any, model: Model | None) -> None:
        super().__init__(address, options, model)
        self.shared_addresses = {0, address // 10 * 10}  # of all drives, and of its group (Mentor MP p. 209)
        known = model.parameters.values() if model else ()
        self._factors = {self.place_of(each.address).start: each.factor for each in known}
        self.forget()

    def place_of(self, address: str) -> Place:
        """Return where a parameter is. Raises ParameterAddressError."""
        found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
        if not found:
            raise ParameterAddressError(f"{address!r} is no parameter; write menu and parameter, 01.21 or 1.21")
        return Place("", int(found[1]) * 100 + int(found[2]))

    def address_at(self, place: Place) -> str:
        """Return how manuals print a parameter."""
        return "{:02}.{:02}".format(*divmod(place.start, 100))

    def target(self, parameter: str, type: str = "") -> Target:
        """Return what is to be read or written; every value is a signed decimal number."""
        if type not in ("", "s32"):
            raise UsageError(f"{type!r} is no type of a {self.title} parameter; all are s32")
        found = replace(super().target(parameter, "s32"), wide=True)
        return found if found.info else replace(found, format=replace(found.format, scale=LEAST))

    def reading(self, place: Place, _count: int, /) -> Ask:
        """Return the question for a parameter; its answer names the parameter and no drive, EOT nothing."""
        return self._ask(place, kind="read")

    def writing(self, place: Place, words: Sequence[int], /) -> Ask:
        """Return the telegram that writes a parameter; ACK and NAK name nothing at all."""
        data = self._data(words[0], place)
        if place.start not in self._factors:
            data, _, decimals = data.partition(".")
            if decimals.strip("0"):
                raise ValueRefusedError(
                    f"{self.address_at(place)} is in no model; write a whole number, or list it there"
                )
        return self._ask(place, kind="write", data=data)

    def _ask(self, place: Place, **fields: Any) -> Ask:
        (group, unit), (menu, parameter) = divmod(self.address, 10), divmod(place.start, 100)
        request = Request(group=group, unit=unit, menu=menu, parameter=parameter, **fields)
        return Ask(message=request, nameless=True, anonymous=True)

    def words(self, reply: Any, place: Place, /) -> tuple[int, ...]:
        """Return what a parameter holds. Raises UnexpectedReplyError for decimals that the model does not have."""
        word = self._word(reply.data, place)
        if word is None:
            raise UnexpectedReplyError(
                f"{self.address_at(place)} is {reply.data}, with other decimals; check the model"
            )
        return (word,)

    def _word(self, data: str, place: Place) -> int | None:
        """Return the unsigned number of steps; None for what is no multiple of them. X is taken where a step is 1."""
        step = self._factors.get(place.start, LEAST)
        if data[0] == "X":
            return int(data[1:], 16) if step == 1 else None
        steps = Decimal(data.strip()) / step
        return int(steps) & 0xFFFFFFFF if steps == int(steps) and -(1 << 31) <= steps < 1 << 31 else None

    def _data(self, word: int, place: Place) -> str:
        """Return sign, digits, and the point as the step of the parameter has it."""
        return f"{(word - (word >> 31 << 32)) * self._factors.get(place.start, LEAST):+f}"

    def refusal(self, reply: Any) -> int | None:
        """Return which answer refuses."""
        return {"unknown": _UNKNOWN, "nak": _NAK}.get(reply.kind)

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return what answers a request."""
        return ("ack", "nak") if request.kind in ("write", "rewrite") else ("value", "unknown")

    def mismatch(self, request: Any, reply: Any) -> str:
        """Name the first field in which an answer does not belong to a request; it names the parameter at most."""
        if reply.kind not in self.reply_kinds_of(request):
            return "kind"
        return "" if None in (reply.menu, request.menu) else difference(request, reply, "menu", "parameter")

    def resolved(self, request: Any) -> Any:
        """Return what a request means for this drive: a short one is about the drive and parameter named last."""
        if request.address is not None:
            self._is_addressed = request.address == self.address
            return request
        group, unit = divmod(self.address, 10)
        if self._is_addressed and request.kind == "rewrite":
            return replace(request, kind="write", group=group, unit=unit)
        if not self._is_addressed or self._last is None:
            return request
        menu, parameter = divmod(self._last, 100)
        return Request(kind="read", group=group, unit=unit, menu=menu, parameter=parameter + _STEPS[request.kind])

    def forget(self) -> None:
        """Forget which drive and parameter were named last."""
        self._is_addressed = False
        self._last: int | None = None

    def meant(self, request: Any) -> Access:
        """Return what a request does. Raises RegisterRefusal for decimals that a parameter does not have."""
        if request.menu is None:
            return Access(place=self.probe)
        if not 0 <= request.parameter < 100:
            raise RegisterRefusal("unknown")
        place = Place("", request.menu * 100 + request.parameter)
        if request.kind == "read":
            return Access(place=place)
        step = self._factors.get(place.start, LEAST)
        is_hex = request.data[0] == "X"
        # Decimals that the parameter does not have are cut (Unidrive SP p. 402).
        steps = int(request.data[1:], 16) if is_hex else int(Decimal(request.data.strip()) / step)
        if self.model is not None and ((is_hex and step != 1) or not -(1 << 31) <= steps < 1 << 31):
            raise RegisterRefusal("limits")
        return Access(place=place, words=(steps & 0xFFFFFFFF,))

    def told(self, request: Any, words: Sequence[int]) -> Reply:
        """Return the answer with a value."""
        place = self.meant(request).place
        self._last = place.start
        data = self._data(words[0], place)[:MOST]
        return Reply(kind="value", menu=request.menu, parameter=request.parameter, data=data)

    def taken(self, request: Any) -> Reply:
        """Return ACK."""
        self._last = self.meant(request).place.start
        return Reply(kind="ack")

    def refused(self, request: Any, code: int) -> Reply:
        """Return EOT to a question for a parameter that is none, and else NAK."""
        return Reply(kind="unknown" if request.kind == "read" and code == _UNKNOWN else "nak")

    def damaged(self, find: Damaged) -> Message | None:
        """Return NAK for a value that came damaged (UD p. 6-10); a question has no check character."""
        group, unit = divmod(self.address, 10)
        is_mine = find.data[:6] == b"\x04%d%d%d%d\x02" % (group, group, unit, unit)
        return Reply(kind="nak") if is_mine and find.error.category in ("checksum", "field") else None


class VirtualCtDrive(VirtualRegisterDrive):
    """A drive that keeps in mind whether it was addressed last, and the last parameter that it had."""

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram, short ones as what they mean now."""
        dialect: Any = self._dialect
        if isinstance(find, Framed):
            find = replace(find, message=dialect.resolved(find.message))
        return super().hear(find, now)
