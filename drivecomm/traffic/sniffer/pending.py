"""Items in the order of the line, held back until the directions of their telegrams are certain.

Listening may start in the middle of an exchange, at a reply. Both possible starts are evaluated until one of them
explains clearly more telegrams. Between drives of several protocols, a reply follows its request, and a request may
follow telegrams of other protocols.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.traffic.sniffer.traffic_items import ambiguous_of, telegram_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.protocol import Direction
    from drivecomm.traffic.sniffer.directions import DirectionEstimator, Observation
    from drivecomm.traffic.sniffer.readings import TelegramReading
    from drivecomm.traffic.sniffer.traffic_items import TrafficItem

_CLEARLY_BETTER = 2
# An odd number: if requests and replies alternate, the next attempt starts with the other direction.
_LONGEST_DOUBT = 15
_AGREED = 4


@dataclass(slots=True)
class _Slot:
    """A reserved place for an item; the item is None while its direction is unknown."""

    heard: Observation
    item: TrafficItem | None = None


class PendingItems:
    """Pending items of one line. estimators: estimators of the protocols that may be spoken, by name."""

    def __init__(self, estimators: Mapping[str, DirectionEstimator]) -> None:
        self._estimators = estimators
        self._found: list[_Slot | TrafficItem] = []
        self._open: dict[str, list[_Slot]] = {name: [] for name in estimators}

    def add(self, item: TrafficItem) -> None:
        """Append an item that needs no direction, or whose direction is known."""
        self._found.append(item)

    def hear_alone(self, heard: Observation) -> list[TrafficItem]:
        """Process the next telegram as `hear` does; return the items that are now certain."""
        if not self._found and (item := self._directed(heard)) is not None:
            return [item]
        self.hear(heard)
        return self.certain()

    def hear(self, heard: Observation) -> None:
        """Process the next telegram of a protocol, whether its direction is certain or not."""
        if (item := self._directed(heard)) is not None:
            self._found.append(item)
            return
        name = heard.readings[0].protocol.name
        slots, slot = self._open[name], _Slot(heard)
        self._found.append(slot)
        slots.append(slot)
        self._settle(name)
        if len(slots) >= _LONGEST_DOUBT:
            self._give_up(name)

    def certain(self) -> list[TrafficItem]:
        """Remove and return the items before the first one whose direction is still open."""
        certain: list[TrafficItem] = []
        for each in self._found:
            item = each.item if isinstance(each, _Slot) else each
            if item is None:
                break
            certain.append(item)
        del self._found[: len(certain)]
        return certain

    def finish(self) -> None:
        """Settle all open directions at the end of the traffic."""
        for name in self._open:
            self._settle(name, 1)
            self._give_up(name)

    def _directed(self, heard: Observation) -> TrafficItem | None:
        """Return the item of a telegram with a single reading or with certain directions in its protocol; else None."""
        readings = heard.readings
        name = readings[0].protocol.name
        estimator = self._estimators[name]
        if len(readings) == 1 and (estimator.certain or not self._open[name]):
            return _taken(estimator, heard, readings[0])
        return _item_of(estimator, heard, estimator.direction_of(heard)) if estimator.certain else None

    def _settle(self, name: str, margin: int = _CLEARLY_BETTER) -> None:
        estimator, slots = self._estimators[name], self._open[name]
        directions = _infer_directions(estimator, [slot.heard for slot in slots], margin) if slots else None
        if directions is not None:
            estimator.certain = True
            for slot, direction in zip(slots, directions, strict=True):
                slot.item = _item_of(estimator, slot.heard, direction)
            slots.clear()

    def _give_up(self, name: str) -> None:
        for slot in self._open[name]:
            slot.item = ambiguous_of(slot.heard)
        self._open[name].clear()


def _item_of(estimator: DirectionEstimator, heard: Observation, direction: Direction | None) -> TrafficItem:
    reading = heard.reading(direction) if direction else None
    if reading is None:
        estimator.doubt(heard)
        return ambiguous_of(heard)
    return _taken(estimator, heard, reading)


def _taken(estimator: DirectionEstimator, heard: Observation, reading: TelegramReading) -> TrafficItem:
    estimator.take(reading, heard.began_s, heard.ended_s)
    return telegram_of(reading, heard)


def _infer_directions(
    estimator: DirectionEstimator, telegrams: Sequence[Observation], margin: int
) -> list[Direction | None] | None:
    """Return the directions of the first telegrams if one start explains them clearly better; None otherwise."""
    asking, as_asked = _play(estimator, telegrams, "request")
    answering, as_answered = _play(estimator, telegrams, "reply")
    if abs(asking - answering) >= margin:
        return as_asked if asking > answering else as_answered
    agreed = [one if one == other else None for one, other in zip(as_asked, as_answered, strict=True)]
    # Both starts agree on the latest telegrams, so the first ones may keep an open direction.
    lately = agreed[-_AGREED:]
    is_settled = len(agreed) > _AGREED and "request" in lately and "reply" in lately and None not in lately
    return agreed if is_settled else None


def _play(
    estimator: DirectionEstimator, telegrams: Sequence[Observation], first: Direction
) -> tuple[int, list[Direction | None]]:
    """Return a score for the first telegram having this direction, and the directions that follow from it.

    A reply that was due adds one; a telegram that does not fit subtracts one.
    """
    state = estimator.copy()
    score = 0
    directions: list[Direction | None] = []
    for number, heard in enumerate(telegrams):
        direction = first if number == 0 and heard.reading(first) else state.direction_of(heard)
        directions.append(direction)
        reading = heard.reading(direction) if direction else None
        if reading is None:
            score -= 1
            continue
        if direction == "reply":
            if number or heard.behind_others or heard.silence_s > state.protocol.facts.timing.reply_timeout_s:
                due = state.awaits(reading.message, heard.began_s) and not heard.behind_others
                score += 1 if due else -1
        elif state.leaves_unanswered(reading):
            score -= 1
        state.take(reading, heard.began_s, heard.ended_s)
    return score, directions
