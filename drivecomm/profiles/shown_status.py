"""Status words of a virtual drive: the bits to set, by the conditions of its model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import Command

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.profiles.profile import Condition
    from drivecomm.protocol import Motor


_OVER_ALL = "reverse_ordered"
_ORDER = (
    "always", "remote", "ready", "way", "running", "started", "reverse", "at_reference", "warning", "stopping", "fault",
    _OVER_ALL,
)  # fmt: skip


def own_truth(motor: Motor) -> dict[str, bool]:
    """Return the statements that do not follow from a state, and whether each holds now, by name."""
    return {
        "remote": True,
        "reverse": motor.output_hz < 0,
        "reverse_ordered": motor.target_hz < 0 or (motor.target_hz == 0 and motor.output_hz < 0),
        "at_reference": motor.at_reference,
        "warning": motor.warning,
    }


def motor_truth(motor: Motor) -> dict[str, bool]:
    """Return the statements that follow from a state, and whether each holds now, for a drive without states."""
    return {
        "always": True,
        "ready": not motor.fault,
        "way": not motor.fault,
        "running": motor.running,
        "started": motor.running,
        "stopping": motor.command is Command.QUICK_STOP and motor.running,
        "fault": bool(motor.fault),
    }


def shown(words: Mapping[str, int], said: Mapping[str, Condition], truth: Mapping[str, bool]) -> dict[str, int]:
    """Return status words with bits set or cleared so that each condition holds exactly if its name is true.

    A condition whose name is not in `truth` is left alone.
    """
    whole = dict(words)
    # False conditions come first: later ones win if two use the same bits, and the ordered direction wins over all.
    names = sorted(said.keys() & truth.keys(), key=lambda name: (name == _OVER_ALL, truth[name], _ORDER.index(name)))
    for condition, holds in ((said[name], truth[name]) for name in names):
        word = whole[condition.place]
        if holds:
            whole[condition.place] = word & ~condition.mask | condition.values[0]
        elif condition.holds(whole):
            whole[condition.place] = word ^ condition.mask
    return whole
