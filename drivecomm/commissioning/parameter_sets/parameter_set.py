"""Parameter sets: what the parameters of one drive were at one time, with what tells that drive from others."""

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
"""settings: how the drive works. communication: how it is spoken to. measured: what it shows and nobody restores.
unknown: what the drive holds and its model does not know, as the telegram carried it; nobody restores it either."""

PARTS: tuple[Part, ...] = ("settings", "communication", "measured", "unknown")
"""All parts of a parameter set."""

SETTINGS: tuple[Part, ...] = ("settings",)
WRITABLE: tuple[Part, ...] = ("settings", "communication")
"""The parts of a set that can be written back to a drive."""

_DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One value of one parameter.

    address: in the protocol's form, with data set or index where the parameter has several values. name: of the model.
    value: physical where the model knows the scale. raw: as the telegram carried it, None where that says no more.
    common: the common name, where the model maps one to it. meaning: what the value stands for; for people only.
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
        """What the telegram carried."""
        return str(self.value) if self.raw is None else self.raw

    @property
    def parameter(self) -> str:
        """The address without data set and index."""
        return self.address.partition("[")[0]

    def __str__(self) -> str:
        return f"{self.value} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Explored:
    """What a drive answered that was asked for every address it may hold.

    asked: how many addresses. answered: how many of them told a value. known: how many of those its model knows.
    """

    asked: int
    answered: int
    known: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Approval:
    """by: who says that a drive shall be set so. why: in their words. time: when they said it, in UTC."""

    by: str
    time: datetime
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterSet:
    """The parameters of one drive. drive: as the command line names it, "vabus:1". model: by the name that it has.

    identity: what the drive told of itself. entries: by address, in the order of addresses. not_read: why a parameter
    is not among them, by address. time: when reading began, in UTC; None for a set that somebody made by hand.
    explored: None where only what its model knows was asked for. approved: of the baseline of a drive only.
    """

    protocol: str
    drive: str
    model: str
    entries: Mapping[str, Entry]
    firmware: str = ""
    identity: Mapping[str, str] = field(default_factory=dict)
    not_read: Mapping[str, str] = field(default_factory=dict)
    time: datetime | None = None
    explored: Explored | None = None
    approved: Approval | None = None

    def of(self, parts: Iterable[Part]) -> list[Entry]:
        """Return the entries of these parts."""
        wanted = frozenset(parts)
        return [entry for entry in self.entries.values() if entry.part in wanted]


def in_order(addresses: Iterable[str]) -> list[str]:
    """Return parameter addresses as people count them: 9 before 10, 3-02 before 3-10, [2] before [10]."""
    return sorted(addresses, key=_place)


def _place(address: str) -> list[tuple[int, int, str]]:
    return [
        (0, int(part), part) if part.isascii() and part.isdigit() else (1, 0, part)
        for part in _DIGITS.split(address)
        if part
    ]


def same(left: Value, right: Value) -> bool:
    """Return whether two values are the same: 10, 10.00 and a "10.00" that somebody wrote for a number are."""
    if isinstance(left, str) is isinstance(right, str):
        return left == right
    try:
        return Decimal(left) == Decimal(right)
    except InvalidOperation:
        return False


def in_unit(value: Value, given: str, wanted: str) -> Value:
    """Return a value in another unit, exactly. Raises UsageError where that is not known or it is no number."""
    if given == wanted:
        return value
    try:
        number = Decimal(value)
    except InvalidOperation:
        raise UsageError(f"{value!r} is no number and cannot be given in {wanted or 'another unit'}") from None
    return converted(number, given, wanted)
