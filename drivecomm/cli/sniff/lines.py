"""What was heard as lines for people, and as objects for scripts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.cli.output import emit, say
from drivecomm.link import ARROWS, fields_text, hex_text, line_text
from drivecomm.protocol import fields_of
from drivecomm.traffic.sniffer import AmbiguousTelegram, DamagedTelegram, HeardTelegram

if TYPE_CHECKING:
    from drivecomm.cli.sniff.naming import Meaning
    from drivecomm.traffic.sniffer import LineEvent


def say_event(event: LineEvent, meaning: Meaning) -> None:
    """Print an event for people: time, direction, drive, content, what is known of the parameter, remarks."""
    arrow, content = _content(event)
    line = f"{event.line}  " if event.line else ""
    parts = (f"{event.drive:<14}", content, _about(meaning))
    say(line + line_text(event.time_s, arrow, *parts, remarks=_remarks(event)))


def emit_event(event: LineEvent, meaning: Meaning) -> None:
    """Print an event as one JSON object."""
    finding, pair = event.item, event.pair
    content: dict[str, Any] = {
        "line": event.line,
        "time_s": round(event.time_s, 6),
        "what": _what(event),
        "drive": event.drive,
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
    emit(**content, **_named(meaning))


def _named(meaning: Meaning) -> dict[str, Any]:
    named: dict[str, Any] = {}
    if meaning.parameter is not None:
        named |= {"parameter": meaning.parameter.address, "name": meaning.parameter.name}
    if meaning.reading is not None:
        named |= {"value": meaning.reading.value, "unit": meaning.reading.unit, "text": meaning.reading.text}
    if meaning.refusal:
        named["refusal"] = meaning.refusal
    return named


def _what(event: LineEvent) -> str:
    finding = event.item
    if finding is None:
        return "unanswered"
    if isinstance(finding, HeardTelegram):
        return finding.direction
    if isinstance(finding, DamagedTelegram):
        return "damaged"
    return "ambiguous" if isinstance(finding, AmbiguousTelegram) else "unknown"


def _content(event: LineEvent) -> tuple[str, str]:
    finding = event.item
    if finding is None:
        asked = event.pair.request if event.pair else None
        return "--", f"no reply to {fields_text(asked.message)}" if asked else "no reply"
    shown = hex_text(finding.data)
    if isinstance(finding, HeardTelegram):
        return ARROWS[finding.direction], fields_text(finding.message)
    if isinstance(finding, DamagedTelegram):
        return "!!", f"damaged {finding.direction}  {shown}  [{finding.error}]"
    if isinstance(finding, AmbiguousTelegram):
        ways = " or ".join(sorted({f"{protocol} {direction}" for protocol, direction, _ in finding.readings}))
        return "??", f"{ways}  {shown}"
    return "~~", f"unknown  {shown}"


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
        found.append("not asked for")
    return found
