"""Why a drive refuses: the cause in bytes 17 and 18 of a reply whose byte 19 is 9; causes.toml has their meaning."""

from __future__ import annotations

from drivecomm.protocol import code_texts

UNKNOWN_PARAMETER = 0
NOT_ACCESSIBLE = 1
NO_SUCH_INDEX = 2
NOT_INDEXED = 3
READ_ONLY = 4
NOT_WHILE_RUNNING = 5
OUT_OF_RANGE = 6
BAD_DECIMALS = 7
TOO_LONG_TO_SEND = 8
ANYTHING_ELSE = 99


def cause_text(code: int) -> str:
    """Return the manual's meaning of a cause; one that the manual does not list is named by its number."""
    return code_texts(__file__, "causes.toml").get(code, f"unlisted cause {code}")
