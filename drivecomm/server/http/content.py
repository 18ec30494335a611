"""API content for plants, drives, values and leases, as plain data or JSON."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from drivecomm.client import error_content, json_text, plain
from drivecomm.errors import UsageError
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.plant import Plant
    from drivecomm.server import Caller, CommandAnswer, CurrentValue, DriveSnapshot, Lease, ServedPlant, StandingStop

SLICE_S = 0.001
"""Seconds of writing before the event loop gets a turn."""


def plant_content(plant: ServedPlant, caller: Caller) -> dict[str, Any]:
    """Return the data of the plant as a whole and of the caller."""
    return {
        "name": plant.name,
        "file": plant.plant.file,
        "session": plant.session,
        "version": __version__,
        "started_s": plant.started_s,
        "time_s": time.time(),
        "you": {"name": caller.name, "role": caller.role.name.lower(), "door": caller.door},
        "lines": plain(plant.lines()),
        "drives": [drive.name for drive in plant.plant.drives],
        "alarms": len(plant.alarms()),
    }


def drive_text(plant: ServedPlant, drive: DriveSnapshot, values: Iterable[CurrentValue], caller: Caller) -> str:
    """Return the JSON of a drive and its values."""
    now = time.time()
    config = drive.config
    content = {
        **config.labels,
        "line": drive.line,
        "title": config.title,
        "groups": _groups(plant.plant, drive.name),
        "model": str(config.options.get("model") or ""),
        "armed": config.armed,
        "read_only_reason": config.read_only_reason,
        "link_loss": plain(config.link_loss),
        "policies": list(drive.policies),
        "monitoring_only": drive.monitoring_only,
        "may": list(plant.may(caller, drive.name)),
        "reachability": drive.reachability,
        "state": None if drive.status is None else drive.status.state.value,
        "status": plain(drive.status),
        **_machine_content(drive),
        "fault": drive.fault,
        "late": drive.late,
        "fault_log": plain(drive.fault_log),
        "error": drive.error,
        "answered_s": drive.answered_s,
        "age_s": None if drive.answered_s is None else _age_s(now, drive.answered_s),
        "lease": None if drive.lease is None else lease_content(drive.lease, caller),
        "kept": drive.kept,
        "standing_stop": _stop_content(drive.standing_stop),
        "drift": {name: getattr(drive.drift, name) for name in ("state", "changed", "since_s", "compared_s")},
        "counters": dict(drive.counters),
        "reply_s": drive.reply_s,
    }
    inside = ",".join(aged(value_head(value), value, now) for value in values)
    return f'{json_text(content)[:-1]},"values":[{inside}]}}'


def _machine_content(drive: DriveSnapshot) -> dict[str, Any]:
    machine, status = drive.config.machine, drive.status
    hz = None if status is None else status.actual_hz
    actual = None if machine is None or hz is None else machine.shown(hz).value
    return {"machine_unit": "" if machine is None else machine.unit, "actual_machine": actual}


def _groups(plant: Plant, drive: str) -> list[str]:
    # A drive is not replaced when only its groups change, so its own configuration may be that of an earlier file.
    with suppress(UsageError):
        return list(plant.drive(drive).groups)
    return []


def _stop_content(stop: StandingStop | None) -> Mapping[str, Any] | None:
    return None if stop is None else {**plain(stop), "text": str(stop)}


def drift_content(drive: DriveSnapshot) -> dict[str, Any]:
    """Return the drift of a drive."""
    drift = drive.drift
    said = {"drive": drive.name, "text": str(drift), "changed": drift.changed, "since_s": drift.since_s}
    return {**said, **plain(drift)}


def value_head(value: CurrentValue) -> str:
    """Return the JSON of a value without its age and closing brace, both of which `aged` adds.

    The head stays the same until the value changes. It is built for each value that is read, so the parts that stay the
    same between readings are cached.
    """
    try:
        return _value_head(value)
    except ValueError as error:
        # A number that JSON cannot hold must not spoil the response for the other values.
        unsaid = f"cannot be told: {error}"
        return _value_head(replace(value, quality="bad", cause=unsaid, time_s=time.time(), reading=None))


def _value_head(value: CurrentValue) -> str:
    begin = _whose(value.drive, value.name, value.quality, value.cause)
    reading = value.reading
    if reading is None:
        return f'{begin},"time_s":{json_text(value.time_s)},"source_s":null,"reading":null'
    source = json_text(reading.time_s)
    said = _said(reading.unit, reading.type, reading.name, reading.text, reading.note, reading.doubt)
    if (machine := value.at_machine) is not None:
        begin += f',"machine_value":{json_text(machine.value)},"machine_unit":{json_text(machine.unit)}'
    return (
        f'{begin},"time_s":{json_text(value.time_s)},"source_s":{source},'
        f'"reading":{{"parameter":{json_text(reading.parameter)},'
        f'"value":{json_text(reading.value)},"raw":{json_text(reading.raw)},{said},'
        f'"time_s":{source},"quality":"{reading.quality}"}}'
    )


@lru_cache(maxsize=4096)
def _whose(drive: str, name: str, quality: str, cause: str) -> str:
    return json_text({"drive": drive, "name": name, "quality": quality, "cause": cause})[:-1]


@lru_cache(maxsize=4096)
def _said(*of_reading: str) -> str:
    return json_text(dict(zip(("unit", "type", "name", "text", "note", "doubt"), of_reading, strict=True)))[1:-1]


def aged(head: str, value: CurrentValue, now: float) -> str:
    """Return the complete JSON of a value, with its age at the time `now`."""
    source_s = value.source_s
    return f'{head},"age_s":{"null" if source_s is None else _age_s(now, source_s)}}}'


async def joined(texts: Iterable[str]) -> str:
    """Return a JSON list of these JSON texts; gives way to the event loop while joining."""
    made, until = [], time.monotonic() + SLICE_S
    for text in texts:
        made.append(text)
        if time.monotonic() > until:
            await asyncio.sleep(0)
            until = time.monotonic() + SLICE_S
    return f"[{','.join(made)}]"


def lease_content(lease: Lease, caller: Caller) -> dict[str, Any]:
    """Return the public data of a lease."""
    return {
        "drive": lease.drive,
        "holder": lease.holder.name,
        "door": lease.holder.door,
        "until_s": lease.until_s,
        "yours": (lease.holder.name, lease.holder.door) == (caller.name, caller.door),
    }


def answer_content(answer: CommandAnswer) -> dict[str, Any]:
    """Return the outcome of a command."""
    return {
        "id": answer.id,
        "outcome": answer.outcome,
        "result": plain(answer.result),
        "error": None if answer.error is None else error_content(answer.error),
    }


def _age_s(now: float, then: float) -> float:
    # A clock that was set back must not give negative ages.
    return round(max(0.0, now - then), 3)
