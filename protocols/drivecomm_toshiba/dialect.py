"""Places of the values of a Toshiba drive, and the telegrams for them.

An address is a communication number in four hexadecimal digits: `0012`, `FD00`. F829, as printed on the panel, is 0829
(E6581913 p. 5). `FD00.tripped` is the state shown by the letters of the reply to FD00 (E6581913 p. 8).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, ParameterAddressError
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal, VirtualRegisterDrive
from drivecomm.protocol import Ask, Framed, LineSettings, code_texts, difference
from drivecomm_toshiba.telegrams import BROADCAST, Reply, Request, ToshibaOptions, codec_for, smallest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import Damaged, Message, Model, VirtualReply

SETTINGS = LineSettings(baudrate=9600, bytesize=8, parity="E")
_RAM, _COMMANDS = 1 << 16, range(0xFA00, 0xFB00)  # a write above _RAM, or to the commands, goes to RAM only
_ADDRESS = re.compile(r"([0-9A-F]{4})(\.tripped)?")
_DAMAGED = re.compile(rb"\(([0-9]{2})?[RWP]|/([\x00-\x3f])?[RWPGX]", re.DOTALL)


class ToshibaDialect(Dialect):
    """The communication numbers of one drive.

    Place `s` is the number whose replies show the state: its value, and whether the drive is tripped, by their letters.
    named: whether a virtual drive's replies carry its number, as their request does.
    """

    title = "Toshiba"
    broadcast_address = BROADCAST
    requests = Request
    refusals = code_texts(__file__, "errors.toml")
    codes = {"unknown": 2, "read only": 2, "running": 0, "limits": 1}  # noqa: RUF012 - never changed
    busy = (0,)
    whole = {"s": range(2)}  # noqa: RUF012 - never changed
    doubts_echoes = True
    reply_delay_s = 0.01
    advice = "whether it stands in emergency off, and its terminals: FA00 counts, and they can hold the motor"

    def __init__(self, address: int, options: Any, model: Model | None) -> None:
        super().__init__(address, options, model)
        self.shared_addresses = {BROADCAST, 200 + address % 10, 210 + address // 10}
        self.identity = model.control.get("identity", {}) if model else {}
        told = [each.address[:4] for each in model.parameters.values() if "." in each.address] if model else []
        self._telling, self.named = int(told[0] if told else "FD00", 16), True
        self.probe = self.place_of("FD00")

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of a communication number. Raises ParameterAddressError."""
        found = _ADDRESS.fullmatch(address)
        number = int(found[1], 16) if found else -1
        number -= 0xF000 if 0xF000 <= number < _COMMANDS.start else 0
        if found is None or (found[2] and number != self._telling):
            raise ParameterAddressError(
                f"{address!r} is not a communication number of a Toshiba drive; write four hexadecimal digits, such as "
                "FD00, F829 for a parameter as the panel has it, or FD00.tripped"
            )
        return RegisterPlace("s", 1 if found[2] else 0) if number == self._telling else RegisterPlace("", number)

    def address_at(self, place: RegisterPlace) -> str:
        """Return the communication number of a place."""
        return f"{self._number(place):04X}" + (".tripped" if place.kind and place.start else "")

    def _number(self, place: RegisterPlace) -> int:
        return self._telling if place.kind else place.start & (_RAM - 1)

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the request that reads a number; a refusal of it names no number."""
        request = Request(address=self.address, command="R", communication_number=self._number(place))
        return Ask(message=request, nameless=True)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes a number.

        It uses P, which writes to RAM only, for volatile values, because W wears the EEPROM (E6581222, first pages).
        """
        if place.kind:
            raise NotSupported(f"{self.address_at(place)} can only be read")
        known = self.places.get(place)
        is_lost = self.model is None or place.start in _COMMANDS or (known is not None and known.storage == "volatile")
        command = "P" if is_lost or place.start >= _RAM else "W"
        number = self._number(place)
        request = Request(address=self.address, command=command, communication_number=number, data=words[0])
        return Ask(message=request, nameless=True, mirrored=True)

    def words(self, reply: Any, place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the value, and for the number that shows the state, whether the drive is tripped."""
        return (reply.data, int(reply.tripped))[place.start :] if place.kind else (reply.data,)

    def refusal(self, reply: Any) -> int | None:
        """Return the error code of N; None for any other reply."""
        return reply.error_code  # type: ignore[no-any-return]

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the first field in which a reply does not belong to a request.

        A wild card is answered by the smallest number that matches it.
        """
        if not isinstance(reply, Reply) or request.mode != reply.mode:
            return "mode"
        if smallest(request.number) != reply.number:
            return "number"
        repeated = ("command", "communication_number", *(("data",) if request.kind == "write" else ()))
        return "" if reply.command == "N" else difference(request, reply, *repeated)

    def access_of(self, request: Any) -> Access:
        """Return the access that a request makes; a block is refused, because only the drive knows what it writes."""
        if request.kind == "block":
            raise RegisterRefusal("running")
        place = self.place_of(f"{request.communication_number:04X}")
        if request.kind == "read":
            return Access(place=place, count=2 if place.kind else 1)
        return Access(place=place, words=(request.data or 0,), only_ram=request.command == "P")

    def read_reply(self, request: Any, words: Sequence[int]) -> Reply:
        """Return the reply to a read."""
        return self._reply(request, data=words[0])

    def write_reply(self, request: Any) -> Reply:
        """Return the reply to a write, which repeats the data."""
        return self._reply(request, data=request.data)

    def _reply(self, request: Any, **fields: Any) -> Reply:
        same = {name: getattr(request, name) for name in ("mode", "command", "communication_number")}
        return Reply(number=self.address if self.named else None, **{**same, **fields})

    def refusal_reply(self, request: Any, code: int) -> Reply:
        """Return the refusal of a request."""
        return self._reply(request, command="N", communication_number=None, error_code=code)

    def damage_reply(self, find: Damaged) -> Reply | None:
        """Return the refusal of a wrong sum; other damage is left without a reply (E6581315 p. 20)."""
        found = _DAMAGED.match(find.data) if find.error.category == "checksum" else None
        number = found and (int(found[1]) if found[1] else found[2][0] if found[2] else None)
        if not found or number not in (None, self.address):
            return None
        return Reply(mode="ascii" if find.data[:1] == b"(" else "binary", number=number, command="N", error_code=4)


class VirtualToshibaDrive(VirtualRegisterDrive):
    """A drive at one address.

    It answers in lower case while it is tripped, and answers wild cards of which it is the first match.
    """

    def __init__(self, address: int, options: ToshibaOptions, model: Model) -> None:
        self._own = ToshibaDialect(address, options, model)
        super().__init__(self._own, codec_for(options), SETTINGS)

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Handle a telegram without a number, or with a wild card that this drive answers, as one to this drive."""
        if isinstance(find, Framed) and isinstance(request := find.message, Request):
            self._own.named = request.number is not None
            if request.number is None or (request.number != "**" and smallest(request.number) == self.address):
                find = replace(find, message=replace(request, address=self.address))
        return super().hear(find, now)

    def _sent(self, reply: Message | None) -> VirtualReply | None:
        return super()._sent(replace(reply, tripped=self.motor.fault != 0) if isinstance(reply, Reply) else None)
