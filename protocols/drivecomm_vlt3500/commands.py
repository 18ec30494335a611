"""Requests and commands to one VLT: parameters, control words, and the state that a master keeps of them.

VLT Series 3500 manual, printed pages 87 and 91; VLT 3000 manual MG.30.A7.02, pages 75 and 78.

Every telegram carries a control word. Reads, writes and status requests always carry the idle word, whose bit 10 is 0,
also after a start: a drive ignores this word and keeps the last valid one (VLT 3000 manual, page 75). So only telegrams
that are meant as commands are commands.

No reply shows which of two similar requests it answers, and the value, the status or the index of one may be wrong for
the other. Every request is therefore `nameless`: after a timeout the link waits for a late reply before it sends
another request.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NoReplyError, RefusedError, ReplyError, StateError
from drivecomm.protocol import Ask, Tell, cached
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.messages import Control, ControlReply, Read, ReadIndex, Reply, Update
from drivecomm_vlt3500.parameters import cause_text
from drivecomm_vlt3500.telegrams import BROADCAST
from drivecomm_vlt3500.words import profile

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.profiles import ControlStep, Words
    from drivecomm.protocol import Exchange
    from drivecomm_vlt3500.options import VltOptions
    from drivecomm_vlt3500.parameters import VltTarget

_MOVING = words.START | words.JOG_1 | words.JOG_2


class VltMemory:
    """State that a master keeps for one drive, shared by all callers that use it on one bus.

    commanded: the last valid control word that the drive has confirmed; None if none was sent, or if it is unknown
    whether one arrived. setup: the set-up that control words select, as their bits.
    """

    def __init__(self) -> None:
        self.commanded: int | None = None
        self.setup = 0

    def forget(self) -> None:
        """Forget the last control word, on which further ones would build."""
        self.commanded = None

    def watch(self, silence_s: float | None) -> None:
        """Do nothing, because nothing is repeated for a watchdog."""


class VltConversation:
    """Exchanges with one drive, or commands to all drives at address 0.

    seen: the status word of the last reply; 0 after a broadcast, which no drive answers.
    """

    def __init__(self, address: int, options: VltOptions, memory: VltMemory) -> None:
        self.seen = 0
        self._address = address
        self._options = options
        self._memory = memory
        self._idle: dict[str, Any] = {"address": address, "control_word": options.idle_word}
        self._question = cached(self._new_question)

    def read(self, wanted: VltTarget) -> Exchange[Decimal]:
        """Read a parameter, or one element of an indexed parameter. Raises RefusedError."""
        return _value(wanted, (yield from self._ask_idle(self._question(wanted.number, wanted.index))))

    def write(self, wanted: VltTarget, value: Decimal, decimals: int, attempts: int) -> Exchange[Decimal | None]:
        """Write a parameter; return the value that the drive reports, None for a broadcast. Raises RefusedError."""
        request = Update(**self._idle, parameter=wanted.number, value=value, decimals=decimals)
        if self._address == BROADCAST:
            yield Tell(message=request)
            return None
        ask = Ask(message=request, attempts=attempts, acts=True, nameless=True)
        return _value(wanted, (yield from self._ask_idle(ask)))

    def status_word(self, *, attempts: int | None = None) -> Exchange[int]:
        """Read the status word with a C telegram that commands nothing."""
        ask = Ask(message=Control(**self._idle), attempts=attempts, nameless=True)
        reply: ControlReply = yield from self._ask_idle(ask)
        self.seen = reply.status_word
        return reply.status_word

    def command(
        self, word: int, *, mask: int | None = None, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[int]:
        """Send a control word and return the status word; 0 for a broadcast, which no drive answers.

        urgent: for commands that stop the motor, see `Ask`.
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
        """Read the status word."""
        return {profiles.SOLE_PLACE: (yield from self.status_word())}

    def send(self, step: ControlStep, *, urgent: bool) -> Exchange[Words]:
        """Send a word in the selected set-up; its reply contains the status."""
        word, attempts = step.word | self._memory.setup, None if step.repeats else 1
        return {profiles.SOLE_PLACE: (yield from self.command(word, attempts=attempts, urgent=urgent))}

    def step(self, bit: int, verb: str) -> Exchange[None]:
        """Set a bit of the last control word and clear it again."""
        word = yield from self.confirmed(verb)
        try:
            yield from self.command(word | bit, attempts=1)
        except ReplyError:
            # The drive may have received the word. Clear the bit, or the change could continue indefinitely.
            yield from self.command(word)
            raise
        yield from self.command(word)

    def confirmed(self, verb: str) -> Exchange[int]:
        """Return the last control word if it still holds, because a repeated word must not start a motor.

        Raises StateError if there is none, or if the drive has stopped meanwhile.
        """
        word = self._memory.commanded
        if word is None:
            raise StateError(
                f"{verb} changes the last control word, but the drive has not confirmed any from this program; "
                "start or stop the drive first"
            )
        seen = yield from self.look()
        if word & _MOVING and not profile().says("running", seen):
            raise StateError(f"{verb} would restart the drive, which has stopped meanwhile; use start")
        return word

    def request(self, word: int, mask: int | None) -> Control:
        """Return the telegram for a control word, or for those bits of it that the mask contains."""
        return Control(address=self._address, control_word=word, control_mask=None if mask == 0xFFFF else mask)

    def _new_question(self, number: int, index: tuple[int, ...] | None) -> Ask:
        if index is None:
            return Ask(message=Read(**self._idle, parameter=number), nameless=True)
        decimals = 0 if len(index) == 1 else 2
        return Ask(message=ReadIndex(**self._idle, parameter=number, index=index, decimals=decimals), nameless=True)

    def _ask_idle(self, ask: Ask) -> Exchange[Any]:
        """Send a request with the idle word; if only a copy of it returns, the error says that it may be the reply."""
        try:
            return (yield ask)
        except NoReplyError as error:
            if "echoes what it sends" not in str(error) or self._options.idle_word & 0xF == 0xF:
                raise
            raise NoReplyError(
                f"{error}; or a drive in local operation answered byte for byte what it was sent: use idle_word=0x000F",
                says="idle_word=0x000F",
            ) from None


def _value(wanted: VltTarget, reply: Reply) -> Decimal:
    if reply.value is None:
        code = reply.fault_code
        raise RefusedError(wanted.address, code, cause_text(code) if code is not None else "without a cause")
    return reply.value
