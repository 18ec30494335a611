"""The tree of topics: PREFIX/DRIVE/QUANTITY, and what is about the whole plant under PREFIX/bridge. No I/O.

A name that MQTT cannot carry, or that would be taken for another topic, is written with % and two digits in its place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

BRIDGE, STATE, INFO = "bridge", "state", "info"
AVAILABILITY, VALUES = "availability", "values"
_OF_DRIVE = frozenset({AVAILABILITY, VALUES, "command", "lease", "response", "stop"})
# A space is legal, and refused by brokers such as NATS.
_UNFIT = re.compile(r"[%+#/\x00-\x20\x7f]")
_ESCAPED = re.compile(r"%([0-9A-F]{2})")


def level(name: str, taken: frozenset[str] = frozenset({BRIDGE})) -> str:
    """Return a name as one level of a topic; another name never has the same. taken: words that mean something."""
    text = _UNFIT.sub(_escaped, name)
    return f"%{ord(text[0]):02X}{text[1:]}" if text in taken else text


def name_of(level_text: str) -> str:
    """Return the name of which this is the level."""
    return _ESCAPED.sub(lambda found: chr(int(found[1], 16)), level_text)


def _escaped(found: re.Match[str]) -> str:
    return f"%{ord(found[0]):02X}"


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of one plant."""

    prefix: str

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
        return f"{self.bridge}/alarms"

    @property
    def historical(self) -> str:
        """Values that could not be published when they came."""
        return f"{self.bridge}/historical"

    def drive(self, drive: str) -> str:
        """Above all that is about one drive."""
        return f"{self.prefix}/{level(drive)}"

    def value(self, drive: str, quantity: str) -> str:
        """The latest of one quantity."""
        return f"{self.drive(drive)}/{level(quantity, _OF_DRIVE)}"

    def values(self, drive: str) -> str:
        """The latest of all quantities of a drive."""
        return f"{self.drive(drive)}/{VALUES}"

    def availability(self, drive: str) -> str:
        """Whether a drive answers."""
        return f"{self.drive(drive)}/{AVAILABILITY}"

    def response(self, drive: str) -> str:
        """What has come of commands to a drive."""
        return f"{self.drive(drive)}/response"

    def command(self, drive: str) -> str:
        """Commands to a drive."""
        return f"{self.drive(drive)}/command"

    def stop(self, drive: str) -> str:
        """Stops of a drive."""
        return f"{self.drive(drive)}/stop"
