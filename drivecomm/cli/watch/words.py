"""Texts of the watch screen, whose colours only repeat their meaning, and the reasons for refused commands."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Literal

from rich.text import Text

from drivecomm.errors import printable
from drivecomm.models import quantities
from drivecomm.plant.watching import state_words

if TYPE_CHECKING:
    from drivecomm.plant.watching import Board, DriveEvent, DriveView, WatchedValue
    from drivecomm.protocol import DriveConfig

FAULT, WARNING, DEAD, RUNNING, ASIDE = "bold red", "yellow", "dim", "green", "dim"

_SHORT = {
    "output_frequency": "freq",
    "output_current": "curr",
    "output_voltage": "volt",
    "output_power": "power",
    "dc_link_voltage": "DC",
    "motor_speed": "speed",
    "torque_percent": "torque",
    "heat_sink_temperature": "temp",
    "inside_temperature": "inside",
    "reference_frequency": "ref",
    "reference_percent": "ref",
    "motor_thermal_load": "motor",
    "drive_thermal_load": "drive",
}
_UNITS = {"degC": "°C"}
_EVENT_STYLES = {"fault": FAULT, "silent": WARNING, "warning": WARNING, "change": "", "command": "bold"}


def unit_of(unit: str) -> str:
    """Return the display form of a unit."""
    return _UNITS.get(unit, unit)


def head_of(name: str) -> str:
    """Return a common name as the head of a narrow column, with its unit."""
    return f"{_SHORT.get(name, name.replace('_', ' '))} {unit_of(quantities()[name].unit)}".rstrip()


def state_of(view: DriveView) -> Text:
    """Return the state of a drive in at most nine characters."""
    if view.reachability == "silent":
        return Text("no answer", style=WARNING)
    if view.reachability == "asking" or view.status is None:
        return Text("asking", style=ASIDE)
    if view.fault:
        return Text("FAULT", style=FAULT)
    words = state_words(view.status)
    if view.status.running:
        return Text("backwards" if words.endswith("backwards") else "running", style=RUNNING)
    return Text(words)


def note_of(view: DriveView) -> Text:
    """Return the most important remark on a drive besides its state."""
    if view.reachability == "silent" and view.age_s is not None:
        return Text(f"silent for {view.age_s:.0f} s", style=WARNING)
    if view.reachability == "silent" or view.error:
        return Text(printable(view.error), style=WARNING)
    if view.fault:
        return Text(printable(view.fault), style=FAULT)
    status = view.status
    if status is None:
        return Text()
    if status.warning:
        return Text("warning", style=WARNING)
    remote = Text("local", style=ASIDE) if status.remote is False else Text()
    return Text("at reference", style=ASIDE) if status.running and status.at_reference else remote


def value_of(view: DriveView, name: str) -> Text:
    """Return a value without its unit: followed by ? if it is old, - if there is none."""
    value = view.values.get(name)
    if value is None:
        return Text("")
    if value.reading is None:
        return Text("-", style=DEAD)
    if not _is_now(view, value):
        return Text(printable(f"{value.reading.value}?"), style=DEAD)
    return Text(printable(str(value.reading.value)))


def at_machine(view: DriveView, name: str) -> Text:
    """Return a frequency in machine units; empty for any other value, and for an old one."""
    value = view.values.get(name)
    if view.drive.machine is None or value is None or value.reading is None or not _is_now(view, value):
        return Text("")
    beside = view.drive.machine.beside(value.reading)
    return Text("" if beside is None else printable(str(beside)))


def _is_now(view: DriveView, value: WatchedValue) -> bool:
    return value.quality != "stale" and view.reachability != "silent"


def in_full(value: WatchedValue) -> Text:
    """Return a value with its unit and remarks."""
    if value.reading is None:
        return Text(printable(value.cause), style=WARNING)
    text = Text(printable(f"{value.reading.value} {unit_of(value.reading.unit)}".rstrip()))
    if value.quality == "stale":
        text.append(printable(f"  old: {value.cause}"), style=WARNING)
    return text


def event_line(event: DriveEvent, began_s: float | None) -> Text:
    """Return an event on one line with its time of day; in virtual time with the time since the beginning."""
    text = Text(no_wrap=True, overflow="ellipsis")
    at = clock(event.time_s) if began_s is None else time_of_day(began_s + event.time_s)
    text.append(f"{at}  ", style=ASIDE).append(printable(event.drive), style="bold")
    return text.append(printable(f"  {event.text}"), style=_EVENT_STYLES[event.kind])


def summary_of(board: Board) -> Text:
    """Return the number of drives, of faults and of silent drives, as text."""
    text = Text(f"{len(board.drives)} drive{'' if len(board.drives) == 1 else 's'}")
    if board.faults:
        text.append(", ").append(f"{board.faults} fault{'' if board.faults == 1 else 's'}", style=FAULT)
    if board.silent:
        text.append(", ").append(f"{board.silent} silent", style=WARNING)
    return text


def counters_of(view: DriveView) -> Text:
    """Return the counters of a drive: the main ones always, the others if they are not zero."""
    always = ("requests", "replies", "timeouts", "damaged")
    counted = [f"{view.counters.get(name, 0)} {name}" for name in always]
    counted += [f"{number} {name}" for name, number in view.counters.items() if name not in always and number]
    reply = f"; {1000 * view.reply_s:.1f} ms a reply" if view.reply_s else ""
    return Text(", ".join(counted) + reply, style=ASIDE)


def time_of_day(seconds: float) -> str:
    """Return a time in seconds since 1970 as local time of day."""
    return datetime.fromtimestamp(seconds).astimezone().strftime("%H:%M:%S")


def clock(seconds: float) -> str:
    """Return a time since the beginning as hours, minutes and seconds."""
    whole = int(seconds)
    return f"{whole // 3600:02}:{whole // 60 % 60:02}:{whole % 60:02}"


HOLD: Literal["hold"] = "hold"
"""Policy that needs no running program: the motor keeps running."""


def why_not(verb: Literal["start", "reset"], drive: DriveConfig, *, armed: bool) -> str:
    """Return why this drive must not be started or reset, empty if it may. armed: whether --arm was given."""
    if not armed:
        return f"{drive.name} is not commanded: watch was started without --arm"
    if not drive.armed:
        return f"{drive.name} is read-only: write armed = true for it in the plant file"
    if verb == "start" and drive.link_loss is None:
        return f"{drive.name} is not started: the plant file has no link_loss, its behaviour without a master"
    if verb == "start" and drive.link_loss is not None and drive.link_loss.policy != HOLD:
        # Other policies need a program that sets the drive's watchdog and stays; a screen may be closed at any moment.
        way = f"drivecomm start {drive.name} --link-loss {drive.link_loss.policy}"
        return f"{drive.name} is not started from here: use {way}, which keeps running beside it"
    return ""
