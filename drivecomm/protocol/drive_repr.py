"""How a virtual drive is shown at the prompt and in failed assertions."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol.motor import Motor


class DriveRepr:
    """Base of virtual drives: their address and what the motor did when the drive was last asked."""

    address: int
    motor: Motor

    def __repr__(self) -> str:
        motor = self.motor
        does = f"fault {motor.fault}" if motor.fault else f"{motor.output_hz:g} Hz" if motor.running else "stopped"
        return f"<{type(self).__name__} at address {self.address}, {does}>"
