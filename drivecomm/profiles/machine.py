"""The drive's side of a control profile: what control words make of the state, and the state of the motor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import Command, DriveState

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.profiles.profile import ControlProfile, State
    from drivecomm.protocol import Motor

_MOTOR = {
    "off": Command.OFF,
    "ramp": Command.RAMP_STOP,
    "quick": Command.QUICK_STOP,
    "dc_brake": Command.DC_BRAKE,
    "hold": Command.HOLD,
}


class ProfileMachine:
    """A drive that is commanded by a profile with states.

    wanted_hz: what the motor shall turn at by a control word, signed. word: the last one that commanded. The state that
    the profile names first is the one after mains is switched on; whichever means fault is the one of a trip.
    """

    def __init__(self, profile: ControlProfile, motor: Motor, wanted_hz: Callable[[int], float]) -> None:
        self.profile = profile
        self.motor = motor
        self.word = 0
        self._wanted_hz = wanted_hz
        self._states = {state.name: state for state in profile.states}
        self._fault = next(state for state in reversed(profile.states) if state.means is DriveState.FAULT)
        self.state = profile.states[0]

    def power_up(self, now: float) -> None:
        """Begin as after mains was switched off and on: no command, no fault."""
        self.motor.stop(Command.OFF, now)
        self.motor.reset(now)
        self.word, self.state = 0, self.profile.states[0]

    def enter(self, state: str, now: float) -> None:
        """Come to a state by something else than a control word."""
        self.state = self._states[state]
        self.act(now)

    def control(self, word: int, now: float) -> None:
        """Take a control word; one without the valid bits is ignored as a whole."""
        if not self.profile.commands(word):
            return
        self.follow(now)
        before, self.word = self.word, word
        self.state = self._next(word, before)
        if self.motor.fault and self.state.means is not DriveState.FAULT:
            self.motor.reset(now)
        self.act(now)

    def act(self, now: float) -> None:
        """Have the motor do what the state says, with the reference as it is now."""
        does = self.state.motor
        if does == "run":
            self.motor.run(self._wanted_hz(self.word), now)
        else:
            self.motor.stop(_MOTOR[does], now)

    def trip(self, code: int, now: float) -> None:
        """Switch the output off until a reset."""
        self.motor.trip(code, now)
        self.state = self._fault

    def follow(self, now: float) -> None:
        """Let time pass: the state follows a motor that has tripped or come to a standstill."""
        self.motor.advance(now)
        if self.motor.fault:
            self.state = self._fault
        elif self.state.stands and not self.motor.running:
            self.state = self._states[self.state.stands]

    def status_word(self) -> int:
        """Return the bits of the status word that say the state; the others are the drive's own."""
        return self.state.shows

    def _next(self, word: int, before: int) -> State:
        """Return the state that a control word leads to, over as many others as it leads through."""
        state = self.state
        for _ in self._states:
            found = next((each for each in self.profile.transitions if each.leads_on(state.name, word, before)), None)
            if found is None:
                break
            # An edge leads on once.
            state, before = self._states[found.goal], word
        return state
