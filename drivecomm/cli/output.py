"""What commands print: text, or JSON objects."""

from __future__ import annotations

import dataclasses
import json
import signal
import sys
from decimal import Decimal
from enum import Enum
from typing import TYPE_CHECKING, Any

from drivecomm.cli import signals, streams
from drivecomm.cli.flags import in_flags
from drivecomm.errors import DriveCommError
from drivecomm.link import trace_data, trace_line

if TYPE_CHECKING:
    from drivecomm.link import TraceEvent


def plain(value: Any) -> Any:
    """Return a value in the types of JSON; exact decimals become text, so that nothing is rounded."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Decimal):
        return str(value)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return sorted(map(plain, value)) if isinstance(value, set | frozenset) else [plain(each) for each in value]
    return value


def emit(**content: Any) -> None:
    """Print one JSON object on a line of its own."""
    sys.stdout.write(json.dumps(plain(content)) + "\n")
    sys.stdout.flush()


def say(text: str = "") -> None:
    """Print a line of text."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def sentence(error: Exception | str, *, where: str = "") -> str:
    """Return an error as one sentence: where, what, and what to do about it."""
    text = " ".join(str(error).split())
    place = where if where and where not in text else ""
    remedy = error.remedy if isinstance(error, DriveCommError) else ""
    return in_flags((f"{place}: " if place else "") + text + (f"; {remedy}" if remedy else ""), error)


def complain(error: Exception | str, *, as_json: bool, where: str = "", exit_code: int = 1) -> None:
    """Print an error: as a sentence on standard error, and with --json as an object on standard output.

    exit_code: of an error that is not one of the tree's.
    """
    text = sentence(error, where=where)
    if as_json:
        code = error.exit_code if isinstance(error, DriveCommError) else exit_code
        kind = type(error).__name__ if isinstance(error, Exception) else "Error"
        about = error.about if isinstance(error, DriveCommError) else None
        emit(**(about or {}), error=text, kind=kind, exit_code=code)
    sys.stderr.write(f"drivecomm: {text}\n")
    sys.stderr.flush()


def interrupted(*, as_json: bool) -> int:
    """Say that a command was interrupted, unless what it says is not read any more, and return its exit code."""
    number = signals.interrupted()
    if not number and streams.is_lost():
        return 0
    code = 128 + (number or signal.SIGINT)
    complain("interrupted", as_json=as_json, exit_code=code)
    return code


def trace_to_standard_error(event: TraceEvent) -> None:
    """Print a trace event as text."""
    sys.stderr.write(trace_line(event) + "\n")
    sys.stderr.flush()


def trace_as_json(event: TraceEvent) -> None:
    """Print a trace event as a JSON object on standard error, apart from the command's own objects."""
    sys.stderr.write(json.dumps(plain({"trace": event.what, **trace_data(event)})) + "\n")
    sys.stderr.flush()
