"""Commanding a VLT: control words over time, and the status that shows whether they are obeyed.

VLT Series 3500 manual, printed pages 87 and 91; VLT 3000 manual MG.30.A7.02, pages 75 and 78.

Every telegram carries a control word. Reading, writing and asking for the status carry the idle word, whose bit 10 is
0, always, also after a start: a drive ignores it and keeps the last valid word (VLT 3000 manual, page 75). So only what
is meant to command does.

No reply says which of two like requests it answers, and the value, the status or the index of one may be wrong for the
other. Every request is therefore `nameless`: after a time-out the link lets a late reply pass before it asks for
something else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import NoReplyError, ReplyError, StateError
from drivecomm.protocol import Ask, Exchange, Pause, Tell
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.messages import Control, ControlReply
from drivecomm_vlt3500.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm_vlt3500.options import VltOptions

_POLL_S = 0.05
_SETUP = words.SETUP_LOW | words.SETUP_HIGH
_MOVING = words.START | words.JOG_1 | words.JOG_2
_OBEYED = words.RUNNING | words.ENABLED


class VltMemory:
    """What a master remembers of one drive, shared by all who speak to it on one bus.

    commanded: the last valid control word that the drive has confirmed; None while none was sent, and when it is open
    whether one arrived. setup: the set-up that control words select, as their bits.
    """

    def __init__(self) -> None:
        self.commanded: int | None = None
        self.setup = 0

    def forget(self) -> None:
        """Forget the last control word, which further ones would build on."""
        self.commanded = None

    def watch(self, silence_s: float | None) -> None:
        """Do nothing: nothing is repeated for a watchdog."""


class Commander:
    """Sends control words to one drive, or to all at address 0, and remembers what a master must."""

    def __init__(self, address: int, options: VltOptions, memory: VltMemory) -> None:
        self._address = address
        self._options = options
        self._memory = memory

    def ask_idle(self, request: Any, *, attempts: int | None = None, acts: bool = False) -> Exchange[Any]:
        """Ask with the idle word; where only a copy of the request came, say that it may have been the reply."""
        try:
            return (yield Ask(message=request, attempts=attempts, acts=acts, nameless=True))
        except NoReplyError as error:
            if "hands back" not in str(error) or self._options.idle_word & 0xF == 0xF:
                raise
            raise NoReplyError(
                f"{error}; or a drive in local operation answered byte for byte what it was sent: use idle_word=0x000F",
                says="idle_word=0x000F",
            ) from None

    def status_word(self, *, attempts: int | None = None) -> Exchange[int]:
        """Ask for the status word with a C telegram that commands nothing."""
        request = Control(address=self._address, control_word=self._options.idle_word)
        reply: ControlReply = yield from self.ask_idle(request, attempts=attempts)
        return reply.status_word

    def command(
        self, word: int, *, mask: int = 0xFFFF, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[int]:
        """Send a control word and return the status word; nobody answers a broadcast, which gives 0.

        urgent: for what stops the motor, see `Ask`.
        """
        before, self._memory.commanded = self._memory.commanded, None
        request = Control(address=self._address, control_word=word, control_mask=None if mask == 0xFFFF else mask)
        status = 0
        if self._address == BROADCAST:
            yield Tell(message=request)
        else:
            reply: ControlReply = yield Ask(message=request, attempts=attempts, acts=True, nameless=True, urgent=urgent)
            status = reply.status_word
        if not word & words.VALID:
            self._memory.commanded = before
        elif mask == 0xFFFF or before is not None:
            self._memory.commanded = (before or 0) & ~mask | word
        if word & words.VALID and mask & _SETUP:
            self._memory.setup = word & _SETUP
        return status

    def run(self, word: int) -> Exchange[None]:
        """Send a word that makes the motor run, and wait until it does; a start that is not obeyed is taken back."""
        status = yield from self.status_word()
        if status & words.TRIPPED:
            raise StateError("the drive has tripped and cannot start; reset it first")
        if not status & words.BUS_CONTROL:
            raise StateError("the drive is in local operation and cannot be started over the bus; set it to remote")
        if status & words.START_NOT_POSSIBLE:
            yield from self.command(words.OFF1 | self._memory.setup)
        status = yield from self.command(word | self._memory.setup, attempts=1)
        try:
            status = yield from self._await(_OBEYED, _OBEYED, status)
        except ReplyError as error:
            raise type(error)(f"{error}; the drive had been told to run before") from None
        if status & _OBEYED == _OBEYED:
            return
        # Standing orders are accidents: it would run whenever its last start condition comes.
        yield from self.command(words.RAMP_STOP | self._memory.setup)
        why = ", ".join(words.flags_of(status)) or "nothing"
        raise StateError(
            f"the drive did not run within {self._options.state_timeout_s:g} s after the start, which was taken back; "
            f"its status word 0x{status:04X} says: {why}; check its digital inputs and parameters 503 to 510"
        )

    def stop(self, word: int, reported: int) -> Exchange[None]:
        """Send a word that stops the motor. reported: the status bits that show that the drive obeys."""
        status = yield from self.command(word | self._memory.setup, urgent=True)
        if self._address == BROADCAST:
            return
        status = yield from self._await(reported, reported, status)
        if status & reported != reported or (status & words.RUNNING and not status & words.BUS_CONTROL):
            raise StateError(
                f"the drive got the stop (0x{word:04X}) and does not report it: status word 0x{status:04X}; in local "
                "operation it does not obey the bus"
            )

    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with bit 7 from 0 to 1 and back; does nothing without a trip.

        The edge is what counts (as on later drives; the pages seen do not say). Bit 6 is 0 in all three words, so that
        nothing starts by it.
        """
        status = yield from self.status_word()
        if not status & words.TRIPPED:
            return
        stopped = words.RAMP_STOP | self._memory.setup
        yield from self.command(stopped, attempts=1)
        yield from self.command(stopped | words.RESET, attempts=1)
        status = yield from self.command(stopped)
        status = yield from self._await(words.TRIPPED, 0, status)
        if status & words.TRIPPED:
            raise StateError("the drive was told to reset and is still tripped; its fault may still be there")

    def step(self, bit: int, verb: str) -> Exchange[None]:
        """Set a bit of the last control word and take it away again."""
        word = yield from self._confirmed(verb)
        try:
            yield from self.command(word | bit, attempts=1)
        except ReplyError:
            # The drive may have it: take the bit away, or it could go on and on.
            yield from self.command(word)
            raise
        yield from self.command(word)

    def amend(self, change: Callable[[int], int], verb: str) -> Exchange[None]:
        """Send the last control word, changed."""
        word = yield from self._confirmed(verb)
        yield from self.command(change(word))

    def select(self, setup: int) -> Exchange[None]:
        """Select a set-up in the last control word and in all that follow."""
        word = yield from self._confirmed("set_up")
        yield from self.command(word & ~_SETUP | setup)

    def _confirmed(self, verb: str) -> Exchange[int]:
        """Return the last control word, if what it says still holds: a word sent again must not start a motor."""
        word = self._memory.commanded
        if word is None:
            raise StateError(
                f"{verb} changes the last control word, and this program has none that the drive has confirmed; "
                "start or stop the drive first"
            )
        status = yield from self.status_word()
        if word & _MOVING and not status & words.RUNNING:
            raise StateError(f"{verb} would start the drive again, which has stopped meanwhile; use start")
        return word

    def _await(self, bits: int, goal: int, status: int) -> Exchange[int]:
        """Ask for the status until these bits are so, at most for the state time-out; return the last status."""
        waited = 0.0
        while status & bits != goal and waited < self._options.state_timeout_s:
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S
            status = yield from self.status_word()
        return status
