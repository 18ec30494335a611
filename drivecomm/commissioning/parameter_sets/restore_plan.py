"""Plan of a restore, in an order that writes parameters before those that depend on them.

Hardly any manual states which parameter limits which, so the order follows from general properties in the models.
Values that the drive refuses all the same, or changes because of a later write, are written again after all others.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import ParameterInfo, Reading, Value, Watchdog


class Stage(IntEnum):
    """Position of a parameter in the order of a restore.

    MAKE_UP: options and motor data, on which the limits, scales and meanings of other parameters depend. LIMITS: limits
    of other values. VALUES: all other parameters. WATCHDOG: the reaction to a silent master. LOCKS: parameters that may
    block writes to others. COMMUNICATION: parameters that can cut the line.
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
    """Return the stage of a parameter. common: its common name, empty without one. watchdog: watchdog of its model."""
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
    # Parameters that are locked while the motor runs, or chosen from a list, usually configure the drive.
    if info.access == "rw*" or info.values or not info.unit:
        return Stage.MAKE_UP
    return Stage.VALUES


Action: TypeAlias = Literal["write", "equal", "skip"]
"""Action of a restore on one parameter.

write: the drive has another value. equal: the drive already has the value. skip: the parameter is left alone, for a
stated reason.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class RestoreOptions:
    """User's options for a restore.

    only: addresses, names or common names of the parameters to restore; empty for all. communication: also write
    addresses, baud rates and the like, which can cut the line. another_drive: allow a set of another drive, another
    model or another maker. volatile: keep nothing over power-off, on drives that support volatile writes.
    """

    only: frozenset[str] = frozenset()
    communication: bool = False
    another_drive: bool = False
    volatile: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedItem:
    """Planned action for one entry of a parameter set.

    address: on the drive, or a common name. value, unit: the value to write, in the drive's unit. current: the present
    value, None if the drive does not report it. options: options for reading and writing, if the value is the raw
    number because its scale is unknown. told: the raw number from the backup, if the value returns to its own drive and
    the scale may have been stated differently since. missed: left alone although it should have been restored.
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
        """Return the value of a reading in the form of this item: raw or physical."""
        return reading.raw if self.options else reading.value


@dataclass(frozen=True, slots=True, kw_only=True)
class RestorePlan:
    """Items of a restore, in their order. store: whether writes are kept over power-off, as far as is known."""

    drive: str
    store: bool
    items: tuple[PlannedItem, ...]
    remarks: tuple[str, ...] = ()

    def to(self, action: Action) -> list[PlannedItem]:
        """Return the items with this action."""
        return [item for item in self.items if item.action == action]

    @property
    def missed(self) -> list[PlannedItem]:
        """Items that are left alone although they should have been restored.

        For a set of the same model, that is every setting; for parameters named in the options, all of them.
        Communication settings that were not requested, and values without meaning for another model, do not count.
        """
        return [item for item in self.items if item.missed]
