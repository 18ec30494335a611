"""The error register, parameter 11: why the drive answered NAK.

Short description section 6.5; codes 20 and 30 from the Agile VABus manual p. 33 and the CM-VABus/TCP manual p. 40.
"""

from __future__ import annotations

ERROR_REGISTER = 11

VALUE_NOT_PERMITTED = 1
DATASET_NOT_PERMITTED = 2
NOT_READABLE = 3
NOT_WRITABLE = 4
NOT_WHILE_RUNNING = 8
DATASETS_DIFFER = 9
UNKNOWN_PARAMETER = 11
CHECKSUM_ERROR = 12
SYNTAX_ERROR = 13
WRONG_LENGTH = 14
SYSTEM_BUS_UNREACHABLE = 20

ERRORS = {
    0: "no error",
    VALUE_NOT_PERMITTED: "value not permitted",
    DATASET_NOT_PERMITTED: "data set not permitted",
    NOT_READABLE: "not readable",
    NOT_WRITABLE: "not writable",
    5: "EEPROM read error",
    6: "EEPROM write error",
    7: "EEPROM checksum error",
    NOT_WHILE_RUNNING: "not writable while the drive runs",
    DATASETS_DIFFER: "the four data sets differ",
    10: "wrong parameter type",
    UNKNOWN_PARAMETER: "unknown parameter",
    CHECKSUM_ERROR: "checksum error in the received telegram",
    SYNTAX_ERROR: "syntax error in the received telegram",
    WRONG_LENGTH: "number of characters does not fit the type",
    15: "unknown error",
    SYSTEM_BUS_UNREACHABLE: "system-bus node cannot be reached",
    30: "syntax error",
}

LINE_FAULTS = frozenset([CHECKSUM_ERROR, SYNTAX_ERROR])
"""What a disturbed line can cause, so that asking once more makes sense."""


def error_text(code: int) -> str:
    """Return the manual's words for an error code; codes that no manual lists are named by their number."""
    return ERRORS.get(code, f"unlisted error {code}")
