"""Communication errors: the code of a NAK, which is also what M26 holds.

tables.toml has their texts, with the pages.
"""

from __future__ import annotations

from drivecomm_fuji.tables import TABLES

CHECKSUM_ERROR = 71
FORMAT_ERROR = 74
COMMAND_ERROR = 75
LINK_PRIORITY = 76
FUNCTION_ERROR = 78
WRITE_DISABLED = 79
DATA_ERROR = 80
WRITE_BUSY = 81

WITHOUT_ECHO = frozenset([FORMAT_ERROR, COMMAND_ERROR])
"""Codes whose NAK need not repeat command and function: FRENIC5000G11S RS-485 manual p. 13, HVAC/AQUA manual 4-5."""


def error_text(code: int) -> str:
    """Return the manuals' words for an error code; codes that no manual lists are named by their number."""
    return str(TABLES["errors"].get(str(code), f"unlisted error {code}"))
