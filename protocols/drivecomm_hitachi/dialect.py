"""Places of the parameters, commands and monitored values of a Hitachi drive, and the telegrams for them.

`A001` is a parameter, as the panel calls it; `02` is a command with a value; `03-1` is the first value in the reply to
command 03, `04-A` a state, `05-0` the number of trips, `05-1-1` the factor of the latest; F001 is written by 01
(p. 4-127).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, ParameterAddressError
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal
from drivecomm.protocol import Ask, code_texts
from drivecomm_hitachi import telegrams as sent
from drivecomm_hitachi.telegrams import Reply, Request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import Damaged, Message

FREQUENCY, STORABLE, STORE, NOWHERE = (
    RegisterPlace("F", 1),
    RegisterPlace("e", 9),
    RegisterPlace("e", 10),
    RegisterPlace("u", 0),
)
_COMMANDS = {
    "run": RegisterPlace("r", 0), "frequency": FREQUENCY, "terminals": RegisterPlace("t", 0),
    "further_terminals": RegisterPlace("t", 1),
    "store": STORE, "recalculate": RegisterPlace("e", 11),
}  # fmt: skip
_KINDS = {place: kind for kind, place in _COMMANDS.items()}
_BLOCKS = {"monitor": "m", "status": "s", "history": "h"}
_ADDRESSES = {
    **{sent.REQUESTS[kind]: place for kind, place in _COMMANDS.items()}, "09": STORABLE, "05-0": RegisterPlace("h", 0),
    "04": RegisterPlace("s", 0), "04-A": RegisterPlace("s", 0, "high"), "04-B": RegisterPlace("s", 0, "low"),
    "04-C": RegisterPlace("s", 1),
    **{f"03-{number}": RegisterPlace("m", number) for number in sent.MONITORED},
    **{f"05-{trip}-{item}": RegisterPlace("h", 9 * trip + item - 9) for trip in range(1, 7) for item in range(1, 10)},
}  # fmt: skip
_NAMES = {**{place: address for address, place in _ADDRESSES.items()}, FREQUENCY: "F001"}
_PARAMETER = re.compile("([A-CFHPUb])([0-9]{3})", re.ASCII)
_LENGTHS = {
    "monitor": ("data", 104), "status": ("data", 8), "history": ("data", 440), "read": ("ack_data", 8),
    "check": ("ack_data", 2),
}  # fmt: skip
_LONG_S = {"monitor": 1.5, "history": 3.0}
"""Reply timeouts at 2400 baud with the longest C078, for an adapter that delivers a reply in one piece."""
_DAMAGED = {"checksum": 2, "length": 5, "field": 6}


@dataclass(frozen=True, slots=True, kw_only=True)
class HitachiOptions:
    """Hitachi drives have no options."""


class HitachiDialect(Dialect):
    """The places of one Hitachi drive, and the telegrams for them."""

    title = "Hitachi"
    broadcast_address = sent.BROADCAST
    requests = Request
    probe = RegisterPlace("s", 0)
    common_model = "models/sj300.toml"
    refusals = code_texts(__file__, "errors.toml")
    codes = {"unknown": 16, "read only": 13, "running": 13, "limits": 13, "not set up": 13}  # noqa: RUF012 - constant
    whole = {"m": sent.MONITORED, "s": range(2), "h": sent.RECORDED}  # noqa: RUF012 - constant
    reply_delay_s = 0.01
    advice = "A002, the terminals of command 02, and the drive's own FRS, EXT and RS terminals"

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an address in the manual. Raises ParameterAddressError."""
        if address in _ADDRESSES:
            return _ADDRESSES[address]
        if not (found := _PARAMETER.fullmatch(address)):
            raise ParameterAddressError(
                f"{address!r} is not a parameter of a Hitachi drive; write A001, 03-1 to 03-13 for what it monitors, "
                "04-A to 04-C for its states, or 05-1-1 to 05-6-9 for its trips"
            )
        return RegisterPlace(found[1], int(found[2]))

    def address_at(self, place: RegisterPlace) -> str:
        """Return the address of a place as the manual prints it."""
        return _NAMES.get(place, f"{place.kind}{place.start:03d}")

    def allowed(self, place: RegisterPlace) -> range:
        """Return the numbers for which a telegram has room."""
        return range(1 << 64 if place.kind == "t" else 10**6 if place == FREQUENCY else 10**8)

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the request for a place; only a reply to 06 has a length that replies to other requests share."""
        for kind, block in {**_BLOCKS, "check": "e"}.items():
            if place.kind == block and place not in _KINDS:
                return Ask(message=self._ask(kind), distinct=True, reply_timeout_s=_LONG_S.get(kind))
        if place.kind in ("r", "t", "e"):
            raise NotSupported(f"{self.address_at(place)} is a command, which a drive does not return")
        return Ask(message=self._ask("read", parameter=self.address_at(place)), nameless=True)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes a place, or the command."""
        kind = _KINDS.get(place, "write")
        if kind == "write" and place.kind.islower() and place.kind != "b":
            raise NotSupported(f"{self.address_at(place)} can only be read")
        name = self.address_at(place) if kind == "write" else None
        value = None if kind in ("store", "recalculate") else words[0]
        return Ask(message=self._ask(kind, parameter=name, value=value), nameless=True)

    def preparing(self, place: RegisterPlace) -> Ask | None:
        """Return the request that checks whether values can be stored, for the store command; None for other places."""
        return self.reading(STORABLE, 1) if place == STORE else None

    def words(self, reply: Any, place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the values of a reply from a place on; trip codes with letters are hexadecimal."""
        if place.kind == "s":
            a, b, c = (int(reply.data[at : at + 2]) for at in (0, 2, 4))
            return (a << 8 | b, c)[place.start :]
        first = place.start - self.whole[place.kind].start if place.kind in self.whole else 0
        values = [reply.data[at : at + 8] for at in range(8 * first, len(reply.data), 8)]
        bits = [place.kind == "m" and place.start + each in sent.TERMINALS for each in range(len(values))]
        return tuple(int(each, 16 if bit or not each.isdigit() else 10) for each, bit in zip(values, bits, strict=True))

    def refusal(self, reply: Any) -> int | None:
        """Return the code of a NAK; 0 for 00, which means that values cannot be stored."""
        return int(reply.error) if reply.kind == "nak" else 0 if reply.data == "00" else None

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the field in which a sound reply does not belong to a request; only drive and length are compared."""
        if not isinstance(reply, Reply) or request.address != reply.address:
            return "broadcast" if request.address == sent.BROADCAST else "node"
        told = reply.kind, len(reply.data or "")
        return "" if reply.kind == "nak" or told == _LENGTHS.get(request.kind, ("ack", 0)) else "length"

    def access_of(self, request: Any) -> Access:
        """Return the access that a request makes.

        Command 08 is refused, so that no virtual drive loses its parameters.
        """
        if request.kind == "initialise":
            raise RegisterRefusal("read only")
        if request.kind in _COMMANDS:
            return Access(place=_COMMANDS[request.kind], words=(1 if request.value is None else request.value,))
        if block := _BLOCKS.get(request.kind):
            return Access(place=RegisterPlace(block, self.whole[block].start), count=len(self.whole[block]))
        if request.kind == "check":
            return Access(place=STORABLE)
        place = (
            RegisterPlace(request.parameter[0], int(request.parameter[1:])) if request.parameter != "F001" else NOWHERE
        )
        return Access(place=place, words=(request.value,) if request.kind == "write" else None)

    def read_reply(self, request: Any, words: Sequence[int]) -> Message:
        """Return the reply to a read."""
        if request.kind == "status":
            return self._reply("data", data=f"{words[0] >> 8:02d}{words[0] & 0xFF:02d}{words[1]:02d}00")
        if request.kind in _BLOCKS:
            bits = sent.TERMINALS if request.kind == "monitor" else ()
            shown = (f"{word:08X}" if number in bits else f"{word:08d}" for number, word in enumerate(words, 1))
            return self._reply("data", data="".join(shown))
        return self._reply("ack_data", data=f"{words[0]:0{_LENGTHS[request.kind][1]}d}")

    def write_reply(self, request: Any) -> Message:  # noqa: ARG002 - ACK is the same for all requests
        """Return the confirmation of a request."""
        return self._reply("ack")

    def refusal_reply(self, request: Any, code: int) -> Message:  # noqa: ARG002 - NAK depends only on the code
        """Return the refusal of a request."""
        return self._reply("nak", error=f"{code:02d}")

    def damage_reply(self, find: Damaged) -> Message | None:
        """Return the refusal of a damaged request to this drive; no manual states how a real drive answers."""
        code = _DAMAGED.get(find.error.category)
        return self.refusal_reply(None, code) if code and find.data[1:3] == b"%02d" % self.address else None

    def _ask(self, kind: str, **fields: Any) -> Request:
        return Request(kind=kind, node=self.address, **fields)

    def _reply(self, kind: str, **fields: Any) -> Reply:
        return Reply(kind=kind, node=self.address, **fields)
