"""Where the command line begins and where its errors end: one sentence each, and an exit code.

0 success, 1 a step or a check failed, 2 usage, 3 port or line, 4 no believable reply, 5 the drive said no, 130
interrupted (143 by SIGTERM, 129 by SIGHUP). The codes live on the error classes.
"""

from __future__ import annotations

import sys

from drivecomm.version import __version__


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; without arguments, as the whole of this process."""
    if arguments is not None:
        return _carry_out(arguments)
    # Not for those who run commands within a program of their own.
    from drivecomm.cli import signals, streams  # noqa: PLC0415

    given = sys.argv[1:]
    streams.guard()
    if given[:1] == ["stop"]:
        # It is carried through, and its exit code says what came of it.
        signals.go_on()
        streams.begin(reads=False)
    else:
        signals.interrupt()
    try:
        code = _carry_out(given)
        signals.go_on()
    except KeyboardInterrupt:
        # While another error was told, or when all was done.
        from drivecomm.cli.output import interrupted  # noqa: PLC0415

        code = interrupted(as_json="--json" in given)
        signals.go_on()
    code = streams.finished(code)
    signals.leave()
    return code


def _carry_out(given: list[str]) -> int:
    if given == ["--version"]:
        # Answered before anything is loaded: scripts ask for it often.
        sys.stdout.write(f"drivecomm {__version__}\n")
        return 0
    if given[:1] == ["stop"] and "--all" in given:
        from drivecomm.cli.stop_at_once import stop_at_once  # noqa: PLC0415

        code = stop_at_once(given[1:])
        if code is not None:
            return code
    from drivecomm.cli.run import run  # noqa: PLC0415

    return run(given)
