"""The drive's side of a profile without states: commands that are complete with what was just written.

Such a drive has a register, or a coil, for each thing that it can be told. The steps of a command that go to one place
must come in their order (0006, 0007, 000F); those to other places must hold at that time (direction, then run).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.profiles.shown_status import motor_truth, own_truth, shown
from drivecomm.protocol import Command, Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from drivecomm.profiles.profile import Condition, ControlProfile, Step, Words
    from drivecomm.protocol import Motor

_STOPS = {
    Stop.COAST: Command.OFF,
    Stop.QUICK: Command.QUICK_STOP,
    Stop.DC_BRAKE: Command.DC_BRAKE,
    Stop.RAMP: Command.RAMP_STOP,
}
"""In the order in which they are looked for."""

_STARTS = ("reverse", "start")


class OrderMachine:
    """A drive that is commanded by places of its own.

    wanted_hz: the reference as it is now, unsigned by the command. way: what the status shows before the first step of
    a start and after each. reverse: which way the last start was.
    """

    def __init__(
        self, profile: ControlProfile, motor: Motor, wanted_hz: Callable[[], float], way: Condition | None = None
    ) -> None:
        self.motor = motor
        self._way = way
        self.reverse = False
        self._wanted_hz = wanted_hz
        # Stops before starts: what could be both is a stop first.
        stops = {how.value: profile.stops.get(how, ()) for how in _STOPS}
        self._orders = {**stops, "reverse": profile.start_reverse, "start": profile.start}
        self._done: dict[tuple[str, str], int] = {}
        self._reset = profile.reset
        self._before: Words = {}

    def power_up(self, words: Words, now: float) -> None:
        """Begin with mains switched on; what a place then holds counts only where it is the one step of a command."""
        self.motor.stop(Command.OFF, now)
        self.motor.reset(now)
        for name, place, steps in self._by_place():
            self._done[name, place] = int(len(steps) == 1 and _means(steps[0], words[place]))
        self._before = dict(words)

    def written(self, places: Collection[str], words: Words, now: float) -> None:
        """Obey what is complete now that these places have been written."""
        if self._acknowledges(places, words):
            self.motor.reset(now)
        self._before = dict(words)
        for name in self._complete(places, words):
            if name in _STARTS:
                self.reverse = name == "reverse"
                self.act(now)
            else:
                self.motor.stop(_STOPS[Stop(name)], now)

    def stop(self, how: Stop, now: float) -> None:
        """Stop the motor by itself, without a command."""
        self.motor.stop(_STOPS[how], now)

    def trip(self, code: int, now: float) -> None:
        """Trip with this fault code."""
        self.motor.trip(code, now)

    def follow(self, now: float) -> None:
        """Let time pass."""
        self.motor.advance(now)

    def act(self, now: float) -> None:
        """Run with the reference as it is now."""
        self.motor.run(-self._wanted_hz() if self.reverse else self._wanted_hz(), now)

    def status_words(self, said: Mapping[str, Condition]) -> dict[str, int]:
        """Return the status words in which the conditions of these names are as they are now.

        "always" is so at all times; a name that is not known never is.
        """
        if self._way is not None:
            said = {**said, "way": replace(self._way, values=(self._way.values[self._stage()],))}
        words = dict.fromkeys((condition.place for condition in said.values()), 0)
        return shown(words, said, {**own_truth(self.motor), **motor_truth(self.motor)})

    def _stage(self) -> int:
        """Return how many steps of a start are done; a motor that still turns has not left the last."""
        steps = self._orders["start"]
        return len(steps) if self.motor.running else self._done["start", steps[-1].place]

    def _acknowledges(self, places: Collection[str], words: Words) -> bool:
        """Whether what was written is the reset: an edge, where a further step takes its bits back."""
        place = self._reset[-1].place if self._reset else ""
        if place not in places:
            return False
        own = [step for step in self._reset if step.place == place]
        sets = max(own, key=lambda step: step.word & step.mask)
        rises = not all(_means(sets, step.word) for step in own)
        others = {step.place: step for step in self._reset if step.place != place}
        return (
            _means(sets, words[place])
            and not (rises and _means(sets, self._before[place]))
            and all(_means(step, words[other]) for other, step in others.items())
        )

    def _complete(self, places: Collection[str], words: Words) -> Iterator[str]:
        by_name: dict[str, list[tuple[str, Sequence[Step]]]] = {}
        for name, place, steps in self._by_place():
            by_name.setdefault(name, []).append((place, steps))
        for name, own in by_name.items():
            touched = [(place, steps) for place, steps in own if place in places]
            for place, steps in touched:
                # A motor that runs needs only the last step to run the other way.
                runs = name in _STARTS and self.motor.command is Command.RUN and _means(steps[-1], words[place])
                self._done[name, place] = (
                    len(steps) if runs else _progress(steps, self._done[name, place], words[place])
                )
            if touched and all(self._done[name, place] == len(steps) for place, steps in own):
                yield name

    def _by_place(self) -> Iterator[tuple[str, str, Sequence[Step]]]:
        """Yield the steps of each command that go to one place."""
        for name, steps in self._orders.items():
            for place in dict.fromkeys(step.place for step in steps):
                yield name, place, [step for step in steps if step.place == place]


def _means(step: Step, word: int) -> bool:
    """Whether a written word is this step."""
    return word & step.mask == step.word & step.mask


def _progress(steps: Sequence[Step], done: int, word: int) -> int:
    """Return how many steps to one place are done after this word."""
    reached = done
    while reached < len(steps) and _means(steps[reached], word):
        reached += 1
    if reached > done:
        return reached
    return next((number for number in range(done, 0, -1) if _means(steps[number - 1], word)), 0)
