"""What is fuzzed: a function of bytes that raises only when something is wrong with drivecomm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from mutation import Mutator

FOUND = Path(__file__).with_name("found")
"""What was found, one folder for each target: the only inputs that are kept."""


class PropertyBrokenError(Exception):
    """No error came out, and what came out cannot be right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One thing that reads what others wrote.

    name: as the command line calls it. check: raises whatever came out of drivecomm that is not in its tree of errors,
    and PropertyBrokenError. seeds: sound inputs to begin with. mutate: makes new inputs of old ones.
    """

    name: str
    check: Callable[[bytes], None]
    seeds: tuple[bytes, ...]
    mutate: Mutator

    def found(self) -> list[bytes]:
        """Return the inputs that once showed something, in a fixed order."""
        return [path.read_bytes() for path in sorted((FOUND / self.name).glob("*")) if path.is_file()]


def expect(condition: object, failure: str) -> None:
    """Raise PropertyBrokenError with this reason unless the condition holds."""
    if not condition:
        raise PropertyBrokenError(failure)
