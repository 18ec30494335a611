"""Registers and coils in Modbus telegrams."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm.profiles import Dialect, RegisterPlace
from drivecomm.protocol import Ask
from drivecomm_modbus import functions as fn, parameters
from drivecomm_modbus.control import ModbusControl, control_of
from drivecomm_modbus.messages import Request
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions

_READS = {"": fn.READ_REGISTERS, "i": fn.READ_INPUT_REGISTERS, "c": fn.READ_COILS, "d": fn.READ_INPUTS}
_EXCEPTIONS = {"function": 1, "sub_function": 1, "unknown": 2, "read only": 2, "limits": 3, "count": 3, "running": 4}
"""Exception codes for refusals if the model of a series gives no others."""


class ModbusDialect(Dialect):
    """The registers and coils of one Modbus drive, defined by its options and the table [control] of its model."""

    title = "Modbus"
    broadcast_address = BROADCAST
    requests = Request
    busy, stop_again = (fn.BUSY,), (5,)
    follows = ()
    joins = True
    reference_option = "reference_maximum_hz=50"

    def __init__(self, address: int, options: ModbusOptions, model: Model | None) -> None:
        super().__init__(address, options, model)
        self.most, self.bridged = options.max_registers, options.bridged_registers
        self.state_timeout_s, self.reply_delay_s = options.state_timeout_s, options.reply_delay_s
        self.reference_range = options.reference_range
        self.probe, self.identity = self.control.probe, self.control.identity
        self.refusals, self.codes = self.control.exceptions, {**_EXCEPTIONS, **self.control.refusals}

    @cached_property
    def control(self) -> ModbusControl:
        """The commands and storage of the drive."""
        return control_of(self.model, self.options)

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an address as the manual prints it. Raises ParameterAddressError."""
        return parameters.place_of(address, self.options)

    def address_at(self, place: RegisterPlace) -> str:
        """Return the address of a place as the model gives it, or else in the numbering of the manual."""
        known = self.places.get(place)
        return known.address if known else parameters.address_at(place, self.options)

    def allowed(self, place: RegisterPlace) -> range | None:
        """Return the values of a coil; None for a register."""
        return range(2) if place.is_bit else None

    def is_wide(self, place: RegisterPlace, type: str) -> bool:
        """Whether functions 64H and 65H read and write a place."""
        return type.endswith("32") and not place.kind and bool(self.options.wide_functions)

    def reading(self, place: RegisterPlace, count: int, /) -> Ask:
        """Return the request that reads consecutive registers."""
        message = Request(address=self.address, function=_READS[place.kind], start=place.start, count=count)
        # The reply repeats nothing of the request, so a late one could be mistaken for the next.
        return Ask(message=message, nameless=True)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes registers by a function that contains their number."""
        function = fn.WRITE_COILS if place.is_bit else fn.WRITE_REGISTERS
        message = Request(address=self.address, function=function, start=place.start, values=tuple(words))
        return Ask(message=message, distinct=True)

    def writing_one(self, place: RegisterPlace, word: int) -> Ask:
        """Return the request that writes one register or coil, and that equals its reply."""
        function = fn.WRITE_COIL if place.is_bit else fn.WRITE_REGISTER
        message = Request(address=self.address, function=function, start=place.start, value=word)
        return Ask(message=message, distinct=True, mirrored=True)

    def words(self, reply: Any, _place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the words in the reply to a read."""
        return reply.values or (0,)

    def refusal(self, reply: Any) -> int | None:
        """Return the exception code of a reply; None if there is none."""
        code: int | None = reply.exception
        return code

    def refusal_text(self, code: int, called: str) -> str:
        """Return the meaning of an exception; without a model, also a hint about how the manual numbers registers."""
        text = super().refusal_text(code, called)
        hint = self.model is None and code == fn.UNKNOWN_ADDRESS and parameters.counting_hint(called, self.options)
        return f"{text}; {hint}" if hint else text
