"""Asking and commanding one VLT: parameters, control words, and what a master remembers of them.

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

from drivecomm import profiles
from drivecomm.errors import NoReplyError, RefusedError, ReplyError, StateError
from drivecomm.protocol import Ask, Tell, kept
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.messages import Control, ControlReply, Read, ReadIndex, Reply, Update
from drivecomm_vlt3500.parameters import cause_text
from drivecomm_vlt3500.telegrams import BROADCAST
from drivecomm_vlt3500.words import profile

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.profiles import Step, Words
    from drivecomm.protocol import Exchange
    from drivecomm_vlt3500.options import VltOptions
    from drivecomm_vlt3500.parameters import Target

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


class Conversation:
    """Words to one drive, or to all at address 0. seen: the status word of the last reply, 0 where nobody answers."""

    def __init__(self, address: int, options: VltOptions, memory: VltMemory) -> None:
        self.seen = 0
        self._address = address
        self._options = options
        self._memory = memory
        self._idle: dict[str, Any] = {"address": address, "control_word": options.idle_word}
        self._question = kept(self._new_question)

    def read(self, wanted: Target) -> Exchange[Decimal]:
        """Ask for a parameter, or an element of an indexed one. Raises RefusedError."""
        return _value(wanted, (yield from self._ask_idle(self._question(wanted.number, wanted.index))))

    def write(self, wanted: Target, value: Decimal, decimals: int, attempts: int) -> Exchange[Decimal | None]:
        """Write a parameter and return what the drive reports then, None where nobody answers. Raises RefusedError."""
        request = Update(**self._idle, parameter=wanted.number, value=value, decimals=decimals)
        if self._address == BROADCAST:
            yield Tell(message=request)
            return None
        ask = Ask(message=request, attempts=attempts, acts=True, nameless=True)
        return _value(wanted, (yield from self._ask_idle(ask)))

    def status_word(self, *, attempts: int | None = None) -> Exchange[int]:
        """Ask for the status word with a C telegram that commands nothing."""
        ask = Ask(message=Control(**self._idle), attempts=attempts, nameless=True)
        reply: ControlReply = yield from self._ask_idle(ask)
        self.seen = reply.status_word
        return reply.status_word

    def command(
        self, word: int, *, mask: int | None = None, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[int]:
        """Send a control word and return the status word; nobody answers a broadcast, which gives 0.

        urgent: for what stops the motor, see `Ask`.
        """
        before, self._memory.commanded = self._memory.commanded, None
        request, mask = self.request(word, mask), 0xFFFF if mask is None else mask
        self.seen = 0
        if self._address == BROADCAST:
            yield Tell(message=request)
        else:
            reply: ControlReply = yield Ask(message=request, attempts=attempts, acts=True, nameless=True, urgent=urgent)
            self.seen = reply.status_word
        if not word & words.VALID:
            self._memory.commanded = before
        elif mask == 0xFFFF or before is not None:
            self._memory.commanded = (before or 0) & ~mask | word
        if word & words.VALID and mask & words.SETUP:
            self._memory.setup = word & words.SETUP
        return self.seen

    def look(self) -> Exchange[Words]:
        """Return the status word."""
        return {profiles.ONLY: (yield from self.status_word())}

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:
        """Send a word in the set-up that is selected; its reply shows the status."""
        word, attempts = step.word | self._memory.setup, None if step.repeats else 1
        return {profiles.ONLY: (yield from self.command(word, attempts=attempts, urgent=urgent))}

    def step(self, bit: int, verb: str) -> Exchange[None]:
        """Set a bit of the last control word and take it away again."""
        word = yield from self.confirmed(verb)
        try:
            yield from self.command(word | bit, attempts=1)
        except ReplyError:
            # The drive may have it: take the bit away, or it could go on and on.
            yield from self.command(word)
            raise
        yield from self.command(word)

    def confirmed(self, verb: str) -> Exchange[int]:
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

    def request(self, word: int, mask: int | None) -> Control:
        """Return the telegram that carries a control word, or those bits of it that a mask gives."""
        return Control(address=self._address, control_word=word, control_mask=None if mask == 0xFFFF else mask)

    def _new_question(self, number: int, index: tuple[int, ...] | None) -> Ask:
        if index is None:
            return Ask(message=Read(**self._idle, parameter=number), nameless=True)
        decimals = 0 if len(index) == 1 else 2
        return Ask(message=ReadIndex(**self._idle, parameter=number, index=index, decimals=decimals), nameless=True)

    def _ask_idle(self, ask: Ask) -> Exchange[Any]:
        """Ask with the idle word; where only a copy of the request came, say that it may have been the reply."""
        try:
            return (yield ask)
        except NoReplyError as error:
            if "hands back" not in str(error) or self._options.idle_word & 0xF == 0xF:
                raise
            raise NoReplyError(
                f"{error}; or a drive in local operation answered byte for byte what it was sent: use idle_word=0x000F",
                says="idle_word=0x000F",
            ) from None


def _value(wanted: Target, reply: Reply) -> Decimal:
    if reply.value is None:
        code = reply.fault_code
        raise RefusedError(wanted.address, code, cause_text(code) if code is not None else "without a cause")
    return reply.value
