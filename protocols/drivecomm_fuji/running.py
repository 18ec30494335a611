"""The run command of a Fuji inverter: S06, which carries terminals and run command together, and M14, which answers it.

FVR-E11S manual 9-20; AF-300 Ethernet manual p. 35, 36; HVAC/AQUA RS-485 manual, preface.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm.errors import ReplyError, StateError
from drivecomm.protocol import Exchange, Stop, unless_refused
from drivecomm_fuji import words
from drivecomm_fuji.telegrams import BROADCAST
from drivecomm_fuji.words import COMMAND, RUN

if TYPE_CHECKING:
    from drivecomm.profiles import Commander, ControlProfile, Step, Words
    from drivecomm_fuji.asking import Asking
    from drivecomm_fuji.memory import FujiMemory
    from drivecomm_fuji.options import FujiOptions


class Running:
    """The motor of one inverter, or of all at station 99."""

    def __init__(self, address: int, options: FujiOptions, asking: Asking, memory: FujiMemory) -> None:
        self._address = address
        self._options = options
        self._asking = asking
        self._memory = memory

    @cached_property
    def profile(self) -> ControlProfile:
        """The control profile, with the terminal that is assigned to coasting: set by that stop, cleared by a start."""
        known, name = words.control_profile(), self._options.coast_terminal
        if not name:
            return known
        coast = 1 << self._options.generation.terminals[name]
        start, backwards = (
            tuple(replace(step, mask=RUN | coast) for step in steps) for steps in (known.start, known.start_reverse)
        )
        stops = {**known.stops, Stop.COAST: (profiles.Step(word=coast, mask=RUN | coast, repeats=True),)}
        return replace(known, start=start, start_reverse=backwards, stops=stops)

    def look(self) -> Exchange[Words]:
        """Read M14; a motor that does not run has no run command that could be sent again."""
        reply = yield from self._asking.ask_for(words.STATUS)
        seen = {profiles.ONLY: reply.data}
        if not words.control_profile().says("running", seen):
            # Whatever stopped it, nothing that is written from now on may start it again.
            self._memory.forget()
        return seen

    def send(self, step: Step, *, urgent: bool) -> Exchange[None]:  # noqa: ARG002 - the word tells
        """Change those bits of S06 that the step is about, or send the command that stands in its place.

        RST is taken back when it is open whether it arrived.
        """
        if step.place:
            yield from self._asking.reset(step.place)
            return
        word = self._memory.word & ~step.mask | step.word
        try:
            yield from self.command(word)
        except ReplyError:
            if word & words.RESET:
                with suppress(ReplyError):
                    yield from self.command(word & ~words.RESET)
            raise

    def again(self, _step: Step) -> Exchange[Words]:
        """Read M14: no command is sent again."""
        return self.look()

    def alarm_code(self) -> Exchange[int | None]:
        """Read the latest alarm; None when the inverter does not tell."""
        reply = yield from unless_refused(self._asking.ask_for(words.ALARM))
        return None if reply is None else reply.data

    def start(self, *, reverse: bool) -> Exchange[None]:
        """Set FWD or REV. Raises StateError when there is an alarm."""
        return self.commander(self.profile).start(reverse=reverse)

    def stop(self, how: Stop) -> Exchange[None]:
        """Clear FWD and REV; to coast, set the terminal for it, too."""
        return self.commander(self.profile).stop(how)

    def reset(self, command: str = "") -> Exchange[None]:
        """Acknowledge an alarm by RST, or by a command of its own, and wait until it is gone; nothing without one."""
        known = self.profile
        before, *_, last = known.reset
        reset = (before, replace(last, place=command)) if command else known.reset
        try:
            yield from self.commander(replace(known, reset=reset)).reset()
        except StateError as error:
            raise StateError(f"the alarm is still there: {error}") from None

    def command(self, word: int) -> Exchange[None]:
        """Write S06. A run command is sent once and remembered only when it was confirmed."""
        acts = bool(word & (RUN | words.RESET))
        self._memory.word = word & ~(RUN | words.RESET)
        yield from self._asking.write(COMMAND, word, attempts=1 if acts else None, urgent=not word & RUN)
        self._memory.word = word & ~words.RESET

    def switch(self, on: int, off: int) -> Exchange[None]:
        """Set and clear terminals. Raises StateError when this would command a motor that runs."""
        if self._address != BROADCAST:
            yield from self._confirm_command()
        yield from self.command(self._memory.word & ~off | on)

    def commander(self, known: ControlProfile) -> Commander:
        """Return who commands by a profile."""
        return profiles.Commander(
            known,
            self,
            state_timeout_s=self._options.reset_timeout_s,
            answers=self._address != BROADCAST,
            fault_code=self.alarm_code,
        )

    def _confirm_command(self) -> Exchange[None]:
        """Make sure that sending the run bits again, or none, changes nothing.

        The status alone is not enough: a motor that somebody else has stopped runs on while it ramps down.
        """
        status = yield from self.look()
        if not words.control_profile().says("running", status):
            return
        reply = yield from self._asking.ask_for(COMMAND)
        if reply.data & RUN != self._memory.word & RUN:
            self._memory.forget()
            raise StateError(
                "the motor runs, and S06 holds a run command that is not the one of this program; it carries terminals "
                "and run command together, so the motor would obey the other one: start or stop it from here first"
            )
