"""The results of checks: one of each, a report of many, and the report by theme."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError
from drivecomm.testing.checking import CheckFailure

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.testing.checking import Check


@dataclass(frozen=True, slots=True)
class CheckResult:
    """What came of one check. reason: why it does not hold, empty when it does. seconds: what it took."""

    check: Check
    reason: str = ""
    seconds: float = 0.0

    @property
    def name(self) -> str:
        """The name of the check."""
        return self.check.name

    @property
    def passed(self) -> bool:
        """Whether it holds."""
        return not self.reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The results of a number of checks. left_out: what could not be checked here, and why."""

    results: tuple[CheckResult, ...]
    left_out: tuple[str, ...] = ()

    @property
    def passed(self) -> tuple[str, ...]:
        """The names of the checks that held."""
        return tuple(result.name for result in self.results if result.passed)

    @property
    def failed(self) -> tuple[CheckResult, ...]:
        """The checks that did not hold."""
        return tuple(result for result in self.results if not result.passed)

    @property
    def seconds(self) -> float:
        """What all of it took."""
        return sum(result.seconds for result in self.results)

    @property
    def ok(self) -> bool:
        """Whether all checks held; a report about nothing is not good news."""
        return bool(self.results) and all(result.passed for result in self.results)

    def __str__(self) -> str:
        lines = [f"{len(self.passed)} checks passed, {len(self.failed)} failed"]
        return "\n".join([*lines, *(f"{failure.name}: {failure.reason}" for failure in self.failed)])


def try_out(check: Check) -> CheckResult:
    """Run one check and return what came of it; whatever a protocol raises is a reason."""
    began = time.perf_counter()
    try:
        check.run()
    except CheckFailure as failure:
        reason = str(failure) or "it does not hold"
    except DriveCommError as error:
        reason = f"refused: {error}"
    except Exception as error:  # noqa: BLE001 - a protocol may raise anything, and that is the finding
        reason = f"{type(error).__name__} outside the error tree: {error}"
    else:
        reason = ""
    return CheckResult(check, reason, time.perf_counter() - began)


def carry_out(checks: Iterable[Check]) -> Report:
    """Run checks and return what came out."""
    return Report(results=tuple(map(try_out, checks)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One thing that is checked, on however many vectors or models. failed: those on which it does not hold."""

    kind: str
    meaning: str
    number: int
    failed: tuple[CheckResult, ...]
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """What belongs together, such as the contract, the vectors of a file, or one model."""

    title: str
    rows: tuple[Row, ...]

    @property
    def number(self) -> int:
        """How many checks there are."""
        return sum(row.number for row in self.rows)

    @property
    def failed(self) -> int:
        """How many of them do not hold."""
        return sum(len(row.failed) for row in self.rows)


def sections_of(report: Report) -> list[Section]:
    """Return a report by theme, in the order in which it was made."""
    themes: dict[str, list[CheckResult]] = {}
    for result in report.results:
        themes.setdefault(_theme(result.name), []).append(result)
    return [Section(title=theme, rows=_rows(verdicts)) for theme, verdicts in themes.items()]


def _theme(name: str) -> str:
    parts = name.split("/")
    return parts[1] if len(parts) > 2 else parts[0]


def _rows(results: Iterable[CheckResult]) -> tuple[Row, ...]:
    kinds: dict[tuple[str, str], list[CheckResult]] = {}
    for result in results:
        kinds.setdefault((result.check.kind, result.check.meaning), []).append(result)
    return tuple(
        Row(
            kind=kind,
            meaning=meaning,
            number=len(each),
            failed=tuple(result for result in each if not result.passed),
            seconds=sum(result.seconds for result in each),
        )
        for (kind, meaning), each in kinds.items()
    )
