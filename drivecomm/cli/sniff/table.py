"""The drives on the line as a table, while one listens and at the end."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.cli.output import emit
from drivecomm.sniffer.tally import LINE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rich.live import Live
    from rich.table import Table

    from drivecomm.cli.sniff.naming import Meaning
    from drivecomm.sniffer import Event
    from drivecomm.statistics import Statistics

_COUNTED = ("requests", "replies", "retries", "timeouts", "damaged", "strays")
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

    def show(self, event: Event, meaning: Meaning) -> None:
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
    """Print what was counted for each drive."""
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

    table = Table(box=box.ROUNDED if sys.stdout.isatty() else box.ASCII2)
    heads = ["drive", *_COUNTED, "errors", "noise bytes", "mean", "95 %", "longest", *(["last value"] if last else [])]
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number == 0 or head == "last value" else "right", no_wrap=number == 0)
    for line, drives in counted.items():
        for drive in sorted(drives, key=_order):
            value = [last.get((line, drive), "")] if last else []
            table.add_row(f"{line} {drive}".strip(), *_cells(drives[drive]), *value)
    return table


def _order(drive: str) -> tuple[bool, str, int, str]:
    """By protocol, then by number; what belongs to no drive comes last."""
    protocol, _, address = drive.partition(":")
    return drive == LINE, protocol, int(address) if address.isdigit() else -1, address


def _cells(each: Statistics) -> list[str]:
    times = each.reply_times
    shown = [f"{time * 1000:.1f} ms" for time in (times.mean_s, times.percentile_s(95), times.longest_s)]
    return [
        *(str(each.counters[name]) for name in _COUNTED),
        str(sum(each.counters[name] for name in _ERRORS)),
        str(each.counters["noise bytes"]),
        *(shown if times.count else [""] * len(shown)),
    ]


def _print(table: Any) -> None:
    from rich.console import Console  # noqa: PLC0415 - as above

    Console(width=None if sys.stdout.isatty() else _NOT_A_TERMINAL).print(table, markup=False)
