"""Plant files.

A plant is a TOML file. All times are seconds from the start of the plant's process. Example:

format = 1

[[line]]
name = "hall"
listen = "tcp:127.0.0.1:4001"       # optional: where a master connects, pty:PATH, tcp:HOST:PORT, rfc2217:HOST:PORT
listeners = true                    # optional: with tcp, further clients may listen to the line
port = "/dev/ttyUSB0"               # optional: port for a master; by default where the line listens
echo = true                         # optional: the master receives its own characters
paced = false                       # optional: characters take no time; by default they do
baudrate = 19200                    # optional, for all its drives: also bytesize, parity, stopbits
noise = { rate = 0.01, seed = 1, kinds = ["corrupt", "drop"] }
                                    # optional; also requests, replies (true or false), delay_s, bits

[[drive]]
name = "pump"                       # optional: by default PROTOCOL:ADDRESS
drive = "vabus:1"                   # PROTOCOL:ADDRESS
line = "hall"                       # optional if there is only one line
title = "feed pump, hall 2"         # optional: description for people
groups = ["pumps", "hall 2"]        # optional: group names that commands accept in place of its name
options = { model = "agile" }       # optional: keywords of Bus.drive
armed = true                        # optional: may be written and commanded; by default read-only
confirmed = ["output_voltage"]      # optional: parameters whose type, scale and unit were checked on this drive
poll = [{ parameters = ["output_frequency"], period_s = 0.2, priority = 1 }]
                                    # optional: values to poll; by default each second, equal priority; also options
                                    # of the protocol for reading, such as options = { type = "long" }
link_loss = { policy = "trip", watchdog_s = 5 }
                                    # optional: hold, ramp, coast or trip when its master falls silent; after 5 s
network = { http = ["start", "reset"], write = ["480"] }
                                    # optional: permitted commands over a network, by the kind of door
tags = { output_frequency = { name = "P101.SPEED", group = "mixing", deadband = 0.05 } }
                                    # optional: names of polled values in supervisory systems
machine = { unit = "m/min", per_hz = "1.25" }
                                    # optional: machine units per hertz; or the mechanics, such as
                                    # { unit = "m/min", poles = 4, gear = "5.2", per_turn = "0.314" }
reply_delay_s = 0.005               # optional: reply time of the virtual drive, also used by forecasts
needs_pause_s = 0.001               # optional: the virtual drive misses requests that begin sooner after its reply
values = { "480" = 1000 }           # optional: raw values of parameters at the start
motor = { rated_kw = 7.5 }          # optional: differences from the usual motor

[[fault]]                           # telegrams that are lost, changed, cut, late or doubled
line = "hall"                       # or drive = "pump": replies of this drive
kind = "drop"                       # corrupt, truncate, delay (with delay_s), duplicate
of = "reply to a write"             # optional: request, reply, reply to a read, reply to a command
to = { parameter = 480 }            # optional: fields that the answered request must have
every = 3                           # optional: each third one; or a share: rate = 0.1 with seed; by default all
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

# [server], [[door]], [[alarm]] and backup, of a line or drive, are read by `drivecomm.server` alone
"""

from __future__ import annotations

import re
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.line import STATUS
from drivecomm.plant.groups import check_apart, checked_groups
from drivecomm.plant.plant import Plant, PlantLine
from drivecomm.plant.script import LineNoise, kind_named
from drivecomm.plant.script_files import errors_in, fault_of
from drivecomm.protocol import (
    DriveConfig,
    LineSettings,
    LinkLossPolicy,
    MachineUnit,
    NetworkAccess,
    PollGroup,
    Tag,
    parse_drive,
)
from drivecomm.tomlfile import (
    CHOICE,
    DECIMAL,
    LIST,
    NUMBER,
    RAW,
    SECONDS,
    SWITCH,
    TABLE,
    TABLES,
    TEXT,
    WHOLE,
    read_toml,
)

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.tomlfile import TomlTable

_ADDRESS = re.compile(r"[a-z0-9-]+:[0-9]+")
_TOP = {
    "format": WHOLE, "line": TABLES, "drive": TABLES, "fault": TABLES, "server": TABLE, "door": TABLES, "alarm": TABLES,
}  # fmt: skip
_SETTINGS = {"baudrate": WHOLE, "bytesize": WHOLE, "parity": TEXT, "stopbits": NUMBER}
_LINE = {
    **dict.fromkeys(("name", "listen", "port"), TEXT), **dict.fromkeys(("listeners", "echo", "paced"), CHOICE),
    **_SETTINGS, "noise": TABLE, "backup": SWITCH,
}  # fmt: skip
_NOISE = {
    "rate": NUMBER,
    "seed": WHOLE,
    "kinds": LIST,
    "requests": CHOICE,
    "replies": CHOICE,
    "delay_s": SECONDS,
    "bits": WHOLE,
}
_DRIVE = {
    "name": TEXT,
    "drive": TEXT,
    "line": TEXT,
    "title": TEXT,
    "groups": LIST,
    "options": TABLE,
    "armed": CHOICE,
    "confirmed": LIST,
    "poll": LIST,
    "link_loss": TABLE,
    "network": TABLE,
    "tags": TABLE,
    "machine": TABLE,
    "reply_delay_s": SECONDS,
    "needs_pause_s": SECONDS,
    "values": TABLE,
    "motor": TABLE,
    "backup": SWITCH,
}
_POLL = {"parameters": LIST, "period_s": SECONDS, "priority": WHOLE, "options": TABLE}
_TAG = {"name": TEXT, "group": TEXT, "deadband": NUMBER}
_MACHINE = {"unit": TEXT, "per_hz": DECIMAL, "poles": WHOLE, "gear": DECIMAL, "per_turn": DECIMAL}
_LINK_LOSS = {"policy": TEXT, "watchdog_s": SECONDS}


def read_plant(path: Path) -> Plant:
    """Read a plant file. Raises FileFormatError with the name of the file, the line, the entry and its fault."""
    read_s = time.time()
    top = read_toml(path, "a plant")
    for each in top.tables("poll"):
        raise each.error(
            "poll plans are plant files now; write a [[line]] with name and port, and in each [[drive]] what is polled "
            'of it: poll = [{ parameters = ["481"], period_s = 0.2 }]'
        )
    if top.content.get("format") != 1 or top.content["format"] is True:
        raise top.error("a plant begins with format = 1", "format")
    top.take(_TOP)
    lines = tuple(_line(each) for each in top.tables("line"))
    if not lines:
        raise top.error("a plant has one or more [[line]]")
    only_line = lines[0].name if len(lines) == 1 else ""
    drives: tuple[DriveConfig, ...] = ()
    tables = top.tables("drive")
    for each in tables:
        drives += (_told_apart(_drive(each, only_line), drives, each),)
    check_apart(drives, tables)
    script = tuple(fault_of(each) for each in top.tables("fault"))
    try:
        return Plant(
            lines=lines,
            drives=drives,
            script=script,
            file=str(path),
            content=top.source,
            read_s=read_s,
        )
    except UsageError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _line(table: TomlTable) -> PlantLine:
    given = table.take(_LINE, "name")
    given.pop("backup", None)
    with errors_in(table):
        settings = {key: given.pop(key) for key in _SETTINGS if key in given}
        LineSettings(**settings)
        if "noise" in given:
            given["noise"] = _noise(table.table("noise"))
        return PlantLine(**given, settings=settings)


def _noise(table: TomlTable) -> LineNoise:
    given = table.take(_NOISE, "rate")
    if "kinds" in given:
        given["kinds"] = tuple(kind_named(str(name)) for name in given["kinds"])
    return LineNoise(**given)


def _drive(table: TomlTable, only_line: str) -> DriveConfig:
    given = {"line": only_line, **table.take(_DRIVE, *(["drive"] if only_line else ["drive", "line"]))}
    given.pop("backup", None)
    for key, kind in (("values", RAW), ("motor", NUMBER)):
        table.table(key).take(dict.fromkeys(given.get(key, ()), kind))
    with errors_in(table):
        drive = parse_drive(given.pop("drive"))
        if drive.options:
            raise UsageError(f"options cannot stand after {drive}; write options = {{ key = value }}")
        if "groups" in given:
            given["groups"] = checked_groups(_texts(table, "groups", given["groups"], '["pumps", "hall 2"]'), table)
        if "confirmed" in given:
            given["confirmed"] = _texts(table, "confirmed", given["confirmed"], '["output_voltage"]')
        if "poll" in given:
            given["poll"] = _poll(table)
        if "link_loss" in given:
            given["link_loss"] = LinkLossPolicy(**table.table("link_loss").take(_LINK_LOSS, "policy"))
        if "network" in given:
            given["network"] = _network(table.table("network"))
        if "tags" in given:
            given["tags"] = _tags(table.table("tags"), given.get("poll", ()))
        if "machine" in given:
            given["machine"] = _machine(table.table("machine"))
        return replace(drive, **given)


def _told_apart(drive: DriveConfig, before: tuple[DriveConfig, ...], table: TomlTable) -> DriveConfig:
    """Return a drive. Raises FileFormatError if another drive has its name or its place."""
    if _ADDRESS.fullmatch(drive.name) and drive.name != str(drive):
        what = f"{drive} is named as if it were {drive.name}; give it another name, or leave the name out"
        raise table.error(what, "name")
    twin = next((each for each in before if (each.line, str(each)) == (drive.line, str(drive))), None)
    if twin is not None and twin.name != drive.name:
        what = f"{drive} is on line {drive.line} already, as {twin.name}; a line has one drive at an address"
        raise table.error(what, "drive")
    return drive


def _network(table: TomlTable) -> NetworkAccess:
    for key, listed in table.take(dict.fromkeys(table.content, LIST)).items():
        _texts(table, key, listed, '["start", "reset"]')
    lists = {key: tuple(listed) for key, listed in table.content.items()}
    return NetworkAccess(write=lists.pop("write", ()), verbs=lists)


def _texts(table: TomlTable, key: str, listed: list[Any], such_as: str) -> tuple[str, ...]:
    if not all(isinstance(each, str) for each in listed):
        raise table.error(f"{key} holds texts in quotes, such as {such_as}", key)
    return tuple(listed)


def _tags(table: TomlTable, poll: tuple[PollGroup, ...]) -> dict[str, Tag]:
    polled = {STATUS, *(name for group in poll for name in group.parameters)}
    tags = {}
    for name in table.content:
        # The server's default polls are not known yet, so without `poll` every tag is accepted.
        if poll and name not in polled:
            raise table.error(f"{name} is not polled; write it under poll, too", name)
        tags[name] = Tag(**table.table(name).take(_TAG))
    return tags


def _machine(table: TomlTable) -> MachineUnit:
    with errors_in(table):
        return MachineUnit(**table.take(_MACHINE, "unit"))


def _poll(table: TomlTable) -> tuple[PollGroup, ...]:
    for each in table.content["poll"]:
        if not isinstance(each, dict):
            raise table.error(f'invalid poll entry {each!r}; write {{ parameters = ["output_frequency"] }}', "poll")
    return tuple(_poll_group(each) for each in table.tables("poll"))


def _poll_group(table: TomlTable) -> PollGroup:
    given: dict[str, Any] = table.take(_POLL, "parameters")
    if not all(isinstance(each, str) for each in given["parameters"]):
        raise table.error('parameters are texts in quotes, such as ["481", "output_current"]', "parameters")
    return PollGroup(**{**given, "parameters": tuple(given["parameters"])})
