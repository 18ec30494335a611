"""A virtual drive under observation: its values over time, and its replies."""

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

from drivecomm.protocol import Framed


@dataclass(frozen=True)
class Answer:
    """Time, request and reply of the drive."""

    time: float
    request: bytes
    reply: bytes


class Watched:
    """A virtual drive with a history of its values.

    horizon_s: time after a request in which it may still take effect.
    """

    def __init__(self, drive, broadcast_address, horizon_s):
        self.answers = []
        self.said = deque(maxlen=200)
        self._drive = drive
        self._broadcast = broadcast_address
        self._horizon_s = horizon_s
        self._times = {}
        self._held = {}
        self._asked = {}
        self._current = ""
        self._written = {}

    def __getattr__(self, name):
        return getattr(self._drive, name)

    def hear(self, find, now):
        answer = self._drive.hear(find, now)
        if answer is not None:
            self.answers.append(Answer(now, find.data, answer.data))
            self.said.append(answer.data)
        if answer is not None or self._could_mean_it(find):
            self._look(now)
        return answer

    def power_cycle(self, now):
        if hasattr(self._drive, "power_cycle"):
            self._drive.power_cycle(now)
        self._look(now)

    def begin(self, name, now):
        """Record that this parameter is requested now, and its present value."""
        self.answers.clear()
        self._note(name, now)
        times = [time for time in self._asked.get(name, []) if now - time < self._horizon_s]
        self._asked[name] = [*times, now]
        self._current = name

    def wrote(self, name, now):
        """Keep watching this parameter: the write may take effect later, and twice."""
        self._written[name] = now

    def poke(self, name, raw, now):
        self._note(name, now)
        self._drive.poke(name, raw)
        self._note(name, now)

    def held_for(self, name, since):
        """Return the values held at any time since then."""
        start = max(0, bisect_right(self._times[name], since) - 1)
        return self._held[name][start:]

    def could_answer(self, name):
        """Return the values that a reply about this parameter may show, including late replies to earlier requests."""
        return self.held_for(name, min(self._asked[name]))

    def _could_mean_it(self, find):
        """Whether a request may have acted on this drive.

        A disturbed address can turn a write to another drive into a write to this one or a broadcast.
        """
        if not isinstance(find, Framed):
            return True
        return getattr(find.message, "address", self.address) in (self.address, self._broadcast)

    def _look(self, now):
        if self._current:
            # Some registers count received telegrams, so they change with the traffic on the line.
            self._note(self._current, now)
        for name, written in list(self._written.items()):
            if now - written > self._horizon_s:
                del self._written[name]
            elif name != self._current:
                self._note(name, now)

    def _note(self, name, now):
        raw = self._drive.peek(name, now)
        times, held = self._times.setdefault(name, []), self._held.setdefault(name, [])
        if not held or held[-1] != raw:
            times.append(now)
            held.append(raw)
            del times[:-200], held[:-200]
