"""Virtual drives whose parameters are registers, made from their dialect and the table [control] of their model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UsageError, ValueRefusedError
from drivecomm.profiles.control_table import views_of
from drivecomm.profiles.register_machine import RegisterMachine, RegisterRefusal
from drivecomm.protocol import Damaged, DriveRepr, Framed, Motor, VirtualReply

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles.dialect import Dialect
    from drivecomm.profiles.register_machine import Why
    from drivecomm.profiles.registers import RegisterParameter
    from drivecomm.protocol import Codec, LineSettings, Message

_OBEYED = {"maximum_frequency": "maximum_hz", "acceleration_time": "ramp_up_s", "deceleration_time": "ramp_down_s"}
"""Fields of a `Motor` that parameters set, by the common names of the parameters."""


class VirtualRegisterDrive(DriveRepr):
    """A drive at one address. It obeys a command when the last step is written after all others.

    overhear: registers a telegram to another drive. mishear: registers characters that are not a telegram. The drive
    has these methods only if such a telegram feeds the watchdog, or if either ends a series of requests that continue
    each other.
    """

    overhear: Callable[[float], None]
    mishear: Callable[[float], None]

    def __init__(self, dialect: Dialect, codec: Codec, settings: LineSettings) -> None:
        if dialect.model is None:
            raise UsageError(f"a virtual {dialect.title} drive needs a model")
        self.address, self.codec, self.settings, self.gap_s = dialect.address, codec, settings, 0.050
        self.motor = Motor()
        self._dialect, self._model = dialect, dialect.model
        self.shared_addresses = dialect.shared_addresses
        targets = self._targets = {each: dialect.target(each) for each in dialect.model.parameters}
        views = views_of(dialect.model, dialect.place_of)
        machine = self._machine = RegisterMachine(dialect.model, targets, dialect.control, self.motor, views)
        self.trip = machine.trip
        self._deaf_until = 0.0
        self._set: dict[str, int | str] = {}
        self._obey()
        if dialect.feeds_all:
            self.overhear = machine.heard
        if dialect.continues:
            self.overhear = self.mishear = lambda _now: dialect.forget()

    def follow(self, now: float) -> None:
        """Advance the drive to the time `now`."""
        self._obey()
        self._machine.live(now)

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram; silent for one to another drive, and for damage that the protocol does not answer."""
        self.follow(now)
        if now < self._deaf_until:
            return None
        if isinstance(find, Damaged):
            return self._sent(self.complain(find))
        request: Any = self._dialect.complete_request(find.message)
        if not isinstance(request, self._dialect.requests):
            return None
        for_all = request.address in self.shared_addresses
        if for_all or request.address == self.address or self._dialect.feeds_all:
            self._machine.heard(now)
        if not for_all and request.address != self.address:
            return None
        try:
            reply = self.answer(request, now)
        except RegisterRefusal as refusal:
            reply = self.refuse(request, refusal.why)
        if silence_s := self._dialect.silence_s(request):
            # Deaf for half the silence only, so that a restarting drive is back before its master sends again.
            self._dialect.forget()
            self._deaf_until = now + silence_s / 2
        return None if for_all or silence_s else self._sent(reply)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on."""
        self._dialect.forget()
        self._machine.power_cycle(now)

    def peek(self, parameter: str, now: float) -> int | str:
        """Return the raw value that a read would return."""
        self.follow(now)
        return self._machine.fetch(self._held(parameter))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set a parameter, as if at the keypad. Raises ValueRefusedError for a number that does not fit."""
        wanted = self._held(parameter)
        if wanted.format.type != "string":
            raw, room = int(raw), wanted.room
            if raw not in room and raw + room.stop not in room:
                where = " is a coil and" if wanted.place.is_bit else ""
                raise ValueRefusedError(f"{parameter}{where} has no room for {raw}")
        self._machine.put(wanted, raw)

    def _held(self, parameter: str) -> RegisterParameter:
        found = self._dialect.target(parameter)
        if found.place.name not in self._machine.words:
            raise ParameterAddressError(f"the virtual drive holds no parameter {parameter!r}")
        return found

    def answer(self, request: Any, now: float) -> Message:
        """Carry out a request and return the reply. Raises RegisterRefusal."""
        dialect, access = self._dialect, self._dialect.access_of(request)
        if access is None:
            return dialect.write_reply(request)
        first, words = access.place, access.words
        names = [f"{first.kind}{first.start + each}" for each in range(access.count if words is None else len(words))]
        if words is None:
            return dialect.read_reply(request, self._machine.read(names))
        if "not set up" in dialect.codes and self._machine.ignores(names):
            raise RegisterRefusal("not set up")
        self._machine.write(names, words, now, only_ram=access.only_ram)
        return dialect.write_reply(request)

    def refuse(self, request: Any, why: Why) -> Message:
        """Return the refusal of a request."""
        return self._refused(request, self._dialect.codes[why])

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request with this code; None if no drive refuses it."""
        self.follow(now)
        request: Any = find.message
        return self._sent(self._refused(request, code)) if self._dialect.can_refuse(request) else None

    def _refused(self, request: Any, code: int) -> Message:
        self._keep(code)
        return self._dialect.refusal_reply(request, code)

    def complain(self, find: Damaged) -> Message | None:
        """Return the reply to a damaged telegram; None if the drive stays silent."""
        reply = self._dialect.damage_reply(find)
        if reply is not None and (code := self._dialect.codes.get(find.error.category)) is not None:
            self._keep(code)
        return reply

    def _keep(self, code: int) -> None:
        """Keep the code of a refusal in the register for it, if there is one."""
        place = self._dialect.reason
        if place is not None and place.name in self._machine.words:
            self._machine.words[place.name] = code

    def _sent(self, reply: Message | None) -> VirtualReply | None:
        if reply is None:
            return None
        return VirtualReply(data=self.codec.encode(reply), delay_s=self._dialect.reply_delay_s)

    def _obey(self) -> None:
        """Set the limit and the ramps of the motor from parameters, once for each value that they get."""
        for name in self._dialect.follows:
            wanted = self._targets.get(self._model.quantities.get(name, ""))
            if wanted is None or wanted.info is None or wanted.info.unit not in ("Hz", "s"):
                continue
            address, raw = wanted.address, self._machine.fetch(wanted)
            if self._set.get(address) != raw:
                self._set[address] = raw
                setattr(self.motor, _OBEYED[name], float(wanted.reading(raw).value))
