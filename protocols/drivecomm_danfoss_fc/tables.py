"""Tables of the manuals; tables.toml names the pages."""

from __future__ import annotations

from functools import cache
from typing import Any

from drivecomm.protocol import tables_beside

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
"""Fault codes: the reasons for a reply with AK 7."""


@cache
def table(name: str) -> dict[int, Any]:
    """Return a table by its name, with numbers as keys; the file is read on first use, but never for a stop."""
    return {int(number): each for number, each in tables_beside(__file__, "tables.toml")[name].items()}


def fault_text(code: int) -> str:
    """Return the manual's text for a fault code; a code that no manual lists is named by its number."""
    return str(table("faults").get(code, f"unlisted fault {code} ({code:02X}H)"))
