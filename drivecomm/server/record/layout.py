"""The topics of the plants on a broker, from which a record is filled. No I/O."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.errors import UsageError, suggestion
from drivecomm.server import LEVELS, LINE, PLANT
from drivecomm.server.mqtt import ALARMS, BRIDGE, INFO, STATE, name_of, plant_name

if TYPE_CHECKING:
    from collections.abc import Sequence


class TopicSubject(NamedTuple):
    """Subject of a topic. drive: its name, "" for the whole plant. what: the last level, unchanged."""

    plant: str
    drive: str
    what: str


@dataclass(frozen=True, slots=True)
class Layout:
    """Topic layout of plants. Raises UsageError for unknown levels.

    prefix: above all topics. levels: as in `levels` of the doors; default: only the plant's.
    """

    prefix: str = "drivecomm"
    levels: Sequence[str] = (PLANT,)
    _of_plant: int = field(init=False, repr=False)
    _of_drive: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for each in self.levels:
            if each not in LEVELS:
                raise UsageError(f"there is no level {each!r}; {suggestion(each, LEVELS, 'there are')}")
        if not self.levels or list(self.levels) != [each for each in LEVELS if each in self.levels]:
            raise UsageError(f"list levels from highest to lowest, each once: {', '.join(LEVELS)}")
        # If only the line is listed, the name of the plant remains above it.
        object.__setattr__(self, "_of_plant", max(1, sum(each != LINE for each in self.levels)))
        object.__setattr__(self, "_of_drive", 3 if LINE in self.levels else 2)

    @property
    def filters(self) -> tuple[str, ...]:
        """Topic filters that match everything recorded; a message may match several."""
        drives = self._plants + self._of_drive * "/+"
        return (drives, f"{self._plants}/{BRIDGE}/+") if LINE in self.levels else (drives,)

    @property
    def standing(self) -> tuple[str, ...]:
        """Retained topics with the present state of the plants."""
        return tuple(f"{self._plants}/{BRIDGE}/{name}" for name in (STATE, INFO, ALARMS))

    def place_of(self, topic: str) -> TopicSubject | None:
        """Return the subject of a topic, None if the topic does not fit this layout."""
        if not topic.startswith(f"{self.prefix}/"):
            return None
        levels = topic.removeprefix(f"{self.prefix}/").split("/")
        plant, below = levels[: self._of_plant], levels[self._of_plant :]
        if len(below) == 2 and below[0] == BRIDGE:
            return TopicSubject(plant_name("/".join(plant)), "", below[1])
        if len(below) != self._of_drive:
            return None
        return TopicSubject(plant_name("/".join(plant)), name_of(below[-2]), below[-1])

    @property
    def _plants(self) -> str:
        return self.prefix + self._of_plant * "/+"
