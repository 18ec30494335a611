"""Entry point of the command line, which turns errors into one sentence each and an exit code.

0 success, 1 a step or a check failed, 2 usage, 3 port or line, 4 no valid reply, 5 the drive refused, 130 interrupted
(143 by SIGTERM, 129 by SIGHUP). The codes are defined on the error classes.
"""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable

# Imports are late: `--version` needs none of them, and a stop does not even need click.
COMPLETION = "_DRIVECOMM_COMPLETE"
"""Environment variable with which a shell requests completions from click."""


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; without arguments, run this process's command line."""
    if arguments is not None:
        return _carry_out(arguments)
    # Only for this process as a whole, not for callers that run commands within their own program.
    from drivecomm.cli import signals, streams

    given = sys.argv[1:]
    if given[:1] == ["stop"]:
        return _stop(given)
    streams.guard()
    signals.interrupt()
    try:
        code = _carry_out(given)
        signals.ignore()
    except KeyboardInterrupt:
        # The interrupt came while an error was being printed, or at the very end.
        from drivecomm.cli.output import interrupted

        code = interrupted(as_json="--json" in given)
        signals.ignore()
    code = streams.finished(code)
    signals.restore()
    return code


def _stop(given: list[str]) -> int:
    """Complete a stop despite any signal, and despite failures of this process's own setup.

    Returns the exit code of the stop.
    """
    from drivecomm.cli import signals, streams

    for prepare in (streams.guard, signals.ignore, partial(streams.begin, reads=False)):
        with suppress(Exception):
            prepare()
    code = _carry_out(given)
    with suppress(Exception):
        code = streams.finished(code)
        signals.restore()
    return code


def _carry_out(given: list[str]) -> int:
    if given == ["--version"]:
        # Answered before any import, because scripts call it often.
        sys.stdout.write(f"drivecomm {__version__}\n")
        return 0
    if given[:1] == ["stop"]:
        from drivecomm.cli.stop.quick import quick_stop

        if stop := quick_stop(given[1:]):
            return exit_code_of(stop, as_json="--json" in given)
    return run(given)


def run(arguments: list[str]) -> int:
    """Run one command by its words, and return its exit code."""
    from drivecomm.cli import streams
    from drivecomm.cli.app import READING, app

    if not arguments and (instruction := os.environ.get(COMPLETION)):
        from click.shell_completion import shell_complete

        return shell_complete(app, {}, "drivecomm", COMPLETION, instruction)

    def call() -> Any:
        with app.make_context("drivecomm", list(arguments)) as context:
            return app.invoke(context)

    streams.begin(reads=not arguments or arguments[0] in READING or arguments[0].startswith("-"))
    return exit_code_of(call, as_json="--json" in arguments)


def exit_code_of(command: Callable[[], Any], *, as_json: bool) -> int:
    """Run a command and return its exit code; the only place where errors become sentences."""
    from drivecomm.cli import signals
    from drivecomm.cli.output import complain, interrupted
    from drivecomm.errors import DriveCommError

    try:
        code = command()
    except DriveCommError as error:
        complain(error, as_json=as_json)
        return error.exit_code
    except KeyboardInterrupt:
        return interrupted(as_json=as_json)
    except BrokenPipeError:
        # The reader of the output has closed it, as `head` does.
        return 0
    except Exception as error:
        if signals.interrupted():
            # An interruption may arrive here as another exception.
            return interrupted(as_json=as_json)
        if hasattr(error, "exit_code"):
            return _usage_error(error, as_json=as_json)
        if isinstance(error, OSError):
            return _systems_error(error, as_json=as_json)
        raise
    return code if isinstance(code, int) else 0


def _systems_error(error: OSError, *, as_json: bool) -> int:
    """Print an error of the operating system, and return the exit code."""
    from drivecomm.cli.output import complain
    from drivecomm.errors import DriveCommError, UsageError, reason_of

    if error.filename is None or error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.EIO):
        # The cause is the machine, such as a full disk or too many open files.
        complain(f"{error.filename or 'this machine'}: {reason_of(error)}", as_json=as_json)
        return DriveCommError.exit_code
    text = f"{error.filename}: cannot be used: {reason_of(error)}; make it usable for this user, or name another place"
    complain(text, as_json=as_json, exit_code=UsageError.exit_code)
    return UsageError.exit_code


def _usage_error(error: Any, *, as_json: bool) -> int:
    """Print an error in the words of a call, and return the exit code; prints nothing for click's exit after --help."""
    from drivecomm.cli.output import complain

    if not hasattr(error, "format_message"):
        return int(error.exit_code)
    text = error.format_message()
    if type(error).__name__ == "NoArgsIsHelpError":
        sys.stdout.write(f"{text}\n")
        return int(error.exit_code)
    context = getattr(error, "ctx", None)
    text = text.rstrip(".")
    hint = f" (see {context.command_path} --help)" if context else ""
    complain(f"{text}{hint}", as_json=as_json, exit_code=error.exit_code)
    return int(error.exit_code)
