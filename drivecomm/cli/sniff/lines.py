"""Output of traffic: as lines for people, as JSON objects for scripts, and as a table of the drives."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.cli.output import emit, plain, print_table, say, times_ms
from drivecomm.errors import printable
from drivecomm.link import ARROWS, fields_text, hex_text, line_text
from drivecomm.protocol import fields_of
from drivecomm.traffic.sniffer import LINE, AmbiguousTelegram, DamagedTelegram, HeardTelegram

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rich.live import Live
    from rich.table import Table

    from drivecomm.cli.sniff.naming import Meaning
    from drivecomm.link import ReplyTimes, Statistics
    from drivecomm.protocol import Message
    from drivecomm.traffic.sniffer import LineEvent

_MOST_TEXTS = 512
_texts: dict[int, tuple[Message, str]] = {}
_json_text = json.JSONEncoder(default=plain).encode


def say_event(event: LineEvent, meaning: Meaning) -> None:
    """Print an event as a line: time, direction, drive, content, parameter, remarks."""
    _, arrow, content = _described(event)
    line = f"{event.line}  " if event.line else ""
    parts = (f"{event.drive:<14}", content, _about(meaning))
    # No flush here: the reader of a live port flushes, and a long capture is written in blocks.
    text = line + line_text(event.time_s, arrow, *parts, remarks=_remarks(event))
    sys.stdout.write(printable(text) + "\n")


def emit_event(event: LineEvent, meaning: Meaning) -> None:
    """Print an event as one JSON object."""
    finding, pair = event.item, event.pair
    content: dict[str, Any] = {
        "line": event.line,
        "time_s": round(event.time_s, 6),
        "what": _described(event)[0],
        "drive": event.drive,
        "drive_name": event.drive,
        "data": b"" if finding is None else finding.data,
    }
    if isinstance(finding, HeardTelegram):
        content |= {"protocol": finding.protocol, "fields": fields_of(finding.message), "guarded": finding.guarded}
        content |= {"broadcast": finding.broadcast, "retries": event.retries}
    elif isinstance(finding, DamagedTelegram):
        content |= {"protocol": finding.protocol, "direction": finding.direction}
        content |= {"category": finding.error.category, "error": str(finding.error)}
    elif isinstance(finding, AmbiguousTelegram):
        content["readings"] = [
            {"protocol": protocol, "direction": direction, "fields": fields_of(message)}
            for protocol, direction, message in finding.readings
        ]
    if pair is not None:
        content |= {"outcome": pair.outcome, "retries": pair.retries}
        content["reply_time_ms"] = None if pair.reply_time_s is None else round(pair.reply_time_s * 1000, 3)
    if meaning.parameter is not None:
        content |= {"parameter": meaning.parameter.address, "name": meaning.parameter.name}
    if meaning.reading is not None:
        content |= {"value": meaning.reading.value, "unit": meaning.reading.unit, "text": meaning.reading.text}
    if meaning.refusal:
        content["refusal"] = meaning.refusal
    sys.stdout.write(_json_text(content) + "\n")


def _described(event: LineEvent) -> tuple[str, str, str]:
    """Return the kind of an event, its arrow, and its content."""
    item = event.item
    if item is None:
        asked = event.pair.request if event.pair else None
        return "unanswered", "--", f"no reply to {fields_text(asked.message)}" if asked else "no reply"
    if isinstance(item, HeardTelegram):
        return item.direction, ARROWS[item.direction], _text_of(item.message)
    shown = hex_text(item.data)
    if isinstance(item, DamagedTelegram):
        return "damaged", "!!", f"damaged {item.direction}  {shown}  [{item.error}]"
    if isinstance(item, AmbiguousTelegram):
        ways = " or ".join(sorted({f"{protocol} {direction}" for protocol, direction, _ in item.readings}))
        return "ambiguous", "??", f"{ways}  {shown}"
    return "unknown", "~~", f"unknown  {shown}"


def _text_of(message: Message) -> str:
    """Return the text of a message, cached because many telegrams repeat."""
    known = _texts.get(id(message))
    if known is None:
        if len(_texts) >= _MOST_TEXTS:
            _texts.clear()
        # The cached message keeps its id from being reused.
        known = _texts[id(message)] = message, fields_text(message)
    return known[1]


def _about(meaning: Meaning) -> str:
    if meaning.parameter is None:
        return ""
    name = f"{meaning.parameter.address} {meaning.parameter.name}".rstrip()
    if meaning.refusal:
        return f"{name}: {meaning.refusal}"
    return name if meaning.reading is None else f"{name} = {meaning.reading}"


def _remarks(event: LineEvent) -> list[str]:
    found = []
    if event.retries:
        found.append(f"retry {event.retries}")
    pair = event.pair
    if pair is None or event.item is None:
        return found
    if pair.reply_time_s is not None:
        found.append(f"{pair.reply_time_s * 1000:.1f} ms")
    if pair.outcome == "late":
        found.append("late")
    elif pair.outcome == "stray":
        found.append("unsolicited")
    return found


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
    """Table that is redrawn as events arrive, on a terminal only."""

    counted: Callable[[], Mapping[str, Mapping[str, Statistics]]]
    _last: dict[tuple[str, str], str] = field(default_factory=dict)
    _live: Live | None = None

    def start(self) -> None:
        """Start drawing."""
        from rich.live import Live

        if sys.stdout.isatty():
            self._live = Live(
                get_renderable=lambda: drawn(self.counted(), self._last), refresh_per_second=_PER_SECOND, screen=False
            )
            self._live.start()

    def show(self, event: LineEvent, meaning: Meaning) -> None:
        """Store the last value of each drive."""
        if meaning.parameter is not None and meaning.reading is not None:
            self._last[event.line, event.drive] = f"{meaning.parameter.name} = {meaning.reading}"

    def stop(self) -> None:
        """Draw the final table."""
        if self._live is not None:
            self._live.stop()
            self._live = None
        else:
            print_table(drawn(self.counted(), self._last), _NOT_A_TERMINAL)


def print_summary(counted: Mapping[str, Mapping[str, Statistics]]) -> None:
    """Print the statistics of each drive, after an empty line."""
    say()
    print_table(drawn(counted, {}), _NOT_A_TERMINAL)


def emit_summary(counted: Mapping[str, Mapping[str, Statistics]]) -> None:
    """Print the statistics as one JSON object for each drive, and one for the line."""
    for line, drives in counted.items():
        for drive, each in sorted(drives.items()):
            times = each.reply_times
            emit(
                what="statistics",
                line=line,
                drive=drive,
                drive_name=drive,
                counters=dict(each.counters),
                reply_times={"count": times.count, **times_ms(times, (95,))} if times.count else None,
            )


def drawn(counted: Mapping[str, Mapping[str, Statistics]], last: Mapping[tuple[str, str], str]) -> Table:
    """Return the table of statistics. last: last value of each drive."""
    from rich import box
    from rich.table import Table

    narrow = {"box": box.SIMPLE_HEAD, "padding": (0, 1, 0, 0), "show_edge": False, "pad_edge": False}
    table = Table(**narrow if sys.stdout.isatty() else {"box": box.ASCII2})
    table.add_column("drive", no_wrap=True)
    # A terminal has 80 columns, and the last values need the space.
    times = dict(list(_TIMES.items())[: 1 if last else None])
    for head in (*_COUNTED, *times):
        table.add_column(head, justify="right", no_wrap=True)
    rows = [(line, drive, drives[drive]) for line, drives in counted.items() for drive in sorted(drives, key=_order)]
    errors = [_errors_of(each) for _, _, each in rows]
    told = [("errors", any(errors)), ("last value", bool(last))]
    for head in (head for head, is_told in told if is_told):
        table.add_column(head)
    for (line, drive, each), wrong in zip(rows, errors, strict=True):
        texts = (wrong, printable(last.get((line, drive), "")))
        table.add_row(
            f"{line} {drive}".strip(),
            *(str(each.counters[name]) for name in _COUNTED),
            *(_milliseconds(each.reply_times, how) for how in times.values()),
            *(text for text, (_, is_told) in zip(texts, told, strict=True) if is_told),
        )
    return table


def _order(drive: str) -> tuple[bool, str, int, str]:
    """Return the sort key of a drive: protocol, then address; entries without a drive come last."""
    protocol, _, address = drive.partition(":")
    return drive == LINE, protocol, int(address) if address.isdigit() else -1, address


def _milliseconds(times: ReplyTimes, how: Callable[[ReplyTimes], float]) -> str:
    return f"{how(times) * 1000:.1f}" if times.count else ""


def _errors_of(each: Statistics) -> str:
    """Return the errors of a drive in words, because a table of zeros would hide them."""
    counts = [(each.counters[name], *words) for name, words in _COUNTED_ERRORS.items()]
    counts.append((sum(each.counters[name] for name in _ERRORS), "error", "errors"))
    counts.append((each.counters["noise bytes"], "noise byte", "noise bytes"))
    return ", ".join(f"{count} {one if count == 1 else many}" for count, one, many in counts if count)
