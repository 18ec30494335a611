"""The tree of topics: PREFIX/DRIVE/QUANTITY, and what is about the whole plant under PREFIX/bridge. No I/O.

Where lines are among the levels, it is PREFIX/LINE/DRIVE/QUANTITY.
Characters that a topic cannot have, or that a broker refuses, are percent-encoded as in a URL; so is the first one of a
name that would be taken for another topic.
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
"""Printable, and not for a level. NATS refuses a space, and takes * and > for wildcards of its own."""


@lru_cache(maxsize=65536)
def level(name: str, taken: frozenset[str] = frozenset({BRIDGE})) -> str:
    """Return a name as one level of a topic; another name never has the same. taken: words that mean something."""
    text = "".join(each if each.isprintable() and each not in _UNFIT else quote(each, safe="") for each in name)
    return f"%{ord(text[0]):02X}{text[1:]}" if text in taken else text


def name_of(level_text: str) -> str:
    """Return the name of which this is the level."""
    return unquote(level_text)


def plant_name(path: str) -> str:
    """Return what a plant is called whose topics are below a path."""
    first, *others = map(name_of, path.split("/"))
    return "/".join(each.replace("/", "%2F") for each in (first, *others)) if others else first


def value_topic(drive_topic: str, quantity: str) -> str:
    """Return the topic of one quantity of the drive that is told below a topic."""
    return f"{drive_topic}/{level(quantity, OF_DRIVE)}"


def line_of(plant: ServedPlant) -> Callable[[str], str | None]:
    """Return what tells the line of a drive as the plant is now, None of a drive that it does not have."""
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
    """The topics of one plant. line: tells the line of a drive; None where lines are not among the levels."""

    prefix: str
    line: Callable[[str], str | None] | None = None

    @property
    def bridge(self) -> str:
        """Above what is about the gateway and the plant as a whole."""
        return f"{self.prefix}/{BRIDGE}"

    @property
    def state(self) -> str:
        """Whether the gateway is there, and the session that commands have to name."""
        return f"{self.bridge}/{STATE}"

    @property
    def info(self) -> str:
        """What there is: drives, with their topics."""
        return f"{self.bridge}/{INFO}"

    @property
    def event(self) -> str:
        """What happens."""
        return f"{self.bridge}/event"

    @property
    def alarms(self) -> str:
        """The alarms that stand."""
        return f"{self.bridge}/{ALARMS}"

    @property
    def audit(self) -> str:
        """Who commanded what, and what came of it."""
        return f"{self.bridge}/audit"

    @property
    def historical(self) -> str:
        """Values that could not be published when they came."""
        return f"{self.bridge}/historical"

    def drive(self, drive: str) -> str:
        """Above all that is about one drive; of one that the plant does not have, without a line."""
        line = None if self.line is None else self.line(drive)
        return f"{self.prefix}/{level(drive)}" if line is None else f"{self.prefix}/{level(line)}/{level(drive)}"

    def of_all(self, kind: str) -> str:
        """Return the filter for what is published to every drive, such as stop."""
        return f"{self.prefix}/+/{kind}" if self.line is None else f"{self.prefix}/+/+/{kind}"

    def value(self, drive: str, quantity: str) -> str:
        """The latest of one quantity."""
        return value_topic(self.drive(drive), quantity)

    def values(self, drive: str) -> str:
        """The latest of all quantities of a drive."""
        return f"{self.drive(drive)}/{VALUES}"

    def availability(self, drive: str) -> str:
        """Whether a drive answers."""
        return f"{self.drive(drive)}/{AVAILABILITY}"

    def drift(self, drive: str) -> str:
        """How far a drive is set as approved."""
        return f"{self.drive(drive)}/{DRIFT}"

    def response(self, drive: str) -> str:
        """What has come of commands to a drive."""
        return f"{self.drive(drive)}/response"

    def command(self, drive: str) -> str:
        """Commands to a drive."""
        return f"{self.drive(drive)}/command"

    def stop(self, drive: str) -> str:
        """Stops of a drive."""
        return f"{self.drive(drive)}/stop"
