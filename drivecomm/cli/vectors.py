"""The vectors commands: test vectors of protocols, built-in and third-party."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from drivecomm.cli.options import Json, ProtocolOption
from drivecomm.cli.output import complain, emit, say
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import installed, parse_options, protocol_options


def check(
    files: Annotated[
        list[Path] | None, typer.Argument(metavar="[FILE...]", help="Those of the installed protocols if absent.")
    ] = None,
    json: Json = False,
) -> int:
    """Run every check of every vector. Exit code 1 when one fails."""
    from drivecomm.testing import load_vectors, packaged_vectors, run_checks  # noqa: PLC0415

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
            if json:
                emit(check=failure.name, passed=False, reason=failure.reason)
            else:
                say(f"FAILED {failure.name}: {failure.reason}")
        if json:
            emit(vectors=name, protocol=plugin.name, passed=len(report.passed), failed=len(report.failed))
        else:
            say(f"{name}: {len(report.passed)} checks passed, {len(report.failed)} failed")
        code = code or (1 if report.failed else 0)
    return code


def from_capture(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A capture, .jsonl or .pcapng.")],
    protocol: Annotated[str, typer.Option("--protocol", help="The protocol whose telegrams are wanted.")],
    output: Annotated[Path | None, typer.Option("--output", help="The vector file; printed if absent.")] = None,
    option: ProtocolOption = None,
) -> int:
    """Turn a capture into vectors: each sound telegram of a protocol once, replies with their requests.

    They say what was on the line and what drivecomm makes of it today: look at the fields before you rely on them.
    """
    from drivecomm.capture import read_capture  # noqa: PLC0415 - only this command needs captures
    from drivecomm.traffic.replay import vectors_text  # noqa: PLC0415

    plugin = installed[protocol]
    options = parse_options(option or [])
    protocol_options(plugin, options)
    capture = read_capture(file)
    for remark in capture.remarks:
        sys.stderr.write(f"drivecomm: {remark}\n")
    text = vectors_text(capture, plugin, name=file.name, options=options)
    count = text.count("[[vector]]")
    if not count:
        raise UsageError(f"{file}: no telegram of {protocol} is in this capture; check --protocol and its options")
    if output is None:
        sys.stdout.write(text)
        return 0
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{output}: cannot be written ({error.strerror or error}); choose another file") from error
    say(f"{count} vectors in {output}")
    return 0
