"""Results of checks: one result each, a report of many, and the report by theme."""

from __future__ import annotations

import time
import traceback
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError
from drivecomm.testing.checking import CheckFailure
from drivecomm.testing.html_page import html_page, made_with

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Protocol
    from drivecomm.testing.checking import Check


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check. reason: why the check failed, or empty. seconds: duration of the check."""

    check: Check
    reason: str = ""
    seconds: float = 0.0

    @property
    def name(self) -> str:
        """Name of the check."""
        return self.check.name

    @property
    def passed(self) -> bool:
        """Whether the check passed."""
        return not self.reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Results of a number of checks.

    left_out: checks that could not run on this machine, and why. unproven: features that no printed telegram shows, so
    that master and virtual drive may be wrong in the same way; they do not count as failures.
    """

    results: tuple[CheckResult, ...]
    left_out: tuple[str, ...] = ()
    unproven: tuple[str, ...] = ()

    @property
    def passed(self) -> tuple[str, ...]:
        """Names of the checks that passed."""
        return tuple(result.name for result in self.results if result.passed)

    @property
    def failed(self) -> tuple[CheckResult, ...]:
        """Results of the checks that failed."""
        return tuple(result for result in self.results if not result.passed)

    @property
    def seconds(self) -> float:
        """Total duration of the checks in seconds."""
        return sum(result.seconds for result in self.results)

    @property
    def ok(self) -> bool:
        """Whether all checks passed; an empty report is not ok."""
        return bool(self.results) and all(result.passed for result in self.results)

    def __str__(self) -> str:
        reasons = Reasons()
        head = f"{len(self.passed)} checks passed, {len(self.failed)} failed"
        return "\n".join([head, *(f"{failure.name}: {reasons.of(failure)}" for failure in self.failed)])


class Reasons:
    """Reasons of failures for printing; a repeated reason refers to the first check that gave it."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}

    def of(self, failure: CheckResult) -> str:
        """Return why a check failed, or the name of an earlier check that failed for the same reason."""
        first = self._first.setdefault(failure.reason, failure.name)
        return failure.reason if first == failure.name else f"as {first}"


def try_out(check: Check) -> CheckResult:
    """Run one check and return its result; any error that the protocol raises becomes the reason of a failure."""
    began = time.perf_counter()
    try:
        check.run()
    except CheckFailure as failure:
        reason = str(failure) or "it does not hold"
    except DriveCommError as error:
        reason = f"refused: {error}"
    except Exception as error:  # noqa: BLE001 - a protocol may raise anything, and that is the finding
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__} outside the error tree: {error} ({where.filename}:{where.lineno})"
    else:
        reason = ""
    return CheckResult(check, reason, time.perf_counter() - began)


def carry_out(checks: Iterable[Check]) -> Report:
    """Run checks and return their report."""
    return Report(results=tuple(map(try_out, checks)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One kind of check on any number of vectors or models. failed: the results that failed."""

    kind: str
    meaning: str
    number: int
    failed: tuple[CheckResult, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Results of one theme, such as the contract, the vectors of a file, or one model."""

    title: str
    rows: tuple[Row, ...]

    @property
    def number(self) -> int:
        """Number of checks."""
        return sum(row.number for row in self.rows)

    @property
    def failed(self) -> int:
        """Number of failed checks."""
        return sum(len(row.failed) for row in self.rows)


def notes_of(report: Report) -> list[str]:
    """Return the notes of a report beside its results, one sentence each."""
    left_out = [f"left out: {what}" for what in report.left_out]
    return left_out + [f"unproven: {what}" for what in report.unproven]


def sections_of(report: Report) -> list[Section]:
    """Return a report by theme, in the order of its results."""
    themes: dict[str, list[CheckResult]] = {}
    for result in report.results:
        parts = result.name.split("/")
        themes.setdefault(parts[1] if len(parts) > 2 else parts[0], []).append(result)
    return [Section(title=theme, rows=_rows(verdicts)) for theme, verdicts in themes.items()]


def _rows(results: Iterable[CheckResult]) -> tuple[Row, ...]:
    kinds: dict[tuple[str, str], list[CheckResult]] = {}
    for result in results:
        kinds.setdefault((result.check.kind, result.check.meaning), []).append(result)
    failed = {key: tuple(result for result in each if not result.passed) for key, each in kinds.items()}
    return tuple(Row(kind=key[0], meaning=key[1], number=len(kinds[key]), failed=failed[key]) for key in kinds)


def page(plugin: Protocol, report: Report) -> str:
    """Return a report about a protocol as HTML."""
    failed, number = len(report.failed), len(report.results)
    result = f"all {number} checks hold" if report.ok else f"{failed} of {number} checks do not hold"
    return html_page(
        title=plugin.title,
        kind="conformance",
        about=f"Conformance of the protocol package <code>{escape(plugin.name)}</code>",
        good=report.ok,
        result=result,
        notes=[f"{made_with()}, {report.seconds:.1f} s", *notes_of(report)],
        body="\n".join(map(_section, sections_of(report))),
    )


def _section(section: Section) -> str:
    count = f"{section.failed} of {section.number} do not hold" if section.failed else f"{section.number} hold"
    rows = "\n".join(map(_row, section.rows))
    return f'<h2>{escape(section.title)} <span class="quiet">{count}</span></h2>\n<ul>\n{rows}\n</ul>'


def _row(row: Row) -> str:
    holds = not row.failed
    return (
        f'<li class="row {"holds" if holds else "fails"}"><div class="line">'
        f'<span class="mark">{"✓" if holds else "✗"}</span>'
        f'<span>{escape(row.meaning or row.kind)} <span class="quiet">{escape(row.kind)}</span></span>'
        f'<span class="count quiet">{row.number - len(row.failed)}/{row.number}</span></div>'
        f"{_failures(row.failed)}</li>"
    )


def _failures(failed: Iterable[CheckResult]) -> str:
    told = "".join(
        f'<div class="failure"><code>{escape(result.name)}</code><br>{escape(result.reason)}</div>' for result in failed
    )
    return f"<details open><summary>what is wrong</summary>{told}</details>" if told else ""
