"""The run command of a Fuji inverter: S06, which carries terminals and run command together, and M14, which answers it.

FVR-E11S manual 9-20; AF-300 Ethernet manual p. 35, 36; HVAC/AQUA RS-485 manual, preface.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, ReplyError, StateError
from drivecomm.protocol import Exchange, Pause
from drivecomm_fuji import words
from drivecomm_fuji.telegrams import BROADCAST
from drivecomm_fuji.words import COMMAND, RUN, bit

if TYPE_CHECKING:
    from drivecomm_fuji.asking import Asking
    from drivecomm_fuji.memory import FujiMemory

_POLL_S = 0.05


class Running:
    """The motor of one inverter, or of all at station 99."""

    def __init__(self, address: int, asking: Asking, memory: FujiMemory, *, reset_timeout_s: float) -> None:
        self._address = address
        self._asking = asking
        self._memory = memory
        self._reset_timeout_s = reset_timeout_s

    def status_word(self) -> Exchange[int]:
        """Read M14; a motor that does not run has no run command that could be sent again."""
        reply = yield from self._asking.ask_for(words.STATUS)
        word: int = reply.data
        if not runs(word):
            # Whatever stopped it, nothing that is written from now on may start it again.
            self._memory.forget()
        return word

    def alarm_code(self) -> Exchange[int | None]:
        """Read the latest alarm; None when the inverter does not tell."""
        try:
            reply = yield from self._asking.ask_for(words.ALARM)
        except RefusedError:
            return None
        code: int = reply.data
        return code

    def start(self, direction: int, coast: int) -> Exchange[None]:
        """Set FWD or REV, and take the terminal to coast back. Raises StateError when there is an alarm."""
        word = yield from self.status_word()
        if bit(word, "ALM"):
            code = yield from self.alarm_code()
            raise StateError(f"the inverter has an alarm (code {code}) and cannot start; reset it first")
        yield from self.command(self._memory.word & ~(RUN | coast) | direction)

    def command(self, word: int) -> Exchange[None]:
        """Write S06. A run command is sent once and remembered only when it was confirmed."""
        acts = bool(word & (RUN | words.RESET))
        self._memory.word = word & ~(RUN | words.RESET)
        yield from self._asking.write(COMMAND, word, attempts=1 if acts else None, urgent=not word & RUN)
        self._memory.word = word & ~words.RESET

    def stop(self, coast: int) -> Exchange[None]:
        """Clear FWD and REV; coast: the bit of a terminal that makes it a coasting stop."""
        yield from self.command(self._memory.word & ~RUN | coast)

    def switch(self, on: int, off: int) -> Exchange[None]:
        """Set and clear terminals. Raises StateError when this would command a motor that runs."""
        if self._address != BROADCAST:
            yield from self._confirm_command()
        yield from self.command(self._memory.word & ~off | on)

    def _confirm_command(self) -> Exchange[None]:
        """Make sure that sending the run bits again, or none, changes nothing.

        The status alone is not enough: a motor that somebody else has stopped runs on while it ramps down.
        """
        status = yield from self.status_word()
        if not runs(status):
            return
        reply = yield from self._asking.ask_for(COMMAND)
        if reply.data & RUN != self._memory.word & RUN:
            self._memory.forget()
            raise StateError(
                "the motor runs, and S06 holds a run command that is not the one of this program; it carries terminals "
                "and run command together, so the motor would obey the other one: start or stop it from here first"
            )

    def reset(self, command: str | None) -> Exchange[None]:
        """Acknowledge an alarm, by S06 or by a command of its own, and wait until it is gone."""
        word = yield from self.status_word()
        if not bit(word, "ALM"):
            return
        yield from self.reset_all(command)
        waited = 0.0
        while True:
            word = yield from self.status_word()
            if not bit(word, "ALM"):
                return
            if waited >= self._reset_timeout_s:
                break
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S
        raise StateError("the alarm is still there after the reset; its cause lasts")

    def reset_all(self, command: str | None) -> Exchange[None]:
        """Take the run command away first: a reset with one present may start the motor (HVAC/AQUA manual, preface)."""
        idle = self._memory.word & ~RUN
        yield from self.command(idle)
        if command is not None:
            yield from self._asking.reset(command)
            return
        try:
            yield from self.command(idle | words.RESET)
        except ReplyError:
            with suppress(ReplyError):
                yield from self.command(idle)
            raise
        yield from self.command(idle)


def runs(word: int) -> bool:
    """Whether M14 says that the motor runs."""
    return (bit(word, "FWD") or bit(word, "REV")) and not bit(word, "ALM")
