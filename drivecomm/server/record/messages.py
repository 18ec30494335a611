"""Parsing of published messages into rows of a record. No I/O, no clock.

The messages come from other programs: a message that is invalid, or that no database could store, raises ValueError.
"""

from __future__ import annotations

from decimal import Decimal
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from drivecomm.client import json_text
from drivecomm.server.mqtt import ALARMS, INFO, OF_DRIVE, STATE, VALUES, name_of, object_in
from drivecomm.server.record.database import TO_THE_END_MS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.server.record.layout import Layout

_LONGEST = 10_000
_MOST_DIGITS, _LARGEST_EXPONENT = 200, 300
_LARGEST_WHOLE = 2**63 - 1
_OF_COMMAND = ("id", "who", "door", "drive", "verb", "outcome", "text")
_NAMED = OF_DRIVE - {VALUES}


class RecordedSample(NamedTuple):
    """Value of a plant, or its absence. number: decimal digits, so that it stays exact; string: for a text value."""

    plant: str
    drive: str
    name: str
    time_ms: int
    number: str | None
    string: str | None
    unit: str
    quality: str
    text: str
    note: str
    source_ms: int | None


class RecordedEvent(NamedTuple):
    """An event of a plant."""

    plant: str
    time_ms: int
    number: int
    kind: str
    text: str
    drive: str
    line: str
    who: str
    alarm: str


class RecordedCommand(NamedTuple):
    """Command to a plant and its outcome."""

    plant: str
    time_ms: int
    row: int
    done_ms: int
    id: str
    who: str
    door: str
    drive: str
    verb: str
    arguments: str
    outcome: str
    text: str


class StandingAlarm(NamedTuple):
    """Alarm that is active or not acknowledged."""

    id: str
    rule: str
    drive: str
    text: str
    since_ms: int
    over_ms: int | None
    times: int
    acknowledged_by: str
    acknowledged_ms: int | None


class StandingAlarms(NamedTuple):
    """All alarms of a plant that are active or not acknowledged."""

    plant: str
    alarms: tuple[StandingAlarm, ...]


class PlantState(NamedTuple):
    """State of a plant as a whole. A field is None if the message did not contain it."""

    plant: str
    state: str | None = None
    version: str | None = None
    file: str | None = None
    file_sha256: str | None = None
    file_read_ms: int | None = None


Recorded: TypeAlias = "RecordedSample | RecordedEvent | RecordedCommand | StandingAlarms | PlantState"


def records_in(layout: Layout, topic: str, payload: bytes) -> Iterator[Recorded]:
    """Yield the records in a message; none for topics that are not recorded.

    Raises ValueError, or another of the errors in `recorder._UNFIT`, for an invalid message.
    """
    place = layout.place_of(topic) if payload else None
    if place is None:
        return
    plant, drive = _text(place.plant), _text(place.drive)
    if not drive:
        if place.what in _OF_BRIDGE:
            yield from _OF_BRIDGE[place.what](plant, object_in(payload))
    elif place.what == VALUES:
        for name, each in object_in(payload).items():
            yield _sample(plant, drive, _text(name), each)
    elif place.what not in _NAMED:
        yield _sample(plant, drive, _text(name_of(place.what)), object_in(payload))


def _sample(plant: str, drive: str, name: str, said: Mapping[str, Any]) -> RecordedSample:
    value = said["value"]
    is_text = isinstance(value, str)
    return RecordedSample(
        plant,
        drive,
        name,
        _ms(said["time_s"]),
        None if value is None or is_text else _number(value),
        _text(value) if is_text else None,
        _text(said.get("unit", "")),
        _text(said["quality"]),
        _text(said.get("text", "")),
        _text(said.get("note", "")),
        _ms_or_none(said.get("source_s")),
    )


def _historical(plant: str, content: Mapping[str, Any]) -> Iterator[Recorded]:
    for each in content["values"]:
        yield _sample(plant, _text(each["drive"]), _text(each["name"]), each)


def _event(plant: str, said: Mapping[str, Any]) -> Iterator[Recorded]:
    yield RecordedEvent(
        plant,
        _ms(said["time_s"]),
        _whole(said["number"]),
        **{name: _text(said.get(name, "")) for name in ("kind", "text", "drive", "line", "who", "alarm")},
    )


def _audit(plant: str, content: Mapping[str, Any]) -> Iterator[Recorded]:
    for said in content["commands"]:
        yield RecordedCommand(
            plant,
            _ms(said["time_s"]),
            _whole(said["row"]),
            _ms(said["done_s"]),
            arguments=_text(json_text(said.get("arguments", {}))),
            **{name: _text(said.get(name, "")) for name in _OF_COMMAND},
        )


def _alarms(plant: str, content: Mapping[str, Any]) -> Iterator[Recorded]:
    yield StandingAlarms(
        plant,
        tuple(
            StandingAlarm(
                **{name: _text(said[name]) for name in ("id", "rule", "drive", "text")},
                since_ms=_ms(said["since_s"]),
                over_ms=_ms_or_none(said.get("over_s")),
                times=_whole(said.get("times", 1)),
                acknowledged_by=_text(said.get("acknowledged_by", "")),
                acknowledged_ms=_ms_or_none(said.get("acknowledged_s")),
            )
            for said in content["alarms"]
        ),
    )


def _state(plant: str, said: Mapping[str, Any]) -> Iterator[Recorded]:
    version = said.get("version")
    yield PlantState(plant, state=_text(said["state"]), version=None if version is None else _text(version))


def _info(plant: str, content: Mapping[str, Any]) -> Iterator[Recorded]:
    said = content.get("file") or {}
    yield PlantState(
        plant,
        version=_text(content.get("version", "")),
        file=_text(said.get("name", "")),
        file_sha256=_text(said.get("sha256", "")),
        file_read_ms=_ms_or_none(said.get("read_s")),
    )


_OF_BRIDGE = {
    "historical": _historical,
    "event": _event,
    "audit": _audit,
    ALARMS: _alarms,
    STATE: _state,
    INFO: _info,
}


@lru_cache(maxsize=4096)
def _text(said: Any) -> str:
    if not isinstance(said, str):
        raise TypeError("not a text")
    # PostgreSQL stores no zero bytes, and unpaired surrogates cannot be encoded.
    return said[:_LONGEST].replace("\0", "\ufffd").encode(errors="replace").decode()


def _number(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, int | Decimal):
        raise TypeError("neither a number nor a text")
    exact = Decimal(value)
    _, digits, exponent = exact.as_tuple()
    if not isinstance(exponent, int) or len(digits) > _MOST_DIGITS or abs(exponent) > _LARGEST_EXPONENT:
        raise ValueError("no database stores this number exactly")
    return str(exact)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > _LARGEST_WHOLE:
        raise ValueError("not a whole number")
    return value


def _ms(said: Any) -> int:
    if isinstance(said, bool) or not isinstance(said, int | Decimal):
        raise TypeError("not a time")
    # Compared first, because rounding a number with a huge exponent takes extremely long.
    if not 0 <= said * 1000 <= TO_THE_END_MS:
        raise ValueError("not a plausible time")
    return round(said * 1000)


def _ms_or_none(said: Any) -> int | None:
    return None if said is None else _ms(said)
