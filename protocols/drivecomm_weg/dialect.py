"""Places of the parameters and basic variables of a WEG drive, and the telegrams for them.

`P003` is a parameter, `V02` a basic variable, `V02.low` its low byte. After a NAK, which gives no reason, V02 is read,
whose low byte is an error code (CFW-08 manual p. 144, 181).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, RefusedError, ReplyError, UsageError
from drivecomm.profiles import Access, Dialect, RegisterConversation, RegisterPlace
from drivecomm.protocol import Ask, Intent, Tell, code_texts
from drivecomm_weg.telegrams import Reply, Request

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.protocol import Damaged, Exchange

STATE = RegisterPlace("v", 2)
_NAK, _ANY = 0x15, 9
_ADDRESS = re.compile(r"(?:P([0-6][0-9]{2})|V([0-9]{2}))(?:\.(low|high|[0-9]|1[0-5]))?", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class WegOptions:
    """Options of a drive. equipment: the digit in its codes, 7 for a CFW-08, 8 for a CFW-09."""

    equipment: int = 7

    def __post_init__(self) -> None:
        if type(self.equipment) is not int or self.equipment not in (7, 8):
            raise UsageError("equipment is 7 for a CFW-08 or 8 for a CFW-09; what a drive answers to 9 is on no page")


class WegDialect(Dialect):
    """The variables of one drive."""

    title = "WEG"
    requests = Request
    probe = RegisterPlace("v", 0)
    identity = {"drive_type": "V00"}  # noqa: RUF012 - constant; models explain its codes by equipment
    repeats = {"": ("address",), "data": ("code",)}  # noqa: RUF012 - never changed
    refusals = {_NAK: "there is no such variable, it cannot be read or written now, or the value is not allowed"}  # noqa: RUF012
    codes = {"unknown": _NAK, "read only": _NAK, "running": _NAK, "limits": _NAK}  # noqa: RUF012
    reply_delay_s = 0.012

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an address in the manual. Raises ParameterAddressError."""
        if not (found := _ADDRESS.fullmatch(address)):
            raise ParameterAddressError(
                f"{address!r} is not a variable of a WEG drive; write P000 to P699, V00 to V99, or V02.low for a byte"
            )
        place = RegisterPlace("p", int(found[1])) if found[1] else RegisterPlace("v", int(found[2]))
        return RegisterPlace(place.kind, place.start, found[3]) if found[3] else place

    def address_at(self, place: RegisterPlace) -> str:
        """Return the address of a place as the manual prints it."""
        return f"P{place.start:03d}" if place.kind == "p" else f"V{place.start:02d}"

    def _code(self, place: RegisterPlace) -> str:
        hundreds, rest = divmod(place.start, 100)
        return f"0{hundreds + 1 if place.kind == 'p' else 0}{self.options.equipment}{rest:02d}"

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the request for a variable; its reply names the variable, but a NAK names only the drive."""
        return Ask(message=Request(kind="read", address=self.address, code=self._code(place)), nameless=True)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes a variable; ACK and NAK name only the drive."""
        request = Request(kind="write", address=self.address, code=self._code(place), value=words[0])
        return Ask(message=request, nameless=True)

    def words(self, reply: Any, _place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the value of a reply."""
        return (reply.value,)

    def refusal(self, reply: Any) -> int | None:
        """Return the code of a refusal; None for any other reply."""
        return _NAK if reply.kind == "nak" else None

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return the kinds of reply to a request."""
        return {"read": ("data", "nak"), "write": ("ack", "nak")}.get(request.kind, ())

    def access_of(self, request: Any) -> Access | None:
        """Return the access that a request makes; None for EOT.

        A code for other equipment does not exist in this drive; 9 means any equipment (CFW-08 p. 180).
        """
        if request.kind == "end":
            return None
        hundreds, equipment, rest = int(request.code[1]), int(request.code[2]), int(request.code[3:])
        place = RegisterPlace("p", (hundreds - 1) * 100 + rest) if hundreds else RegisterPlace("v", rest)
        if equipment not in (self.options.equipment, _ANY):
            place = RegisterPlace("u", 0)
        return Access(place=place, words=(request.value,) if request.kind == "write" else None)

    def intent(self, request: Any) -> Intent:
        """Return the intent of a request; EOT only ends an exchange."""
        return Intent() if request.kind == "end" else super().intent(request)

    def read_reply(self, request: Any, words: Sequence[int]) -> Reply:
        """Return the reply to a read."""
        return Reply(kind="data", address=self.address, code=request.code, value=words[0])

    def write_reply(self, request: Any) -> Reply:  # noqa: ARG002 - ACK is the same for all requests
        """Return ACK."""
        return Reply(kind="ack", address=self.address)

    def refusal_reply(self, request: Any, code: int) -> Reply:  # noqa: ARG002 - NAK is the same for all requests
        """Return NAK."""
        return Reply(kind="nak", address=self.address)

    def damage_reply(self, find: Damaged) -> Reply | None:
        """Return NAK for a wrong BCC, and None for any other damage (CFW-08 p. 180)."""
        is_mine = find.data[:3] == bytes([4, 0x40 + self.address, 2])
        return self.refusal_reply(None, _NAK) if is_mine and find.error.category == "checksum" else None


class WegConversation(RegisterConversation):
    """Requests to one drive: each exchange ends with EOT (CFW-08 p. 138), and V02 gives the reason of a NAK."""

    def send_request(self, ask: Ask, called: str, place: RegisterPlace | None = None) -> Exchange[Any]:
        """Send a request, return the reply and close the exchange. Raises RefusedError with the error code from V02."""
        try:
            reply = yield from super().send_request(ask, called, place)
        except RefusedError:
            yield Tell(message=Request(kind="end"), pause_s=0)
            if place is None or replace(place, part="") != STATE:
                yield from self._explained(called)
            raise
        yield Tell(message=Request(kind="end"), pause_s=0)
        return reply

    def _explained(self, called: str) -> Exchange[None]:
        """Raise RefusedError with the reason in V02, which may be that of an earlier fault; return if it gives none."""
        try:
            code = (yield from self.words(STATE, 1, "V02"))[0] & 0xFF
        except (RefusedError, ReplyError):
            return
        if text := code_texts(__file__, "errors.toml").get(code, ""):
            raise RefusedError(called, code, f"{text}, by the error code that V02 shows")
