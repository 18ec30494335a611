"""Verdicts: what came of each case, with its reason and the telegrams that show it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NoReturn, TypeAlias

Outcome: TypeAlias = Literal["passed", "failed", "not tried"]


class CaseFailure(Exception):  # noqa: N818 - a result, not an error of this program
    """The master does what it must not, or does not do what it must; the text says what, in one sentence."""


class NotTried(Exception):  # noqa: N818 - a result, not an error of this program
    """The case could not be tried with this master or this drive; the text says why, in one sentence."""


def fail(reason: str) -> NoReturn:
    """End a case as failed."""
    raise CaseFailure(reason)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What came of one case.

    case: its name. title: what happens in it. reason: why it came so, in one sentence. seed: of this case alone. trace:
    the telegrams, decoded, a text for each line that was used. output: what the master printed. violations: what it did
    against the timing or the settings of the line, as sentences; they fail the cases for these only.
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
