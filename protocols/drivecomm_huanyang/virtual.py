"""How a Huanyang drive answers control data, where it is not as all drives that hold registers do."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.profiles import VirtualRegisterDrive
from drivecomm.protocol import Command, Framed, LineSettings, VirtualReply
from drivecomm_huanyang import telegrams as fn
from drivecomm_huanyang.dialect import HuanyangDialect
from drivecomm_huanyang.telegrams import HuanyangCodec, Reply

if TYPE_CHECKING:
    from drivecomm.protocol import Message, Model
    from drivecomm_huanyang.options import HuanyangOptions


class VirtualHuanyangDrive(VirtualRegisterDrive):
    """A drive at one address. It obeys the line where PD001 says so, and has a motor that PD005 limits."""

    def __init__(self, address: int, options: HuanyangOptions, model: Model) -> None:
        super().__init__(HuanyangDialect(address, options, model), HuanyangCodec(), LineSettings())

    def answer(self, request: Any, now: float) -> Message:
        """Do what a request says, and return the reply; that to control data tells how the drive is."""
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
        """Refuse a request; the codes of refusals are functions, and each kind of request has one."""
        request: Any = find.message
        refused = fn.CONTROL_REFUSED if request.function == fn.CONTROL else fn.REFUSED
        self.follow(now)
        return self._sent(self.refuse(request, "unknown")) if code == refused else None

    def _status_byte(self) -> int:
        """Return CNST: run, jog, r/f as commanded, running, jogging, r/f as it turns (p. 62)."""
        motor = self.motor
        says = (motor.command is Command.RUN, False, motor.target_hz < 0, motor.running, False, motor.output_hz < 0)
        return sum(holds << bit for bit, holds in enumerate(says))
