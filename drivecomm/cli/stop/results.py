"""What came of stops, and how it is said."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.cli.output import complain, emit, say

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Stop


@dataclass(frozen=True, slots=True, kw_only=True)
class StopResult:
    """The outcome of a stop: of a drive by its name, or where that is empty of a broadcast.

    how: other than asked for where that is not possible. error: why a drive has not confirmed, or a broadcast was not
    sent. line: its name in the plant. without: what was left out, because it was invalid.
    """

    line: str = ""
    drive: str = ""
    protocol: str = ""
    how: Stop
    error: Exception | None = None
    without: str = ""


Tell: TypeAlias = "Callable[[StopResult], None]"


def show(news: StopResult, wanted: Stop, *, as_json: bool) -> None:
    """Say what came of a stop; that it cannot be said keeps no other motor running."""
    with suppress(Exception):
        _show(news, wanted, as_json=as_json)


def _show(news: StopResult, wanted: Stop, *, as_json: bool) -> None:
    who = news.drive or f"{news.protocol}:*"
    confirmed = bool(news.drive) and news.error is None
    if as_json:
        error = "" if news.error is None else str(news.error)
        told = {"stop": news.how, "confirmed": confirmed, "error": error, "without": news.without}
        emit(line=news.line, drive=who, drive_name=who, **told)
        return
    where = f"{news.line}: " if news.line else ""
    if news.error is not None:
        complain(news.error, as_json=False, where=f"{where}{who} has not confirmed its stop")
        return
    instead = "" if news.how is wanted else f", because it cannot by {wanted.value}"
    what = "confirmed" if confirmed else "sent to all"
    say(f"{where}{who}  stop ({news.how.value}{instead}) {what}{f', {news.without}' if news.without else ''}")
