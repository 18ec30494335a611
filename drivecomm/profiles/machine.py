"""The drive's side of a control profile: changes of the state by control words, and the motor in each state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import Command, DriveState, Stop

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles.profile import ControlProfile, MotorDoes
    from drivecomm.protocol import Motor

_STOPS = {
    "off": Command.OFF,
    "ramp": Command.RAMP_STOP,
    "quick": Command.QUICK_STOP,
    "dc_brake": Command.DC_BRAKE,
    "hold": Command.HOLD,
}


def have_do(motor: Motor, does: MotorDoes, hz: Callable[[], float], now: float) -> None:
    """Make a motor act as a state demands.

    hz: returns the frequency at which it runs, signed.
    """
    if does == "run":
        motor.run(hz(), now)
    else:
        motor.stop(_STOPS[does], now)


class ProfileMachine:
    """A drive that is commanded by a profile with states.

    wanted_hz: returns the frequency that a control word demands, signed. reset_lock_s: seconds after a trip in which no
    reset is obeyed. word: the last control word that commanded. The first state of the profile is the state after
    power-up; the last one that means fault is the state of a trip.
    """

    def __init__(
        self, profile: ControlProfile, motor: Motor, wanted_hz: Callable[[int], float], reset_lock_s: float = 0.0
    ) -> None:
        self.profile = profile
        self.motor = motor
        self.word = 0
        self._wanted_hz = wanted_hz
        self._reset_lock_s, self._tripped_at = reset_lock_s, 0.0
        self._fault = next(state for state in reversed(profile.states) if state.means is DriveState.FAULT)
        self.state = profile.states[0]

    def power_up(self, now: float) -> None:
        """Begin as after a power-up: no command, no fault."""
        self.motor.stop(Command.OFF, now)
        self.motor.reset(now)
        self.word, self.state = 0, self.profile.states[0]

    def enter(self, state: str, now: float) -> None:
        """Enter a state for another reason than a control word."""
        self.state = self.profile.state(state)
        self.act(now)

    def control(self, word: int, now: float) -> None:
        """Obey a control word; without the valid bits, only the bits count that stop by being 0."""
        if not self.profile.commands(word):
            if not self.profile.off:
                return
            word = self.word & (word | ~self.profile.off)
        self.follow(now)
        before, self.word = self.word, word
        if self.motor.fault and now - self._tripped_at < self._reset_lock_s:
            return
        self.state = self.profile.next_state(self.state, word, before)
        if self.motor.fault and self.state.means is not DriveState.FAULT:
            self.motor.reset(now)
        self.act(now)

    def contacts(self, word: int, starting: int, now: float) -> None:
        """Obey a word whose bits are contacts: any of the starting bits starts the motor; without them it stops."""
        running = next(state for state in self.profile.states if state.motor == "run")
        stopped = self.profile.next_state(running, self.profile.stops[Stop.RAMP][-1].word, 0)
        self.word = word
        self.enter((running if word & starting else stopped).name, now)

    def act(self, now: float) -> None:
        """Make the motor act as the state demands, with the present reference."""
        have_do(self.motor, self.state.motor, lambda: self._wanted_hz(self.word), now)

    def trip(self, code: int, now: float) -> None:
        """Switch the output off until a reset."""
        self.motor.trip(code, now)
        self.state, self._tripped_at = self._fault, now

    def follow(self, now: float) -> None:
        """Advance the time: the state follows a motor that has tripped or come to a standstill."""
        self.motor.advance(now)
        if self.motor.fault:
            if self.state is not self._fault:
                self.state, self._tripped_at = self._fault, now
        elif self.state.stands and not self.motor.running:
            self.state = self.profile.state(self.state.stands)

    def status_word(self) -> int:
        """Return the bits of the status word that show the state; the drive sets the others."""
        return self.state.shows
