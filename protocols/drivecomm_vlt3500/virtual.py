"""A virtual VLT.

VLT Series 3500 manual, printed pages 85 to 92; VLT 3000 manual MG.30.A7.02, pages 75 (control word) and 78 (status
word, start inhibit). No source describes what a drive does with broken telegrams, a `P` in byte 7 or a value with too
many decimals: the README lists the decisions.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError, ValueRefusedError
from drivecomm.protocol import (
    Damaged,
    DriveRepr,
    Framed,
    LineSettings,
    Motor,
    Refusal,
    VirtualReply,
    refusals_as_address_errors,
)
from drivecomm_vlt3500.machine import VltMachine
from drivecomm_vlt3500.messages import Control, ControlReply, Read, ReadIndex, Reply, Request, Update
from drivecomm_vlt3500.parameters import ANYTHING_ELSE, BAD_DECIMALS, DECIMALS, target
from drivecomm_vlt3500.store import VltStore
from drivecomm_vlt3500.telegrams import BROADCAST, LENGTH, STOP, UNCHECKED, telegrams

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_vlt3500.options import VltOptions

_FAULT_MEMORY = 602
_ADDRESS, _REFERENCE, _FUNCTION = 500, 516, 309


class VirtualVltDrive(DriveRepr):
    """A VLT at one address: parameter store, control word with its held groups, start inhibit, motor.

    `machine` implements the control word. `store.factory_setup`, `machine.overloaded` and the motor may be changed from
    outside to cause these conditions. The baud rate in parameter 501 is a number without effect, because the coding of
    speeds is unknown.
    """

    def __init__(self, address: int, options: VltOptions, model: Model) -> None:
        self.address = address
        self.codec = telegrams()
        self.settings = LineSettings()
        self.gap_s = 0.050
        self.motor = Motor()
        self.store = VltStore(model)
        self.store.decimals(_REFERENCE, options.reference_decimals)
        self.store.poke(_ADDRESS, None, Decimal(address))
        if options.start_inhibit:
            self.store.poke(_FUNCTION, None, Decimal(11))
        self.machine = VltMachine(self.motor, self.store, dc_brake=options.dc_brake)
        self.store.measured = self.machine.measured()
        self._model = model
        self._options = options

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a telegram: silence for damaged telegrams and those to other drives, a cause for refused requests."""
        self.machine.live(now)
        if isinstance(find, Damaged):
            return self._complain(find, now)
        message = find.message
        if not isinstance(message, Request) or message.address not in (self.address, BROADCAST):
            return None
        self.machine.obey(message.control_word, message.control_mask, now)
        reply = self._answer(message, now)
        self.address = int(self.store.number(_ADDRESS, self.address))
        return None if message.address == BROADCAST else self._send(reply)

    def peek(self, parameter: str, now: float) -> str:
        """Return the value as a reading would show it, with the decimals that the drive sends."""
        self.machine.live(now)
        wanted = target(parameter, self._model)
        with refusals_as_address_errors(parameter):
            return str(self.store.fetch(wanted.number, wanted.index))

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set a value; a text keeps its decimals if the parameter has fewer."""
        wanted = target(parameter, self._model)
        try:
            value = Decimal(raw)
            if not value.is_finite() or int(value.as_tuple().exponent) < -DECIMALS[-1]:
                raise InvalidOperation  # noqa: TRY301
            with refusals_as_address_errors(parameter):
                self.store.poke(wanted.number, wanted.index, value)
        except InvalidOperation as error:
            raise ValueRefusedError(
                f"{raw!r} for parameter {parameter} is not a number that a drive can hold"
            ) from error
        if wanted.number == _ADDRESS:
            self.address = int(value)

    def power_cycle(self, now: float) -> None:
        """Switch the mains off and on: control word and trip are lost; all parameters are kept.

        No source describes which parameters a real drive keeps.
        """
        self.machine.live(now)
        self.machine.power_up(now)

    def trip(self, code: int, now: float) -> None:
        """Trip: output off, status bit 3, the code as alarm word and at the front of the fault memory."""
        self.machine.trip(code, now)
        self.store.remember(_FAULT_MEMORY, code, Decimal(int(now // 3600)))

    def _answer(self, message: Request, now: float) -> Reply | ControlReply:
        if isinstance(message, Control):
            return ControlReply(**self._said(message), filler=message.filler)
        value: Decimal | None = None
        code: int | None = None
        try:
            if isinstance(message, Update):
                value = self.store.write(message.parameter, Decimal(message.value), running=self.motor.running)
            else:
                index = message.index if isinstance(message, ReadIndex) else None
                value = self.store.fetch(message.parameter, index)
        except Refusal as refusal:
            code = refusal.code
        if isinstance(message, Update):
            self.machine.live(now)
        return self._reply(message, value, code)

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse the parameter access of a telegram; its control word is obeyed."""
        message = find.message
        if not isinstance(message, Update | Read | ReadIndex) or message.address == BROADCAST:
            return None
        self.machine.live(now)
        self.machine.obey(message.control_word, message.control_mask, now)
        return self._send(self._reply(message, None, code))

    def _reply(self, message: Update | Read | ReadIndex, value: Decimal | None, code: int | None) -> Reply:
        decimals = None if value is None else -int(value.as_tuple().exponent)
        return Reply(**self._said(message), kind=message.kind, value=value, decimals=decimals, fault_code=code)

    def _said(self, message: Request) -> dict[str, Any]:
        """Return the status, and the fields that every reply repeats from its request."""
        return {
            "address": message.address,
            "status_word": self.machine.status(),
            "parameter": message.parameter,
            "unchecked": message.unchecked if self._options.copies_unchecked else None,
        }

    def _complain(self, find: Damaged, now: float) -> VirtualReply | None:
        """Answer a bad byte 19 with cause 07, and other damage with silence, or with 99 if that option is set."""
        if len(find.data) != LENGTH:
            return None
        bad_decimals = find.error.category == "field" and find.error.field == "decimals"
        if not bad_decimals and not self._options.answers_broken:
            return None
        # Decode the telegram with a valid byte 19, data and check characters in place of the damaged ones.
        try:
            message = self.codec.decode(find.data[:13] + b"000000" + UNCHECKED + STOP, "request")
        except TelegramError:
            return None
        if not isinstance(message, Update | Read | ReadIndex) or message.address != self.address:
            return None
        message = replace(message, unchecked=True if bad_decimals and find.data[19:21] == UNCHECKED else None)
        if bad_decimals:
            self.machine.obey(message.control_word, message.control_mask, now)
        return self._send(self._reply(message, None, BAD_DECIMALS if bad_decimals else ANYTHING_ELSE))

    def _send(self, message: Reply | ControlReply) -> VirtualReply:
        return VirtualReply(data=self.codec.encode(message), delay_s=self._options.reply_delay_s)
