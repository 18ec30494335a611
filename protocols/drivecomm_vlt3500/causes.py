"""Why a drive refuses: the cause in bytes 17 and 18 of a reply whose byte 19 is 9.

VLT Series 3500 manual, printed page 92; VLT 3000 manual MG.30.A7.02, page 80. The older page 86 knows only "unknown
parameter", which is cause 00. For VLT 2000 the table was not seen; a public program treats byte 19 = 9 as "invalid
parameter" only.
"""

from __future__ import annotations

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

CAUSES = {
    UNKNOWN_PARAMETER: "unknown parameter number",
    NOT_ACCESSIBLE: "parameter not accessible for what was asked",
    NO_SUCH_INDEX: "no such index",
    NOT_INDEXED: "the parameter is not indexed",
    READ_ONLY: "read-only, always or while the factory setup is active",
    NOT_WHILE_RUNNING: "not changeable while the motor runs",
    OUT_OF_RANGE: "value out of range",
    BAD_DECIMALS: "number of decimals (byte 19) not accepted",
    TOO_LONG_TO_SEND: "the value exceeds 99999 and cannot be sent",
    ANYTHING_ELSE: "any other reason",
}


def cause_text(code: int) -> str:
    """Return the manual's meaning of a cause; one that the manual does not list is named by its number."""
    return CAUSES.get(code, f"unlisted cause {code}")
