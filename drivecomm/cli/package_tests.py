"""Commands that test a protocol package: `conformance`, `vectors check` and `vectors from-capture`."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import complain, emit, note, say, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import installed, parse_options, protocol_options
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.testing import CheckResult, Reasons, Report


@click.command(cls=CliCommand)
@click.argument("protocol", shell_complete=options.complete_protocol, help="An installed protocol.")
@click.option("--only", show_default=False, metavar="NAME", default="", help="Checks whose name contains this.")
@click.option("--html", type=FILE, help="Write the report as a page too.")
@click.option("--quick", is_flag=True, help="A few seconds: fewer examples, one model, no ports.")
@force_option
@click.option("--stop", is_flag=True, help="Stop at the first check that fails.")
@options.json
def conformance(
    *, protocol: str, only: str, html: Path | None, quick: bool, force: bool, stop: bool, json: bool
) -> int:
    """Run the conformance tests of a protocol package. Exit code 1 when a check fails."""
    from drivecomm.testing import FULL, QUICK, Reasons, make_report, results

    plugin = installed[protocol]
    must_be_free(html, "--html", force=force)
    found: list[CheckResult] = []
    reasons = Reasons()
    for result in results(plugin, QUICK if quick else FULL, only=only):
        found.append(result)
        _tell(result, reasons, as_json=json)
        if stop and not result.passed:
            break
    report = make_report(plugin, found, only=only)
    if json:
        emit(
            protocol=protocol,
            passed=len(report.passed),
            failed=len(report.failed),
            left_out=report.left_out,
            unproven=report.unproven,
        )
    else:
        _summarise(protocol, report)
    if html is not None:
        from drivecomm.testing import page

        write_atomically(html, page(plugin, report))
    return 0 if report.ok else 1


def _tell(result: CheckResult, reasons: Reasons, *, as_json: bool) -> None:
    """Print the result of a check: every check as JSON, only failed ones as text."""
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
        say(f"FAILED {result.name}: {reasons.of(result)}")


def _summarise(protocol: str, report: Report) -> None:
    from drivecomm.testing import notes_of, sections_of

    for number, section in enumerate(sections_of(report)):
        if number or report.failed:
            say()
        say(section.title)
        for row in section.rows:
            held = f"{row.number - len(row.failed)}/{row.number}"
            say(f"  {'FAILED' if row.failed else 'ok':<6} {held:>9}  {row.kind}: {row.meaning}")
    say()
    for what in notes_of(report):
        say(what)
    say(f"{protocol}: {len(report.passed)} checks passed, {len(report.failed)} failed, {report.seconds:.1f} s")


@click.command(cls=CliCommand)
@click.argument("files", type=FILE, metavar="[FILE...]", nargs=-1, help="Default: those of the installed protocols.")
@options.json
def check(*, files: tuple[Path, ...], json: bool) -> int:
    """Run every check of every vector. Exit code 1 when one fails."""
    from drivecomm.testing import load_vectors, packaged_vectors, run_checks

    code = 0
    sets = []
    if files:
        for path in files:
            try:
                loaded = load_vectors(path)
                sets.append((str(path), installed[loaded.protocol], loaded))
            except FileFormatError as error:
                complain(error, as_json=json)
                code = error.exit_code
    else:
        sets = [(plugin.name, plugin, packaged_vectors(plugin)) for plugin in installed.working()]
    for name, plugin, loaded in sets:
        report = run_checks(plugin, loaded)
        for failure in report.failed:
            text = f"FAILED {failure.name}: {failure.reason}"
            tell(text, as_json=json, check=failure.name, passed=False, reason=failure.reason)
        passed, failed = len(report.passed), len(report.failed)
        text = f"{name}: {passed} checks passed, {failed} failed"
        tell(text, as_json=json, vectors=name, protocol=plugin.name, passed=passed, failed=failed)
        code = code or (1 if report.failed else 0)
    return code


@click.command("from-capture", cls=CliCommand)
@click.argument("file", type=FILE, help="A capture, .jsonl or .pcapng.")
@click.option(
    "--protocol",
    metavar="PROTOCOL",
    shell_complete=options.complete_protocol,
    required=True,
    help="The protocol of the telegrams.",
)
@click.option("--output", type=FILE, help="The vector file to write. Default: print it.")
@force_option
@options.protocol_option
def from_capture(*, file: Path, protocol: str, output: Path | None, force: bool, option: tuple[str, ...]) -> int:
    """Turn a capture into vectors: each sound telegram of a protocol once, replies with their requests.

    They show the bytes on the line and today's decoding of them: check the fields before you rely on them.
    """
    from drivecomm.capture import read_capture
    from drivecomm.traffic.replay import vectors_text

    must_be_free(output, "--output", force=force)
    plugin = installed[protocol]
    options = parse_options(option)
    protocol_options(plugin, options)
    capture = read_capture(file)
    for remark in capture.remarks:
        note(remark)
    text = vectors_text(capture, plugin, name=file.name, options=options)
    count = text.count("[[vector]]")
    if not count:
        raise UsageError(f"{file}: no telegram of {protocol} is in this capture; check --protocol and its options")
    if output is None:
        sys.stdout.write(text)
        return 0
    write_atomically(output, text)
    say(f"{count} vectors in {output}")
    return 0
