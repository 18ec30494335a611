"""The vectors commands: test vectors of protocols, the packaged ones and a stranger's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivecomm.cli.output import complain, emit, say
from drivecomm.errors import FileFormatError
from drivecomm.registry import installed

AsJson = Annotated[bool, typer.Option("--json", help="One JSON object per line.")]


def check(
    files: Annotated[list[Path] | None, typer.Argument(metavar="[FILE...]", help="Packaged vectors if absent.")] = None,
    json: AsJson = False,
) -> int:
    """Run every check of every vector. Exit code 1 when one fails."""
    from drivecomm.conformance.checks import run_checks  # noqa: PLC0415 - only this command needs the kit
    from drivecomm.conformance.vectors import load_vectors, packaged_vectors  # noqa: PLC0415

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
