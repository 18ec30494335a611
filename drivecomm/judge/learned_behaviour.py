"""Knowledge from an undisturbed run of a task: the master's requests, its effects, and its output."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from drivecomm.judge.judged_drive import ObservedRequest
    from drivecomm.judge.process import Run
    from drivecomm.judge.shown_values import Display


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedBehaviour:
    """Behaviour of one task without disturbance.

    goes_on: whether the master runs until it is ended. success_output: its exit code and output on success. keys:
    number of requests by key. displays: how each parameter that it reads is shown, by address. raws: two raw test
    values for each of these. starts, stops: the requests that start and stop the motor. written: the parameter that it
    writes.
    """

    goes_on: bool
    success_output: tuple[int | None, frozenset[str]]
    keys: Mapping[Hashable, int] = field(default_factory=Counter)
    displays: Mapping[str, Display] = field(default_factory=dict)
    raws: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    starts: tuple[ObservedRequest, ...] = ()
    stops: tuple[ObservedRequest, ...] = ()
    written: str = ""


def reported_outcome(run: Run) -> tuple[int | None, frozenset[str]]:
    """Return how a master reports its outcome: its exit code, and its lines with all numbers masked.

    If two runs report the same, a user cannot see that one of them failed.
    """
    lines = (re.sub(r"[-+]?\d[\d.,:]*", "#", line.text).strip() for line in run.lines)
    return run.code, frozenset(line for line in lines if line)


def says_success(run: Run, learned: LearnedBehaviour) -> bool:
    """Whether a run reports nothing that an undisturbed run does not report as well."""
    code, lines = reported_outcome(run)
    usual_code, usual = learned.success_output
    return code == usual_code and lines <= usual
