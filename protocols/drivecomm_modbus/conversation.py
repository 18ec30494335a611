"""What one drive is asked and told, telegram by telegram; what carries the words of its control profile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, RefusedError
from drivecomm.profiles import TRIPPED, Place
from drivecomm.protocol import Ask, Tell
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Request
from drivecomm_modbus.parameters import target
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.profiles import Step, Target, Words
    from drivecomm.protocol import Exchange, Model
    from drivecomm_modbus.control import Control
    from drivecomm_modbus.messages import Reply
    from drivecomm_modbus.options import ModbusOptions

_READS = {"": fn.READ_REGISTERS, "i": fn.READ_INPUT_REGISTERS, "c": fn.READ_COILS, "d": fn.READ_INPUTS}


class Conversation:
    """Reads and writes registers of one drive, or writes those of all drives at address 0."""

    def __init__(self, address: int, options: ModbusOptions, control: Control, model: Model | None) -> None:
        self._address, self._options, self._control = address, options, control
        self._is_there = False
        self._fault_code = target(control.fault_code, model, options) if control.fault_code else None

    def must_be_one(self) -> None:
        """Raise NotSupported for what is not for all drives at once."""
        if self._address == BROADCAST:
            raise NotSupported("that is for one drive; all drives of a series can only be stopped")

    def asking(self, place: Place, count: int, attempts: int | None = None) -> Ask:
        """Return the request for some registers from a place on."""
        self.must_be_one()
        message = Request(address=self._address, function=_READS[place.kind], start=place.start, count=count)
        # The reply names nothing of the request: a late one would pass for the next.
        return Ask(message=message, attempts=attempts, nameless=True)

    def words(self, place: Place, count: int, called: str) -> Exchange[tuple[int, ...]]:
        """Read some registers from a place on. called: what a refusal is of."""
        reply = yield from self._answered(self.asking(place, count), called)
        return reply.values or (0,) * count

    def raw(self, wanted: Target) -> Exchange[int | str]:
        """Read what the registers of a parameter hold."""
        if not wanted.wide:
            return wanted.raw_of((yield from self.words(wanted.place, wanted.format.size, wanted.address)))
        request = Request(address=self._address, function=fn.READ_LONG, start=wanted.place.start)
        reply = yield from self._answered(Ask(message=request, nameless=True), wanted.address)
        return int(reply.value or 0)

    def write(
        self, place: Place, words: Sequence[int], called: str, *, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[None]:
        """Write registers, or a coil, from a place on; told only where nobody answers."""
        message = self._writing(place, words)
        if self._address == BROADCAST:
            yield Tell(message=message)
            return
        mirrored = message.function in (fn.WRITE_COIL, fn.WRITE_REGISTER, fn.WRITE_LONG)
        ask = Ask(message=message, acts=True, attempts=attempts, urgent=urgent, distinct=True, mirrored=mirrored)
        yield from self._answered(ask, called)
        if not self._is_there:
            # The echo of an adapter passes for a mirrored reply, and not for that to a read; a stop is out by now.
            yield self.asking(self._control.probe, 1)
            self._is_there = True
            if urgent:
                # The drive itself confirms this one.
                yield from self._answered(ask, called)

    def look(self) -> Exchange[Words]:
        """Read the status registers, and the code of a fault where only that tells one."""
        if not self._control.status:
            # Nothing tells, so that a reset is sent.
            return {TRIPPED: 1}
        words: dict[str, int] = {}
        for name in dict.fromkeys(condition.place for condition in self._control.status.values()):
            (words[name], *_) = yield from self.words(Place.named(name), 1, name)
        fault = self._control.status.get("fault")
        tripped = bool((yield from self.fault_code())) if fault is None else fault.holds(words)
        return {**words, TRIPPED: int(tripped)}

    def fault_code(self) -> Exchange[int | None]:
        """Read the code of a fault, None where there is none."""
        if self._fault_code is None:
            return None
        raw = yield from self.raw(self._fault_code)
        return raw if isinstance(raw, int) and raw else None

    def send(self, step: Step, *, urgent: bool) -> Exchange[None]:
        """Write one step of a command: once, unless it stops the motor."""
        place = Place.named(step.place)
        yield from self.write(place, (step.word,), step.place, attempts=None if urgent else 1, urgent=urgent)

    def again(self, step: Step) -> Exchange[Words]:  # noqa: ARG002 - nothing is sent again
        """Read the status registers while something is awaited."""
        return self.look()

    def _writing(self, place: Place, words: Sequence[int]) -> Request:
        address, start = self._address, place.start
        if self._options.wide_functions and len(words) == 2:
            return Request(address=address, function=fn.WRITE_LONG, start=start, value=words[0] << 16 | words[1])
        if self._options.write_function == fn.WRITE_REGISTER and len(words) == 1:
            function = fn.WRITE_COIL if place.is_bit else fn.WRITE_REGISTER
            return Request(address=address, function=function, start=start, value=words[0])
        function = fn.WRITE_COILS if place.is_bit else fn.WRITE_REGISTERS
        return Request(address=address, function=function, start=start, values=tuple(words))

    def _answered(self, ask: Ask, called: str) -> Exchange[Reply]:
        reply: Reply = yield ask
        self._is_there = self._is_there or not ask.mirrored
        if reply.exception is not None:
            text = self._control.exceptions.get(reply.exception, "not listed in the manual")
            raise RefusedError(called, reply.exception, text)
        return reply
