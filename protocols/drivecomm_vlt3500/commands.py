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

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NoReplyError, ReplyError, StateError
from drivecomm.protocol import Ask, Exchange, Stop, Tell
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.messages import Control, ControlReply
from drivecomm_vlt3500.telegrams import BROADCAST
from drivecomm_vlt3500.words import profile

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from drivecomm.profiles import Commander, ControlProfile, Step, Words
    from drivecomm_vlt3500.options import VltOptions

_SETUP = words.SETUP_LOW | words.SETUP_HIGH
_MOVING = words.START | words.JOG_1 | words.JOG_2


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


class Motion:
    """The motor of one drive, or of all at address 0: sends control words, and remembers what a master must."""

    def __init__(self, address: int, options: VltOptions, memory: VltMemory) -> None:
        self._address = address
        self._options = options
        self._memory = memory
        # The status word of the last reply; nobody answers a broadcast.
        self._seen = 0

    @cached_property
    def _profile(self) -> ControlProfile:
        known, dc_brake = profile(), self._options.dc_brake
        return replace(
            known, stops={how: steps for how, steps in known.stops.items() if how is not Stop.DC_BRAKE or dc_brake}
        )

    @property
    def stops(self) -> Collection[Stop]:
        """How the drive can be stopped."""
        return self._profile.stops.keys()

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
        self._seen = reply.status_word
        return reply.status_word

    def command(
        self, word: int, *, mask: int = 0xFFFF, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[int]:
        """Send a control word and return the status word; nobody answers a broadcast, which gives 0.

        urgent: for what stops the motor, see `Ask`.
        """
        before, self._memory.commanded = self._memory.commanded, None
        request = Control(address=self._address, control_word=word, control_mask=None if mask == 0xFFFF else mask)
        self._seen = 0
        if self._address == BROADCAST:
            yield Tell(message=request)
        else:
            reply: ControlReply = yield Ask(message=request, attempts=attempts, acts=True, nameless=True, urgent=urgent)
            self._seen = reply.status_word
        if not word & words.VALID:
            self._memory.commanded = before
        elif mask == 0xFFFF or before is not None:
            self._memory.commanded = (before or 0) & ~mask | word
        if word & words.VALID and mask & _SETUP:
            self._memory.setup = word & _SETUP
        return self._seen

    def look(self) -> Exchange[Words]:
        """Return the status word."""
        return {profiles.ONLY: (yield from self.status_word())}

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:
        """Send a word in the set-up that is selected; its reply shows the status."""
        word, attempts = step.word | self._memory.setup, None if step.repeats else 1
        return {profiles.ONLY: (yield from self.command(word, attempts=attempts, urgent=urgent))}

    def again(self, _step: Step) -> Exchange[Words]:
        """Return the status word: no command is sent again."""
        return self.look()

    def start(self, *, reverse: bool) -> Exchange[None]:
        """Start, and wait until the motor runs; a start that is not obeyed is taken back."""
        return self._by(self._profile).start(reverse=reverse)

    def jog(self, bit: int) -> Exchange[None]:
        """Run by a jog bit in the same way, without bit 6, so that any stop ends it."""
        *before, last = self._profile.start
        jogs = replace(last, word=last.word & ~words.START | bit)
        return self._by(replace(self._profile, start=(*before, jogs))).start()

    def stop(self, how: Stop) -> Exchange[None]:
        """Stop, and make sure that the drive obeys."""
        yield from self._by(self._profile).stop(how)
        status = profile().status({profiles.ONLY: self._seen})
        if status.running and not status.remote:
            raise StateError(
                f"the drive got the stop and does not report it: status word 0x{self._seen:04X}; in local operation it "
                "does not obey the bus"
            )

    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with bit 7 from 0 to 1 and back; does nothing without a trip."""
        return self._by(self._profile).reset()

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
        seen = yield from self.look()
        if word & _MOVING and not profile().says("running", seen):
            raise StateError(f"{verb} would start the drive again, which has stopped meanwhile; use start")
        return word

    def _by(self, known: ControlProfile) -> Commander:
        return profiles.Commander(
            known,
            self,
            state_timeout_s=self._options.state_timeout_s,
            advice="its digital inputs and parameters 503 to 510",
            answers=self._address != BROADCAST,
        )
