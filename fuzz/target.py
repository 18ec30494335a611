"""Fuzz targets: functions of bytes that raise only if drivecomm has a flaw."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from mutation import Mutator

FOUND = Path(__file__).with_name("found")
"""Folder of stored inputs that revealed a flaw, one subfolder for each target."""


class PropertyBrokenError(Exception):
    """No error was raised, but the result cannot be right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FuzzTarget:
    """One reader of foreign data.

    name: as on the command line. check: raises any error outside drivecomm's tree of errors, and PropertyBrokenError.
    seeds: valid inputs to start with. mutate: makes new inputs from existing ones.
    """

    name: str
    check: Callable[[bytes], None]
    seeds: tuple[bytes, ...]
    mutate: Mutator

    def found(self) -> list[bytes]:
        """Return the stored inputs that once revealed a flaw, in a fixed order."""
        return [path.read_bytes() for path in sorted((FOUND / self.name).glob("*")) if path.is_file()]


def expect(condition: object, failure: str) -> None:
    """Raise PropertyBrokenError with this reason unless the condition holds."""
    if not condition:
        raise PropertyBrokenError(failure)
