"""The drives on the line as a table, while one listens and at the end."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.cli.output import emit, say
from drivecomm.traffic.sniffer import LINE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rich.live import Live
    from rich.table import Table

    from drivecomm.cli.sniff.naming import Meaning
    from drivecomm.link import ReplyTimes, Statistics
    from drivecomm.traffic.sniffer import LineEvent

_COUNTED = ("requests", "replies")
_TIMES: dict[str, Callable[[ReplyTimes], float]] = {
    "mean ms": lambda times: times.mean_s,
    "95 %": lambda times: times.percentile_s(95),
    "longest": lambda times: times.longest_s,
}
_COUNTED_ERRORS = {
    "retries": ("retry", "retries"),
    "timeouts": ("timeout", "timeouts"),
    "damaged": ("damaged", "damaged"),
    "strays": ("stray", "strays"),
}
_ERRORS = ("framing errors", "length errors", "checksum errors", "field errors")
_PER_SECOND = 4
_NOT_A_TERMINAL = 160


@dataclass(slots=True)
class LiveTable:
    """A table that is drawn anew while events come; only on a terminal."""

    counted: Callable[[], Mapping[str, Mapping[str, Statistics]]]
    _last: dict[tuple[str, str], str] = field(default_factory=dict)
    _live: Live | None = None

    def start(self) -> None:
        """Begin to draw."""
        from rich.live import Live  # noqa: PLC0415 - rich is loaded only where something is drawn

        if sys.stdout.isatty():
            self._live = Live(get_renderable=self._table, refresh_per_second=_PER_SECOND, screen=False)
            self._live.start()

    def show(self, event: LineEvent, meaning: Meaning) -> None:
        """Keep the last value of each drive."""
        if meaning.parameter is not None and meaning.reading is not None:
            self._last[event.line, event.drive] = f"{meaning.parameter.name} = {meaning.reading}"

    def stop(self) -> None:
        """Draw for the last time."""
        if self._live is not None:
            self._live.stop()
            self._live = None
        else:
            _print(self._table())

    def _table(self) -> Table:
        return drawn(self.counted(), self._last)


def print_summary(counted: Mapping[str, Mapping[str, Statistics]]) -> None:
    """Print what was counted for each drive, apart from what stands before it."""
    say()
    _print(drawn(counted, {}))


def emit_summary(counted: Mapping[str, Mapping[str, Statistics]]) -> None:
    """Print what was counted as one JSON object for each drive, and one for the line."""
    for line, drives in counted.items():
        for drive, each in sorted(drives.items()):
            times = each.reply_times
            emit(
                what="statistics",
                line=line,
                drive=drive,
                counters=dict(each.counters),
                reply_times={
                    "count": times.count,
                    "shortest_ms": round(times.shortest_s * 1000, 3),
                    "mean_ms": round(times.mean_s * 1000, 3),
                    "p95_ms": round(times.percentile_s(95) * 1000, 3),
                    "longest_ms": round(times.longest_s * 1000, 3),
                }
                if times.count
                else None,
            )


def drawn(counted: Mapping[str, Mapping[str, Statistics]], last: Mapping[tuple[str, str], str]) -> Table:
    """Return the table; last: what each drive said last."""
    from rich import box  # noqa: PLC0415 - as above
    from rich.table import Table  # noqa: PLC0415

    narrow = {"box": box.SIMPLE_HEAD, "padding": (0, 1, 0, 0), "show_edge": False, "pad_edge": False}
    table = Table(**narrow if sys.stdout.isatty() else {"box": box.ASCII2})
    table.add_column("drive", no_wrap=True)
    # A terminal has 80 columns, and the last values need them.
    times = dict(list(_TIMES.items())[: 1 if last else None])
    for head in (*_COUNTED, *times):
        table.add_column(head, justify="right", no_wrap=True)
    rows = [(line, drive, drives[drive]) for line, drives in counted.items() for drive in sorted(drives, key=_order)]
    errors = [_errors_of(each) for _, _, each in rows]
    told = [("errors", any(errors)), ("last value", bool(last))]
    for head in (head for head, is_told in told if is_told):
        table.add_column(head)
    for (line, drive, each), wrong in zip(rows, errors, strict=True):
        texts = (wrong, last.get((line, drive), ""))
        table.add_row(
            f"{line} {drive}".strip(),
            *(str(each.counters[name]) for name in _COUNTED),
            *(_milliseconds(each.reply_times, how) for how in times.values()),
            *(text for text, (_, is_told) in zip(texts, told, strict=True) if is_told),
        )
    return table


def _order(drive: str) -> tuple[bool, str, int, str]:
    """By protocol, then by number; what belongs to no drive comes last."""
    protocol, _, address = drive.partition(":")
    return drive == LINE, protocol, int(address) if address.isdigit() else -1, address


def _milliseconds(times: ReplyTimes, how: Callable[[ReplyTimes], float]) -> str:
    return f"{how(times) * 1000:.1f}" if times.count else ""


def _errors_of(each: Statistics) -> str:
    """Return what went wrong, in words: a table of zeros would hide it."""
    counts = [(each.counters[name], *words) for name, words in _COUNTED_ERRORS.items()]
    counts.append((sum(each.counters[name] for name in _ERRORS), "error", "errors"))
    counts.append((each.counters["noise bytes"], "noise byte", "noise bytes"))
    return ", ".join(f"{count} {one if count == 1 else many}" for count, one, many in counts if count)


def _print(table: Any) -> None:
    from rich.console import Console  # noqa: PLC0415 - as above

    Console(width=None if sys.stdout.isatty() else _NOT_A_TERMINAL).print(table, markup=False)
