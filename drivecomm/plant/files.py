"""Plants as files.

A plant is a TOML file; all times are seconds of the process from the start of the plant:

format = 1

[[line]]
name = "hall"
listen = "tcp:127.0.0.1:4001"       # optional: where a master connects, pty:PATH, tcp:HOST:PORT, rfc2217:HOST:PORT
port = "/dev/ttyUSB0"               # optional: what a master opens; where the line listens unless given
echo = true                         # optional: the master hears itself
paced = false                       # optional: characters take no time; they do unless this is said
baudrate = 19200                    # optional, for all its drives: also bytesize, parity, stopbits
noise = { rate = 0.01, seed = 1, kinds = ["corrupt", "drop"] }
                                    # optional; also requests, replies (true or false), delay_s, bits

[[drive]]
name = "pump"                       # optional: PROTOCOL:ADDRESS unless given
drive = "vabus:1"                   # PROTOCOL:ADDRESS
line = "hall"                       # optional where there is one line only
title = "feed pump, hall 2"         # optional: what it is, for people
options = { model = "agile" }       # optional: what Bus.drive takes
armed = true                        # optional: may be written and commanded; read-only unless this is said
poll = [{ parameters = ["output_frequency"], period_s = 0.2, priority = 1 }]
                                    # optional: what is polled of it; each second and alike unless said
link_loss = { policy = "ramp", watchdog_s = 5 }
                                    # optional: hold, ramp, coast or trip when its master falls silent; after 5 s
values = { "480" = 1000 }           # optional: raw values that parameters hold at the start
motor = { rated_kw = 7.5 }          # optional: what differs from the usual motor

[[fault]]                           # telegrams that are lost, changed, cut, late or doubled
line = "hall"                       # or drive = "pump": replies of this drive
kind = "drop"                       # corrupt, truncate, delay (with delay_s), duplicate
of = "reply to a write"             # optional: request, reply, reply to a read, reply to a command
to = { parameter = 480 }            # optional: fields that the answered request has
every = 3                           # optional: each third; or rate = 0.1 with seed: this share; or each one
from_s = 10                         # optional
until_s = 60                        # optional

[[fault]]
drive = "pump"
power = { off_at_s = 20, back_at_s = 35, factory = true }

[[fault]]
drive = "pump"
trip = { code = 5, at_s = 40 }      # or when = { parameter = "210", above = 45, for_s = 2 }; below = 1

[[fault]]
drive = "pump"
stuck = { parameter = "210", value = 0, from_s = 5, until_s = 9 }

[[fault]]
line = "hall"
inject = { data = "04 41 FF", at_s = 3 }
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.errors import DriveCommError, FileFormatError, UsageError, closest
from drivecomm.plant.plant import (
    Condition,
    InjectStep,
    Noise,
    Plant,
    PlantDrive,
    PlantLine,
    PlantLinkLoss,
    PlantRead,
    PowerCutStep,
    Step,
    StuckStep,
    TelegramFault,
    TripStep,
    Window,
    kind_named,
)
from drivecomm.protocol import LineSettings
from drivecomm.tomlfile import parse_toml, read_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

_FORMAT = 1


class _Kind(NamedTuple):
    """What a key may hold: its types, and what to write."""

    types: tuple[type, ...]
    words: str


_TEXT = _Kind((str,), "a text in quotes")
_WHOLE = _Kind((int,), "a whole number")
_NUMBER = _Kind((int, float), "a number")
_SECONDS = _Kind((int, float), "seconds")
_CHOICE = _Kind((bool,), "true or false")
_TABLE = _Kind((dict,), "a table in braces, such as { key = value }")
_LIST = _Kind((list,), 'a list, such as ["drop", "corrupt"]')
_RAW = _Kind((int, str), "a whole number, or a text in quotes")
_VALUE = _Kind((int, float, str), "a number as it is read, or its raw text in quotes")

_Keys = dict[str, _Kind]

_SETTINGS: _Keys = {"baudrate": _WHOLE, "bytesize": _WHOLE, "parity": _TEXT, "stopbits": _NUMBER}
_LINE: _Keys = {
    "name": _TEXT,
    "listen": _TEXT,
    "port": _TEXT,
    "echo": _CHOICE,
    "paced": _CHOICE,
    **_SETTINGS,
    "noise": _TABLE,
}
_NOISE: _Keys = {
    "rate": _NUMBER,
    "seed": _WHOLE,
    "kinds": _LIST,
    "requests": _CHOICE,
    "replies": _CHOICE,
    "delay_s": _SECONDS,
    "bits": _WHOLE,
}
_DRIVE: _Keys = {
    "name": _TEXT,
    "drive": _TEXT,
    "line": _TEXT,
    "title": _TEXT,
    "options": _TABLE,
    "armed": _CHOICE,
    "poll": _LIST,
    "link_loss": _TABLE,
    "values": _TABLE,
    "motor": _TABLE,
}
_POLL: _Keys = {"parameters": _LIST, "period_s": _SECONDS, "priority": _WHOLE}
_LINK_LOSS: _Keys = {"policy": _TEXT, "watchdog_s": _SECONDS}
_WINDOW: _Keys = {"from_s": _SECONDS, "until_s": _SECONDS}
_TELEGRAMS: _Keys = {
    "line": _TEXT,
    "drive": _TEXT,
    "kind": _TEXT,
    "of": _TEXT,
    "to": _TABLE,
    "every": _WHOLE,
    "rate": _NUMBER,
    "seed": _WHOLE,
    "delay_s": _SECONDS,
    **_WINDOW,
}
_POWER: _Keys = {"off_at_s": _SECONDS, "back_at_s": _SECONDS, "factory": _CHOICE}
_TRIP: _Keys = {"code": _WHOLE, "at_s": _SECONDS, "when": _TABLE}
_WHEN: _Keys = {"parameter": _TEXT, "above": _NUMBER, "below": _NUMBER, "for_s": _SECONDS}
_STUCK: _Keys = {"parameter": _TEXT, "value": _VALUE, **_WINDOW}
_INJECT: _Keys = {"data": _TEXT, "at_s": _SECONDS}

# No number of a plant is larger, and larger ones are too much for a float.
_LARGEST = 2**63


def read_plant(path: Path) -> Plant:
    """Read a plant file. Raises FileFormatError with the file's name, the entry and what is wrong in it."""
    return plant_in(read_toml(path, "a plant").content, path)


def plant_in(content: Mapping[str, Any], path: Path) -> Plant:
    """Return the plant that a file says. Raises as `read_plant` does."""
    try:
        return _plant(content)
    except DriveCommError as error:
        raise FileFormatError(f"{path}: {error}") from error


def read_fault(text: str) -> Step:
    """Read what stands behind one [[fault]]. Raises FileFormatError."""
    content = parse_toml(text, "the text cannot be read as a fault")
    try:
        return _fault(content, "the fault")
    except FileFormatError:
        raise
    except DriveCommError as error:
        raise FileFormatError(f"the fault: {error}") from error


def _plant(content: Mapping[str, Any]) -> Plant:
    if content.get("format") != _FORMAT or type(content["format"]) is not int:
        raise FileFormatError(f"a plant begins with format = {_FORMAT}")
    _no_others(content, ("format", "line", "drive", "fault"), "the file")
    lines = _each(content, "line", _line)
    if not lines:
        raise FileFormatError("a plant has one or more [[line]]")
    only = lines[0].name if len(lines) == 1 else ""
    return Plant(
        lines=tuple(lines),
        drives=tuple(_each(content, "drive", lambda entry, where: _drive(entry, where, only))),
        script=tuple(_each(content, "fault", _fault)),
    )


def _each(content: Mapping[str, Any], key: str, read: Callable[[Mapping[str, Any], str], Any]) -> list[Any]:
    entries = content.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise FileFormatError(f"{key} is a table of its own each time; write [[{key}]]")
    made = []
    for number, entry in enumerate(entries, start=1):
        name = entry.get("name")
        where = f"{key} {number} ({name})" if isinstance(name, str) and name else f"{key} {number}"
        try:
            made.append(read(entry, where))
        except FileFormatError:
            raise
        except DriveCommError as error:
            raise FileFormatError(f"{where}: {error}") from error
    return made


def _line(entry: Mapping[str, Any], where: str) -> PlantLine:
    _check(entry, _LINE, ("name",), where)
    settings = {key: entry[key] for key in _SETTINGS if key in entry}
    LineSettings(**settings)
    noise = entry.get("noise")
    return PlantLine(
        **{key: entry[key] for key in ("name", "listen", "port", "echo", "paced") if key in entry},
        settings=settings,
        noise=None if noise is None else _noise(noise, f"{where}, noise"),
    )


def _noise(entry: Mapping[str, Any], where: str) -> Noise:
    _check(entry, _NOISE, ("rate",), where)
    given = dict(entry)
    if "kinds" in given:
        given["kinds"] = tuple(kind_named(str(name)) for name in given["kinds"])
    return Noise(**given)


def _drive(entry: Mapping[str, Any], where: str, only_line: str) -> PlantDrive:
    _check(entry, _DRIVE, ("drive",) if only_line else ("drive", "line"), where)
    protocol, colon, address = entry["drive"].partition(":")
    if not colon or not protocol or not address.isascii() or not address.isdigit():
        raise FileFormatError(f"{where}: {entry['drive']!r} names no drive; write PROTOCOL:ADDRESS, such as vabus:1")
    values, motor = entry.get("values", {}), entry.get("motor", {})
    _check(values, dict.fromkeys(values, _RAW), (), f"{where}, values")
    _check(motor, dict.fromkeys(motor, _NUMBER), (), f"{where}, motor")
    link_loss = entry.get("link_loss")
    if link_loss is not None:
        _check(link_loss, _LINK_LOSS, ("policy",), f"{where}, link_loss")
    return PlantDrive(
        protocol=protocol,
        address=int(address),
        line=entry.get("line", only_line),
        name=entry.get("name", ""),
        title=entry.get("title", ""),
        options=entry.get("options", {}),
        armed=entry.get("armed", False),
        poll=tuple(
            _read(each, f"{where}, poll {number}") for number, each in enumerate(entry.get("poll", []), start=1)
        ),
        link_loss=None if link_loss is None else PlantLinkLoss(**link_loss),
        values=values,
        motor=motor,
    )


def _read(entry: object, where: str) -> PlantRead:
    if not isinstance(entry, dict):
        raise FileFormatError(f'{where}: {entry!r} is no table; write {{ parameters = ["output_frequency"] }}')
    _check(entry, _POLL, ("parameters",), where)
    if not all(isinstance(each, str) for each in entry["parameters"]):
        raise FileFormatError(f'{where}: parameters are texts in quotes, such as ["481", "output_current"]')
    return PlantRead(**{**entry, "parameters": tuple(entry["parameters"])})


def _fault(entry: Mapping[str, Any], where: str) -> Step:
    ways: dict[str, Callable[[Mapping[str, Any], str], Step]] = {
        "kind": _telegram_fault,
        "power": _power,
        "trip": _trip,
        "stuck": _stuck,
        "inject": _inject,
    }
    named = [way for way in ways if way in entry]
    if len(named) != 1:
        raise FileFormatError(f"{where}: a fault is one of {', '.join(ways)}; write one of them")
    return ways[named[0]](entry, where)


def _telegram_fault(entry: Mapping[str, Any], where: str) -> TelegramFault:
    _check(entry, _TELEGRAMS, (), where)
    given = {key: value for key, value in entry.items() if key not in _WINDOW}
    return TelegramFault(**{**given, "kind": kind_named(entry["kind"])}, window=_window(entry))


def _power(entry: Mapping[str, Any], where: str) -> PowerCutStep:
    given = _inner(entry, "drive", "power", where)
    _check(given, _POWER, ("off_at_s",), f"{where}, power")
    return PowerCutStep(drive=entry["drive"], **given)


def _trip(entry: Mapping[str, Any], where: str) -> TripStep:
    given = _inner(entry, "drive", "trip", where)
    _check(given, _TRIP, ("code",), f"{where}, trip")
    if "when" in given:
        _check(given["when"], _WHEN, ("parameter",), f"{where}, when")
        given["when"] = Condition(**given["when"])
    return TripStep(drive=entry["drive"], **given)


def _stuck(entry: Mapping[str, Any], where: str) -> StuckStep:
    given = _inner(entry, "drive", "stuck", where)
    _check(given, _STUCK, ("parameter", "value"), f"{where}, stuck")
    return StuckStep(drive=entry["drive"], parameter=given["parameter"], value=given["value"], window=_window(given))


def _inject(entry: Mapping[str, Any], where: str) -> InjectStep:
    given = _inner(entry, "line", "inject", where)
    _check(given, _INJECT, ("data", "at_s"), f"{where}, inject")
    return InjectStep(line=entry["line"], data=bytes_of(given["data"]), at_s=given["at_s"])


def bytes_of(text: str) -> bytes:
    """Return the bytes that a text of hexadecimal digits stands for. Raises UsageError."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise UsageError(f'{text!r} are no bytes; write two hexadecimal digits for each, such as "04 41 FF"') from None


def _inner(entry: Mapping[str, Any], whose: str, key: str, where: str) -> dict[str, Any]:
    """Return the table behind the key of a fault; beside it stands only whose fault it is."""
    _check(entry, {whose: _TEXT, key: _TABLE}, (whose,), where)
    return dict(entry[key])


def _window(entry: Mapping[str, Any]) -> Window:
    return Window(**{key: float(entry[key]) for key in _WINDOW if key in entry})


def _check(entry: Mapping[str, Any], known: _Keys, needed: tuple[str, ...], where: str) -> None:
    _no_others(entry, tuple(known), where)
    for key in needed:
        if key not in entry:
            raise FileFormatError(f"{where}: the key {key!r} is missing; write {key} = {known[key].words}")
    for key, value in entry.items():
        kind = known[key]
        if not isinstance(value, kind.types) or (isinstance(value, bool) and bool not in kind.types):
            raise FileFormatError(f"{where}: {key} cannot be {value!r}; write {kind.words}")
        if isinstance(value, int) and abs(value) > _LARGEST:
            raise FileFormatError(f"{where}: {key} is too large a number")


def _no_others(entry: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in sorted(set(entry) - set(known)):
        near = closest(key, known)
        hint = f"write {near}" if near else f"the keys are {', '.join(known)}"
        raise FileFormatError(f"{where}: {key!r} is no key here; {hint}")
