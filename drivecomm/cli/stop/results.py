"""Output of the results of stops."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.cli.output import complain, emit, say

if TYPE_CHECKING:
    from drivecomm.bus import StopResult
    from drivecomm.protocol import Stop


def show(news: StopResult, wanted: Stop, *, as_json: bool) -> None:
    """Print the result of a stop; a failed output keeps no other motor running."""
    with suppress(Exception):
        _show(news, wanted, as_json=as_json)


def _show(news: StopResult, wanted: Stop, *, as_json: bool) -> None:
    who = news.drive or f"{news.protocol}:*"
    if as_json:
        error = "" if news.error is None else str(news.error)
        told = {"stop": news.how, "confirmed": news.confirmed, "error": error, "without": news.without}
        emit(line=news.line, drive=who, drive_name=who, **told)
        return
    where = f"{news.line}: " if news.line else ""
    if news.error is not None:
        complain(news.error, as_json=False, where=f"{where}{who} has not confirmed its stop")
        return
    instead = "" if news.how is wanted else f", because {wanted.value} is not supported"
    what = "confirmed" if news.confirmed else "sent to all"
    say(f"{where}{who}  stop ({news.how.value}{instead}) {what}{f', {news.without}' if news.without else ''}")
