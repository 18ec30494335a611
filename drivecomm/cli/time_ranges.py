"""Options for a time range: from one time to another, or the last hours; times without a zone are local."""

from __future__ import annotations

from datetime import datetime, time, timedelta
from typing import NamedTuple

import click

from drivecomm.durations import UNITS, seconds_in
from drivecomm.errors import UsageError

from_option = click.option(
    "--from", "begin", metavar="TIME", help='Start time, such as "2026-11-22 10:00", or 10:00 today.'
)
to_option = click.option("--to", "end", metavar="TIME", help="End time.")
last_option = click.option("--last", metavar="DURATION", help="The last 30min, 2h or 7d.")


class TimeRange(NamedTuple):
    """Begin and end of a time range, in seconds since 1970; None for an open end."""

    from_s: float | None
    to_s: float | None

    def has(self, time_s: float) -> bool:
        """Return whether a time is within the range."""
        return (self.from_s is None or self.from_s <= time_s) and (self.to_s is None or time_s <= self.to_s)


def time_range(
    begin: str | None,
    end: str | None,
    last: str | None,
    *,
    otherwise: str | None = None,
    flags: tuple[str, str] = ("--from", "--to"),
) -> TimeRange:
    """Return the time range of a call. otherwise: default DURATION before now. flags: names of the two options.

    Raises UsageError.
    """
    from_flag, to_flag = flags
    if last is not None and (begin is not None or end is not None):
        raise UsageError(f"--last reaches to the present; give it alone, or {from_flag} and {to_flag}")
    if last is None and begin is None and end is None:
        last = otherwise
    if last is not None:
        if (seconds := seconds_in(last)) is None:
            raise UsageError(f"invalid --last {last!r}; write a number and {UNITS}, such as 2h")
        now = datetime.now().astimezone()
        try:
            return TimeRange((now - timedelta(seconds=seconds)).timestamp(), None)
        except OverflowError:
            return TimeRange(None, None)
    found = TimeRange(_clock(begin, from_flag), _clock(end, to_flag))
    if found.from_s is not None and found.to_s is not None and found.from_s > found.to_s:
        raise UsageError(f"{from_flag} {begin} is after {to_flag} {end}; swap them")
    return found


def clock(time_s: float) -> str:
    """Return a time as text for people: local, with the zone."""
    return datetime.fromtimestamp(time_s).astimezone().isoformat(sep=" ", timespec="milliseconds")


def _clock(text: str | None, flag: str) -> float | None:
    if text is None:
        return None
    try:
        try:
            when = datetime.combine(datetime.now().astimezone().date(), time.fromisoformat(text))
        except ValueError:
            when = datetime.fromisoformat(text)
        return when.astimezone().timestamp() if when.tzinfo is None else when.timestamp()
    except (ValueError, OverflowError, OSError):
        raise UsageError(f'invalid {flag} {text!r}; write a local time such as "2026-11-22 10:00", or 10:00') from None
