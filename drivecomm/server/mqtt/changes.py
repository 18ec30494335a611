"""Which values are worth a message where a door publishes changes only. No I/O, no clock.

A value is compared with the one that was published last, so that one that creeps is published, too.
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
    from drivecomm.server.mqtt.content import Sample

AT_LEAST_EVERY_S = 60.0
"""How often a value that stays the same is published all the same, unless told otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeRules:
    """What counts as a change.

    deadbands: by how much a quantity must differ, in its unit, by its name, unless its tag says so; others by anything.
    at_least_every_s: how often a value is published that stays as it is, so that who listens can tell it from one that
    is no longer polled.
    """

    deadbands: Mapping[str, float] = field(default_factory=dict)
    at_least_every_s: float = AT_LEAST_EVERY_S


def tag_deadband(plant: ServedPlant, drive: str, name: str) -> float | None:
    """Return the deadband of a value by its tag in the plant file, None if it has none."""
    with suppress(UsageError):
        # The history has drives that the plant does not have any more.
        tag = plant.plant.drive(drive).tags.get(name)
        return None if tag is None else tag.deadband
    return None


def _no_tag(_drive: str, _name: str) -> None:
    return None


class Changes:
    """What was published last of each quantity, and what differs from it.

    deadband_of: the deadband of a value of a drive by its tag, None for that of the rules.
    """

    def __init__(self, rules: ChangeRules, deadband_of: Callable[[str, str], float | None] = _no_tag) -> None:
        self._deadband_of = deadband_of
        self._deadbands = {name: Decimal(str(size)) for name, size in rules.deadbands.items()}
        self._every_ms = rules.at_least_every_s * 1000
        self._last: dict[tuple[str, str], Sample] = {}

    def published(self, sample: Sample) -> None:
        """Take note that the broker has a value."""
        self._last[sample.drive, sample.name] = sample

    def is_one(self, sample: Sample) -> bool:
        """Return whether a value is to be published."""
        last = self._last.get((sample.drive, sample.name))
        return (
            last is None
            or _said(sample) != _said(last)
            or not 0 <= sample.time_ms - last.time_ms < self._every_ms
            or self._differs(last, sample)
        )

    def _differs(self, last: Sample, sample: Sample) -> bool:
        before, now = last.value, sample.value
        if isinstance(before, int | Decimal) and isinstance(now, int | Decimal):
            own = self._deadband_of(sample.drive, sample.name)
            deadband = self._deadbands.get(sample.name, Decimal(0)) if own is None else Decimal(str(own))
            return abs(Decimal(now) - before) > deadband
        return before != now


def _said(sample: Sample) -> tuple[str, ...]:
    """Return what is always told when it changes."""
    return sample.quality, sample.unit, sample.text, sample.note
