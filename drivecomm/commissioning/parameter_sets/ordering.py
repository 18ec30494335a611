"""In which order parameters are written: what others depend on goes first.

Hardly any manual says which parameter bounds which, so the order follows from what models know of any parameter; what a
drive refuses all the same, or changes again on account of a later write, is written once more when all others are.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol import ParameterInfo, Watchdog


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
