"""All possible traffic of a line as a graph of places, and where another telegram may be found in it.

The graph knows which characters each place may hold and which places may follow it. It ignores dependencies between
characters: check characters, lengths, words of a table. So what it excludes is impossible, but what it allows may be
impossible as well.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.protocol import Damaged, Framed, Framer
from drivecomm.virtual import heard

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from random import Random

    from drivecomm.protocol import Codec, Direction, LineSettings, Message
    from drivecomm.traffic.cohabitation.outlines import TelegramOutline

Node = tuple[int, int]
"""Number of an outline, and number of a place in it."""

State = tuple[Node, Node]
"""A place of the traffic, and the place of the other telegram that is found there."""


class TrafficGraph:
    """Consecutive telegrams: a reply follows only a request, a request follows anything.

    outlines: the telegrams. hears: translation table from sent to heard characters.
    """

    def __init__(self, outlines: Sequence[TelegramOutline], hears: bytes) -> None:
        self.outlines, self.hears = outlines, hears
        self._masks = [[_mask(hears[code] for code in place.allowed) for place in each.places] for each in outlines]
        behind_reply = [number for number, each in enumerate(outlines) if each.direction == "request"]
        self._behind = {"request": range(len(outlines)), "reply": behind_reply}

    def mask(self, node: Node) -> int:
        """Return the characters that may be heard at a place, as a bit mask."""
        return self._masks[node[0]][node[1]]

    def nodes(self, of: Iterable[int]) -> list[Node]:
        """Return all places of these outlines."""
        return [(number, place) for number in of for place in range(len(self.outlines[number].places))]

    def entries(self, number: int) -> list[Node]:
        """Return the places with which an outline may begin."""
        return _entries(self.outlines[number], number)

    def following(self, node: Node) -> list[Node]:
        """Return the places that may follow a place."""
        number, place = node
        outline = self.outlines[number]
        found: list[Node] = []
        for after in outline.following(place):
            if after < len(outline.places):
                found.append((number, after))
            else:
                for other in self._behind[outline.direction]:
                    found.extend(_entries(self.outlines[other], other))
        return found


class Sightings:
    """All ways in which the wanted telegrams may be found in the traffic that is heard.

    traffic: the traffic. wanted: the telegrams to look for. begins: outlines of the traffic in which a wanted telegram
    may begin at any place. entered: outlines in which it may begin only with the first character.
    """

    def __init__(
        self,
        traffic: TrafficGraph,
        wanted: Sequence[TelegramOutline],
        begins: Iterable[int],
        entered: Iterable[int] = (),
    ) -> None:
        self.traffic, self.wanted = traffic, wanted
        self._masks = [[_mask(place.allowed) for place in each.places] for each in wanted]
        entries = [entry for number, each in enumerate(wanted) for entry in _entries(each, number)]
        places = traffic.nodes(begins) + [place for number in entered for place in traffic.entries(number)]
        first = [(place, entry) for place in places for entry in entries if self._fits(place, entry)]
        self._steps = self._search(first)
        self._alive = self._leading_to_the_end()
        self.starts = [state for state in first if state in self._alive]
        """States in which a wanted telegram may begin; empty if none can be found at all."""

    def way(self, start: State, chance: Random) -> list[State]:
        """Return a random path from a start to the end, place by place."""
        states = [start]
        while True:
            onward = [state for state in self._steps[states[-1]] if state in self._alive]
            if self._may_end(states[-1]) and (not onward or chance.random() < 0.5):
                return states
            states.append(chance.choice(onward))

    def may_end_elsewhere(self) -> bool:
        """Whether a wanted telegram may begin in one telegram of the traffic and end in another."""
        outlines = self.traffic.outlines
        return any(
            is_next_telegram(state[0], after[0], outlines)
            for state in self._alive
            for after in self._steps[state]
            if after in self._alive
        )

    def farthest(self) -> Node | None:
        """Return the last reachable place of the wanted telegram that gets farthest; None if no place is reachable."""
        met = [wanted for _, wanted in self._steps]
        return max(met, key=lambda wanted: (wanted[1], -wanted[0]), default=None)

    def _search(self, first: list[State]) -> dict[State, list[State]]:
        steps: dict[State, list[State]] = {}
        pending = list(first)
        while pending:
            state = pending.pop()
            if state in steps:
                continue
            node, (number, place) = state
            outline = self.wanted[number]
            later = [(number, after) for after in outline.following(place) if after < len(outline.places)]
            steps[state] = [
                (behind, after)
                for behind in (self.traffic.following(node) if later else ())
                for after in later
                if self._fits(behind, after)
            ]
            pending.extend(steps[state])
        return steps

    def _leading_to_the_end(self) -> set[State]:
        before: dict[State, list[State]] = defaultdict(list)
        for state, onward in self._steps.items():
            for after in onward:
                before[after].append(state)
        alive: set[State] = set()
        pending = [state for state in self._steps if self._may_end(state)]
        while pending:
            state = pending.pop()
            if state not in alive:
                alive.add(state)
                pending.extend(before[state])
        return alive

    def _may_end(self, state: State) -> bool:
        number, place = state[1]
        outline = self.wanted[number]
        return len(outline.places) in outline.following(place)

    def _fits(self, node: Node, wanted: Node) -> bool:
        return bool(self.traffic.mask(node) & self._masks[wanted[0]][wanted[1]])


def is_next_telegram(before: Node, after: Node, outlines: Sequence[TelegramOutline]) -> bool:
    """Whether a new telegram begins between two consecutive places."""
    if before[0] != after[0] or after[1] < before[1]:
        return True
    return after[1] == before[1] and not outlines[before[0]].places[before[1]].repeats


def _entries(outline: TelegramOutline, number: int) -> list[Node]:
    return [(number, place) for place in outline.following(-1) if place < len(outline.places)]


def _mask(codes: Iterable[int]) -> int:
    mask = 0
    for code in codes:
        mask |= 1 << code
    return mask


def character_map(sender: LineSettings, receiver: LineSettings) -> bytes | None:
    """Return the heard character for each of the 256 sent ones; None if that depends on the neighbouring characters."""
    receiver_bits = 1 + receiver.bytesize + (receiver.parity != "N") + 1
    sender_bits = 1 + sender.bytesize + (sender.parity != "N") + sender.stopbits
    if sender.baudrate != receiver.baudrate or receiver_bits > sender_bits:
        return None
    each = [heard(bytes([code]), sender, receiver) for code in range(256)]
    return b"".join(each) if all(len(one) == 1 for one in each) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class TelegramFinder:
    """Finder of telegrams in the received bytes. means: whether the reader accepts a telegram as its own."""

    codec: Codec
    direction: Direction
    means: Callable[[Message], bool]

    def taken(self, pieces: Iterable[bytes]) -> tuple[int, Framed] | None:
        """Return the first telegram that the reader accepts as its own, and the number of characters before it.

        Return None if there is no such telegram.
        """
        framer = Framer(self.codec, self.direction)
        done = 0
        for piece in pieces:
            for find in framer.feed(piece):
                if isinstance(find, Framed) and self.means(find.message):
                    return done, find
                if not isinstance(find, Damaged):
                    done += len(find.data)
        return None

    def reads_whole(self, data: bytes) -> bool:
        """Whether the reader reads these bytes as exactly one telegram."""
        return [find.data for find in Framer(self.codec, self.direction).feed(data) if isinstance(find, Framed)] == [
            data
        ]
