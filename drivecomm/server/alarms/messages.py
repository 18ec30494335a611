"""Alarm messages for receivers, in words and as JSON: a message holds an entry for each of its alarms."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from drivecomm.errors import printable
from drivecomm.server.alarms.receivers import WITHIN_S, receivers_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.server.alarms.alarm import AlarmTransition
    from drivecomm.server.alarms.rules import AlarmRule


def message_of(plant: str, entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the message with these entries, as receivers get it."""
    first = entries[0]
    about = first["title"] if len(entries) == 1 else f"{len(entries)} alarms"
    return {
        "plant": plant,
        "title": f"{plant}: {about}",
        "text": "\n".join(each["text"] for each in entries),
        "alarms": [dict(each) for each in entries],
    }


def entry_of(transition: AlarmTransition) -> dict[str, Any]:
    """Return the message entry of a transition, as receivers get it."""
    alarm = transition.alarm
    title = f"{alarm.rule}: {alarm.drive}" + {"reminded": " (reminder)", "over": " (over)"}.get(transition.what, "")
    since = "" if transition.what == "over" else f", since {_clock(alarm.since_s)}"
    return {
        "message": f"{alarm.id}.{alarm.told}",
        "what": transition.what,
        "id": alarm.id,
        "rule": alarm.rule,
        "drive": alarm.drive,
        "title": title,
        "text": printable(f"{alarm.drive}: {transition.text}{since}"),
        "since": _utc(alarm.since_s),
        "time": _utc(transition.time_s),
        "times": alarm.times,
        "acknowledged_by": alarm.acknowledged_by,
    }


def try_out(rule: AlarmRule, plant: str, environment: Mapping[str, str]) -> dict[str, str]:
    """Deliver a test message to the receivers of a rule; return their reasons for failure, "" on success, by label."""
    message = message_of(plant, [_test_entry(rule)])
    receivers = receivers_of(rule.deliver, environment).values()
    return {each.label: each.problem() or each.deliver(message, WITHIN_S) for each in receivers}


def _test_entry(rule: AlarmRule) -> dict[str, Any]:
    now = time.time()
    text = f"This is a test of {rule.name}; there is no alarm."
    return {
        "message": f"test-{now:.0f}", "what": "test", "id": f"test-{now:.0f}", "rule": rule.name, "drive": "",
        "title": f"{rule.name} (test)", "text": text, "since": _utc(now), "time": _utc(now), "times": 0,
        "acknowledged_by": "",
    }  # fmt: skip


def _utc(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _clock(time_s: float) -> str:
    return datetime.fromtimestamp(time_s).astimezone().isoformat(" ", timespec="seconds")
