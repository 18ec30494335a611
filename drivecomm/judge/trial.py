"""One case in the making: lines with the judged drive, runs of the master on them, and what is kept as evidence."""

from __future__ import annotations

from contextlib import contextmanager
from random import Random
from typing import TYPE_CHECKING

from drivecomm.judge.order import USUAL_VALUE
from drivecomm.judge.verdicts import NotTried

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.judge.drive import Heard, JudgedDrive
    from drivecomm.judge.knowledge import Learned
    from drivecomm.judge.known_drive import KnownDrive
    from drivecomm.judge.masters import Master
    from drivecomm.judge.order import Order, Task
    from drivecomm.judge.process import Run
    from drivecomm.judge.stand import Stand


class Trial:
    """What a case works with.

    task: that the master is given. learned: what an undisturbed run of it has shown. random: from the seed of the case.
    stands: those that were made, for their traces.
    """

    def __init__(
        self, order: Order, known: KnownDrive, master: Master, task: Task, *, learned: Learned | None, seed: int
    ) -> None:
        self.order = order
        self.known = known
        self.task = task
        self.random = Random(seed)  # noqa: S311 - repeatable on purpose
        self.stands: list[Stand] = []
        self._master = master
        self._learned = learned

    @property
    def learned(self) -> Learned:
        """What an undisturbed run has shown. Raises NotTried where there was none that worked."""
        if self._learned is None:
            raise NotTried(
                f"the task {self.task.name} does not work on an undisturbed line; see {self.task.name}-plain"
            )
        return self._learned

    @contextmanager
    def stand(
        self, prepare: Callable[[JudgedDrive], object] = lambda _: None, *, echo: bool = False
    ) -> Iterator[Stand]:
        """Serve a line with a new drive. prepare: what is done with the drive before."""
        drive = self.known.judged()
        prepare(drive)
        with self._master.stand(drive, self.order.listen, echo=echo) as stand:
            self.stands.append(stand)
            yield stand

    def run(
        self,
        stand: Stand,
        *,
        task: Task | None = None,
        value: str = USUAL_VALUE,
        until: Callable[[], bool] | None = None,
        within_s: float | None = None,
    ) -> Run:
        """Let the master do its task, or another one, on a line, and return what it did.

        until: ends one that goes on by itself when it is met. within_s: the longest time; the order's limit if None.
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

    def kill_when(self, stand: Stand, condition: Callable[[], bool]) -> None:
        """Let the master do its task, and kill it when a condition is met, or when its time is over."""
        stand.runs.append(self._master.killed(stand, self.task, condition, self.order.limit_s))

    @property
    def goes_on(self) -> bool | None:
        """Whether the master goes on until it is ended; None where that is not known yet."""
        if self.task.goes_on is not None:
            return self.task.goes_on
        return None if self._learned is None else self._learned.goes_on

    def heard(self, stand: Stand) -> list[Heard]:
        """Return the requests that the drive heard."""
        return stand.drive.since()
