"""What a caller waits for a drive to do, and when waiting is over."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.bus.procedures import ask_status, sleep_until
from drivecomm.errors import NotSupported, StateError, UsageError, shortened
from drivecomm.protocol import DriveState, is_duration

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus.procedures import Procedure
    from drivecomm.protocol import DriveStatus

Goal: TypeAlias = DriveState | Literal["at_reference"]
"""A state, or a motor that runs at its reference."""

POLL_S = 0.1
"""How often a drive is asked meanwhile."""


def reaching(name: str, goal: Goal, timeout_s: float, now: Callable[[], float]) -> Procedure[DriveStatus]:
    """Ask the drive with this name for its status until it is where it shall be, and return that status."""
    waiting = Waiting(name, goal, timeout_s, now())
    status: DriveStatus = yield ask_status()
    while not waiting.over(status, asked_at := now()):
        yield sleep_until(asked_at + POLL_S)
        status = yield ask_status()
    return status


class Waiting:
    """Waits from a time on for a goal, for so many seconds. Raises UsageError for a goal or a time that cannot be."""

    def __init__(self, name: str, goal: Goal, timeout_s: float, now: float) -> None:
        if not isinstance(goal, DriveState) and goal != "at_reference":
            known = ", ".join(state.name for state in DriveState)
            raise UsageError(f"cannot wait for {shortened(goal)}; use a DriveState ({known}) or 'at_reference'")
        if not is_duration(timeout_s):
            raise UsageError(f"timeout_s cannot be {shortened(timeout_s)}; give seconds, 0 or more")
        self._name = name
        self._goal = goal
        self._timeout_s = timeout_s
        self._until = now + timeout_s

    def over(self, status: DriveStatus, now: float) -> bool:
        """Whether the drive is where it shall be; called with its status again and again.

        Raises StateError when the time is over, and at once for a fault that nobody waits for; NotSupported where the
        status word does not say whether the reference is reached.
        """
        if self._met(status):
            return True
        shown = self._goal if isinstance(self._goal, str) else self._goal.value
        if status.fault and self._goal is not DriveState.FAULT:
            code = "" if status.fault_code is None else f" {status.fault_code} {status.fault_text}".rstrip()
            raise StateError(f"{self._name} has a fault{code} and will not reach {shown!r}; reset it first")
        if now >= self._until:
            raise StateError(
                f"{self._name} did not reach {shown!r} within {self._timeout_s:g} s; it is {status.state.value}"
            )
        return False

    def _met(self, status: DriveStatus) -> bool:
        if isinstance(self._goal, DriveState):
            return status.state is self._goal
        if status.at_reference is None and status.running:
            raise NotSupported(f"the status of {self._name} does not say whether the reference is reached")
        return bool(status.running and status.at_reference)
