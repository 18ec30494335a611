"""Topic tree: PREFIX/DRIVE/QUANTITY, and PREFIX/bridge for the whole plant. No I/O.

If lines are among the levels, it is PREFIX/LINE/DRIVE/QUANTITY. Characters that a topic cannot contain, or that a
broker refuses, are percent-encoded as in a URL; so is the first character of a name that would collide with another
topic.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.plant import Plant
    from drivecomm.server import ServedPlant

BRIDGE, STATE, INFO, ALARMS = "bridge", "state", "info", "alarms"
AVAILABILITY, DRIFT, VALUES = "availability", "drift", "values"
OF_DRIVE = frozenset({AVAILABILITY, DRIFT, VALUES, "command", "lease", "response", "stop"})
"""Levels below a drive that are not quantities."""
_UNFIT = frozenset("%+#/ *>")
"""Printable characters that a level cannot contain. NATS refuses spaces and uses * and > as wildcards."""


@lru_cache(maxsize=65536)
def level(name: str, taken: frozenset[str] = frozenset({BRIDGE})) -> str:
    """Return a name as one topic level, different for each name. taken: reserved words."""
    text = "".join(each if each.isprintable() and each not in _UNFIT else quote(each, safe="") for each in name)
    return f"%{ord(text[0]):02X}{text[1:]}" if text in taken else text


def name_of(level_text: str) -> str:
    """Return the name from a topic level."""
    return unquote(level_text)


def plant_name(path: str) -> str:
    """Return the name of the plant whose topics are below this path."""
    first, *others = map(name_of, path.split("/"))
    return "/".join(each.replace("/", "%2F") for each in (first, *others)) if others else first


def value_topic(drive_topic: str, quantity: str) -> str:
    """Return the topic of a quantity of the drive with this topic."""
    return f"{drive_topic}/{level(quantity, OF_DRIVE)}"


def line_of(plant: ServedPlant) -> Callable[[str], str | None]:
    """Return a function that maps a drive to its present line, None for a drive that is not in the plant."""
    seen: Plant | None = None
    lines: dict[str, str] = {}

    def line(drive: str) -> str | None:
        nonlocal seen, lines
        if plant.plant is not seen:
            seen = plant.plant
            lines = {each.name: each.line for each in seen.drives}
        return lines.get(drive)

    return line


@dataclass(frozen=True, slots=True)
class Topics:
    """Topics of one plant. line: returns the line of a drive; None if lines are not among the levels."""

    prefix: str
    line: Callable[[str], str | None] | None = None

    @property
    def bridge(self) -> str:
        """Prefix of the topics about the gateway and the whole plant."""
        return f"{self.prefix}/{BRIDGE}"

    @property
    def state(self) -> str:
        """Topic that shows whether the gateway is online, and the session for commands."""
        return f"{self.bridge}/{STATE}"

    @property
    def info(self) -> str:
        """Topic of the inventory: drives and their topics."""
        return f"{self.bridge}/{INFO}"

    @property
    def event(self) -> str:
        """Topic of events."""
        return f"{self.bridge}/event"

    @property
    def alarms(self) -> str:
        """Topic of the active alarms."""
        return f"{self.bridge}/{ALARMS}"

    @property
    def audit(self) -> str:
        """Topic of the audit: commands, callers and outcomes."""
        return f"{self.bridge}/audit"

    @property
    def historical(self) -> str:
        """Topic of values that were not published live."""
        return f"{self.bridge}/historical"

    def drive(self, drive: str) -> str:
        """Return the prefix of a drive's topics; without a line for a drive that is not in the plant."""
        line = None if self.line is None else self.line(drive)
        return f"{self.prefix}/{level(drive)}" if line is None else f"{self.prefix}/{level(line)}/{level(drive)}"

    def of_all(self, kind: str) -> str:
        """Return the topic filter for messages of one kind, such as stop, to any drive."""
        return f"{self.prefix}/+/{kind}" if self.line is None else f"{self.prefix}/+/+/{kind}"

    def value(self, drive: str, quantity: str) -> str:
        """Return the topic of the latest value of a quantity."""
        return value_topic(self.drive(drive), quantity)

    def values(self, drive: str) -> str:
        """Return the topic of the latest values of a drive."""
        return f"{self.drive(drive)}/{VALUES}"

    def availability(self, drive: str) -> str:
        """Return the topic that shows whether a drive answers."""
        return f"{self.drive(drive)}/{AVAILABILITY}"

    def drift(self, drive: str) -> str:
        """Return the topic that shows whether a drive is set as approved."""
        return f"{self.drive(drive)}/{DRIFT}"

    def response(self, drive: str) -> str:
        """Return the topic of answers to commands to a drive."""
        return f"{self.drive(drive)}/response"

    def command(self, drive: str) -> str:
        """Return the topic for commands to a drive."""
        return f"{self.drive(drive)}/command"

    def stop(self, drive: str) -> str:
        """Return the topic for stops of a drive."""
        return f"{self.drive(drive)}/stop"
