"""The verbs that start, stop and steer the motor with the control word.

Specification, section 12.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, StateError, UsageError, ValueRefusedError
from drivecomm.protocol import Stop, Tell, exact, needs_answer
from drivecomm_danfoss_fc import words
from drivecomm_danfoss_fc.conversation import BROADCAST, Conversation
from drivecomm_danfoss_fc.options import span

if TYPE_CHECKING:
    from drivecomm.profiles import Commander, ControlProfile
    from drivecomm.protocol import Exchange, Value
    from drivecomm_danfoss_fc.options import DanfossFcOptions


class Motion:
    """The motor of one drive, or of all drives at address 0."""

    def __init__(self, address: int, options: DanfossFcOptions, memory: profiles.CommandMemory | None) -> None:
        self.answers = address != BROADCAST
        self._memory = memory or profiles.CommandMemory()
        self._talk = Conversation(address, options, self._memory)
        self._words = self._talk.words
        self._state_timeout_s = options.state_timeout_s
        self._range = span("reference", options.reference_minimum_hz, options.reference_maximum_hz)

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start with 047C, or with 047E and 047F in PROFIdrive; refuses to on a tripped or locally operated drive.

        reverse sets bit 15, which works only if 8-54 (506) gives reversing to the bus. The reference is the one that
        was set; if that was not done here, the one that the drive shows. Raises StateError where it shows none: it
        would be zero.
        """
        talk = self._words
        return self._by(talk.profile).start(reverse=reverse, prepare=talk.take_over_reference())

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: 043C (ramp), 0474 (coast), 046C (quick stop) or 0478 (DC brake), each function as it is."""
        talk = self._words
        if self._talk.broadcast and how in talk.profile.stops:
            yield Tell(message=self._talk.block(talk.profile.stops[how][-1].word, 0))
            return
        yield from self._by(talk.profile).stop(how)
        if not talk.says("remote"):
            raise StateError(
                "the drive is in local operation, where bus commands have no effect; stop it at its keypad"
            )

    @needs_answer
    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with 043C, 04BC, 043C; a drive that has not tripped is left alone."""
        talk = self._words
        try:
            yield from self._by(talk.profile).reset()
        except StateError as error:
            if self._talk.profidrive or not words.has(talk.seen, words.TRIP_LOCK):
                raise
            raise StateError(f"{error}; it is trip-locked: switch its mains off and on") from None

    @needs_answer
    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the bus reference, -200 % to 199.99 % of the reference range, to the nearest step of 0.0061 %.

        It goes out at once with the control word that holds: the last one from here, or the ramp-stop word for a drive
        that stands. Raises StateError for a motor that was not started from here, or does not run any more.
        """
        return self._words.set_reference(self._words.profile.steps_of(exact(percent, "reference")))

    @needs_answer
    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the bus reference as a frequency within the reference range that the options give."""
        if self._range is None:
            raise NotSupported(
                "the telegram carries a percentage; give what the drive's maximum reference 3-03 (205) holds, such as "
                "reference_maximum_hz=50, to set a reference in Hz",
                says="reference_maximum_hz=50",
            )
        lowest, highest = self._range
        number = exact(hz, "reference")
        if (lowest and number < lowest) or abs(number) > highest:
            raise ValueRefusedError(f"{number} Hz is outside the reference range {lowest} to {highest} Hz")
        return self._words.set_reference(self._words.profile.steps_of((number - lowest) * 100 / (highest - lowest)))

    # Functions of the control word that only this protocol has

    @needs_answer
    def jog(self, number: int = 1) -> Exchange[None]:
        """Run at the jog speed (3-11 or 3-19; PROFIdrive: bus jog 1 or 2, 8-90 and 8-91) until start or stop."""
        choice = _one_of(number, range(1, 3 if self._talk.profidrive else 2), "jog")
        *before, last = self._words.profile.start
        jogs = replace(last, word=last.word | 1 << (words.JOG_1_BIT, words.JOG_2_BIT)[choice - 1])
        return self._by(replace(self._words.profile, start=(*before, jogs))).start()

    @needs_answer
    def select_preset(self, number: int) -> Exchange[None]:
        """Select preset reference 1 to 4, that is 3-10 [0] to [3] (215 to 218; VLT 6000: 211 to 214).

        A running drive gets it at once, any other with the next start. Whether it adds to the bus reference is a
        setting of the drive.
        """
        self._fc_profile_only("preset references")
        bits = _one_of(number, range(1, 5), "preset") - 1
        return self._switch(words.PRESET_MASK, bits, "select_preset", at_once=False)

    @needs_answer
    def select_setup(self, number: int) -> Exchange[None]:
        """Select set-up 1 to 4; multi set-up must be chosen in 0-10 (004).

        Small drives are said to have no bit 14 and so no set-ups 3 and 4; the bit is set for those two only.
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
        yield from self._words.command(word, repeated=True)
        self._memory.word = word

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
        """Send this control word with the reference that is set; `status` repeats a valid one for the watchdog.

        It is sent as it is, once; it is repeated without reset and relative commands.
        """
        return self._any_word(_one_of(word, range(0x10000), "control word"))

    def release(self) -> Exchange[None]:
        """Stop repeating the control word, so that another master can take over. Sends nothing."""
        return self._words.release()

    # Conversations

    def _by(self, known: ControlProfile, **further: Any) -> Commander:
        return profiles.Commander(known, self._words, state_timeout_s=self._state_timeout_s, **further)

    def _switch(self, mask: int, bits: int, verb: str, *, at_once: bool) -> Exchange[None]:
        """Set some function bits in this and every later word.

        at_once: they act on a standing motor too, so that they are sent also when it is stopped. That takes a valid
        control word, and only a caller who commands the drive already has one.
        """
        memory, talk = self._memory, self._words
        if at_once and not memory.word:
            raise UsageError(
                "this needs a valid control word, and the drive was not commanded yet; call start() or stop() first"
            )
        if at_once or talk.runs:
            yield from talk.ask()
            if at_once and not memory.word:
                raise StateError(f"{verb} needs a command that holds, and another one does by now; start or stop first")
            if memory.word:
                yield from talk.must_hold(verb)
                word = memory.word & ~mask | bits
                yield from talk.command(word, repeated=True)
                memory.word = word
        memory.functions = memory.functions & ~mask | bits

    def _pulse(self, verb: str, bit: int) -> Exchange[None]:
        """Set a bit once: a relative command, never repeated and never remembered."""
        if not self._talk.profidrive:
            raise NotSupported(f"{verb} is a function of the PROFIdrive control word; the FC profile has relays there")
        return self._set_once(verb, bit)

    def _set_once(self, verb: str, bit: int) -> Exchange[None]:
        word = yield from self._running_word(verb)
        yield from self._words.command(word | 1 << bit, repeated=True, attempts=1)
        yield from self._words.command(word, repeated=True)

    def _any_word(self, word: int) -> Exchange[None]:
        talk = self._words
        kept = word & ~(1 << words.RESET_BIT) if words.has(word, words.VALID_BIT) else words.IGNORED
        if self._talk.profidrive:
            kept &= ~(1 << words.CATCH_UP_BIT | 1 << words.SLOW_DOWN_BIT)
        if not talk.profile.lets_run(kept):
            self._remember(kept)
        yield from talk.command(word, attempts=1, urgent=not talk.profile.lets_run(word))
        self._remember(kept)

    def _running_word(self, verb: str) -> Exchange[int]:
        """Return the word that was commanded, if the motor runs by it."""
        if not self._words.runs:
            raise UsageError(f"{verb} is for a motor that was started; call start() first")
        yield from self._words.ask()
        yield from self._words.must_hold(verb)
        return self._memory.word

    def _remember(self, word: int) -> None:
        self._words.remember(word)
        self._memory.functions = word & words.function_mask(profidrive=self._talk.profidrive)

    def _fc_profile_only(self, what: str) -> None:
        """Raise NotSupported for what the PROFIdrive control word has no bits for."""
        if self._talk.profidrive:
            raise NotSupported(f"the PROFIdrive control word has no bits for {what}; the FC profile has")


def _one_of(value: int, allowed: range, what: str) -> int:
    """Return a number that chooses something. Raises ValueRefusedError for one that does not exist."""
    if type(value) is not int or value not in allowed:
        raise ValueRefusedError(f"{what} {value!r} does not exist; they are {allowed.start} to {allowed.stop - 1}")
    return value
