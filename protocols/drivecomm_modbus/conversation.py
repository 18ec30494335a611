"""Requests to one Modbus drive, telegram by telegram, and the words of its control profile on their way there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, RefusedError
from drivecomm.profiles import Place
from drivecomm.protocol import Ask, Pause, Tell
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Request
from drivecomm_modbus.parameters import address_at, by_place, counting_hint, place_of, target
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.profiles import Step, Target
    from drivecomm.protocol import Exchange, Model
    from drivecomm_modbus.control import Control
    from drivecomm_modbus.memory import ModbusMemory
    from drivecomm_modbus.messages import Reply
    from drivecomm_modbus.options import ModbusOptions

_BUSY_S, _POLL_S = 1.0, 0.05
"""How long a busy drive is asked again, and how often; the other drives of its line wait meanwhile."""

_READS = {"": fn.READ_REGISTERS, "i": fn.READ_INPUT_REGISTERS, "c": fn.READ_COILS, "d": fn.READ_INPUTS}


class Conversation:
    """Reads and writes registers of one drive, or writes those of all drives at address 0."""

    def __init__(
        self, address: int, options: ModbusOptions, control: Control, model: Model | None, memory: ModbusMemory
    ) -> None:
        self._address, self._options, self._control, self._memory = address, options, control, memory
        self._model = model
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
        found = Place.named(place)
        return (yield from self.words(found, 1, self._address_at(found)))[0]

    def raw(self, wanted: Target) -> Exchange[int | str]:
        """Read what the registers of a parameter hold."""
        if not wanted.wide:
            return wanted.raw_of((yield from self.words(wanted.place, wanted.format.size, wanted.address)))
        request = Request(address=self._address, function=fn.READ_LONG, start=wanted.place.start)
        reply = yield from self._answered(Ask(message=request, nameless=True), wanted.address)
        return int(reply.value or 0)

    def write(self, place: Place, words: Sequence[int], called: str, **how: Any) -> Exchange[None]:
        """Write registers, or a coil, from a place on; told only where nobody answers. how: see `Ask`.

        A single register or coil is written by whichever function the drive knows. Raises RefusedError.
        """
        ways = self._ways(place, words)
        if self._address == BROADCAST:
            yield Tell(message=ways[0])
            return
        if how.get("urgent") and (coils := self._coils_of(place, words)) is not None:
            ways.append(coils)
        refusal = None
        for message in ways:
            try:
                yield from self._write(message, called, **how)
            except RefusedError as error:
                if error.code != fn.UNKNOWN_FUNCTION:
                    raise
                self._memory.lacking.add(message.function)
                refusal = refusal or error
            else:
                self._memory.lacking.discard(message.function)
                return
        tried = " nor ".join(str(message.function) for message in ways)
        lacks = f"it takes neither function {tried}" if len(ways) > 1 else f"{len(words)} registers need {tried}"
        reason = f"{refusal.reason if refusal else ''}; {lacks}; see the option write_function"
        raise RefusedError(called, fn.UNKNOWN_FUNCTION, reason)

    def _write(self, message: Request, called: str, **how: Any) -> Exchange[None]:
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
        place = Place.named(step.place)
        return self.write(place, (step.word,), self._address_at(place), **how)

    def _ways(self, place: Place, words: Sequence[int]) -> list[Request]:
        """Return the requests that write these words, the one that the drive is known or likely to take first."""
        address, start = self._address, place.start
        if self._options.wide_functions and len(words) == 2:
            return [Request(address=address, function=fn.WRITE_LONG, start=start, value=words[0] << 16 | words[1])]
        one, many = (fn.WRITE_COIL, fn.WRITE_COILS) if place.is_bit else (fn.WRITE_REGISTER, fn.WRITE_REGISTERS)
        ways = [Request(address=address, function=many, start=start, values=tuple(words))]
        if len(words) == 1:
            first = self._options.write_function == fn.WRITE_REGISTER
            ways.insert(0 if first else 1, Request(address=address, function=one, start=start, value=words[0]))
        return sorted(ways, key=lambda each: each.function in self._memory.lacking)

    def _coils_of(self, place: Place, words: Sequence[int]) -> Request | None:
        """Return the request that writes a register by the coils that are its bits, None if the model has none."""
        if self._model is None or place.is_bit or len(words) != 1:
            return None
        for address, shown in self._model.control.get("views", {}).items():
            coil = place_of(address, self._options)
            if coil.is_bit and isinstance(shown, str) and place_of(shown, self._options) == place:
                bits = tuple(words[0] >> bit & 1 for bit in range(16))
                return Request(address=self._address, function=fn.WRITE_COILS, start=coil.start, values=bits)
        return None

    def _address_at(self, place: Place) -> str:
        """Return how a message calls a register or coil: as the model does, else as the manual counts it."""
        known = by_place(self._model, self._options).get(place)
        return known.address if known else address_at(place, self._options)

    def _answered(self, ask: Ask, called: str) -> Exchange[Reply]:
        reply = yield from self._patiently(ask)
        if reply.exception is not None:
            text = self._control.exceptions.get(reply.exception, "not listed in the manual")
            if reply.exception == fn.UNKNOWN_ADDRESS and self._model is None:
                hint = counting_hint(called, self._options)
                text = f"{text}; {hint}" if hint else text
            raise RefusedError(called, reply.exception, text)
        return reply

    def _patiently(self, ask: Ask) -> Exchange[Reply]:
        """Ask again while the drive is busy, unless the request may go out once only; stops have their own patience."""
        waited = 0.0
        while True:
            self._memory.unanswered = True
            reply: Reply = yield ask
            self._memory.unanswered = False
            self._is_there = self._is_there or not ask.mirrored
            if reply.exception != fn.BUSY or ask.attempts is not None or ask.urgent or waited >= _BUSY_S:
                return reply
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S
