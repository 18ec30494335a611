"""The register map of a door for PLC programmers, as Markdown to read and CSV to import."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

from drivecomm.plant import notes_of_polls
from drivecomm.server.modbus_tcp.layout import STATE_BITS, command_rows, fixed_rows, value_rows
from drivecomm.server.modbus_tcp.outcomes import Outcome, Reason
from drivecomm.server.modbus_tcp.words import Quality

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from drivecomm.plant import Plant
    from drivecomm.server.modbus_tcp.door import ModbusTcpDoor
    from drivecomm.server.modbus_tcp.layout import OwnRegister, RegisterRow
    from drivecomm.server.modbus_tcp.settings import DoorSettings

_INPUT, _HOLDING = 30001, 40001
"""Conventional numbers of the registers at address 0."""

_QUALITIES = {
    Quality.BAD: "the drive does not provide it, or reports that it does not exist",
    Quality.UNAVAILABLE: "not polled, or the register cannot hold it, such as a text",
    Quality.STALE: "too old, or the drive has fallen silent",
    Quality.WAITING: "polled, and not there yet",
    Quality.UNCERTAIN: "current, but something speaks against it, such as another master on the line",
    Quality.GOOD: "current",
}
_OUTCOMES = {
    Outcome.NOTHING: "no request yet",
    Outcome.UNDER_WAY: "under way",
    Outcome.DONE: "done: the drive has confirmed it",
    Outcome.REFUSED: "refused: nothing was sent",
    Outcome.FAILED: "failed: the drive refused",
    Outcome.OPEN: "open: sent, and not known whether the drive acted",
}
_REASONS = {
    Reason.NONE: "none",
    Reason.NO_COMMAND: "the sequence changed, and there is no command, or no reference to send",
    Reason.STOP_IS_ON: "the stop register holds a stop",
    Reason.NO_LEASE: "the heartbeat does not count, has not counted yet, or another commander holds the lease",
    Reason.BUSY: "another command was under way",
    Reason.NOT_ALLOWED: "network of the drive does not allow it to this door",
    Reason.READ_ONLY: "the drive is not armed",
    Reason.VALUE: "the drive cannot take this value",
    Reason.CANNOT: "the drive cannot do it, or not now",
    Reason.DRIVE_REFUSES: "the drive refused",
    Reason.NO_REPLY: "the drive did not answer",
    Reason.NO_LINE: "the line is not open",
    Reason.CANCELLED: "a stop came after it",
    Reason.MISTAKE: "an internal error of the server; see its log",
}


def registers_as_markdown(doors: Sequence[ModbusTcpDoor], plant: Plant) -> str:
    """Return the register map of these doors as Markdown."""
    notes = notes_of_polls(plant)
    return "\n".join(line for door in doors for line in _markdown(door, plant, notes)).rstrip()


def _markdown(door: ModbusTcpDoor, plant: Plant, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    settings = door.settings
    titles = {drive.name: drive.title for drive in plant.drives}
    yield f"# Registers of {door.name}"
    yield ""
    yield from _table(
        ("unit", "drive", "what it is"), ((unit, name, titles[name]) for unit, name in settings.units.items())
    )
    yield "Each is read by function 04, and the same by 03; numbers of two registers have the higher word first."
    yield "Behind a value of two registers comes its quality, and then its age in 0.1 s, 65535 without a value."
    yield ""
    yield "## Every unit"
    yield ""
    yield from _rows(fixed_rows())
    for name, own in settings.registers.items():
        yield f"## Further values of {name}"
        yield ""
        yield from _rows(_own_rows(own))
    if settings.commands_from:
        yield f"## Commands, from {', '.join(map(str, settings.commands_from))}"
        yield ""
        yield from _rows(command_rows())
        yield from _numbers("outcome", _OUTCOMES)
        yield from _numbers("reason", _REASONS)
    yield from _numbers("quality", _QUALITIES)
    told = [(drive, name, note) for (drive, name), note in notes.items() if drive in settings.units.values()]
    if told:
        yield "Good quality does not show how certain the drive's model is of type and unit:"
        yield ""
        yield from _table(("drive", "value", "how sure"), told)
    yield from _table(("bit of the state", "meaning"), enumerate(STATE_BITS))


def _rows(rows: Iterable[RegisterRow]) -> Iterator[str]:
    yield from _table(
        ("address", "input", "holding", "type", "name", "unit", "what it is"),
        (
            (
                row.address,
                "" if row.written else _INPUT + row.address,
                _HOLDING + row.address,
                row.type,
                row.name,
                row.unit,
                row.meaning,
            )
            for row in rows
            if not row.about
        ),
    )


def _numbers(title: str, meanings: dict[Quality, str] | dict[Outcome, str] | dict[Reason, str]) -> Iterator[str]:
    yield from _table((title, "meaning"), ((int(number), text) for number, text in meanings.items()))


def _table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> Iterator[str]:
    yield f"| {' | '.join(titles)} |"
    yield f"|{'---|' * len(titles)}"
    for row in rows:
        yield f"| {' | '.join(str(cell).replace('|', '&#124;') for cell in row)} |"
    yield ""


def registers_content(doors: Sequence[ModbusTcpDoor], plant: Plant) -> Iterator[dict[str, str | int | None]]:
    """Yield one mapping per value of each unit of these doors, for programs."""
    notes = notes_of_polls(plant)
    for door in doors:
        for unit, drive in door.settings.units.items():
            for row in _all_rows(door.settings, drive):
                yield {
                    "door": door.name,
                    "unit": unit,
                    "drive": drive,
                    "address": row.address,
                    "input": None if row.written else _INPUT + row.address,
                    "holding": _HOLDING + row.address,
                    "registers": row.words,
                    "type": row.type,
                    "name": row.name,
                    "measured_in": row.unit,
                    "access": "read, write" if row.written else "read",
                    "meaning": row.meaning,
                    "note": notes.get((drive, row.name), ""),
                }


def registers_as_csv(doors: Sequence[ModbusTcpDoor], plant: Plant) -> str:
    """Return the register map as CSV: one line per value below a header line."""
    text = io.StringIO()
    rows = list(registers_content(doors, plant))
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _all_rows(settings: DoorSettings, drive: str) -> Iterator[RegisterRow]:
    yield from fixed_rows()
    yield from _own_rows(settings.registers.get(drive, ()))
    if settings.commands_from:
        yield from command_rows()


def _own_rows(own: Iterable[OwnRegister]) -> Iterator[RegisterRow]:
    for register in own:
        yield from value_rows(register.address, register.name, register.type)
