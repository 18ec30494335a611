"""Output of commands: text, or JSON objects; errors in the words of the command line; a progress bar."""

from __future__ import annotations

import dataclasses
import json
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import contextmanager
from decimal import Decimal
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm import link
from drivecomm.cli import signals, streams
from drivecomm.errors import DriveCommError, printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from drivecomm.link import ReplyTimes, TraceEvent
    from drivecomm.protocol import DriveConfig, MachineValue

    Progress: TypeAlias = Callable[[str, int, int], None]

_NOTE_EVERY_S = 10.0


def plain(value: Any) -> Any:
    """Convert a value to JSON types; exact decimals become text, so that nothing is rounded."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Decimal):
        return str(value)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return sorted(map(plain, value)) if isinstance(value, set | frozenset) else [plain(each) for each in value]
    return value


def labels(drive: DriveConfig) -> dict[str, str]:
    """Return the keys with which a JSON object names its drive.

    drive_name is the same in all commands; the other keys have had different meanings in different commands since the
    first version.
    """
    return {**drive.labels, "drive_name": drive.name}


def machine_content(machine: MachineValue) -> dict[str, Any]:
    """Return the keys of a JSON object for a machine speed beside a frequency."""
    return {"machine_value": machine.value, "machine_unit": machine.unit}


def emit(**content: Any) -> None:
    """Print one JSON object on a separate line."""
    say(json.dumps(plain(content)))


def say(text: str = "") -> None:
    """Print a line of text; control characters from drives, files or servers are made harmless."""
    sys.stdout.write(printable(text) + "\n")
    sys.stdout.flush()


def tell(text: str, /, *, as_json: bool, **content: Any) -> None:
    """Print a line of text, or its content as one JSON object."""
    if as_json:
        emit(**content)
    else:
        say(text)


def counted(number: int, what: str) -> str:
    """Return a number with its noun: `1 drive` or `2 drives`."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def times_ms(times: ReplyTimes, percentiles: Iterable[int]) -> dict[str, float]:
    """Return reply times by their keys in JSON, in milliseconds."""
    seconds = {
        "shortest_ms": times.shortest_s,
        "mean_ms": times.mean_s,
        **{f"p{percent}_ms": times.percentile_s(percent) for percent in percentiles},
        "longest_ms": times.longest_s,
    }
    return {key: round(each * 1000, 3) for key, each in seconds.items()}


def print_columns(rows: Iterable[tuple[str, ...]]) -> None:
    """Print rows with aligned columns, each as wide as its longest text."""
    lines = [tuple(map(printable, row)) for row in rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        say("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())


def print_table(table: Any, width: int) -> None:
    """Print a table in the width of the terminal, or in this width without a terminal."""
    from rich.console import Console

    on_terminal = sys.stdout.isatty()
    Console(file=sys.stdout, width=None if on_terminal else width, markup=False).print(table)


def sentence(error: Exception | str, *, where: str = "") -> str:
    """Return an error as one sentence: place, cause and remedy."""
    text = " ".join(str(error).split())
    place = where if where and where not in text else ""
    remedy = error.remedy if isinstance(error, DriveCommError) else ""
    return printable(in_flags((f"{place}: " if place else "") + text + (f"; {remedy}" if remedy else ""), error))


def complain(error: Exception | str, *, as_json: bool, where: str = "", exit_code: int = 1) -> None:
    """Print an error: as a sentence on standard error, and with --json as an object on standard output.

    exit_code: exit code of an error that is not a DriveCommError.
    """
    text = sentence(error, where=where)
    if as_json:
        code = error.exit_code if isinstance(error, DriveCommError) else exit_code
        kind = type(error).__name__ if isinstance(error, Exception) else "Error"
        about = error.about if isinstance(error, DriveCommError) else None
        emit(**(about or {}), error=text, kind=kind, exit_code=code)
    note(text)


def note(text: str) -> None:
    """Print a remark on standard error, such as an error, an expected duration, or an omission."""
    sys.stderr.write(f"drivecomm: {printable(text)}\n")
    sys.stderr.flush()


def interrupted(*, as_json: bool) -> int:
    """Print that a command was interrupted, and return its exit code; print nothing if the output is closed."""
    number = signals.interrupted()
    if not number and streams.is_lost():
        return 0
    code = 128 + (number or signal.SIGINT)
    complain("interrupted", as_json=as_json, exit_code=code)
    return code


def show_trace(event: TraceEvent, *, as_json: bool) -> None:
    """Print a trace event on standard error: as text, or as a JSON object separate from the command's own objects."""
    show_traced({"trace": event.what, **link.trace_data(event)} if as_json else link.trace_line(event))


def show_traced(line: str | Mapping[str, Any]) -> None:
    """Print a line of a trace on standard error: a text, or a JSON object."""
    text = line if isinstance(line, str) else json.dumps(plain(line))
    sys.stderr.write(printable(text) + "\n")
    sys.stderr.flush()


_FLAGS = {
    "store": "--store",
    "reply_timeout_s": "--timeout",
    "attempts": "--attempts",
    "rs485": "--rs485",
    "low_latency": "--low-latency",
}
"""Keywords that are flags; all others are options of a drive, and are written after its name."""


def in_flags(text: str, error: Exception | str) -> str:
    """Return an error's text with its keywords replaced by the words of the command line."""
    about = error.about if isinstance(error, DriveCommError) else None
    for keyword in _said_by(error):
        text = text.replace(keyword, _written(keyword, about["name"] if about else "DRIVE"))
    return text


def _said_by(error: object) -> tuple[str, ...]:
    """Return the keywords in an error's sentence, including those of its cause, whose words it may repeat."""
    if not isinstance(error, DriveCommError):
        return ()
    return tuple(dict.fromkeys((*error.says, *_said_by(error.__cause__))))


def _written(keyword: str, drive: str) -> str:
    name, equals, value = keyword.partition("=")
    if keyword.startswith("start() "):
        return f"drivecomm start {drive} --link-loss hold --percent {value.rstrip(')')}"
    if name not in _FLAGS:
        return f"{drive},{keyword}" if equals else f"{drive},{name}=..."
    return _FLAGS[name] if value in ("", "True") else f"{_FLAGS[name]} {value}"


def _notes(what: str) -> Progress:
    noted_s = time.monotonic()

    def note(detail: str, done: int, total: int) -> None:
        nonlocal noted_s
        if time.monotonic() - noted_s >= _NOTE_EVERY_S:
            noted_s = time.monotonic()
            sys.stderr.write(f"{what} {detail} ({done} of {total})\n".lstrip())
            sys.stderr.flush()

    return note


@contextmanager
def progress_bar(what: str, *, shown: bool) -> Iterator[Progress]:
    """Yield a function that displays progress on standard error: current work, amount done, and total.

    On a terminal it draws a bar; otherwise it prints a line now and then, so that a log shows that the work continues.
    """
    if not shown:
        yield lambda *_: None
        return
    if not sys.stderr.isatty():
        yield _notes(what)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    # If output and bar share a terminal, printed lines appear above the bar.
    redirected = sys.stdout.isatty()
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=redirected) as drawing:
        task = drawing.add_task(what, total=None)

        def show(detail: str, done: int, total: int) -> None:
            drawing.update(task, description=f"{what} {detail}".rstrip(), completed=done, total=total)

        yield show
