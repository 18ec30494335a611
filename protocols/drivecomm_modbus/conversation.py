"""What one drive is asked and told, telegram by telegram; what carries the words of its control profile."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, RefusedError
from drivecomm.profiles import Place
from drivecomm.protocol import Ask, Tell
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Request
from drivecomm_modbus.parameters import target
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.profiles import OrderMemory, Step, Target
    from drivecomm.protocol import Exchange, Model
    from drivecomm_modbus.control import Control
    from drivecomm_modbus.messages import Reply
    from drivecomm_modbus.options import ModbusOptions

_READS = {"": fn.READ_REGISTERS, "i": fn.READ_INPUT_REGISTERS, "c": fn.READ_COILS, "d": fn.READ_INPUTS}


class Conversation:
    """Reads and writes registers of one drive, or writes those of all drives at address 0."""

    def __init__(
        self, address: int, options: ModbusOptions, control: Control, model: Model | None, memory: OrderMemory
    ) -> None:
        self._address, self._options, self._control, self._memory = address, options, control, memory
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

    def word(self, place: str) -> Exchange[int]:
        """Read one register, or coil."""
        return (yield from self.words(Place.named(place), 1, place))[0]

    def raw(self, wanted: Target) -> Exchange[int | str]:
        """Read what the registers of a parameter hold."""
        if not wanted.wide:
            return wanted.raw_of((yield from self.words(wanted.place, wanted.format.size, wanted.address)))
        request = Request(address=self._address, function=fn.READ_LONG, start=wanted.place.start)
        reply = yield from self._answered(Ask(message=request, nameless=True), wanted.address)
        return int(reply.value or 0)

    def write(self, place: Place, words: Sequence[int], called: str, **how: Any) -> Exchange[None]:
        """Write registers, or a coil, from a place on; told only where nobody answers. how: see `Ask`."""
        message = self._writing(place, words)
        if self._address == BROADCAST:
            yield Tell(message=message)
            return
        mirrored = message.function in (fn.WRITE_COIL, fn.WRITE_REGISTER, fn.WRITE_LONG)
        ask = Ask(message=message, acts=True, **how, distinct=True, mirrored=mirrored)
        # Another reply names no value: that to a write that was given up passes for it, until a read has been answered.
        is_late = self._memory.unanswered and not mirrored
        if is_late and not ask.urgent:
            yield self.asking(self._control.probe, 1)
        yield from self._answered(ask, called)
        if not self._is_there or (is_late and ask.urgent):
            # The echo of an adapter passes for a mirrored reply, and not for that to a read; a stop is out by now.
            yield self.asking(self._control.probe, 1)
            self._is_there = True
            if ask.urgent:
                # The drive itself confirms this one.
                yield from self._answered(ask, called)

    def fault_code(self) -> Exchange[int | None]:
        """Read the code of a fault, None where there is none."""
        if self._fault_code is None:
            return None
        raw = yield from self.raw(self._fault_code)
        return raw if isinstance(raw, int) and raw else None

    def carry(self, step: Step, **how: Any) -> Exchange[None]:
        """Write one step of a command. how: see `Ask`."""
        return self.write(Place.named(step.place), (step.word,), step.place, **how)

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
        self._memory.unanswered = True
        reply: Reply = yield ask
        self._memory.unanswered = False
        self._is_there = self._is_there or not ask.mirrored
        if reply.exception is not None:
            text = self._control.exceptions.get(reply.exception, "not listed in the manual")
            raise RefusedError(called, reply.exception, text)
        return reply
