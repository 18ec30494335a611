"""Verdicts: the result of each case, with its reason and the telegrams that prove it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NoReturn, TypeAlias

Outcome: TypeAlias = Literal["passed", "failed", "not tried"]


class CaseFailure(Exception):  # noqa: N818 - a result, not an error of this program
    """The master violates a condition of the case; the text says how, in one sentence."""


class NotTried(Exception):  # noqa: N818 - a result, not an error of this program
    """The case could not be tried with this master or this drive; the text says why, in one sentence."""


def fail(reason: str) -> NoReturn:
    """End a case as failed."""
    raise CaseFailure(reason)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Result of one case.

    case: its name. title: its disturbance. reason: the reason of the result, in one sentence. seed: seed of this case
    alone. trace: the decoded telegrams, a text for each line that was used. output: the master's output. violations:
    violations of timing and line settings as sentences; they fail only the cases about these.
    """

    case: str
    title: str
    outcome: Outcome
    reason: str
    seed: int
    seconds: float = 0.0
    trace: tuple[str, ...] = ()
    output: tuple[str, ...] = ()
    violations: tuple[str, ...] = ()
