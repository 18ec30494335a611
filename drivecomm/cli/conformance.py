"""The conformance command: the conformance tests of a protocol package, built-in or third-party."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivecomm.cli.options import Json
from drivecomm.cli.output import emit, say
from drivecomm.errors import UsageError
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from drivecomm.testing import CheckResult, Report


def conformance(
    protocol: Annotated[str, typer.Argument(help="An installed protocol.")],
    only: Annotated[str, typer.Option("--only", metavar="NAME", help="Checks whose name contains this.")] = "",
    html: Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write the report as a page too.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A few seconds: fewer examples, one model, no ports.")] = False,
    stop: Annotated[bool, typer.Option("--stop", help="Stop at the first check that fails.")] = False,
    json: Json = False,
) -> int:
    """Run the conformance tests of a protocol package. Exit code 1 when a check fails."""
    from drivecomm.testing import FULL, QUICK, Report, left_out, results  # noqa: PLC0415 - only this command needs them

    plugin = installed[protocol]
    if html is not None:
        _write(html, "")
    found: list[CheckResult] = []
    for result in results(plugin, QUICK if quick else FULL, only=only):
        found.append(result)
        _tell(result, as_json=json)
        if stop and not result.passed:
            break
    report = Report(results=tuple(found), left_out=left_out())
    if json:
        emit(protocol=protocol, passed=len(report.passed), failed=len(report.failed), left_out=report.left_out)
    else:
        _summarise(protocol, report)
    if html is not None:
        from drivecomm.testing import page  # noqa: PLC0415

        _write(html, page(plugin, report))
    return 0 if report.ok else 1


def _tell(result: CheckResult, *, as_json: bool) -> None:
    """Print the result of a check: as JSON of each, as text of those that fail."""
    if as_json:
        check = result.check
        emit(
            check=check.name,
            passed=result.passed,
            reason=result.reason,
            meaning=check.meaning,
            seconds=round(result.seconds, 4),
        )
    elif not result.passed:
        say(f"FAILED {result.name}: {result.reason}")


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
