"""Running the application: exceptions become sentences and exit codes here, and only here."""

from __future__ import annotations

from typing import Any

import typer

from drivecomm.cli import signals, streams
from drivecomm.cli.output import complain, interrupted, say
from drivecomm.errors import DriveCommError

INTERRUPTED = 130

READING = frozenset(
    {
        *("protocols", "decode", "encode", "scan", "doctor", "stats", "read", "status", "wait", "compare", "poll"),
        *("forecast", "cohabit", "replay", "sniff", "conformance", "models", "vectors", "demo"),
    }
)
"""The commands whose work is what they say, so that they end when that cannot be written; the others finish theirs."""


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
    app = _app_for(arguments)
    streams.begin(reads=not arguments or arguments[0] in READING or arguments[0].startswith("-"))
    signals.loaded()
    try:
        code = app(args=arguments, prog_name="drivecomm", standalone_mode=False)
    except DriveCommError as error:
        complain(error, as_json=as_json)
        return error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        return interrupted(as_json=as_json)
    except BrokenPipeError:
        # The reader of our output has gone, as `head` does.
        return 0
    except Exception as error:
        if signals.interrupted():
            # An interruption does not get out of everything as what it is.
            return interrupted(as_json=as_json)
        if hasattr(error, "exit_code") and hasattr(error, "format_message"):
            return _of_the_call(error, as_json=as_json)
        if isinstance(error, OSError):
            # The machine's, which cannot be foreseen everywhere: a full disk, no room for another file.
            complain(f"{error.filename or 'this machine'}: {error.strerror or error}", as_json=as_json)
            return DriveCommError.exit_code
        raise
    # typer takes Ctrl-C for itself and leaves only its exit code.
    return interrupted(as_json=as_json) if code == INTERRUPTED else code if isinstance(code, int) else 0


def _of_the_call(error: Any, *, as_json: bool) -> int:
    """Tell what is wrong with the words of a call; where there are none, the help says which there are."""
    context = getattr(error, "ctx", None)
    text = error.format_message().rstrip(".")
    if type(error).__name__ == "NoArgsIsHelpError":
        # Where it is drawn, it was when the error was made.
        if text:
            say(text)
        return int(error.exit_code)
    details = getattr(error.__cause__, "errors", None)
    if details is not None:
        text = _wrong_value(error, details()[0])
    hint = f" (see {context.command_path} --help)" if context else ""
    complain(f"{text}{hint}", as_json=as_json, exit_code=error.exit_code)
    return int(error.exit_code)


def _wrong_value(error: Any, detail: dict[str, Any]) -> str:
    """Return what is wrong with a value in words for people, which the library that reads it has for programmers."""
    words = {"int": "a whole number", "float": "a number", "bool": "true or false"}
    kind = words.get(detail["type"].partition("_")[0])
    if kind is None:
        return str(error.format_message()).rstrip(".")
    return f"{error.param.get_error_hint().strip(chr(39))} cannot be {detail['input']!r}; write {kind}"
