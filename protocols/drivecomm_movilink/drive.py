"""A drive that speaks MOVILINK: its parameters, the verbs of its master, and the virtual drive.

Parameters are indices, read and written by the acyclic parameter channel (MOVIDRIVE MDX60B/61B communication manual
p. 111; SEW web manual MOVITRAC B 5947108235). Every telegram with process data is a command. So the status is read as a
parameter, and process data are sent only by verbs that command, or to feed the watchdog of a motor started here.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import ParameterAddressError, RefusedError, UsageError
from drivecomm.profiles import SOLE_PLACE, Access, CommandMemory, ProcessWords, RegisterPlace
from drivecomm.protocol import Ask, Intent, LineSettings, Tell, code_texts, difference, exact
from drivecomm_movilink.telegrams import BROADCAST, CYCLIC, PARAMETER, TELEGRAMS, Reply, Request

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.protocol import DriveStatus, Exchange, Message, Model, Value

_READ, _WRITE, _WRITE_VOLATILE, _HANDSHAKE, _ERROR = 0x31, 0x32, 0x33, 0x40, 0x80  # management byte
_RAM, _STATUS = 1 << 24, RegisterPlace("", 8310 << 8)
"""Offset added to the place of a volatile write; index of status word 1, which is on no page that was found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MovilinkOptions:
    """Options of a drive that speaks MOVILINK.

    maximum_rpm: the speed of 100 % if process word 2 is a speed in steps of 0.2 rpm; 0 if it is a relative speed, a
    share of the drive's own maximum. ramp_ms: a ramp that is sent as process word 3; 0 for telegrams of two words.
    """

    maximum_rpm: float = 0.0
    ramp_ms: int = 0

    def __post_init__(self) -> None:
        if (self.maximum_rpm and not 1 <= self.maximum_rpm <= 6553) or not 0 <= self.ramp_ms <= 0xFFFF:
            raise UsageError("maximum_rpm is 0 or 1 to 6553 and ramp_ms 0 to 65535; process words hold no more")

    @property
    def profile(self) -> profiles.ControlProfile:
        """The control profile, with 100 % in steps of process word 2 (communication manual p. 85)."""
        return replace(profiles.control_profile("movilink"), full=round(self.maximum_rpm * 5) or 0x4000)


class MovilinkDialect(profiles.Dialect, profiles.WordTelegrams):
    """Indices and subindices are places of 32 bits; control and status words are process data (`WordTelegrams`)."""

    keeps_start, needs_words, actual = True, False, (0, 0, 0)  # actual: process words of the next reply
    title, broadcast_address, requests, types = "MOVILINK", BROADCAST, Request, ("u32", "s32", "f32")
    probe, identity = RegisterPlace("", 8300 << 8), {"software": "8300"}  # PROFINET field distributors, data set 47
    refusals = code_texts(__file__, "errors.toml")
    codes: Mapping[str, int] = {"unknown": 0x10, "read only": 0x12, "limits": 0x1D, "running": 0x20}

    def control_defaults(self) -> Mapping[str, Any]:
        """Return the storage of writes: service 2 stores in EEPROM, service 3 does not.

        Source: MOVITRAC B operating instructions p. 108.
        """
        return {"plain_write": "stored", "volatile_offset": _RAM}

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an index such as 8470, or of an index with a subindex, 8470.1.

        Raises ParameterAddressError.
        """
        found = re.fullmatch(r"([0-9]{1,5})(?:\.([0-9]{1,3}))?", address)
        index, subindex = (int(each or 0) for each in found.groups()) if found else (-1, 0)
        if index not in range(0x10000) or subindex not in range(0x100):
            raise ParameterAddressError(f"{address!r} is not an index; write 0 to 65535, or index.subindex: 8470.1")
        return RegisterPlace("", index << 8 | subindex)

    def address_at(self, place: RegisterPlace) -> str:
        """Return the index and subindex of a place."""
        index, subindex = divmod(place.start & (_RAM - 1), 0x100)
        return f"{index}.{subindex}" if subindex else str(index)

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the request that reads an index."""
        return Ask(message=self._channel(_READ, place, 0))

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes an index, to RAM if there is no model.

        A late reply to another write may match it.
        """
        service = _WRITE if self.model is not None and place.start < _RAM else _WRITE_VOLATILE
        return Ask(message=self._channel(service, place, words[0]), nameless=True)

    def words(self, reply: Any, _place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the value of a reply."""
        return (reply.value,)

    def refusal(self, reply: Any) -> int | None:
        """Return the additional code of error class 8; for another class, the code plus 65536 times the class.

        Return None for a reply without an error.
        """
        error_class, code = divmod(reply.value & 0xFF00FFFF, 1 << 24)
        return None if not reply.management & _ERROR else code if error_class == 8 else error_class << 16 | code

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the first field in which a reply does not belong to a request; only the error bit may differ."""
        if differs := difference(request, reply, "address", "type", "subindex", "index"):
            return differs
        return "management" if ((request.management or 0) ^ (reply.management or 0)) & ~_ERROR else ""

    def access_of(self, request: Any) -> Access | None:
        """Return the access of a parameter channel, with or without the handshake bit; None if there is no channel."""
        if request.management is None:
            return None
        service, place = request.management & ~_HANDSHAKE, RegisterPlace("", request.index << 8 | request.subindex)
        if service not in (_READ, _WRITE, _WRITE_VOLATILE):
            raise profiles.RegisterRefusal("unknown")
        words = None if service == _READ else (request.value,)
        return Access(place=place, words=words, only_ram=service == _WRITE_VOLATILE)

    def intent(self, request: Any) -> Intent:
        """Return the intent of a request; each one with a process word is a command."""
        service = 0 if request.management is None else request.management & 0x0F
        return Intent(access="write" if service in (2, 3) else "read" if service else "", commands=bool(request.pd))

    def read_reply(self, request: Any, words: Sequence[int]) -> Reply:
        """Return the reply to a read."""
        return self.write_reply(request, value=words[0])

    def write_reply(self, request: Any, **changed: Any) -> Reply:
        """Return a reply that repeats its request, except for the process words and the changed fields."""
        return Reply(**{**asdict(request), "pd": self.actual[: len(request.pd)], **changed})

    def refusal_reply(self, request: Any, code: int) -> Reply:
        """Return the refusal of a service, of error class 8 unless the code contains another."""
        value = (code >> 16 or 8) << 24 | code & 0xFFFF
        return self.write_reply(request, management=request.management | _ERROR, value=value)

    def can_refuse(self, request: Any) -> bool:
        """Whether a request has a parameter channel."""
        return isinstance(request, Request) and request.management is not None

    def block(self, word: int, reference: int, /, **_task: Any) -> Request:
        """Return cyclic process data with these words; without a control word, the request for the status."""
        if not word:
            return self._channel(_READ, _STATUS, 0)
        ramp_ms = self.options.ramp_ms
        pd = (word & 0xFFFF, reference & 0xFFFF, ramp_ms)[: 3 if ramp_ms else 2]
        return Request(address=self.address, type=CYCLIC[len(pd)], pd=pd)

    def answer(self, ask: Ask) -> Exchange[Reply]:
        """Send a request and return its reply, or send a broadcast.

        Raises RefusedError if the drive refuses its status.
        """
        if self.address == BROADCAST:
            yield Tell(message=ask.message)
            return self.write_reply(ask.message)
        reply: Reply = yield ask
        if not reply.pd and (code := self.refusal(reply)) is not None:
            raise RefusedError(self.address_at(_STATUS), code, self.refusal_text(code, ""))
        return reply

    def _channel(self, management: int, place: RegisterPlace, value: int) -> Request:
        index, subindex = divmod(place.start & (_RAM - 1), 0x100)
        same: Any = {"address": self.address, "type": PARAMETER}
        return Request(**same, management=management, index=index, subindex=subindex, value=value)


class MovilinkOperations(profiles.RegisterOperations):
    """Verbs of one drive, or at address 255 the stop of all drives on the line."""

    def __init__(
        self, address: int, options: MovilinkOptions, model: Model | None, memory: CommandMemory | None = None
    ) -> None:
        asking, commanding = (MovilinkDialect(address, options, model) for _ in range(2))
        commanding.needs_words = True
        super().__init__(asking)
        words, known = options.profile, memory or CommandMemory()
        known.functions = 0x10000  # marks a word as given, because 0000 is a command too; no telegram contains it
        self._control = replace(self._control, profile=words, reference_percent="PO2")
        how: dict[str, Any] = {"state_timeout_s": asking.state_timeout_s, "answers": self._drive.answers}
        self._talk = ProcessWords(lambda: words, asking, known, asking.answer)
        self._orders = ProcessWords(lambda: words, commanding, known, commanding.answer)
        self._commander = self._orders.commander(**how)
        self._resetting = self._talk.commander(**how)
        self.capabilities = replace(
            self.capabilities, stops=frozenset(words.stops), reference_percent=True, monitoring_only=False
        )

    def status(self) -> Exchange[DriveStatus]:
        """Read status word 1 as a parameter; repeat the present command to a running motor if a watchdog guards it."""
        self._drive.must_be_one()
        word = (yield from self._talk.status()).status_word
        told, texts = self._control.profile.status({SOLE_PLACE: word}), self._model.faults if self._model else {}
        return replace(told, fault_code=word >> 8, fault_text=texts.get(word >> 8, "")) if told.fault else told

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault by one edge of bit 6; do nothing for a drive without a fault."""
        self._drive.must_be_one()
        return self._resetting.reset()

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the speed, negative for reverse; the reply to a repeated stop word also carries the status."""
        self._drive.must_be_one()
        steps = self._control.profile.steps_of(exact(percent, "reference"))
        yield from (self._orders if self._talk.memory.idle else self._talk).set_reference(steps)


class VirtualMovilinkDrive(profiles.VirtualRegisterDrive):
    """A drive at one address, which obeys process data and broadcasts. PI2 is its speed in the scale of PO2."""

    def __init__(self, address: int, options: MovilinkOptions, model: Model) -> None:
        self._drive = MovilinkDialect(address, options, model)
        super().__init__(self._drive, TELEGRAMS, LineSettings(parity="E"))
        self._speed, self._hz_per_step = 0, self.motor.maximum_hz / options.profile.full
        self._words = profiles.ProfileMachine(options.profile, self.motor, lambda _: self._hz_per_step * self._speed)

    def follow(self, now: float) -> None:
        """Advance the drive's time, and update the parameter that holds status word 1."""
        super().follow(now)
        self._words.follow(now)
        self._machine.words[_STATUS.name] = self._words.status_word() | self.motor.fault << 8 & 0xFF00

    def answer(self, request: Any, now: float) -> Message:
        """Obey the control word and the parameter channel; the reply shows the state before that."""
        actual = round(self.motor.output_hz / self._hz_per_step) & 0xFFFF
        self._drive.actual = (self._machine.words[_STATUS.name], actual, 0)
        if request.pd:
            word, speed, ramp_ms = (*request.pd, 0, 0)[:3]
            self._speed = speed - 0x10000 * (speed >> 15)
            self.motor.ramp_up_s = ramp_ms / 1000 or self.motor.ramp_up_s
            self._words.control(word, now)
        return super().answer(request, now)

    def power_cycle(self, now: float) -> None:
        """Switch the mains off and on; the control word is lost."""
        super().power_cycle(now)
        self._words.power_up(now)
