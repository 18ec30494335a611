"""Starting, stopping and steering the motor with the control word.

Specification, section 12. The status word in a reply shows the drive before the command of the same request took effect
(VLT 5000 Design Guide p. 95), so nothing is concluded from it about that command.
"""

from __future__ import annotations

from decimal import ROUND_HALF_EVEN, Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, StateError, UsageError, ValueRefusedError
from drivecomm.exchange import Exchange, Pause
from drivecomm.status import Stop
from drivecomm_danfoss_fc import words

if TYPE_CHECKING:
    from drivecomm_danfoss_fc.conversation import Conversation

STOP_WORDS = {
    Stop.RAMP: words.RAMP_STOP,
    Stop.COAST: words.COAST,
    Stop.QUICK: words.QUICK_STOP,
    Stop.DC_BRAKE: words.DC_BRAKE,
}
PROFIDRIVE_STOP_WORDS = {
    Stop.RAMP: words.PROFIDRIVE_RAMP_STOP,
    Stop.COAST: words.PROFIDRIVE_COAST,
    Stop.QUICK: words.PROFIDRIVE_QUICK_STOP,
}

PERCENT_PER_STEP = Decimal(100) / words.HUNDRED_PERCENT
"""Resolution of reference and actual value: 0.006103515625 %, exactly."""

_POLL_S = 0.05


def stop_words(*, profidrive: bool) -> dict[Stop, int]:
    """Return the ways to stop and their control words; the PROFIdrive word has no bit for the DC brake."""
    return PROFIDRIVE_STOP_WORDS if profidrive else STOP_WORDS


def reference_for(percent: Decimal, shown: str) -> int:
    """Return the step of PCD2 that is nearest to a percentage; halves go to the even step.

    100 % is 16384 steps, so that only multiples of 0.006103515625 % can be met. Raises ValueRefusedError beyond the
    range of PCD2, -200 % to 199.99 %.
    """
    steps = (
        (percent * words.HUNDRED_PERCENT / 100).quantize(Decimal(1), ROUND_HALF_EVEN) if abs(percent) < 1000 else None
    )
    if steps is None or not -(2**15) <= steps < 2**15:
        raise ValueRefusedError(f"a reference of {shown} is beyond what the telegram holds, -200 % to 199.99 %")
    return int(steps)


class Motion:
    """The motor of one drive.

    A start is remembered only when the drive has answered it, so that reading never starts a motor later; a stop is
    remembered before it is sent, so that every further telegram repeats it.
    """

    def __init__(
        self,
        talk: Conversation,
        *,
        state_timeout_s: float,
        control_word_pnu: int | None = None,
        reference_pnu: int | None = None,
    ) -> None:
        self._talk = talk
        self._state_timeout_s = state_timeout_s
        self._control_word_pnu = control_word_pnu
        self._reference_pnu = reference_pnu

    def status_word(self) -> Exchange[tuple[int, int]]:
        """Ask for status word and actual value, commanding nothing that is not commanded already."""
        reply = yield from self._talk.process(self._talk.word)
        return reply.status_word, reply.main_actual

    def start(self, *, reverse: bool) -> Exchange[None]:
        """Start with 047C, or with 047E and 047F in PROFIdrive; refuses to on a tripped or locally operated drive.

        The reference is the one that was set; if that was not done here, the one that the drive shows.
        """
        yield from self._ready_to_start()
        yield from self._take_over_reference()
        yield from self._run(words.REVERSE_BIT if reverse else None)

    def jog(self, number: int) -> Exchange[None]:
        """Run at the jog speed until the next start or stop."""
        yield from self._ready_to_start()
        yield from self._run((words.JOG_1_BIT, words.JOG_2_BIT)[number - 1])

    def stop(self, word: int) -> Exchange[None]:
        """Stop with this word."""
        self._talk.word = self._talk.stop_word(word)
        reply = yield from self._talk.process(self._talk.word, acts=True)
        if not words.has(reply.status_word, words.BUS_CONTROL):
            raise StateError(
                "the drive is in local operation, where bus commands have no effect; stop it at its keypad"
            )

    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with a rising edge of bit 7, between two words without it; nothing without a trip."""
        talk = self._talk
        status, _ = yield from self.status_word()
        if not self._tripped(status):
            return
        idle, edge = (words.RAMP_STOP, words.RESET)
        if talk.profidrive:
            idle, edge = (words.PROFIDRIVE_STANDSTILL, words.PROFIDRIVE_RESET)
        talk.word = talk.stop_word(idle)
        yield from talk.process(talk.word, acts=True)
        yield from talk.process(talk.stop_word(edge), attempts=1, acts=True)
        waited = 0.0
        while True:
            # The first of these takes the bit away again.
            status, _ = yield from self.status_word()
            if not self._tripped(status):
                return
            if waited >= self._state_timeout_s:
                break
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S
        locked = words.has(status, words.TRIP_LOCK) and not talk.profidrive
        raise StateError(
            "the drive is still tripped after the reset; "
            + ("it is trip-locked: switch its mains off and on" if locked else "the cause of the trip is still there")
        )

    def set_reference(self, steps: int) -> Exchange[None]:
        """Send the reference with the control word that holds, and remember it for all that follow.

        A drive that was not commanded from here keeps running as it does; one that stands gets the ramp-stop word.
        """
        talk = self._talk
        if not talk.word:
            yield from self._take_over_word()
        talk.reference, talk.reference_known = steps, True
        yield from talk.process(talk.word, acts=True)

    def switch(self, mask: int, bits: int, *, at_once: bool) -> Exchange[None]:
        """Set some function bits in this and every later word.

        at_once: they act on a standing motor too, so that they are sent also when it is stopped. That takes a valid
        control word, and only a caller who commands the drive already has one.
        """
        talk = self._talk
        if at_once and not talk.word:
            raise UsageError(
                "this needs a valid control word, and the drive was not commanded yet; call start() or stop() first"
            )
        talk.functions = talk.functions & ~mask | bits
        if talk.word:
            talk.word = talk.word & ~mask | bits
        if at_once or talk.runs:
            yield from talk.process(talk.word, acts=True)

    def freeze(self) -> Exchange[None]:
        """Hold the output frequency as it is, until the next start or stop."""
        self._must_run("freeze")
        self._talk.word &= ~(1 << words.HOLD_BIT)
        yield from self._talk.process(self._talk.word, acts=True)

    def pulse(self, bit: int, verb: str) -> Exchange[None]:
        """Set a bit once: a relative command, never repeated and never remembered."""
        self._must_run(verb)
        yield from self._talk.process(self._talk.word | 1 << bit, attempts=1, acts=True)
        yield from self._talk.process(self._talk.word, acts=True)

    def control_word(self, word: int) -> Exchange[None]:
        """Send a control word as it is, once; it is repeated from then on, but for reset and relative commands."""
        talk = self._talk
        kept = word & ~(1 << words.RESET_BIT) if words.has(word, words.VALID_BIT) else words.IGNORED
        if talk.profidrive:
            kept &= ~(1 << words.CATCH_UP_BIT | 1 << words.SLOW_DOWN_BIT)
        if not words.lets_run(kept, profidrive=talk.profidrive):
            self._remember(kept)
        yield from talk.process(word, attempts=1, acts=True)
        self._remember(kept)

    def release(self) -> Exchange[None]:
        """Repeat nothing any more: the drive keeps its last command until its control word timeout. Sends nothing."""
        self._talk.word = words.IGNORED
        yield from ()

    def _run(self, bit: int | None) -> Exchange[None]:
        talk = self._talk
        more = talk.functions | (0 if bit is None else 1 << bit)
        word = words.START
        if talk.profidrive:
            word = words.PROFIDRIVE_START
            if not talk.runs:
                talk.word = words.PROFIDRIVE_READY | talk.functions
                yield from talk.process(talk.word, attempts=1, acts=True)
        yield from talk.process(word | more, attempts=1, acts=True)
        talk.word = word | more

    def _take_over_word(self) -> Exchange[None]:
        """Find out which control word the drive obeys, so that sending it again changes nothing."""
        talk = self._talk
        status, _ = yield from self.status_word()
        if not words.has(status, words.RUNNING):
            talk.word = talk.stop_word(words.PROFIDRIVE_STANDSTILL if talk.profidrive else words.RAMP_STOP)
            return
        word = None if self._control_word_pnu is None else (yield from talk.shown_word(self._control_word_pnu))
        if word is None or not words.lets_run(word, profidrive=talk.profidrive):
            raise StateError(
                "the motor runs, and the drive does not show a control word of this port that made it run; set the "
                "reference from the program that started it, or together with a start"
            )
        self._remember(word)

    def _take_over_reference(self) -> Exchange[None]:
        talk = self._talk
        if talk.reference_known or self._reference_pnu is None:
            return
        word = yield from talk.shown_word(self._reference_pnu)
        if word is not None:
            talk.reference, talk.reference_known = word - 0x10000 if word >= 0x8000 else word, True

    def _ready_to_start(self) -> Exchange[None]:
        status, _ = yield from self.status_word()
        if self._tripped(status):
            raise StateError("the drive has tripped and cannot start; reset it first")
        if not words.has(status, words.BUS_CONTROL):
            raise StateError("the drive is in local operation, where bus commands have no effect; switch it to remote")

    def _remember(self, word: int) -> None:
        mask = function_mask(profidrive=self._talk.profidrive)
        self._talk.word = word
        self._talk.functions = word & mask

    def _must_run(self, verb: str) -> None:
        if not self._talk.runs:
            raise UsageError(f"{verb} is for a motor that was started; call start() first")

    def _tripped(self, status: int) -> bool:
        return words.tripped(status, profidrive=self._talk.profidrive)


PRESET_MASK = 0b11
RAMP_MASK = 1 << words.RAMP_2_BIT
SET_UP_MASK = 0b11 << words.SET_UP_BIT


def function_mask(*, profidrive: bool) -> int:
    """Return the bits of a control word that choose functions and belong to no single command."""
    if profidrive:
        return SET_UP_MASK
    return PRESET_MASK | RAMP_MASK | SET_UP_MASK | 1 << words.RELAY_1_BIT | 1 << words.RELAY_2_BIT


def one_of(value: int, allowed: range, what: str) -> int:
    """Return a number that chooses something. Raises ValueRefusedError for one that does not exist."""
    if type(value) is not int or value not in allowed:
        raise ValueRefusedError(f"{what} {value!r} does not exist; they are {allowed.start} to {allowed.stop - 1}")
    return value


def fc_profile_only(talk: Conversation, what: str) -> None:
    """Raise NotSupported for what the PROFIdrive control word has no bits for."""
    if talk.profidrive:
        raise NotSupported(f"the PROFIdrive control word has no bits for {what}; the FC profile has")
