"""Running the application: exceptions become sentences and exit codes here, and only here."""

from __future__ import annotations

import typer

from drivecomm.cli.output import complain
from drivecomm.errors import DriveCommError

INTERRUPTED = 130


def _app_for(arguments: list[str]) -> typer.Typer:
    if arguments[:1] == ["stop"]:
        # Loading the other commands takes longer than stopping a motor.
        from drivecomm.cli.stop_only import app as stop_only  # noqa: PLC0415

        return stop_only
    from drivecomm.cli.app import app  # noqa: PLC0415

    return app


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code."""
    as_json = "--json" in arguments
    try:
        code = _app_for(arguments)(args=arguments, prog_name="drivecomm", standalone_mode=False)
    except DriveCommError as error:
        complain(error, as_json=as_json)
        return error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        complain("interrupted", as_json=as_json)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone, as `head` does.
        return 0
    except Exception as error:
        exit_code = getattr(error, "exit_code", None)
        if exit_code is None or not hasattr(error, "format_message"):
            raise
        context = getattr(error, "ctx", None)
        hint = f" (see {context.command_path} --help)" if context else ""
        complain(f"{error.format_message().rstrip('.')}{hint}", as_json=as_json)
        return int(exit_code)
    if code == INTERRUPTED:
        # typer takes Ctrl-C for itself and leaves only its exit code.
        complain("interrupted", as_json=as_json)
    return code if isinstance(code, int) else 0
