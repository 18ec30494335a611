"""The read-only orders of the control socket: telegrams, violations, counters and states of a running plant."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.virtual.line_trace import LineTrace
    from drivecomm.virtual.plant_drive import PlantDrive
    from drivecomm.virtual.virtual_plant import VirtualPlant

MOST_AT_ONCE = 500
"""Largest number of telegrams in one answer; the next order continues after them."""


def telegrams(plant: VirtualPlant, line: str, since: int) -> Mapping[str, Any]:
    """Return the telegrams of a line after the one with this number, and the number for the next order.

    more: whether later ones exist already. missing: number of transmissions that are no longer stored.
    """
    trace = _trace(plant, line)
    found = trace.since(since, ended_by=_line_time(plant, line))
    shown = found[:MOST_AT_ONCE]
    if len(found) > MOST_AT_ONCE:
        # The lines of one transmission share its number and stay together.
        shown = [each for each in shown if each.number < found[MOST_AT_ONCE].number] or shown
    return {
        "telegrams": [each.as_object() for each in shown],
        "last": shown[-1].number if shown else since,
        "more": len(shown) < len(found),
        "missing": max(0, trace.first_kept - 1 - since),
    }


def violations(plant: VirtualPlant, line: str) -> Mapping[str, Any]:
    """Return the violations by the master of a line: the last 1000, and the number of them for each rule."""
    log = _trace(plant, line).violations
    shown = [{**asdict(each), "sentence": str(each)} for each in log.found]
    return {"violations": shown, "failures": log.failures, "notes": log.notes}


def counters(plant: VirtualPlant) -> Mapping[str, Any]:
    """Return all counters of each line and each drive."""
    return {
        "lines": [_line_counters(plant, name) for name in plant.lines],
        "drives": [
            {
                "name": drive.name,
                "requests": drive.requests.total(),
                "kinds": dict(drive.requests),
                "replies": drive.replies,
                "damaged": drive.damaged,
            }
            for drive in plant.drives.values()
        ],
    }


def _line_counters(plant: VirtualPlant, name: str) -> dict[str, Any]:
    line, trace = plant.lines[name], _trace(plant, name)
    return {
        "name": name,
        "time_s": round(line.time, 3),
        "transmissions": trace.counts,
        "failures": trace.violations.failures,
        "notes": trace.violations.notes,
        "faults": {kind.value: number for kind, number in line.faults.happened.items()},
        "script": [str(each) for each in plant.disturbances if each in line.disturbances],
    }


def states(plant: VirtualPlant) -> Mapping[str, Any]:
    """Return the present state of each line and each drive."""
    known = [(state, plant.drive(state.name)) for state in plant.states()]
    return {
        "speed": plant.speed,
        "lines": [{"name": name, "time_s": round(line.time, 3)} for name, line in plant.lines.items()],
        "drives": [{**state._asdict(), **dict(_more(drive))} for state, drive in known],
    }


def _more(drive: PlantDrive) -> Iterator[tuple[str, Any]]:
    motor = drive.motor
    yield "address", drive.address
    yield "settings", str(drive.settings)
    yield "at_reference", motor.at_reference
    yield "target_hz", round(motor.target_hz, 2)
    yield "current_a", round(motor.current_a, 2)


def _line_time(plant: VirtualPlant, line: str) -> float:
    return plant.lines[line].time if line else next(iter(plant.lines.values())).time


def _trace(plant: VirtualPlant, line: str) -> LineTrace:
    traces = plant.watch()
    if not line and len(traces) > 1:
        raise UsageError(f"this plant has several lines; name one of {', '.join(traces)}")
    return traces[plant.plant.line(line or next(iter(traces))).name]
