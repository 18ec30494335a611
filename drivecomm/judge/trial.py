"""One running case: its lines with the judged drive, the master's runs on them, and the evidence."""

from __future__ import annotations

from contextlib import contextmanager
from random import Random
from typing import TYPE_CHECKING

from drivecomm.judge.order import USUAL_VALUE
from drivecomm.judge.verdicts import NotTried

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.judge.judged_drive import JudgedDrive, ObservedRequest
    from drivecomm.judge.known_drive import KnownDrive
    from drivecomm.judge.learned_behaviour import LearnedBehaviour
    from drivecomm.judge.masters import Master
    from drivecomm.judge.order import JudgeOrder, JudgeTask
    from drivecomm.judge.process import Run
    from drivecomm.judge.stand import JudgeLine


class CaseContext:
    """Context of a case.

    task: the master's task. learned: knowledge from an undisturbed run. random: seeded for the case. stands: all lines
    made so far, for their traces.
    """

    def __init__(
        self,
        order: JudgeOrder,
        known: KnownDrive,
        master: Master,
        task: JudgeTask,
        *,
        learned: LearnedBehaviour | None,
        seed: int,
    ) -> None:
        self.order = order
        self.known = known
        self.task = task
        self.random = Random(seed)  # noqa: S311 - repeatable on purpose
        self.stands: list[JudgeLine] = []
        self._master = master
        self._learned = learned

    @property
    def learned(self) -> LearnedBehaviour:
        """Knowledge from an undisturbed run. Raises NotTried if no such run was successful."""
        if self._learned is None:
            raise NotTried(
                f"the task {self.task.name} does not work on an undisturbed line; see {self.task.name}-plain"
            )
        return self._learned

    @contextmanager
    def stand(
        self, prepare: Callable[[JudgedDrive], object] = lambda _: None, *, echo: bool = False
    ) -> Iterator[JudgeLine]:
        """Serve a line with a new drive. prepare: called with the drive before the line begins."""
        drive = self.known.judged()
        prepare(drive)
        with self._master.stand(drive, self.order.listen, echo=echo) as stand:
            self.stands.append(stand)
            yield stand

    def run(
        self,
        stand: JudgeLine,
        *,
        task: JudgeTask | None = None,
        value: str = USUAL_VALUE,
        until: Callable[[], bool] | None = None,
        within_s: float | None = None,
    ) -> Run:
        """Run the master's task, or another one, on a line, and return the run.

        until: condition that ends a continuous master. within_s: time limit in seconds; the order's limit if None.
        """
        run = self._master.run(
            stand,
            task or self.task,
            value=value,
            goes_on=self.goes_on,
            until=until,
            limit_s=self.order.limit_s if within_s is None else within_s,
        )
        stand.runs.append(run)
        return run

    def kill_when(self, stand: JudgeLine, condition: Callable[[], bool]) -> None:
        """Run the master's task, and kill the master when a condition is met, or at its time limit."""
        stand.runs.append(self._master.killed(stand, self.task, condition, self.order.limit_s))

    @property
    def goes_on(self) -> bool | None:
        """Whether the master runs until it is ended; None if that is not known yet."""
        if self.task.goes_on is not None:
            return self.task.goes_on
        return None if self._learned is None else self._learned.goes_on

    def heard(self, stand: JudgeLine) -> list[ObservedRequest]:
        """Return the requests that the drive received."""
        return stand.drive.since()
