"""The drive's side of a profile without states: a command is obeyed as soon as its last step is written.

Such a drive has a register or a coil for each command. Steps of a command that go to the same place must come in order
(0006, 0007, 000F). Steps that go to other places must hold at that time (direction, then run).
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
"""Motor commands of the stops, in the order in which stops are checked."""

_STARTS = ("reverse", "start")


class OrderMachine:
    """A virtual drive that has a place of its own for each command.

    wanted_hz: returns the present reference, without the direction of the command. way: the values of the status before
    the first step of a start and after each. reverse: whether the last start was backwards.
    """

    def __init__(
        self, profile: ControlProfile, motor: Motor, wanted_hz: Callable[[], float], way: Condition | None = None
    ) -> None:
        self.motor = motor
        self._way = way
        self.reverse = False
        self._wanted_hz = wanted_hz
        # Stops come before starts: a word that may mean both counts as a stop first.
        stops = {how.value: profile.stops.get(how, ()) for how in _STOPS}
        self._orders = {**stops, "reverse": profile.start_reverse, "start": profile.start}
        self._done: dict[tuple[str, str], int] = {}
        self._reset = profile.reset
        self._before: Words = {}

    def power_up(self, words: Words, now: float) -> None:
        """Begin with mains switched on; the content of a place counts only as the single step of a command."""
        self.motor.stop(Command.OFF, now)
        self.motor.reset(now)
        for name, place, steps in self._by_place():
            self._done[name, place] = int(len(steps) == 1 and _means(steps[0], words[place]))
        self._before = dict(words)

    def written(self, places: Collection[str], words: Words, now: float) -> None:
        """Obey the commands that are complete after a write to these places."""
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
        """Stop the motor without a command from the bus."""
        self.motor.stop(_STOPS[how], now)

    def trip(self, code: int, now: float) -> None:
        """Trip with this fault code."""
        self.motor.trip(code, now)

    def follow(self, now: float) -> None:
        """Advance the motor to the time `now`."""
        self.motor.advance(now)

    def act(self, now: float) -> None:
        """Run with the present reference."""
        self.motor.run(-self._wanted_hz() if self.reverse else self._wanted_hz(), now)

    def status_words(self, said: Mapping[str, Condition]) -> dict[str, int]:
        """Return the status words that show which of these conditions hold now.

        said: the conditions by name. "always" holds at all times; an unknown name never holds.
        """
        if self._way is not None:
            said = {**said, "way": replace(self._way, values=(self._way.values[self._stage()],))}
        words = dict.fromkeys((condition.place for condition in said.values()), 0)
        return shown(words, said, {**own_truth(self.motor), **motor_truth(self.motor)})

    def _stage(self) -> int:
        """Return the number of completed steps of a start; all of them while the motor still turns."""
        steps = self._orders["start"]
        return len(steps) if self.motor.running else self._done["start", steps[-1].place]

    def _acknowledges(self, places: Collection[str], words: Words) -> bool:
        """Return whether a write is the reset: an edge, if a further step of the reset clears its bits."""
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
                # A running motor needs only the last step to change its direction.
                runs = name in _STARTS and self.motor.command is Command.RUN and _means(steps[-1], words[place])
                self._done[name, place] = (
                    len(steps) if runs else _progress(steps, self._done[name, place], words[place])
                )
            if touched and all(self._done[name, place] == len(steps) for place, steps in own):
                yield name

    def _by_place(self) -> Iterator[tuple[str, str, Sequence[Step]]]:
        """Yield the name of each command, each place of its steps, and the steps that go there."""
        for name, steps in self._orders.items():
            for place in dict.fromkeys(step.place for step in steps):
                yield name, place, [step for step in steps if step.place == place]


def _means(step: Step, word: int) -> bool:
    """Return whether a written word is this step."""
    return word & step.mask == step.word & step.mask


def _progress(steps: Sequence[Step], done: int, word: int) -> int:
    """Return the number of completed steps to one place after this word."""
    reached = done
    while reached < len(steps) and _means(steps[reached], word):
        reached += 1
    if reached > done:
        return reached
    return next((number for number in range(done, 0, -1) if _means(steps[number - 1], word)), 0)
