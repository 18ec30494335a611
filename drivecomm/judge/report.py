"""Report of a run: its verdicts and coverage, as JSON and as one page of HTML."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from drivecomm.testing import html_page, made_with
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.judge.coverage import Covered
    from drivecomm.judge.verdicts import Verdict

_MARKS = {"passed": ("holds", "✓"), "failed": ("fails", "✗"), "not tried": ("", "·")}


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgeReport:
    """Results of a run.

    drive: as PROTOCOL:ADDRESS. master: its command line, empty for one that ran already. seconds: duration of the run.
    """

    drive: str
    model: str
    master: str
    seed: int
    verdicts: tuple[Verdict, ...]
    coverage: tuple[Covered, ...]
    seconds: float

    @property
    def counts(self) -> Counter[str]:
        """Number of cases by outcome."""
        return Counter(each.outcome for each in self.verdicts)

    @property
    def ok(self) -> bool:
        """Whether no case failed and at least one passed."""
        return not self.counts["failed"] and bool(self.counts["passed"])

    def properties(self) -> dict[str, str]:
        """Return the settings that a reader needs to repeat the run."""
        return {"drive": self.drive, "model": self.model, "seed": str(self.seed), "version": __version__}

    def summary(self) -> str:
        """Return one sentence about the outcome."""
        counts = self.counts
        return f"{counts['passed']} passed, {counts['failed']} failed, {counts['not tried']} not tried"


def as_data(report: JudgeReport) -> dict[str, Any]:
    """Return a report as JSON types."""
    return {
        "format": 1,
        **report.properties(),
        "seed": report.seed,
        "master": report.master,
        "seconds": round(report.seconds, 3),
        "counts": dict(report.counts),
        "coverage": [each._asdict() for each in report.coverage],
        "verdicts": [{**asdict(each), "seconds": round(each.seconds, 3)} for each in report.verdicts],
    }


def page(report: JudgeReport) -> str:
    """Return a report as HTML."""
    themes: dict[str, list[Verdict]] = {}
    for verdict in report.verdicts:
        themes.setdefault(verdict.case.partition("-")[0], []).append(verdict)
    sections = [_section(theme, verdicts) for theme, verdicts in themes.items()]
    covered = "".join(
        f'<li class="row"><div class="line"><span></span><span>{escape(str(each))}'
        f'<br><span class="quiet">{escape(_missing(each))}</span></span></div></li>'
        for each in report.coverage
    )
    sections.append(f"<h2>Coverage</h2>\n<ul>{covered}</ul>")
    return html_page(
        title=f"{report.drive}, model {report.model}",
        kind="judge",
        about=f"A master judged: <code>{escape(report.master or 'one that ran already')}</code>",
        good=report.ok,
        result=report.summary(),
        notes=[f"{made_with()}, {report.seconds:.1f} s, seed {report.seed}"],
        body="\n".join(sections),
    )


def _missing(covered: Covered) -> str:
    return "" if not covered.missing or covered.of > 60 else f"not covered: {', '.join(covered.missing)}"


def _section(theme: str, verdicts: Sequence[Verdict]) -> str:
    failed = sum(each.outcome == "failed" for each in verdicts)
    count = f"{failed} of {len(verdicts)} failed" if failed else f"{len(verdicts)} cases"
    rows = "\n".join(map(_row, verdicts))
    return f'<h2>{escape(theme)} <span class="quiet">{count}</span></h2>\n<ul>\n{rows}\n</ul>'


def _row(verdict: Verdict) -> str:
    css, mark = _MARKS[verdict.outcome]
    reason = f'<span class="quiet">{escape(verdict.outcome)}: {escape(verdict.reason)}</span>'
    evidence = ""
    if verdict.outcome == "failed":
        reason = f'<div class="failure">{escape(verdict.reason)}</div>'
        parts = [*(f"the master printed:\n{each}" for each in verdict.output if each), *verdict.trace]
        evidence = "".join(f"<pre>{escape(each)}</pre>" for each in parts)
    violations = "".join(f'<div class="failure">{escape(each)}</div>' for each in verdict.violations)
    return (
        f'<li class="row {css}"><div class="line"><span class="mark">{mark}</span>'
        f'<span>{escape(verdict.title)} <span class="quiet">{escape(verdict.case)}</span><br>{reason}{violations}'
        f'</span><span class="count quiet">{verdict.seconds:.1f} s</span></div>{evidence}</li>'
    )
