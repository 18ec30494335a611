"""The conformance command: judging a protocol package, one that comes with drivecomm or a stranger's."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.output import emit, say
from drivecomm.errors import UsageError
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from drivecomm.testing import Report, Verdict


def conformance(
    protocol: Annotated[str, typer.Argument(help="An installed protocol.")],
    only: Annotated[str, typer.Option("--only", metavar="NAME", help="Checks whose name contains this.")] = "",
    html: Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write the report as a page too.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A few seconds: fewer examples, one model, no ports.")] = False,
    stop: Annotated[bool, typer.Option("--stop", help="Stop at the first check that does not hold.")] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object per line.")] = False,
) -> int:
    """Judge a protocol package by all that every protocol must stand. Exit code 1 when something does not hold."""
    from drivecomm.testing import (  # noqa: PLC0415 - only this command needs the kit  # noqa: PLC0415
        FULL,
        QUICK,
        Report,
        left_out,
        verdicts,
    )

    plugin = installed[protocol]
    if html is not None:
        _write(html, "")
    found: list[Verdict] = []
    for verdict in verdicts(plugin, QUICK if quick else FULL, only=only):
        found.append(verdict)
        _tell(verdict, as_json=json)
        if stop and not verdict.passed:
            break
    report = Report(verdicts=tuple(found), left_out=left_out())
    if json:
        emit(protocol=protocol, passed=len(report.passed), failed=len(report.failed), left_out=report.left_out)
    else:
        _summarise(protocol, report)
    if html is not None:
        from drivecomm.testing import page  # noqa: PLC0415

        _write(html, page(plugin, report))
    return 0 if report.ok else 1


def _tell(verdict: Verdict, *, as_json: bool) -> None:
    """Tell what came of a check: for scripts of each, for people of what does not hold."""
    if as_json:
        check = verdict.check
        emit(
            check=check.name,
            passed=verdict.passed,
            reason=verdict.reason,
            meaning=check.meaning,
            seconds=round(verdict.seconds, 4),
        )
    elif not verdict.passed:
        say(f"FAILED {verdict.check.name}: {verdict.reason}")


def _summarise(protocol: str, report: Report) -> None:
    from drivecomm.testing import sections_of  # noqa: PLC0415 - as above

    for number, section in enumerate(sections_of(report)):
        if number or report.failed:
            say()
        say(section.title)
        for row in section.rows:
            held = f"{row.number - len(row.failed)}/{row.number}"
            say(f"  {'FAILED' if row.failed else 'ok':<6} {held:>9}  {row.kind}: {row.meaning}")
    say()
    for what in report.left_out:
        say(f"left out: {what}")
    say(f"{protocol}: {len(report.passed)} checks passed, {len(report.failed)} failed, {report.seconds:.1f} s")


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(
            f"{path}: the report cannot be written there ({error.strerror}); choose another file"
        ) from error
