"""Where the command line begins and where its errors end: one sentence each, and an exit code.

0 success, 1 a step or a check failed, 2 usage, 3 port or line, 4 no believable reply, 5 the drive said no,
130 interrupted. The codes live on the error classes.
"""

from __future__ import annotations

import sys

from drivecomm.version import __version__


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
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
