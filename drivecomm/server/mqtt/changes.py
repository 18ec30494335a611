"""Filter for doors that publish only changed values. No I/O, no clock.

A value is compared with the last published one, so that a slow drift is published as well.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.server import ServedPlant
    from drivecomm.server.mqtt.content import PublishedValue

AT_LEAST_EVERY_S = 60.0
"""Default for the longest time in seconds between messages of an unchanged value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeRules:
    """Definition of a change.

    deadbands: smallest change of each quantity, in its unit; other quantities have none, and a tag's own deadband has
    precedence. at_least_every_s: interval at which an unchanged value is published, so that a subscriber can
    distinguish it from a value that is no longer polled.
    """

    deadbands: Mapping[str, float] = field(default_factory=dict)
    at_least_every_s: float = AT_LEAST_EVERY_S


def tag_deadband(plant: ServedPlant, drive: str, name: str) -> float | None:
    """Return the deadband of a value's tag in the plant file, None if it has none."""
    with suppress(UsageError):
        # The history also has drives that are no longer in the plant.
        tag = plant.plant.drive(drive).tags.get(name)
        return None if tag is None else tag.deadband
    return None


def _no_tag(_drive: str, _name: str) -> None:
    return None


class ChangeDetector:
    """Last published value of each quantity, and the comparison with it.

    deadband_of: returns the deadband from the tag of a drive's value; None for the one in the rules.
    """

    def __init__(self, rules: ChangeRules, deadband_of: Callable[[str, str], float | None] = _no_tag) -> None:
        self._deadband_of = deadband_of
        self._deadbands = {name: Decimal(str(size)) for name, size in rules.deadbands.items()}
        self._every_ms = rules.at_least_every_s * 1000
        self._last: dict[tuple[str, str], PublishedValue] = {}

    def published(self, sample: PublishedValue) -> None:
        """Record a value as published."""
        self._last[sample.drive, sample.name] = sample

    def is_change(self, sample: PublishedValue) -> bool:
        """Return whether to publish a value."""
        last = self._last.get((sample.drive, sample.name))
        return (
            last is None
            or _said(sample) != _said(last)
            or not 0 <= sample.time_ms - last.time_ms < self._every_ms
            or self._differs(last, sample)
        )

    def _differs(self, last: PublishedValue, sample: PublishedValue) -> bool:
        before, now = last.value, sample.value
        if isinstance(before, int | Decimal) and isinstance(now, int | Decimal):
            own = self._deadband_of(sample.drive, sample.name)
            deadband = self._deadbands.get(sample.name, Decimal(0)) if own is None else Decimal(str(own))
            return abs(Decimal(now) - before) > deadband
        return before != now


def _said(sample: PublishedValue) -> tuple[str, ...]:
    """Return the parts of a value whose change is always published."""
    return sample.quality, sample.unit, sample.text, sample.note
