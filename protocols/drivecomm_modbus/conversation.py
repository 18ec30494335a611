"""Requests to one Modbus drive, by a function that it knows, and with protection against an adapter's echo."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import RefusedError
from drivecomm.profiles import RegisterConversation, RegisterPlace
from drivecomm.protocol import Ask, Tell
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.profiles import RegisterParameter
    from drivecomm.protocol import Exchange
    from drivecomm_modbus.dialect import ModbusDialect
    from drivecomm_modbus.memory import ModbusMemory


class ModbusConversation(RegisterConversation):
    """Reads and writes of one drive's registers, or writes to those of all drives at address 0."""

    def __init__(self, dialect: ModbusDialect, memory: ModbusMemory) -> None:
        super().__init__(dialect, memory)
        self._modbus, self._lacking = dialect, memory.lacking

    def raw(self, wanted: RegisterParameter) -> Exchange[int | str]:
        """Read the raw value of a parameter."""
        if not wanted.wide:
            return (yield from super().raw(wanted))
        request = Request(address=self._modbus.address, function=fn.READ_LONG, start=wanted.place.start)
        reply = yield from self.send_request(Ask(message=request, nameless=True), wanted.address)
        return int(reply.value or 0)

    def put(self, wanted: RegisterParameter, raw: int | str, goal: RegisterPlace, **how: Any) -> Exchange[None]:
        """Write a parameter, 32 bits as two words."""
        return self.write(goal, wanted.format.words_of(raw), wanted.address, **how)

    def write(self, place: RegisterPlace, words: Sequence[int], called: str, **how: Any) -> Exchange[None]:
        """Write consecutive registers or a coil; at the broadcast address, send only. how: see `Ask`.

        A single register or coil is written by a function that the drive knows. Raises RefusedError.
        """
        ways = self._ways(place, words)
        if not self.answers:
            yield Tell(message=ways[0].message)
            return
        if how.get("urgent") and (coils := self._coils_of(place, words)) is not None:
            ways.append(coils)
        refusal = None
        for ask in ways:
            try:
                yield from self._write(replace(ask, acts=True, **how), called)
            except RefusedError as error:
                if error.code != fn.UNKNOWN_FUNCTION:
                    raise
                self._lacking.add(_function(ask))
                refusal = refusal or error
            else:
                self._lacking.discard(_function(ask))
                return
        tried = " nor ".join(str(_function(ask)) for ask in ways)
        lacks = f"it takes neither function {tried}" if len(ways) > 1 else f"{len(words)} registers need {tried}"
        reason = f"{refusal.reason if refusal else ''}; {lacks}; see the option write_function"
        raise RefusedError(called, fn.UNKNOWN_FUNCTION, reason)

    def _write(self, ask: Ask, called: str) -> Exchange[None]:
        # A reply to another function names no value, so a late one could match until a read has been answered.
        is_late = self._memory.unanswered and not ask.mirrored
        if is_late and not ask.urgent:
            yield self._probing()
        yield from self.send_request(ask, called)
        if not self.is_there or (is_late and ask.urgent):
            # An adapter's echo could be the mirrored reply, but not the reply to a read. A stop has already been sent.
            yield self._probing()
            self.is_there = True
            if ask.urgent:
                # Repeat the stop, so that the drive itself confirms it.
                yield from self.send_request(ask, called)

    def _probing(self) -> Ask:
        return self._modbus.reading(self._modbus.probe, 1)

    def _ways(self, place: RegisterPlace, words: Sequence[int]) -> list[Ask]:
        """Return the requests that write these words, beginning with the one that the drive most likely accepts."""
        modbus = self._modbus
        if modbus.options.wide_functions and len(words) == 2:
            value = words[0] << 16 | words[1]
            message = Request(address=modbus.address, function=fn.WRITE_LONG, start=place.start, value=value)
            return [Ask(message=message, distinct=True, mirrored=True)]
        ways = [modbus.writing(place, words)]
        if len(words) == 1:
            first = modbus.options.write_function == fn.WRITE_REGISTER
            ways.insert(0 if first else 1, modbus.writing_one(place, words[0]))
        return sorted(ways, key=lambda each: _function(each) in self._lacking)

    def _coils_of(self, place: RegisterPlace, words: Sequence[int]) -> Ask | None:
        """Return the request that writes a register as coils, one for each bit; None if the model has none."""
        modbus = self._modbus
        if modbus.model is None or place.is_bit or len(words) != 1:
            return None
        for address, shown in modbus.model.control.get("views", {}).items():
            coil = modbus.place_of(address)
            if coil.is_bit and isinstance(shown, str) and modbus.place_of(shown) == place:
                return modbus.writing(coil, tuple(words[0] >> bit & 1 for bit in range(16)))
        return None


def _function(ask: Ask) -> int:
    function: int = ask.message.function  # type: ignore[attr-defined]
    return function
