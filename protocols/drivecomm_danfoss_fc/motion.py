"""Starting, stopping and steering the motor with the control word.

Specification, section 12. The status word in a reply shows the drive before the command of the same request took effect
(VLT 5000 Design Guide p. 95), so nothing is concluded from it about that command.
"""

from __future__ import annotations

from contextlib import suppress
from decimal import ROUND_HALF_EVEN, Decimal
from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm.errors import CommandTooOldError, NotSupported, StateError, UsageError, ValueRefusedError
from drivecomm_danfoss_fc import words

if TYPE_CHECKING:
    from drivecomm.profiles import Commander, Step, Words
    from drivecomm.protocol import Exchange, Stop
    from drivecomm_danfoss_fc.conversation import Conversation
    from drivecomm_danfoss_fc.messages import ProcessReply

PERCENT_PER_STEP = Decimal(100) / words.HUNDRED_PERCENT
"""Resolution of reference and actual value: 0.006103515625 %, exactly."""


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

    A start is remembered only when the drive has answered it; a stop is remembered before it is sent. What builds on a
    run command that was given before, such as another reference, first asks whether the motor runs, and is refused when
    it does not, or when it runs by a command of somebody else: a word that was not commanded here is never sent.
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
        self._memory = talk.memory
        self._control_word_pnu = control_word_pnu
        self._reference_pnu = reference_pnu
        self._state_timeout_s = state_timeout_s
        # The status word of the last reply to a look or a command.
        self._seen = 0

    def status_word(self) -> Exchange[tuple[int, int]]:
        """Ask for status word and actual value; a command that holds is then repeated, for the drive's watchdog."""
        reply = yield from self._talk.look()
        memory = self._memory
        if (memory.watched or memory.owed) and (yield from self._still_holds(reply.status_word)):
            # Too old: what the look has shown is the status all the same.
            with suppress(CommandTooOldError):
                reply = yield from self._talk.repeat()
                memory.owed = False
        return reply.status_word, reply.main_actual

    def _still_holds(self, status: int) -> Exchange[bool]:
        """Whether the word that was commanded may be sent again: none that would start the motor.

        A motor that another master has stopped shows as running until it stands, so a drive that can is asked which
        word it got last. One that shows none, or an ignored one, says nothing by that.
        """
        memory = self._memory
        if not self._talk.runs:
            return bool(memory.word)
        if not words.has(status, words.RUNNING):
            return False
        if self._control_word_pnu is not None:
            shown = yield from self._talk.shown_word(self._control_word_pnu)
            if shown is not None and words.has(shown, words.VALID_BIT) and shown != memory.word:
                memory.command(words.IGNORED)
        return self._talk.runs

    def start(self, *, reverse: bool) -> Exchange[None]:
        """Start with 047C, or with 047E and 047F in PROFIdrive; refuses to on a tripped or locally operated drive.

        The reference is the one that was set; if that was not done here, the one that the drive shows. Raises
        StateError where it shows none: it would be zero.
        """
        runs = yield from self._ready_to_start()
        yield from self._take_over_reference()
        yield from self._run(self._talk.profile.reverse if reverse else 0, runs=runs)

    def jog(self, number: int) -> Exchange[None]:
        """Run at the jog speed until the next start or stop."""
        runs = yield from self._ready_to_start()
        yield from self._run(1 << (words.JOG_1_BIT, words.JOG_2_BIT)[number - 1], runs=runs)

    def stop(self, how: Stop) -> Exchange[None]:
        """Stop, each function as it is."""
        yield from self._commander().stop(how)
        if not words.has(self._seen, words.BUS_CONTROL):
            raise StateError(
                "the drive is in local operation, where bus commands have no effect; stop it at its keypad"
            )

    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with a rising edge of bit 7, between two words without it; nothing without a trip."""
        try:
            yield from self._commander().reset()
        except StateError as error:
            if self._talk.profidrive or not words.has(self._seen, words.TRIP_LOCK):
                raise
            raise StateError(f"{error}; it is trip-locked: switch its mains off and on") from None

    def look(self) -> Exchange[Words]:
        """Ask for the status with a word that the drive ignores; a command that it contradicts is forgotten."""
        return self._shown((yield from self._talk.look()))

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:
        """Send a word of a stop or a reset, with the functions.

        It is remembered before, but of a reset only the first word: what then contradicts it holds.
        """
        word = self._talk.stop_word(step.word)
        if urgent or step is self._talk.profile.reset[0]:
            self._memory.command(word)
        return self._shown((yield from self._talk.command(word, attempts=None if step.repeats else 1)))

    def again(self, step: Step) -> Exchange[Words]:
        """Send the word again: the reply to the first one shows the drive before that took effect."""
        return self._shown((yield from self._talk.command(self._talk.stop_word(step.word))))

    def _commander(self) -> Commander:
        return profiles.Commander(self._talk.profile, self, state_timeout_s=self._state_timeout_s)

    def _shown(self, reply: ProcessReply) -> Words:
        self._seen = reply.status_word
        return {profiles.ONLY: reply.status_word}

    def set_reference(self, steps: int) -> Exchange[None]:
        """Send the reference with the control word that holds, and remember it for all that follow.

        A drive that stands gets the ramp-stop word. Raises StateError for a motor that runs by a command of somebody
        else: no word could be sent with the reference that changes nothing else.
        """
        memory = self._memory
        status = yield from self._look()
        if not memory.word:
            if words.has(status, words.RUNNING):
                raise StateError(
                    "the motor runs by a command that this program did not give, and a reference cannot be sent "
                    "without a command; start it from here, too, and then set the reference"
                )
            memory.command(self._talk.stop_word(self._talk.profile.reset[0].word))
        yield from self._must_still_run("set_reference", status)
        before = memory.reference, memory.reference_known
        memory.reference, memory.reference_known = steps, True
        try:
            yield from self._talk.amend(memory.word)
        except CommandTooOldError:
            memory.reference, memory.reference_known = before
            raise

    def switch(self, mask: int, bits: int, verb: str, *, at_once: bool) -> Exchange[None]:
        """Set some function bits in this and every later word.

        at_once: they act on a standing motor too, so that they are sent also when it is stopped. That takes a valid
        control word, and only a caller who commands the drive already has one.
        """
        memory = self._memory
        if at_once and not memory.word:
            raise UsageError(
                "this needs a valid control word, and the drive was not commanded yet; call start() or stop() first"
            )
        if at_once or self._talk.runs:
            status = yield from self._look()
            if at_once and not memory.word:
                raise StateError(f"{verb} needs a command that holds, and another one does by now; start or stop first")
            if memory.word:
                yield from self._must_still_run(verb, status)
                word = memory.word & ~mask | bits
                yield from self._talk.amend(word)
                memory.word = word
        memory.functions = memory.functions & ~mask | bits

    def hold(self) -> Exchange[None]:
        """Hold the output frequency as it is, until the next start or stop."""
        word = (yield from self._running_word("hold")) & ~(1 << words.HOLD_BIT)
        yield from self._talk.amend(word)
        self._memory.word = word

    def pulse(self, bit: int, verb: str) -> Exchange[None]:
        """Set a bit once: a relative command, never repeated and never remembered."""
        word = yield from self._running_word(verb)
        yield from self._talk.amend(word | 1 << bit, attempts=1)
        yield from self._talk.amend(word)

    def control_word(self, word: int) -> Exchange[None]:
        """Send a control word as it is, once; it is repeated from then on, but for reset and relative commands."""
        talk = self._talk
        kept = word & ~(1 << words.RESET_BIT) if words.has(word, words.VALID_BIT) else words.IGNORED
        if talk.profidrive:
            kept &= ~(1 << words.CATCH_UP_BIT | 1 << words.SLOW_DOWN_BIT)
        if not talk.profile.lets_run(kept):
            self._remember(kept)
        yield from talk.command(word, attempts=1)
        self._remember(kept)

    def release(self) -> Exchange[None]:
        """Repeat nothing any more: the drive keeps its last command until its control word timeout. Sends nothing."""
        self._memory.command(words.IGNORED)
        yield from ()

    def _run(self, bits: int, *, runs: bool) -> Exchange[None]:
        """Send the word that runs; in PROFIdrive after 047E, unless the motor runs by a command from here already."""
        talk, memory = self._talk, self._memory
        *before, last = talk.profile.start
        for step in () if runs and talk.runs else before:
            memory.command(step.word | memory.functions)
            yield from talk.command(memory.word, attempts=1)
        word = last.word | memory.functions | bits
        yield from talk.command(word, attempts=1)
        memory.command(word)

    def _take_over_reference(self) -> Exchange[None]:
        memory = self._memory
        if memory.reference_known:
            return
        shown = None if self._reference_pnu is None else (yield from self._talk.shown_word(self._reference_pnu))
        if shown is None:
            raise StateError(
                "no reference was set from here, and the drive does not show the one that it has from the bus, so it "
                "would start with 0; set the reference first, while the motor stands: 0 where it comes from elsewhere"
            )
        memory.reference, memory.reference_known = shown - 0x10000 if shown >= 0x8000 else shown, True

    def _ready_to_start(self) -> Exchange[bool]:
        """Make sure that the drive can start; returns whether its motor runs already."""
        return bool(self._talk.profile.says("running", (yield from self._commander().check_start())))

    def _look(self) -> Exchange[int]:
        return (yield from self.look())[profiles.ONLY]

    def _running_word(self, verb: str) -> Exchange[int]:
        """Return the word that was commanded, if the motor runs by it."""
        if not self._talk.runs:
            raise UsageError(f"{verb} is for a motor that was started; call start() first")
        status = yield from self._look()
        yield from self._must_still_run(verb, status)
        return self._memory.word

    def _must_still_run(self, verb: str, status: int) -> Exchange[None]:
        """Make sure that to send the last command again, with something added, does not start the motor."""
        if not (yield from self._still_holds(status)):
            raise StateError(
                f"{verb} would send the start again to a motor that does not run, or that somebody else commands by "
                "now; start it anew, or stop it first"
            )

    def _remember(self, word: int) -> None:
        mask = function_mask(profidrive=self._talk.profidrive)
        self._memory.command(word)
        self._memory.functions = word & mask


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
