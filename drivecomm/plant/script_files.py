"""Tables [[fault]] of plant files; `drivecomm.plant.files` shows examples."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.errors import DriveCommError, FileFormatError, UsageError, shortened
from drivecomm.plant.line_faults import LineFault
from drivecomm.plant.script import (
    FaultWindow,
    InjectStep,
    PowerCutStep,
    ScriptStep,
    StuckStep,
    TelegramFault,
    TripCondition,
    TripStep,
    kind_named,
)
from drivecomm.tomlfile import CHOICE, NUMBER, SECONDS, TABLE, TEXT, WHOLE, Kind, TomlTable, parse_toml

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

_VALUE = Kind((int, float, str), "a number as it is read, or its raw text in quotes")
_WINDOW = {"from_s": SECONDS, "until_s": SECONDS}
_TELEGRAMS = {
    "line": TEXT,
    "drive": TEXT,
    "kind": TEXT,
    "of": TEXT,
    "to": TABLE,
    "every": WHOLE,
    "rate": NUMBER,
    "seed": WHOLE,
    "delay_s": SECONDS,
    **_WINDOW,
}
_POWER = {"off_at_s": SECONDS, "back_at_s": SECONDS, "factory": CHOICE}
_TRIP = {"code": WHOLE, "at_s": SECONDS, "when": TABLE}
_WHEN = {"parameter": TEXT, "above": NUMBER, "below": NUMBER, "for_s": SECONDS}
_STUCK = {"parameter": TEXT, "value": _VALUE, **_WINDOW}
_INJECT = {"data": TEXT, "at_s": SECONDS}


Faults: TypeAlias = "str | Mapping[str, Any] | ScriptStep | Iterable[str | Mapping[str, Any] | ScriptStep]"
"""Faults of one line: each as a text, as a table with the keys of a [[fault]], or as a step."""


def read_fault(text: str) -> ScriptStep:
    """Read a fault from the body of a [[fault]], or from one line with commas. Raises FileFormatError."""
    return fault_of(TomlTable(_content(text), "the fault"))


def script_of(faults: Faults, *, line: str, drives: Sequence[str], seed: int = 0) -> tuple[ScriptStep, ...]:
    """Return the faults of a line as a script.

    A fault that names neither line nor drive is for this line, or for its drive if it has only one. A random fault
    without a seed gets this seed. Raises FileFormatError, and UsageError for an invalid fault.
    """
    several = [faults] if isinstance(faults, str | Mapping | ScriptStep) else list(faults)
    return tuple(_step_of(each, line, drives, seed) for each in several)


def _step_of(fault: object, line: str, drives: Sequence[str], seed: int) -> ScriptStep:
    if isinstance(fault, ScriptStep):
        return fault
    if not isinstance(fault, str | Mapping):
        raise UsageError(f'{shortened(fault)} is not a fault; write a table such as {{"kind": "drop", "every": 3}}')
    table = dict(_content(fault) if isinstance(fault, str) else fault)
    if isinstance(table.get("kind"), LineFault):
        table["kind"] = table["kind"].value
    if not table.keys() & {"line", "drive"}:
        if not table.keys() & {"power", "trip", "stuck"}:
            table["line"] = line
        elif len(drives) == 1:
            table["drive"] = drives[0]
    if "rate" in table:
        table.setdefault("seed", seed)
    return fault_of(TomlTable(table, "the fault"))


def _content(text: str) -> dict[str, Any]:
    refusal = "the text cannot be read as a fault"
    try:
        return parse_toml(text, refusal)
    except FileFormatError as error:
        try:
            inline = parse_toml(f"fault = {{ {text} }}", refusal)
        except FileFormatError:
            raise error from None
        content: dict[str, Any] = inline["fault"]
        return content


def fault_of(table: TomlTable) -> ScriptStep:
    """Return the step that a [[fault]] describes. Raises FileFormatError."""
    ways = {"kind": _telegram_fault, "power": _power, "trip": _trip, "stuck": _stuck, "inject": _inject}
    named = [way for way in ways if way in table.content]
    if len(named) != 1:
        raise table.error(f"a fault is one of {', '.join(ways)}; write one of them")
    with errors_in(table):
        return ways[named[0]](table)


@contextmanager
def errors_in(table: TomlTable) -> Iterator[None]:
    """Add this table, its file and its line to errors raised in the block."""
    try:
        yield
    except FileFormatError:
        raise
    except DriveCommError as error:
        raise table.error(str(error)) from error


def bytes_of(text: str) -> bytes:
    """Convert a text of hexadecimal digits to bytes. Raises UsageError."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise UsageError(f'invalid bytes {text!r}; write two hexadecimal digits for each, such as "04 41 FF"') from None


def _telegram_fault(table: TomlTable) -> ScriptStep:
    given = table.take(_TELEGRAMS)
    window = _window(given)
    return TelegramFault(**{**given, "kind": kind_named(given["kind"])}, window=window)


def _power(table: TomlTable) -> ScriptStep:
    drive, inner = _inner(table, "drive", "power")
    return PowerCutStep(drive=drive, **inner.take(_POWER, "off_at_s"))


def _trip(table: TomlTable) -> ScriptStep:
    drive, inner = _inner(table, "drive", "trip")
    given = inner.take(_TRIP, "code")
    if "when" in given:
        given["when"] = TripCondition(**inner.table("when").take(_WHEN, "parameter"))
    return TripStep(drive=drive, **given)


def _stuck(table: TomlTable) -> ScriptStep:
    drive, inner = _inner(table, "drive", "stuck")
    given = inner.take(_STUCK, "parameter", "value")
    window = _window(given)
    return StuckStep(drive=drive, **given, window=window)


def _inject(table: TomlTable) -> ScriptStep:
    line, inner = _inner(table, "line", "inject")
    given = inner.take(_INJECT, "data", "at_s")
    return InjectStep(line=line, data=bytes_of(given["data"]), at_s=given["at_s"])


def _inner(table: TomlTable, whose: str, key: str) -> tuple[Any, TomlTable]:
    """Return the line or drive of a fault, and the table below its key; no other key is allowed."""
    return table.take({whose: TEXT, key: TABLE}, whose)[whose], table.table(key)


def _window(given: dict[str, Any]) -> FaultWindow:
    """Remove the times of a window from the given keys and return the window."""
    return FaultWindow(**{key: float(given.pop(key)) for key in _WINDOW if key in given})
