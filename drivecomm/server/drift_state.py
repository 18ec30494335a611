"""Drift of drives: the result of the server's last comparison of each drive with its baseline."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import Value

_NAMED = 5
"""Number of parameters that a text names; `changes` has all of them."""

DriftKind: TypeAlias = Literal["as approved", "changed", "replaced", "not comparable", "no baseline", "not compared"]
"""The result of a comparison with the baseline.

not comparable: nothing is known to differ, but some parameters could not be compared. not compared: there is no
comparison yet, or the baseline cannot be read.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class SetChange:
    """One parameter that differs from the approved set.

    approved, now: in `unit`. since_s: the time of the first backup with the current value, in seconds since 1970.
    """

    address: str
    name: str
    unit: str
    approved: Value
    now: Value
    since_s: float

    def __str__(self) -> str:
        named = f"{self.address} {self.name}".rstrip()
        return f"{named}: {self.approved} -> {self.now} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class NotComparable:
    """One parameter that was read only once, either at approval or now. reason: why the other value is missing."""

    address: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveDrift:
    """The differences between a drive and its baseline.

    cause: why there is no comparison. changes: also earlier changes whose parameter could not be read the last time.
    replaced: the evidence that it is another drive, empty otherwise; replaced_since_s: the time of the first backup
    that showed it; restore: the command that writes the approved set to it. untold: identity facts that the drive
    reported when it was approved, but does not report now. equal: the number of parameters as approved. approved_by,
    approved_s: the person who approved the set, and the time. compared_s: the time of the reading that was compared.
    All times are in seconds since 1970.
    """

    state: DriftKind
    cause: str = ""
    changes: tuple[SetChange, ...] = ()
    replaced: str = ""
    replaced_since_s: float | None = None
    restore: str = ""
    not_comparable: tuple[NotComparable, ...] = ()
    untold: tuple[str, ...] = ()
    equal: int = 0
    approved_by: str = ""
    approved_s: float | None = None
    compared_s: float | None = None

    @property
    def changed(self) -> int | None:
        """The number of parameters that differ, or None without a comparison."""
        return None if self.state in ("no baseline", "not compared") else len(self.changes)

    @property
    def since_s(self) -> float | None:
        """The time of the earliest difference, in seconds since 1970, or None if nothing is known to differ."""
        if self.changed is None:
            return None
        replaced = [] if self.replaced_since_s is None else [self.replaced_since_s]
        return min([*replaced, *(each.since_s for each in self.changes)], default=None)

    def __str__(self) -> str:
        if self.state == "replaced":
            return f"replaced by another drive: {self.replaced}"
        if self.state == "changed" and self.since_s is not None:
            since = datetime.fromtimestamp(self.since_s, UTC)
            named = listed([str(each) for each in self.changes])
            return f"{differing(len(self.changes))} from the baseline since {since:%Y-%m-%d %H:%M} UTC: {named}"
        told = {
            "as approved": "set as approved",
            "not comparable": "not all of it could be compared with the baseline",
            "not compared": f"not compared with the baseline: {self.cause}",
        }
        return told.get(self.state, self.state)


def differing(count: int) -> str:
    """Return "1 parameter differs" or "N parameters differ"."""
    return "1 parameter differs" if count == 1 else f"{count} parameters differ"


def listed(texts: Sequence[str]) -> str:
    """Return the first texts joined by commas, followed by the number of those left out."""
    more = len(texts) - _NAMED
    return ", ".join([*texts[:_NAMED], *([f"and {more} more"] if more > 0 else [])])


NOT_COMPARED = DriveDrift(state="not compared", cause="the server has not compared it yet")
