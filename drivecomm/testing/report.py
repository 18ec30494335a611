"""What a check is, and what came out of many of them."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class CheckFailure(AssertionError):  # noqa: N818 - a verdict about a codec, not an error of this program
    """The protocol does not do what it should; the text says what it does instead."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that must hold.

    name: where it belongs, the part before the first slash is the protocol. run: raises CheckFailure when it does not
    hold. meaning: what must hold, in one sentence.
    """

    name: str
    run: Callable[[], None]
    meaning: str = ""

    @property
    def kind(self) -> str:
        """What is checked, without what it is checked on: the last part of the name."""
        return self.name.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came of one check. reason: why it does not hold, empty when it does. seconds: what it took."""

    check: Check
    reason: str = ""
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether it holds."""
        return not self.reason


@dataclass(frozen=True, slots=True)
class Failure:
    """A check that did not hold, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The outcome of a number of checks.

    left_out: what could not be checked here, and why.
    """

    verdicts: tuple[Verdict, ...]
    left_out: tuple[str, ...] = ()

    @property
    def passed(self) -> tuple[str, ...]:
        """The names of the checks that held."""
        return tuple(verdict.check.name for verdict in self.verdicts if verdict.passed)

    @property
    def failed(self) -> tuple[Failure, ...]:
        """The checks that did not hold."""
        return tuple(Failure(each.check.name, each.reason) for each in self.verdicts if not each.passed)

    @property
    def seconds(self) -> float:
        """What all of it took."""
        return sum(verdict.seconds for verdict in self.verdicts)

    @property
    def ok(self) -> bool:
        """Whether all checks held; a report about nothing is not good news."""
        return bool(self.verdicts) and all(verdict.passed for verdict in self.verdicts)

    def __str__(self) -> str:
        lines = [f"{len(self.passed)} checks passed, {len(self.failed)} failed"]
        return "\n".join([*lines, *(f"{failure.name}: {failure.reason}" for failure in self.failed)])


def try_out(check: Check) -> Verdict:
    """Run one check and return what came of it; whatever a protocol raises is a reason."""
    began = time.perf_counter()
    try:
        check.run()
    except CheckFailure as failure:
        reason = str(failure) or "it does not hold"
    except DriveCommError as error:
        reason = f"refused: {error}"
    except Exception as error:  # noqa: BLE001 - a stranger's protocol may raise anything, and that is the finding
        reason = f"{type(error).__name__} outside the error tree: {error}"
    else:
        reason = ""
    return Verdict(check, reason, time.perf_counter() - began)


def carry_out(checks: Iterable[Check]) -> Report:
    """Run checks and return what came out."""
    return Report(verdicts=tuple(map(try_out, checks)))
