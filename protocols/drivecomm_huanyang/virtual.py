"""A virtual Huanyang drive, with answers to control data that differ from other drives with registers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.profiles import VirtualRegisterDrive
from drivecomm.protocol import Framed, LineSettings, MotorCommand, VirtualReply
from drivecomm_huanyang import telegrams as fn
from drivecomm_huanyang.dialect import HuanyangDialect
from drivecomm_huanyang.telegrams import HuanyangCodec, Reply

if TYPE_CHECKING:
    from drivecomm.protocol import Message, Model
    from drivecomm_huanyang.options import HuanyangOptions


class VirtualHuanyangDrive(VirtualRegisterDrive):
    """A drive at one address. It obeys the line if PD001 says so, and PD005 limits its motor."""

    def __init__(self, address: int, options: HuanyangOptions, model: Model) -> None:
        super().__init__(HuanyangDialect(address, options, model), HuanyangCodec(), LineSettings())

    def answer(self, request: Any, now: float) -> Message:
        """Carry out a request and return the reply; the reply to control data contains the drive's state."""
        reply = super().answer(request, now)
        if isinstance(reply, Reply) and reply.function == fn.CONTROL:
            return replace(reply, value=self._status_byte())
        return reply

    def refuse(self, request: Any, why: Any) -> Message:
        """Return the refusal of a request."""
        if request.function != fn.CONTROL:
            return super().refuse(request, why)
        same = {"address": self.address, "function": fn.CONTROL_REFUSED}
        return Reply(**same, length=1, value=self._status_byte())

    def refusing(self, find: Framed, code: int, now: float) -> VirtualReply | None:
        """Refuse a request with a function code, if that is the refusal for its kind; otherwise stay silent."""
        request: Any = find.message
        refused = fn.CONTROL_REFUSED if request.function == fn.CONTROL else fn.REFUSED
        self.follow(now)
        return self._sent(self.refuse(request, "unknown")) if code == refused else None

    def _status_byte(self) -> int:
        """Return CNST: run, jog, r/f as commanded, running, jogging, r/f as the motor turns (p. 62)."""
        motor = self.motor
        says = (
            motor.command is MotorCommand.RUN,
            False,
            motor.target_hz < 0,
            motor.running,
            False,
            motor.output_hz < 0,
        )
        return sum(holds << bit for bit, holds in enumerate(says))
