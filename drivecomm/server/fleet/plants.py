"""State of many plants, updated by the messages that their MQTT doors publish. No I/O, no clock.

Messages come from other programs, so unreadable ones are counted and change nothing. While the gateway of a plant is
away, the plant's state is unknown, whatever the broker has retained.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from drivecomm.line import FRESH, STATUS
from drivecomm.server.mqtt import ALARMS, AVAILABILITY, BRIDGE, INFO, STATE, VALUES, name_of, object_in, plant_name

if TYPE_CHECKING:
    from collections.abc import Mapping

Gateway: TypeAlias = "Literal['online', 'offline', 'unknown']"
"""Connection state of a plant's server; unknown until it has published something about itself."""

SHOWN = ("output_frequency", "output_current", "reference_frequency", "reference_percent")
"""The subscribed quantities, besides the status, of plants with one topic for each quantity."""

_MOST_PLANTS, _MOST_DRIVES = 10_000, 10_000
"""Limits that keep a publisher from filling the memory."""
_MOST_LEVELS = 5
"""Maximum number of levels above a drive: enterprise, site, area, plant and line."""


class Seen(NamedTuple):
    """The latest value of one quantity. time_s: when it was read, by the clock of its server, in seconds since 1970."""

    value: Any
    unit: str
    text: str
    quality: str
    time_s: float


@dataclass(slots=True)
class FleetDrive:
    """One drive. answers: whether the drive answers, None if not published.

    model, line, title: as published by its plant.
    """

    name: str
    title: str = ""
    drive: str = ""
    line: str = ""
    model: str = ""
    answers: bool | None = None
    values: dict[str, Seen] = field(default_factory=dict)

    @property
    def state(self) -> str:
        """The state of the drive, empty if not known now, as with a bad or stale status."""
        status = self.values.get(STATUS)
        known = status is not None and self.answers is not False and status.quality in FRESH
        return str(status.value) if known and status is not None else ""

    @property
    def fault(self) -> str:
        """The fault with which the drive tripped, empty without one."""
        return self.values[STATUS].text if self.state and self.state == "fault" else ""


class FleetAlarm(NamedTuple):
    """A standing alarm. since_s: when it began; over_s: when it was over, None while its condition is present."""

    id: str
    rule: str
    drive: str
    text: str
    since_s: float
    over_s: float | None
    acknowledged_by: str


class PlantSummary(NamedTuple):
    """The summary of a plant. read_s: when a status was last read, None without one.

    alarms: number of standing alarms. version: version of drivecomm. file, file_sha256, file_read_s: the plant file
    that its server has read, and the time of reading; empty and None if not published.
    """

    name: str
    gateway: Gateway
    drives: int
    answering: int
    running: int
    faults: int
    silent: int
    read_s: float | None
    alarms: int
    version: str
    file: str
    file_sha256: str
    file_read_s: float | None


@dataclass(slots=True)
class FleetPlant:
    """One plant. name: name of its level among the topics, or of several levels, joined by /."""

    name: str
    gateway: Gateway = "unknown"
    version: str = ""
    session: str = ""
    """The session that a command to this plant must name."""
    file: str = ""
    file_sha256: str = ""
    file_read_s: float | None = None
    alarms: tuple[FleetAlarm, ...] = ()
    drives: dict[str, FleetDrive] = field(default_factory=dict)
    listed: frozenset[str] | None = None
    """The drives that the server has listed; None if it has listed none yet."""

    @property
    def shown(self) -> list[FleetDrive]:
        """The drives, in the order in which the server lists them."""
        return [drive for name, drive in self.drives.items() if self.listed is None or name in self.listed]

    @property
    def summary(self) -> PlantSummary:
        """The summary of the plant.

        While its server is away, its drives count as neither answering, running nor silent.
        """
        drives = self.shown
        live = drives if self.gateway == "online" else []
        states = Counter(drive.state for drive in live)
        read = [drive.values[STATUS].time_s for drive in drives if STATUS in drive.values]
        return PlantSummary(
            name=self.name,
            gateway=self.gateway,
            drives=len(drives),
            answering=sum(drive.answers is True for drive in live),
            running=states["running"] + states["stopping"],
            faults=states["fault"],
            silent=sum(drive.answers is False for drive in live),
            read_s=max(read, default=None),
            alarms=len(self.alarms),
            version=self.version,
            file=self.file,
            file_sha256=self.file_sha256,
            file_read_s=self.file_read_s,
        )


class Fleet:
    """All plants below one topic. prefix: the topic levels above those of the plants."""

    def __init__(self, prefix: str = "drivecomm") -> None:
        self.prefix = prefix
        self.plants: dict[str, FleetPlant] = {}
        self.unreadable = 0
        """Number of unreadable messages."""
        # By topic: the plant of each drive that publishes at another topic than PLANT/DRIVE.
        self._plant_at: dict[str, str] = {}
        self.depths = frozenset({1})
        """Numbers of levels above drives; grows as plants publish the topics of their drives."""

    @property
    def filters(self) -> list[str]:
        """The topic filters to subscribe to, for the current depths."""
        of_drive = (AVAILABILITY, VALUES, STATUS, *SHOWN)
        above = {depth: self.prefix + depth * "/+" for depth in range(1, _MOST_LEVELS + 1)}
        return [
            *(f"{above[depth]}/{BRIDGE}/{name}" for depth in range(1, _MOST_LEVELS) for name in (STATE, INFO, ALARMS)),
            *(f"{above[depth]}/+/{name}" for depth in sorted(self.depths) for name in of_drive),
        ]

    def take(self, topic: str, payload: bytes) -> None:
        """Process a message from the broker."""
        place, _, last = topic.removeprefix(f"{self.prefix}/").rpartition("/")
        above, _, middle = place.rpartition("/")
        if not topic.startswith(f"{self.prefix}/") or not above:
            return
        try:
            # An empty message deletes the retained one.
            content = object_in(payload) if payload else None
            if middle == BRIDGE:
                self._take_of_gateway(above, last, content)
            elif place in self._plant_at or "/" not in above:
                self._take_of_drive(plant_name(self._plant_at.get(place, above)), name_of(middle), last, content)
        except (ValueError, TypeError, KeyError, ArithmeticError, RecursionError, AttributeError):
            self.unreadable += 1

    def silent(self) -> None:
        """Mark all plants as unknown, because the broker cannot be reached, until they publish again."""
        for plant in self.plants.values():
            plant.gateway = "unknown"

    def _take_of_gateway(self, path: str, what: str, content: Mapping[str, Any] | None) -> None:
        name = plant_name(path)
        if content is None:
            # The retained state was deleted on purpose, so the plant is removed.
            if what == STATE and name in self.plants:
                del self.plants[name]
                self._place(path, [])
            return
        plant = self._plant(name)
        if what == STATE:
            plant.gateway = "online" if content["state"] == "online" else "offline"
            plant.version = str(content.get("version", plant.version))
            plant.session = str(content.get("session", ""))
        elif what == ALARMS:
            plant.alarms = tuple(map(_alarm, content["alarms"]))
        elif what == INFO:
            told = [each for each in content["drives"][:_MOST_DRIVES] if isinstance(each, dict)]
            known = plant.drives
            plant.drives = {str(each["name"]): self._drive(plant, str(each["name"])) for each in told} | known
            for each in told:
                drive = plant.drives[str(each["name"])]
                drive.title, drive.drive = str(each.get("title", "")), str(each.get("drive", ""))
                drive.line, drive.model = str(each.get("line", "")), str(each.get("model", ""))
            file = content.get("file") or {}
            plant.file, plant.file_sha256 = str(file.get("name", "")), str(file.get("sha256", ""))
            plant.file_read_s = None if file.get("read_s") is None else _time(file["read_s"])
            plant.listed = frozenset(str(each["name"]) for each in told)
            self._place(path, [str(each["topic"]) for each in told if "topic" in each])

    def _place(self, path: str, topics: list[str]) -> None:
        """Record the topics of a plant's drives, which may be below the names of their lines."""
        others = {place: plant for place, plant in self._plant_at.items() if plant != path}
        places = [topic.removeprefix(f"{self.prefix}/") for topic in topics]
        own = [each for each in places if each.startswith(f"{path}/") and each.count("/") <= path.count("/") + 2]
        self._plant_at = {**dict.fromkeys(own, path), **others}
        self.depths |= {each.count("/") for each in own}

    def _take_of_drive(self, plant_name: str, name: str, what: str, content: Mapping[str, Any] | None) -> None:
        plant = self._plant(plant_name)
        drive = self._drive(plant, name)
        if what == AVAILABILITY:
            drive.answers = None if content is None else content["state"] == "online"
        elif what == VALUES:
            for quantity, each in (content or {}).items():
                drive.values[str(quantity)] = _seen(each)
        elif content is None:
            drive.values.pop(name_of(what), None)
        else:
            drive.values[name_of(what)] = _seen(content)

    def _plant(self, name: str) -> FleetPlant:
        if name not in self.plants and len(self.plants) >= _MOST_PLANTS:
            raise ValueError("too many plants")
        return self.plants.setdefault(name, FleetPlant(name))

    def _drive(self, plant: FleetPlant, name: str) -> FleetDrive:
        if name not in plant.drives and len(plant.drives) >= _MOST_DRIVES:
            raise ValueError("too many drives")
        return plant.drives.setdefault(name, FleetDrive(name))


def _seen(content: Mapping[str, Any]) -> Seen:
    return Seen(
        value=content["value"],
        unit=str(content.get("unit", "")),
        text=str(content.get("text", "")),
        quality=str(content["quality"]),
        time_s=_time(content["time_s"]),
    )


def _alarm(content: Mapping[str, Any]) -> FleetAlarm:
    return FleetAlarm(
        id=str(content["id"]),
        rule=str(content["rule"]),
        drive=str(content["drive"]),
        text=str(content["text"]),
        since_s=_time(content["since_s"]),
        over_s=None if content.get("over_s") is None else _time(content["over_s"]),
        acknowledged_by=str(content.get("acknowledged_by", "")),
    )


def _time(said: Any) -> float:
    seconds = float(said)
    if not isfinite(seconds):
        raise ValueError("no time")
    return seconds
