"""Parameter sets: the parameters of one drive at one time, with the identity of that drive."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.models import converted

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from datetime import datetime

    from drivecomm.protocol import Value

Part: TypeAlias = Literal["settings", "communication", "measured", "unknown"]
"""Part of a parameter set.

settings: how the drive works. communication: its address and line settings. measured: displayed values, never restored.
unknown: raw values of parameters that the model does not know, never restored either.
"""

PARTS: tuple[Part, ...] = ("settings", "communication", "measured", "unknown")
"""All parts of a parameter set."""

SETTINGS: tuple[Part, ...] = ("settings",)
WRITABLE: tuple[Part, ...] = ("settings", "communication")
"""The parts of a set that can be written back to a drive."""

_DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterEntry:
    """One value of one parameter.

    address: in the protocol's form, with data set or index if the parameter has several values. name: name in the
    model. value: physical if the model knows the scale. raw: as the telegram carried it, None if it adds nothing to the
    value. common: the common name, if the model maps one to the parameter. meaning: text for the value, for display
    only.
    """

    address: str
    value: Value
    name: str = ""
    unit: str = ""
    raw: int | str | None = None
    common: str = ""
    part: Part = "settings"
    meaning: str = field(default="", compare=False)

    @property
    def carried(self) -> int | str:
        """Value as the telegram carried it."""
        return str(self.value) if self.raw is None else self.raw

    @property
    def parameter(self) -> str:
        """Address without data set and index."""
        return self.address.partition("[")[0]

    def __str__(self) -> str:
        return f"{self.value} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Explored:
    """Counts of a drive's answers when every possible address was requested.

    asked: number of addresses. answered: how many of them gave a value. known: how many of the answered ones the model
    knows.
    """

    asked: int
    answered: int
    known: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Approval:
    """Approval of a parameter set. by: name of the person. why: the reason in their words. time: in UTC."""

    by: str
    time: datetime
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterSet:
    """Parameters of one drive. drive: name on the command line, "vabus:1". model: name of its model.

    identity: identity that the drive reported. entries: by address, in the order of addresses. not_read: reasons why
    parameters are missing, by address. time: start of the reading, in UTC; None for a set that was written by hand.
    explored: None if only parameters that the model knows were read. approved: only in the baseline of a drive.
    """

    protocol: str
    drive: str
    model: str
    entries: Mapping[str, ParameterEntry]
    firmware: str = ""
    identity: Mapping[str, str] = field(default_factory=dict)
    not_read: Mapping[str, str] = field(default_factory=dict)
    time: datetime | None = None
    explored: Explored | None = None
    approved: Approval | None = None

    def of(self, parts: Iterable[Part]) -> list[ParameterEntry]:
        """Return the entries of these parts."""
        wanted = frozenset(parts)
        return [entry for entry in self.entries.values() if entry.part in wanted]


def in_order(addresses: Iterable[str]) -> list[str]:
    """Sort parameter addresses in natural order: 9 before 10, 3-02 before 3-10, [2] before [10]."""
    return sorted(addresses, key=_place)


def _place(address: str) -> list[tuple[int, int, str]]:
    return [
        (0, int(part), part) if part.isascii() and part.isdigit() else (1, 0, part)
        for part in _DIGITS.split(address)
        if part
    ]


def same(left: Value, right: Value) -> bool:
    """Return whether two values are equal; 10, 10.00 and a hand-written "10.00" are equal."""
    if isinstance(left, str) is isinstance(right, str):
        return left == right
    try:
        return Decimal(left) == Decimal(right)
    except InvalidOperation:
        return False


def in_unit(value: Value, given: str, wanted: str) -> Value:
    """Convert a value exactly to another unit. Raises UsageError if no conversion is known or it is not a number."""
    if given == wanted:
        return value
    try:
        number = Decimal(value)
    except InvalidOperation:
        raise UsageError(
            f"{value!r} is not a number, so it cannot be converted to {wanted or 'another unit'}"
        ) from None
    return converted(number, given, wanted)
