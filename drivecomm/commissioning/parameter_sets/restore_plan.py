"""What a restore would do, and in which order: what others depend on goes first.

Hardly any manual says which parameter bounds which, so the order follows from what models know of any parameter; what a
drive refuses all the same, or changes again on account of a later write, is written once more when all others are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import ParameterInfo, Reading, Value, Watchdog


class Stage(IntEnum):
    """When a parameter is written.

    MAKE_UP: options and motor data, on which other parameters' limits, scales and meanings depend. LIMITS: what bounds
    other values. VALUES: all that is left. WATCHDOG: what acts on a master that falls silent. LOCKS: what may keep
    others from being written. COMMUNICATION: what can cut the line.
    """

    MAKE_UP = 0
    LIMITS = 1
    VALUES = 2
    WATCHDOG = 3
    LOCKS = 4
    COMMUNICATION = 5


_LIMITS = frozenset({"minimum_frequency", "maximum_frequency", "current_limit"})
_LIMIT_WORDS = frozenset({"minimum", "maximum", "limit", "range", "lowest", "highest", "low", "high", "upper", "lower"})
_LOCK_WORDS = frozenset({"lock", "locked", "password"})
_MOTOR = "motor_rated_"
_MOTOR_WORDS = frozenset({"rated", "motor"})
_NO_LIMIT = frozenset({"warning"})


def stage_of(info: ParameterInfo, common: str, watchdog: Watchdog | None = None) -> Stage:
    """Return when a parameter is written. common: its common name, empty without one. watchdog: of its model."""
    if watchdog is not None and info.address in (watchdog.time, watchdog.action):
        return Stage.WATCHDOG
    words = frozenset(info.name.split("_"))
    if info.kind == "communication":
        return Stage.COMMUNICATION
    if words & _LOCK_WORDS:
        return Stage.LOCKS
    if common.startswith(_MOTOR) or words & _MOTOR_WORDS:
        return Stage.LIMITS if words & _LIMIT_WORDS else Stage.MAKE_UP
    if common in _LIMITS or (words & _LIMIT_WORDS and not words & _NO_LIMIT):
        return Stage.LIMITS
    # What may not change while the motor runs, and what is chosen from a list, is what a drive is made up of.
    if info.access == "rw*" or info.values or not info.unit:
        return Stage.MAKE_UP
    return Stage.VALUES


Action: TypeAlias = Literal["write", "equal", "skip"]
"""write: its value is another one. equal: it has the value already. skip: it is left alone, and why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RestoreOptions:
    """What somebody who restores has said.

    only: addresses, names or common names of the parameters to restore; empty for all. communication: also write
    addresses, baud rates and the like, which can cut the line. another_drive: the set may be of another drive, of
    another model or another maker. volatile: keep nothing over power-off, where the drive makes the difference.
    """

    only: frozenset[str] = frozenset()
    communication: bool = False
    another_drive: bool = False
    volatile: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Planned:
    """What becomes of one entry of a parameter set.

    address: on the drive, or a common name. value, unit: what it is to be, in the drive's unit. current: what it is
    now, None where the drive does not tell. options: of reading and writing it, where the value is the plain number
    because nobody knows its scale. told: the number that the value was told as, where it goes back to its own drive and
    the scale may have been stated otherwise since. missed: left alone although it should have been restored.
    """

    action: Action
    address: str
    name: str
    value: Value
    unit: str
    stage: Stage
    current: Value | None = None
    reason: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    missed: bool = False
    told: int | None = None

    def held_by(self, reading: Reading) -> Value:
        """Return the value of a reading as this one's value is meant."""
        return reading.raw if self.options else reading.value


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What a restore would do, in its order. store: whether writes are kept over power-off, as far as is known."""

    drive: str
    store: bool
    items: tuple[Planned, ...]
    remarks: tuple[str, ...] = ()

    def to(self, action: Action) -> list[Planned]:
        """Return the entries of which this becomes."""
        return [item for item in self.items if item.action == action]

    @property
    def missed(self) -> list[Planned]:
        """What is left alone although it should have been restored.

        Of a set of the same model that is every setting, of what was named in the options all of it; communication
        settings that were not asked for and what has no meaning for another model are left alone as they should be.
        """
        return [item for item in self.items if item.missed]
