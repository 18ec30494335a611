"""Fault codes: why a drive answers with AK 7; tables.toml has the words of the manuals."""

from __future__ import annotations

from drivecomm_danfoss_fc.tables import table

NO_SUCH_PARAMETER = 0
READ_ONLY = 1
OUTSIDE_LIMITS = 2
NO_SUCH_INDEX = 3
NOT_AN_ARRAY = 4
WRONG_TYPE = 5
NO_SUCH_ELEMENT = 9
NO_TEXT = 15
NOT_WHILE_RUNNING = 17
NO_BUS_ACCESS = 130
FACTORY_SET_UP = 131
NOT_SUPPORTED = 253


def fault_text(code: int) -> str:
    """Return the manual's words for a fault code; codes that no manual lists are named by their number."""
    return str(table("faults").get(code, f"unlisted fault {code} ({code:02X}H)"))
