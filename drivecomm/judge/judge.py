"""Judge of one master: plays the cases of the catalogue, several in parallel, and gives a verdict on each."""

from __future__ import annotations

import shlex
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Lock
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.judge.cases.plain import learned_from
from drivecomm.judge.catalogue import cases_named, catalogue
from drivecomm.judge.coverage import Coverage
from drivecomm.judge.known_drive import KnownDrive
from drivecomm.judge.masters import StartedMaster
from drivecomm.judge.report import JudgeReport
from drivecomm.judge.standstill import StandstillWatch
from drivecomm.judge.trial import CaseContext
from drivecomm.judge.verdicts import CaseFailure, NotTried, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from drivecomm.judge.catalogue import JudgeCase
    from drivecomm.judge.learned_behaviour import LearnedBehaviour
    from drivecomm.judge.masters import Master
    from drivecomm.judge.order import JudgeOrder
    from drivecomm.judge.verdicts import Outcome

AT_ONCE = 3
"""Default number of cases played in parallel."""

_LONGEST_OUTPUT = 4000
_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class _Played:
    verdict: Verdict
    learned: LearnedBehaviour | None = None


class Judge:
    """Judge of one master on one type of drive.

    master: runs the tasks; if None, the order's command is started for each task. names: names of the cases; all if
    empty. Raises UsageError for an invalid order before anything is started.
    """

    def __init__(self, order: JudgeOrder, master: Master | None = None, names: Sequence[str] = ()) -> None:
        if master is None and not order.command:
            raise UsageError("no master to judge; write its command behind --, or judge one that runs with --manual")
        self.order = order
        self.known = KnownDrive(order.drive)
        self.cases = cases_named(catalogue(self.known, order), names)
        self.coverage = Coverage(self.known)
        self._master = master or StartedMaster(order)
        self._learned: dict[str, _Played] = {}
        self._guards = {task.name: Lock() for task in order.tasks}

    @property
    def runs_alone(self) -> bool:
        """Whether the run needs no action by a person."""
        return self._master.in_parallel

    def verdicts(
        self, at_once: int = AT_ONCE, begun: Callable[[JudgeCase], object] = lambda _: None
    ) -> Iterator[Verdict]:
        """Yield the verdicts in the order of the catalogue. begun: called with each case before it is played."""
        for task in self.order.tasks:
            cases = [case for case in self.cases if case.task == task.name]
            if not cases:
                continue
            begun(cases[0])
            # All cases of a task need the result of its undisturbed case.
            self._plain(task.name)

            def play(case: JudgeCase) -> Verdict:
                begun(case)
                return self.verdict(case)

            with ThreadPoolExecutor(max_workers=at_once if self._master.in_parallel else 1) as pool:
                try:
                    yield from pool.map(play, cases)
                except BaseException:
                    self._master.stop()
                    pool.shutdown(wait=True, cancel_futures=True)
                    raise

    def verdict(self, case: JudgeCase) -> Verdict:
        """Play one case, preceded once by the undisturbed case of its task; several threads may call this."""
        plain = self._plain(case.task)
        return plain.verdict if case.name == plain.verdict.case else self._played(case, plain.learned).verdict

    def _plain(self, task: str) -> _Played:
        with self._guards[task]:
            if task not in self._learned:
                case = next(each for each in catalogue(self.known, self.order) if each.name == f"{task}-plain")
                self._learned[task] = self._played(case, None, learns=True)
            return self._learned[task]

    def report(self, verdicts: Sequence[Verdict], seconds: float) -> JudgeReport:
        """Return the report of these verdicts. seconds: duration of the run."""
        return JudgeReport(
            drive=str(self.order.drive),
            model=self.known.model.name,
            master=shlex.join(self.order.command),
            seed=self.order.seed,
            verdicts=tuple(verdicts),
            coverage=tuple(self.coverage.summary()),
            seconds=seconds,
        )

    def _played(self, case: JudgeCase, learned: LearnedBehaviour | None, *, learns: bool = False) -> _Played:
        """Play a case, up to three times if it failed while this machine stood still."""
        for attempt in range(1, _ATTEMPTS + 1):
            with StandstillWatch() as watch:
                began = time.monotonic()
                played = self._played_once(case, learned, learns=learns)
                stood_still_s = watch.longest_s(began)
            if played.verdict.outcome != "failed" or not stood_still_s:
                return played
            if attempt == _ATTEMPTS:
                reason = (
                    f"{played.verdict.reason}; this machine stalled for {stood_still_s:.1f} s meanwhile, so "
                    "repeat this case alone before you trust it"
                )
                played = replace(played, verdict=replace(played.verdict, reason=reason))
        return played

    def _played_once(self, case: JudgeCase, learned: LearnedBehaviour | None, *, learns: bool) -> _Played:
        task = self.order.task(case.task)
        if task is None:
            raise RuntimeError(f"{case.name} needs a task that the order does not have")
        seed = seed_of(self.order.seed, case.name)
        trial = CaseContext(self.order, self.known, self._master, task, learned=learned, seed=seed)
        began = time.monotonic()
        found: LearnedBehaviour | None = None
        outcome: Outcome = "passed"
        try:
            if learns:
                found, reason = learned_from(trial)
            else:
                reason = case.play(trial)
        except CaseFailure as failure:
            outcome, reason = "failed", str(failure)
        except NotTried as why:
            outcome, reason = "not tried", str(why)
        self.coverage.add(trial)
        verdict = Verdict(
            case=case.name,
            title=case.title,
            outcome=outcome,
            reason=reason,
            seed=seed,
            seconds=time.monotonic() - began,
            trace=tuple(stand.trace for stand in trial.stands),
            violations=tuple(dict.fromkeys(str(each) for stand in trial.stands for each in stand.violations)),
            output=tuple(run.text[-_LONGEST_OUTPUT:] for stand in trial.stands for run in stand.runs),
        )
        return _Played(verdict, found)


def seed_of(seed: int, name: str) -> int:
    """Return the seed of a case, which does not depend on the other cases of the run."""
    return zlib.crc32(f"{seed}/{name}".encode())
