"""State that a master keeps for one Modbus drive."""

from __future__ import annotations

from drivecomm.profiles import RegisterCommandMemory


class ModbusMemory(RegisterCommandMemory):
    """The memory of one drive, shared by all callers that command it on one bus.

    lacking: write functions that the drive refused as unknown; they are tried last.
    """

    def __init__(self) -> None:
        super().__init__()
        self.lacking: set[int] = set()
