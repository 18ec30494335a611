"""Communication errors: the code of a NAK, which is also what M26 holds.

FVR-E11S manual 9-19; FRENIC5000G11S technical information 2-57; HVAC/AQUA RS-485 manual 4-17 and 5-69. The codes 1, 2,
3 and 7 of the same tables belong to Modbus RTU and never occur here.
"""

from __future__ import annotations

CHECKSUM_ERROR = 71
FORMAT_ERROR = 74
COMMAND_ERROR = 75
LINK_PRIORITY = 76
FUNCTION_ERROR = 78
WRITE_DISABLED = 79
DATA_ERROR = 80
WRITE_BUSY = 81

ERRORS = {
    CHECKSUM_ERROR: "checksum error in the received frame",
    72: "parity error in the received frame",
    73: "framing error, overrun or full buffer",
    FORMAT_ERROR: "format error: ENQ or ETX is not in its place",
    COMMAND_ERROR: "unknown command",
    LINK_PRIORITY: "link priority: the link function (H30, y98, y99) does not allow this over RS-485",
    77: "no right to write",
    FUNCTION_ERROR: "unknown function code",
    WRITE_DISABLED: "writing is not allowed: read only, or not while running",
    DATA_ERROR: "data out of range",
    WRITE_BUSY: "an earlier write is still in progress",
}

WITHOUT_ECHO = frozenset([FORMAT_ERROR, COMMAND_ERROR])
"""Codes whose NAK need not repeat command and function: FRENIC5000G11S RS-485 manual p. 13, HVAC/AQUA manual 4-5."""


def error_text(code: int) -> str:
    """Return the manuals' words for an error code; codes that no manual lists are named by their number."""
    return ERRORS.get(code, f"unlisted error {code}")
