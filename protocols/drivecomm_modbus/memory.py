"""What a master remembers of one Modbus drive."""

from __future__ import annotations

from drivecomm.profiles import OrderMemory


class ModbusMemory(OrderMemory):
    """The memory of one drive, shared by all that command it on one bus.

    lacking: the functions for writing that the drive refused as unknown; they are tried last.
    """

    def __init__(self) -> None:
        super().__init__()
        self.lacking: set[int] = set()
