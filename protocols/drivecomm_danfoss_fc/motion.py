"""Starting, stopping and steering the motor with the control word.

Specification, section 12. The status word in a reply shows the drive before the command of the same request took effect
(VLT 5000 Design Guide p. 95), so nothing is concluded from it about that command.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm import profiles
from drivecomm.errors import CommandTooOldError, StateError, UsageError
from drivecomm_danfoss_fc import words
from drivecomm_danfoss_fc.parameters import target

if TYPE_CHECKING:
    from drivecomm.profiles import Commander, ControlProfile, Step, Words
    from drivecomm.protocol import Exchange, Stop
    from drivecomm_danfoss_fc.conversation import Conversation
    from drivecomm_danfoss_fc.messages import ProcessReply
    from drivecomm_danfoss_fc.options import DanfossFcOptions


class Motion:
    """The motor of one drive.

    A start is remembered only when the drive has answered it; a stop is remembered before it is sent. What builds on a
    run command that was given before, such as another reference, first asks whether the motor runs, and is refused when
    it does not, or when it runs by a command of somebody else: a word that was not commanded here is never sent.
    """

    def __init__(self, talk: Conversation, options: DanfossFcOptions) -> None:
        self._talk = talk
        self._memory = talk.memory
        self._control_word_pnu = _number_of(options.control_word_parameter, options)
        self._reference_pnu = _number_of(options.reference_parameter, options)
        self._state_timeout_s = options.state_timeout_s
        # The status word of the last reply to a look or a command.
        self._seen = 0

    def status_word(self) -> Exchange[tuple[int, int]]:
        """Ask for status word and actual value; a command that holds is then repeated, for the drive's watchdog."""
        reply = yield from self._talk.look()
        memory = self._memory
        if (memory.watched or memory.owed) and (yield from self._still_holds(reply.status_word)):
            # Too old: what the look has shown is the status all the same.
            with suppress(CommandTooOldError):
                reply = yield from self._talk.command(memory.word, age="repeated", acts=False)
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
        return self._by(self._talk.profile).start(reverse=reverse, prepare=self._take_over_reference())

    def jog(self, number: int) -> Exchange[None]:
        """Run at the jog speed until the next start or stop."""
        known = self._talk.profile
        *before, last = known.start
        jogs = replace(last, word=last.word | 1 << (words.JOG_1_BIT, words.JOG_2_BIT)[number - 1])
        return self._by(replace(known, start=(*before, jogs))).start()

    def stop(self, how: Stop) -> Exchange[None]:
        """Stop, each function as it is."""
        known = self._talk.profile
        if self._talk.broadcast and how in known.stops:
            yield from self._talk.tell_all(known.stops[how][-1].word)
            return
        yield from self._by(known).stop(how)
        if not words.has(self._seen, words.BUS_CONTROL):
            raise StateError(
                "the drive is in local operation, where bus commands have no effect; stop it at its keypad"
            )

    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with a rising edge of bit 7, between two words without it; nothing without a trip."""
        try:
            yield from self._by(self._talk.profile).reset()
        except StateError as error:
            if self._talk.profidrive or not words.has(self._seen, words.TRIP_LOCK):
                raise
            raise StateError(f"{error}; it is trip-locked: switch its mains off and on") from None

    def look(self) -> Exchange[Words]:
        """Ask for the status with a word that the drive ignores; a command that it contradicts is forgotten."""
        return self._shown((yield from self._talk.look()))

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words]:  # noqa: ARG002 - the word tells
        """Send a word with the functions. One that stops is remembered before, one that runs when it was answered.

        Of a reset only the first word is: what then contradicts it holds. A motor that runs by a command from here is
        not stopped for the next one.
        """
        talk, known = self._talk, self._talk.profile
        if step in known.start[:-1] and talk.runs and words.has(self._seen, words.RUNNING):
            return {profiles.ONLY: self._seen}
        word, runs = step.word | self._memory.functions, known.lets_run(step.word)
        if not runs and step not in known.reset[1:]:
            self._memory.command(word)
        reply = yield from talk.command(word, attempts=None if step.repeats else 1)
        if runs:
            self._memory.command(word)
        return self._shown(reply)

    def again(self, step: Step) -> Exchange[Words]:
        """Send the word again: the reply to the first one shows the drive before that took effect."""
        return self._shown((yield from self._talk.command(step.word | self._memory.functions)))

    def _by(self, known: ControlProfile) -> Commander:
        return profiles.Commander(known, self, state_timeout_s=self._state_timeout_s)

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
            memory.command(self._talk.profile.reset[0].word | memory.functions)
        yield from self._must_still_run("set_reference", status)
        before = memory.reference, memory.reference_known
        memory.reference, memory.reference_known = steps, True
        try:
            yield from self._talk.command(memory.word, age="repeated")
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
                yield from self._talk.command(word, age="repeated")
                memory.word = word
        memory.functions = memory.functions & ~mask | bits

    def hold(self) -> Exchange[None]:
        """Hold the output frequency as it is, until the next start or stop."""
        word = (yield from self._running_word("hold")) & ~(1 << words.HOLD_BIT)
        yield from self._talk.command(word, age="repeated")
        self._memory.word = word

    def pulse(self, bit: int, verb: str) -> Exchange[None]:
        """Set a bit once: a relative command, never repeated and never remembered."""
        word = yield from self._running_word(verb)
        yield from self._talk.command(word | 1 << bit, age="repeated", attempts=1)
        yield from self._talk.command(word, age="repeated")

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

    def _take_over_reference(self) -> Exchange[None]:
        memory = self._memory
        if memory.reference_known:
            return
        shown = None if self._reference_pnu is None else (yield from self._talk.shown_word(self._reference_pnu))
        memory.reference, memory.reference_known = profiles.taken_over(shown), True

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


def function_mask(*, profidrive: bool) -> int:
    """Return the bits of a control word that choose functions and belong to no single command."""
    if profidrive:
        return words.SET_UP_MASK
    return words.PRESET_MASK | words.RAMP_MASK | words.SET_UP_MASK | 1 << words.RELAY_1_BIT | 1 << words.RELAY_2_BIT


def _number_of(parameter: str, options: DanfossFcOptions) -> int | None:
    return target(parameter, None, options).pnu if parameter else None
