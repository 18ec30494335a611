"""A virtual drive whose control and status words are registers and follow the state machine of a standard.

It reacts as the standard says to any control word from any master, and not only to the words of its own model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.profiles.machine import ProfileMachine
from drivecomm.profiles.shown_status import facts_without_state, set_status_bits

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.profiles.profile import BitCondition, ControlProfile, Words
    from drivecomm.protocol import Motor, Stop


@dataclass(frozen=True, slots=True, kw_only=True)
class StateMachine:
    """The control profile by which a virtual drive acts, and the places of its control and status word.

    reset_lock_s: seconds after a trip in which it obeys no reset. contacts: bits of the control word that start the
    motor as contacts do, while the model's `needs` do not hold and the word commands nothing; 0 if the word commands
    nevertheless.
    """

    profile: ControlProfile
    control_word: str
    status_word: str
    reset_lock_s: float = 0.0
    contacts: int = 0


class StateMachineOrders:
    """The drive's side of a control profile with states, in place of a `RegisterCommandMachine`.

    wanted_hz: returns the present reference, signed, before the control word gives it a direction. control_word:
    returns the present control word. parts: further places that hold bits of it. is_set_up: returns whether the drive
    obeys the bus.
    """

    def __init__(
        self,
        machine: StateMachine,
        motor: Motor,
        wanted_hz: Callable[[], float],
        *,
        control_word: Callable[[], int],
        parts: Collection[str],
        is_set_up: Callable[[], bool],
    ) -> None:
        self._contacts, self._is_set_up = machine.contacts, is_set_up
        self._profile, self._status_place = machine.profile, machine.status_word
        self._control_word, self._control_places = control_word, {machine.control_word, *parts}
        self._machine = ProfileMachine(
            machine.profile, motor, lambda word: machine.profile.directed(word, wanted_hz()), machine.reset_lock_s
        )

    def power_up(self, words: Words, now: float) -> None:  # noqa: ARG002 - for `RegisterCommandMachine`
        """Begin with mains switched on, and with the control word that is in its register then."""
        self._machine.power_up(now)
        self._machine.control(self._control_word(), now)

    def written(self, places: Collection[str], words: Words, now: float) -> None:  # noqa: ARG002 - for the other class
        """Obey the control word if it, or a part of it, has been written."""
        if self._control_places.isdisjoint(places):
            return
        if self._contacts and not self._is_set_up() and not self._machine.motor.fault:
            self._machine.contacts(self._control_word(), self._contacts, now)
        else:
            self._machine.control(self._control_word(), now)

    def stop(self, how: Stop, now: float) -> None:
        """Stop the motor without a command from the bus, as if the word of this stop had arrived."""
        self._machine.control(self._profile.stops[how][-1].word, now)

    def trip(self, code: int, now: float) -> None:
        """Trip with this fault code."""
        self._machine.trip(code, now)

    def follow(self, now: float) -> None:
        """Advance the time: the state follows a motor that has tripped or come to a standstill."""
        self._machine.follow(now)

    def act(self, now: float) -> None:
        """Run with the present reference."""
        self._machine.act(now)

    def status_words(self, said: Mapping[str, BitCondition]) -> dict[str, int]:
        """Return the status words: the state as the profile shows it, and further statements by these conditions."""
        words = dict.fromkeys((condition.place for condition in said.values()), 0)
        words[self._status_place] = self._machine.status_word()
        remote = not self._contacts or self._is_set_up()
        return set_status_bits(words, said, {**facts_without_state(self._machine.motor), "remote": remote})
