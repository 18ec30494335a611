"""Masters under judgement: the interface, and a master that is started for each task."""

from __future__ import annotations

from threading import Event
from typing import TYPE_CHECKING, Protocol

from drivecomm.judge.order import USUAL_VALUE
from drivecomm.judge.process import Process
from drivecomm.judge.stand import JudgeLine

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from drivecomm.judge.judged_drive import JudgedDrive
    from drivecomm.judge.order import JudgeOrder, JudgeTask
    from drivecomm.judge.process import Run

_OBSERVED_S = 4.0
"""Seconds for which a master is watched; if it still sends requests then, it counts as continuous."""
_LATELY_S = 2.0
_QUIET_S = 0.15


class Master(Protocol):
    """A program that can be given tasks."""

    in_parallel: bool

    def stop(self) -> None:
        """Stop all runs as soon as possible; called from another thread."""
        ...

    def stand(self, drive: JudgedDrive, listen: str, *, echo: bool) -> AbstractContextManager[JudgeLine]:
        """Return a served line with this drive."""
        ...

    def run(
        self,
        stand: JudgeLine,
        task: JudgeTask,
        *,
        value: str,
        goes_on: bool | None,
        until: Callable[[], bool] | None,
        limit_s: float,
    ) -> Run:
        """Carry out a task.

        goes_on: True for a continuous master, whose end is not awaited; None if that is still unknown.
        """
        ...

    def killed(self, stand: JudgeLine, task: JudgeTask, condition: Callable[[], bool], limit_s: float) -> Run:
        """Start a task, and kill the master when a condition is met."""
        ...


class StartedMaster:
    """A master with a command line, started anew for each task."""

    in_parallel = True

    def __init__(self, order: JudgeOrder) -> None:
        self._order = order
        self._stopped = Event()

    def stop(self) -> None:
        """Stop all running processes immediately, and any that are started later."""
        self._stopped.set()

    def stand(self, drive: JudgedDrive, listen: str, *, echo: bool) -> JudgeLine:
        """Return a served line with this drive."""
        return JudgeLine(drive, listen, echo=echo)

    def begin(self, stand: JudgeLine, task: JudgeTask, value: str = USUAL_VALUE) -> Process:
        """Start a process for a task."""
        return Process(self._order.words(task, stand.port, value), self._order.environment, stand.now)

    def run(
        self,
        stand: JudgeLine,
        task: JudgeTask,
        *,
        value: str = USUAL_VALUE,
        goes_on: bool | None,
        until: Callable[[], bool] | None,
        limit_s: float,
    ) -> Run:
        """Carry out a task in a new process, and end the process."""
        process = self.begin(stand, task, value)
        in_time = False
        try:
            enough = until or _observed(stand, goes_on)
            in_time = process.wait(limit_s, lambda: self._stopped.is_set() or enough())
            if process.has_ended:
                # The last bytes of the process may still be on the wire.
                stand.comes_about(lambda: False, _QUIET_S)
        finally:
            run = process.end(too_long=not in_time and not goes_on)
        return run

    def killed(self, stand: JudgeLine, task: JudgeTask, condition: Callable[[], bool], limit_s: float) -> Run:
        """Start a task, and kill the process when a condition is met."""
        process = self.begin(stand, task)
        try:
            process.wait(limit_s, lambda: self._stopped.is_set() or condition())
            process.kill()
        finally:
            run = process.end()
        return run


def _observed(stand: JudgeLine, goes_on: bool | None) -> Callable[[], bool]:
    """Return a condition that is met when a possibly continuous master has been watched long enough."""
    began = stand.now()

    def enough() -> bool:
        if goes_on is False or stand.now() - began < _OBSERVED_S:
            return False
        heard = stand.drive.since()
        return bool(goes_on) or (bool(heard) and stand.now() - heard[-1].time_s < _LATELY_S)

    return enough
