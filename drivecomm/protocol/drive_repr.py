"""Text representation of virtual drives, for the prompt and for failed assertions."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol.motor import Motor


class DriveRepr:
    """Base class of virtual drives that shows the address and the state of the motor at the drive's last action."""

    address: int
    motor: Motor

    def __repr__(self) -> str:
        motor = self.motor
        does = f"fault {motor.fault}" if motor.fault else f"{motor.output_hz:g} Hz" if motor.running else "stopped"
        return f"<{type(self).__name__} at address {self.address}, {does}>"
