"""Addresses of an LS drive in LS bus telegrams, and the replies of a drive.

`0x0005` is an address as the manuals of iG5A print it; those of S100 write 0h0005. No reply repeats the address.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal, VirtualRegisterDrive
from drivecomm.protocol import Ask, code_texts
from drivecomm_ls_bus import telegrams as sent

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.protocol import Damaged, Message

WRITE_ENABLE = RegisterPlace("", 4)
"""While this place holds 0, a drive of the iG family accepts no other write (SV-iG5A manual p. 11-3)."""
_ADDRESS = re.compile("0[xh]([0-9A-Fa-f]{4})", re.ASCII)
_CODES = {"IF": 1, "IA": 2, "ID": 3, "WM": 20, "FE": 255}
_ERRORS = {code: error for error, code in _CODES.items()}
_COMMANDS = {"read": "R", "write": "W", "register": "X", "monitor": "Y"}
_REPLIES = {"read": "data", "write": "written", "register": "registered", "monitor": "monitored"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LsBusOptions:
    """LS drives have no options."""


class LsBusDialect(Dialect):
    """The addresses of one drive. registered: addresses registered by X for Y, in a virtual drive."""

    title = "LS bus"
    broadcast_address = sent.BROADCAST
    requests = (sent.Read, sent.Write, sent.Register, sent.Monitor)
    identity = {"inverter_model": "0x0000"}  # noqa: RUF012 - constant
    refusals = code_texts(__file__, "errors.toml")
    codes = {"unknown": 2, "read only": 20, "running": 20, "limits": 3}  # noqa: RUF012 - constant
    joins, most = True, sent.COUNTS[-1]
    follows = ("acceleration_time", "deceleration_time")
    reply_delay_s = 0.01
    advice = (
        "that it is set at its keypad to take its commands and its frequency from RS-485, and that no terminal stops it"
    )
    registered: tuple[int, ...] = ()

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an address in the manual. Raises ParameterAddressError."""
        if not (found := _ADDRESS.fullmatch(address)):
            raise ParameterAddressError(
                f"{address!r} is not an address of an LS drive; write four digits, such as 0x000A"
            )
        return RegisterPlace("", int(found[1], 16))

    def address_at(self, place: RegisterPlace) -> str:
        """Return the address of a place as the manual prints it."""
        return f"0x{place.start:04X}"

    def reading(self, place: RegisterPlace, count: int, /) -> Ask:
        """Return the request that reads consecutive addresses; a reply names its drive but no address."""
        return Ask(message=sent.Read(address=self.address, first=place.start, count=count), nameless=True)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes consecutive addresses."""
        return Ask(message=self._write(place, tuple(words)), nameless=True)

    def _write(self, place: RegisterPlace, words: tuple[int, ...]) -> Any:
        return sent.Write(address=self.address, first=place.start, count=len(words), values=words)

    def words(self, reply: Any, _place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the values of a reply."""
        told: tuple[int, ...] = reply.values
        return told

    def refusal(self, reply: Any) -> int | None:
        """Return the number of a refusal; None for any other reply."""
        return _CODES[reply.error] if reply.kind == "nak" else None

    def reply_kinds_of(self, request: Any) -> Collection[str]:
        """Return the kinds of reply to a request."""
        return _REPLIES[request.kind], "nak"

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the part in which a sound reply does not belong to a request: station, command or number of words.

        The words themselves are not compared: the words that iG5A repeats may be those of the write before (SV-iG5A
        manual p. 11-5).
        """
        if getattr(reply, "address", None) != request.address:
            return "station"
        if reply.kind not in self.reply_kinds_of(request) or getattr(reply, "command", "") not in ("", _of(request)):
            return "command"
        return "count" if reply.kind in ("data", "written") and len(reply.values) != request.count else ""

    def access_of(self, request: Any) -> Access | None:
        """Return the access that a request makes; None for X, which only prepares Y."""
        if request.kind == "register":
            self.registered = request.addresses
            return None
        if request.kind == "monitor":
            return Access(place=RegisterPlace("", next(iter(self.registered), 0)))
        words = request.values if request.kind == "write" else None
        return Access(place=RegisterPlace("", request.first), count=request.count, words=words)

    def forget(self) -> None:
        """Clear the registered addresses."""
        self.registered = ()

    def read_reply(self, request: Any, words: Sequence[int]) -> Message:
        """Return the reply to R or Y."""
        kind = sent.Data if request.kind == "read" else sent.Monitored
        reply: Message = kind(address=self.address, values=tuple(words))
        return reply

    def write_reply(self, request: Any) -> Message:
        """Return the reply to W, which repeats the written words, or to X."""
        reply: Message = (
            sent.Registered(address=self.address)
            if request.kind == "register"
            else sent.Written(address=self.address, values=request.values)
        )
        return reply

    def refusal_reply(self, request: Any, code: int) -> Message:
        """Return the refusal of a request."""
        return self._nak(_of(request), _ERRORS[code])

    def damage_reply(self, find: Damaged) -> Message | None:
        """Return FE for a damaged request to this drive (SV-iG5A manual p. 11-6), IF for an unknown command."""
        command = find.data[3:4].decode("latin-1")
        if find.data[:3] != b"\x05%02X" % self.address or not " " <= command <= "~":
            return None
        unknown = find.error.category == "field" and command not in _COMMANDS.values()
        return self._nak(command, "IF" if unknown else "FE")

    def _nak(self, command: str, error: str) -> Message:
        reply: Message = sent.Nak(address=self.address, command=command, error=error)
        return reply


class VirtualLsBusDrive(VirtualRegisterDrive):
    """A drive at one station."""

    _dialect: LsBusDialect

    def answer(self, request: Any, now: float) -> Any:
        """Carry out a request; Y reads the registered addresses, and writes are refused while writing is disabled."""
        access, dialect = self._dialect.access_of(request), self._dialect
        if request.kind == "monitor":
            if not dialect.registered:
                raise RegisterRefusal("unknown")
            return dialect.read_reply(
                request, self._machine.read([RegisterPlace("", each).name for each in dialect.registered])
            )
        enabled = self._machine.words.get(WRITE_ENABLE.name, 1)
        if access is not None and access.words is not None and access.place != WRITE_ENABLE and not enabled:
            raise RegisterRefusal("read only")
        return super().answer(request, now)


def _of(request: Any) -> str:
    return _COMMANDS[request.kind]
