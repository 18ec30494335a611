"""Functions of the control word that only this protocol has.

Specification, section 12.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, StateError, UsageError, ValueRefusedError
from drivecomm.protocol import needs_answer
from drivecomm_danfoss_fc import words

if TYPE_CHECKING:
    from drivecomm.profiles import ProcessWords
    from drivecomm.protocol import Exchange
    from drivecomm_danfoss_fc.options import DanfossFcOptions

FUNCTIONS = (
    "jog", "hold", "select_setup", "select_preset", "set_relay", "ramp", "catch_up", "slow_down", "control_word",
)  # fmt: skip


class Functions:
    """Control word functions of one drive."""

    def __init__(self, talk: ProcessWords, options: DanfossFcOptions, *, answers: bool) -> None:
        self.answers = answers
        self._talk = talk
        self._profidrive = options.profile == "profidrive"
        self._state_timeout_s = options.state_timeout_s

    @needs_answer
    def jog(self, number: int = 1) -> Exchange[None]:
        """Run at the jog speed (3-11 or 3-19; PROFIdrive: bus jog 1 or 2, 8-90 and 8-91) until a start or stop."""
        choice = _one_of(number, range(1, 3 if self._profidrive else 2), "jog")
        *before, last = self._talk.profile.start
        jogs = replace(last, word=last.word | 1 << (words.JOG_1_BIT, words.JOG_2_BIT)[choice - 1])
        jogging = replace(self._talk.profile, start=(*before, jogs))
        return self._talk.commander(jogging, state_timeout_s=self._state_timeout_s).start()

    @needs_answer
    def select_preset(self, number: int) -> Exchange[None]:
        """Select preset reference 1 to 4, that is 3-10 [0] to [3] (215 to 218; VLT 6000: 211 to 214).

        A running drive gets it immediately, any other drive with the next start. A setting of the drive decides whether
        it adds to the bus reference.
        """
        self._fc_profile_only("preset references")
        bits = _one_of(number, range(1, 5), "preset") - 1
        return self._switch(words.PRESET_MASK, bits, "select_preset", at_once=False)

    @needs_answer
    def select_setup(self, number: int) -> Exchange[None]:
        """Select set-up 1 to 4; 0-10 (004) must be set to multi set-up.

        Small drives are said to have no bit 14, and therefore no set-ups 3 and 4; the bit is set for those two only.
        """
        bits = _one_of(number, range(1, 5), "set-up") - 1 << words.SET_UP_BIT
        return self._switch(words.SET_UP_MASK, bits, "select_setup", at_once=True)

    @needs_answer
    def set_relay(self, number: int, on: bool) -> Exchange[None]:
        """Switch relay 1 or 2; 5-40 must tie it to the control word ([36], [37]).

        VLT 5000 manuals call relay 2 relay 04. The relays drop at the control word timeout (VLT 6000 manual p. 163).
        """
        self._fc_profile_only("relays")
        relay = _one_of(number, range(1, 3), "relay")
        mask = 1 << (words.RELAY_1_BIT if relay == 1 else words.RELAY_2_BIT)
        return self._switch(mask, mask if on else 0, "set_relay", at_once=True)

    @needs_answer
    def ramp(self, number: int) -> Exchange[None]:
        """Use ramp 1 or ramp 2; no function on VLT 6000."""
        self._fc_profile_only("ramp 2")
        bits = _one_of(number, range(1, 3), "ramp") - 1 << words.RAMP_2_BIT
        return self._switch(words.RAMP_MASK, bits, "ramp", at_once=False)

    @needs_answer
    def hold(self) -> Exchange[None]:
        """Hold the output frequency of a running motor until the next start or stop."""
        word = (yield from self._running_word("hold")) & ~(1 << words.HOLD_BIT)
        yield from self._talk.command(word, repeated=True)
        self._talk.memory.word = word

    @needs_answer
    def catch_up(self) -> Exchange[None]:
        """Raise the reference of a running motor by one step (PROFIdrive bit 12); never repeated."""
        return self._pulse("catch_up", words.CATCH_UP_BIT)

    @needs_answer
    def slow_down(self) -> Exchange[None]:
        """Lower the reference of a running motor by one step (PROFIdrive bit 11); never repeated."""
        return self._pulse("slow_down", words.SLOW_DOWN_BIT)

    @needs_answer
    def control_word(self, word: int) -> Exchange[None]:
        """Send this control word with the present reference; `status` repeats a valid one for the watchdog.

        The word is sent once, as given; repetitions leave out reset and relative commands.
        """
        return self._any_word(_one_of(word, range(0x10000), "control word"))

    # Helpers

    def _switch(self, mask: int, bits: int, verb: str, *, at_once: bool) -> Exchange[None]:
        """Set some function bits in this and every later word.

        at_once: whether the bits also act on a motor at standstill, so that they are sent to a stopped drive as well.
        This needs a valid control word, which only a caller that commands the drive has.
        """
        memory, talk = self._talk.memory, self._talk
        if at_once and not memory.word:
            raise UsageError(
                "this needs a valid control word, and the drive was not commanded yet; call start() or stop() first"
            )
        if at_once or talk.runs:
            yield from talk.ask()
            if at_once and not memory.word:
                raise StateError(f"{verb} needs an active command, but another one is active now; start or stop first")
            if memory.word:
                yield from talk.check_repeatable(verb)
                word = memory.word & ~mask | bits
                yield from talk.command(word, repeated=True)
                memory.word = word
        memory.functions = memory.functions & ~mask | bits

    def _pulse(self, verb: str, bit: int) -> Exchange[None]:
        """Set a bit once: a relative command, which is never repeated and never remembered."""
        if not self._profidrive:
            raise NotSupported(
                f"{verb} is a function of the PROFIdrive control word; the FC profile uses these bits for relays"
            )
        return self._set_once(verb, bit)

    def _set_once(self, verb: str, bit: int) -> Exchange[None]:
        word = yield from self._running_word(verb)
        yield from self._talk.command(word | 1 << bit, repeated=True, attempts=1)
        yield from self._talk.command(word, repeated=True)

    def _any_word(self, word: int) -> Exchange[None]:
        talk = self._talk
        kept = word & ~(1 << words.RESET_BIT) if words.has(word, words.VALID_BIT) else words.IGNORED
        if self._profidrive:
            kept &= ~(1 << words.CATCH_UP_BIT | 1 << words.SLOW_DOWN_BIT)
        if not talk.profile.lets_run(kept):
            self._remember(kept)
        yield from talk.command(word, attempts=1, urgent=not talk.profile.lets_run(word))
        self._remember(kept)

    def _running_word(self, verb: str) -> Exchange[int]:
        """Return the control word in force if the motor runs by it. Raises UsageError or StateError otherwise."""
        if not self._talk.runs:
            raise UsageError(f"{verb} is for a motor that was started; call start() first")
        yield from self._talk.ask()
        yield from self._talk.check_repeatable(verb)
        return self._talk.memory.word

    def _remember(self, word: int) -> None:
        self._talk.remember(word)
        self._talk.memory.functions = word & (words.SET_UP_MASK if self._profidrive else words.FUNCTIONS_MASK)

    def _fc_profile_only(self, what: str) -> None:
        """Raise NotSupported in PROFIdrive, whose control word has no bits for this function."""
        if self._profidrive:
            raise NotSupported(f"the PROFIdrive control word has no bits for {what}; use the FC profile")


def _one_of(value: int, allowed: range, what: str) -> int:
    """Return a number that selects something. Raises ValueRefusedError if there is no such number."""
    if type(value) is not int or value not in allowed:
        raise ValueRefusedError(f"{what} {value!r} does not exist; they are {allowed.start} to {allowed.stop - 1}")
    return value
