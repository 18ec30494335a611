"""Fault codes: why a drive answers with AK 7.

Specification, section 9. The tables of the manuals disagree about how they print the number: the FC 101 and FC 360
guides and the VLT 6000 manual print decimal, the FC 102, FC 202 and later FC 300 guides print 11, 82 and 83 under a
hexadecimal heading. On the wire they are 11H (17), 82H (130) and 83H (131); code 11 decimal (0BH) is another fault.
"""

from __future__ import annotations

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

FAULTS = {
    NO_SUCH_PARAMETER: "parameter number does not exist",
    READ_ONLY: "parameter cannot be changed, no write access",
    OUTSIDE_LIMITS: "value above or below its limits",
    NO_SUCH_INDEX: "sub-index does not exist",
    NOT_AN_ARRAY: "parameter is not an array",
    WRONG_TYPE: "wrong data type",
    6: "not used",
    7: "not used",
    NO_SUCH_ELEMENT: "description element not available",
    11: "no parameter write access",
    NO_TEXT: "no text available",
    NOT_WHILE_RUNNING: "not possible in the present mode, for example while the motor runs",
    18: "other error",
    100: "no text given in the manuals",
    NO_BUS_ACCESS: "no bus access to this parameter",
    FACTORY_SET_UP: "not possible, factory set-up selected",
    132: "no LCP access",
    252: "unknown viewer",
    NOT_SUPPORTED: "request not supported",
    254: "unknown attribute",
    255: "no error",
}


def fault_text(code: int) -> str:
    """Return the manual's words for a fault code; codes that no manual lists are named by their number."""
    return FAULTS.get(code, f"unlisted fault {code} ({code:02X}H)")
