"""The verbs of a drive that speaks the Danfoss FC protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, RefusedError, UnexpectedReplyError, ValueRefusedError
from drivecomm.protocol import Capabilities, Stop, exact, kept, needs_answer
from drivecomm_danfoss_fc import access, describing, words
from drivecomm_danfoss_fc.conversation import BROADCAST, Conversation
from drivecomm_danfoss_fc.memory import DanfossFcMemory
from drivecomm_danfoss_fc.motion import Motion
from drivecomm_danfoss_fc.options import span
from drivecomm_danfoss_fc.parameters import target

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from decimal import Decimal

    from drivecomm.protocol import DriveStatus, Exchange, Model, ParameterInfo, Reading, Value
    from drivecomm_danfoss_fc.options import DanfossFcOptions

_NAME_PLATE = {
    "15-40": "FC type",
    "15-41": "power section",
    "15-43": "software version",
    "15-46": "ordering number",
    "15-51": "serial number",
}
_FURTHER_VERBS = (
    "jog", "hold", "select_setup", "select_preset", "set_relay", "ramp", "catch_up", "slow_down", "control_word",
    "release", "describe",
)  # fmt: skip
_OLD_NAME_PLATE = {"621": "unit type"}
"""Texts that are read without a model (FC 102 Design Guide section 8.4.10; VLT 5000 Design Guide p. 87)."""


class DanfossFcOperations:
    """The verbs of one drive, or of all drives at address 0.

    extra: verbs beyond those that every protocol has: `jog(number=1)`, `preset(number)`, `set_up(number)`,
    `relays(relay_1=None, relay_2=None)`, `ramp(number)`, `freeze()`, `catch_up()`, `slow_down()`, `control_word(word)`,
    `release()` and `describe(parameter, option_texts=32)`.
    """

    def __init__(
        self, address: int, options: DanfossFcOptions, model: Model | None, memory: DanfossFcMemory | None = None
    ) -> None:
        self.answers = address != BROADCAST
        self._options = options
        self._model = model
        self._talk = Conversation(address, options, memory or DanfossFcMemory())
        self._known = kept(lambda name, kind: target(name, model, options, type=kind))
        self._types: dict[int, str] = {}
        self._motion = Motion(self._talk, options)
        self._range = span("reference", options.reference_minimum_hz, options.reference_maximum_hz)
        self._limits = span("output", options.output_minimum_hz, options.output_maximum_hz)

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """The verbs beyond those that every protocol has."""
        return {verb: getattr(self, verb) for verb in _FURTHER_VERBS}

    @property
    def capabilities(self) -> Capabilities:
        """What the drive can be asked to do.

        Reverse works only if 8-54 (506) gives it to the bus; the factory setting often does not. A reference in percent
        goes to the nearest of its steps of 100/16384 %, about 0.0061 %. The reference in Hz needs the option
        reference_maximum_hz.
        """
        return Capabilities(
            stops=frozenset(self._talk.profile.stops),
            reverse=True,
            reference_percent=True,
            reference_hz=self._range is not None,
            stored_writes=True,
            volatile_writes=True,
            broadcast=True,
        )

    @needs_answer
    def read(
        self,
        parameter: str,
        *,
        type: str = "",
        index: int | None = None,
        option_text: int | None = None,
        element: int | None = None,
    ) -> Exchange[Reading]:
        """Read a parameter.

        type: int16, int32, uint8, uint16, uint32 or text; without it, a read that the drive refuses for its data type
        is repeated as what the drive says that it is. index: of an array's element. option_text: read what this value
        of an option parameter is called instead. element: read this element of the parameter's description instead (1
        basic characteristics, 2 number of array elements, 4 conversion index and unit, 6 name, 7 and 8 limits, 20
        default value, 21 additional characteristics).
        """
        if index is None:
            wanted = self._known(parameter, type)
        else:
            wanted = target(parameter, self._model, self._options, type=type, index=index)
        return access.chosen_reading(
            self._talk,
            wanted,
            option_text=option_text,
            element=element,
            index_given=index is not None or "[" in parameter,
            types=None if type else self._types,
        )

    def write(
        self,
        parameter: str,
        value: Value | float,
        *,
        store: bool = False,
        type: str = "",
        index: int | None = None,
    ) -> Exchange[Reading | None]:
        """Write a parameter, to RAM, or with store to EEPROM too; returns what the drive reports.

        type: int16, int32, uint8, uint16, uint32 or text. index: of an array's element. EEPROM cells wear: never store
        in a cycle. Whether a text is kept over power-off is up to the drive.
        """
        wanted = target(parameter, self._model, self._options, type=type, index=index)
        if self._talk.broadcast:
            if not self._options.broadcast_parameters or wanted.type == "text":
                raise NotSupported(
                    "no manual says that drives obey a parameter write to all; the option broadcast_parameters forces "
                    "it for numbers"
                )
            return access.tell_number(self._talk, wanted, value, store=store)
        if wanted.type == "text":
            return access.write_text(self._talk, wanted, value, allowed=self._options.text_writes)
        return access.write_number(self._talk, wanted, value, store=store)

    def address_of(self, parameter: str, *, index: int | None = None, **_: Any) -> str:
        """Return PNU and index of a parameter, as they stand in the telegram; no index is index 0."""
        wanted = target(parameter, self._model, self._options, index=index)
        return f"{wanted.pnu}[{wanted.ind}]" if wanted.ind else str(wanted.pnu)

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read status word and actual value with a process block, and the fault code if the drive has tripped."""
        word, actual = yield from self._motion.status_word()
        seen = {profiles.ONLY: word}
        code = (yield from self._fault_code()) if self._talk.profile.says("fault", seen) else None
        percent = _plain(self._talk.profile.percent_of(actual))
        return self._talk.profile.status(
            seen,
            reverse=actual < 0 if actual else None,
            fault_code=code,
            fault_text=self._model.faults.get(code, "") if self._model and code is not None else "",
            actual_percent=percent if self._options.actual_scaling == "reference" else None,
            actual_hz=self._frequency(percent),
        )

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start the motor; reverse sets bit 15, which works only if 8-54 (506) gives reversing to the bus."""
        return self._motion.start(reverse=reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: 043C (ramp), 0474 (coast), 046C (quick stop) or 0478 (DC brake)."""
        return self._motion.stop(how)

    @needs_answer
    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with 043C, 04BC, 043C; a drive that has not tripped is left alone."""
        return self._motion.reset()

    @needs_answer
    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the bus reference, -200 % to 199.99 % of the reference range, to the nearest step of 0.0061 %.

        It goes out at once with the control word that holds: the last one from here, or the ramp-stop word for a drive
        that stands. Raises StateError for a motor that was not started from here, or does not run any more.
        """
        return self._motion.set_reference(self._talk.profile.steps_of(exact(percent, "reference")))

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
        return self._motion.set_reference(self._talk.profile.steps_of((number - lowest) * 100 / (highest - lowest)))

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Ask once for the status word, without a valid control word, by the shortest telegram that there is."""
        yield from self._talk.look(attempts=1)

    @needs_answer
    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read the name plate: the read-only texts of the model, or without one what both families may have."""
        if self._model is not None:
            texts = {
                info.address: info.title
                for info in self._model.parameters.values()
                if info.type == "text" and info.access == "r"
            }
            return (yield from self._texts(texts))
        found = yield from self._texts(_NAME_PLATE)
        return found or (yield from self._texts(_OLD_NAME_PLATE))

    # Functions of the control word that only this protocol has

    @needs_answer
    def jog(self, number: int = 1) -> Exchange[None]:
        """Run at the jog speed (3-11 or 3-19; PROFIdrive: bus jog 1 or 2, 8-90 and 8-91) until start or stop."""
        return self._motion.jog(_one_of(number, range(1, 3 if self._talk.profidrive else 2), "jog"))

    @needs_answer
    def select_preset(self, number: int) -> Exchange[None]:
        """Select preset reference 1 to 4, that is 3-10 [0] to [3] (215 to 218; VLT 6000: 211 to 214).

        A running drive gets it at once, any other with the next start. Whether it adds to the bus reference is a
        setting of the drive.
        """
        _fc_profile_only(self._talk, "preset references")
        return self._motion.switch(
            words.PRESET_MASK, _one_of(number, range(1, 5), "preset") - 1, "select_preset", at_once=False
        )

    @needs_answer
    def select_setup(self, number: int) -> Exchange[None]:
        """Select set-up 1 to 4; multi set-up must be chosen in 0-10 (004).

        Small drives are said to have no bit 14 and so no set-ups 3 and 4; the bit is set for those two only.
        """
        bits = _one_of(number, range(1, 5), "set-up") - 1 << words.SET_UP_BIT
        return self._motion.switch(words.SET_UP_MASK, bits, "select_setup", at_once=True)

    @needs_answer
    def set_relay(self, number: int, on: bool) -> Exchange[None]:
        """Switch relay 1 or 2; 5-40 must tie it to the control word ([36], [37]).

        VLT 5000 manuals call relay 2 relay 04. The relays drop at the control word timeout (VLT 6000 manual p. 163).
        """
        _fc_profile_only(self._talk, "relays")
        relay = _one_of(number, range(1, 3), "relay")
        mask = 1 << (words.RELAY_1_BIT if relay == 1 else words.RELAY_2_BIT)
        return self._motion.switch(mask, mask if on else 0, "set_relay", at_once=True)

    @needs_answer
    def ramp(self, number: int) -> Exchange[None]:
        """Use ramp 1 or ramp 2; no function on VLT 6000."""
        _fc_profile_only(self._talk, "ramp 2")
        bits = _one_of(number, range(1, 3), "ramp") - 1 << words.RAMP_2_BIT
        return self._motion.switch(words.RAMP_MASK, bits, "ramp", at_once=False)

    @needs_answer
    def hold(self) -> Exchange[None]:
        """Hold the output frequency of a running motor until the next start or stop."""
        return self._motion.hold()

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
        """Send this control word with the reference that is set; `status` repeats a valid one for the watchdog."""
        return self._motion.control_word(_one_of(word, range(0x10000), "control word"))

    def release(self) -> Exchange[None]:
        """Stop repeating the control word, so that another master can take over. Sends nothing."""
        return self._motion.release()

    @needs_answer
    def describe(self, parameter: str, *, option_texts: int = 32) -> Exchange[ParameterInfo]:
        """Ask the drive what a parameter is: its name, type, unit, scale, limits and access, and what its options mean.

        option_texts: how many values of an option parameter are asked for their text, 0 to 254, a telegram each.
        Changes nothing.
        """
        return describing.describe(self._talk, self._known(parameter, ""), option_texts)

    # Conversations

    def _frequency(self, percent: Decimal) -> Decimal | None:
        span = self._range if self._options.actual_scaling == "reference" else self._limits
        if span is None or (percent < 0 and span[0]):
            return None
        return _plain(span[0] + (span[1] - span[0]) * percent / 100)

    def _fault_code(self) -> Exchange[int | None]:
        if not self._options.fault_code_parameter:
            return None
        wanted = target(self._options.fault_code_parameter, self._model, self._options, type="uint16")
        try:
            return int((yield from access.read_number(self._talk, wanted)).raw)
        except (RefusedError, UnexpectedReplyError):
            return None

    def _texts(self, parameters: Mapping[str, str]) -> Exchange[Mapping[str, str]]:
        found = {}
        for parameter, title in parameters.items():
            wanted = target(parameter, self._model, self._options, type="text")
            try:
                reading = yield from access.read_text(self._talk, wanted)
            except (RefusedError, UnexpectedReplyError):
                continue
            if reading.value:
                found[title] = str(reading.value)
        return found

    def _pulse(self, verb: str, bit: int) -> Exchange[None]:
        if not self._talk.profidrive:
            raise NotSupported(f"{verb} is a function of the PROFIdrive control word; the FC profile has relays there")
        return self._motion.pulse(bit, verb)


def _plain(number: Decimal) -> Decimal:
    """Return a number without the zeros behind it."""
    whole = number.to_integral_value()
    return whole if whole == number else number.normalize()


def _one_of(value: int, allowed: range, what: str) -> int:
    """Return a number that chooses something. Raises ValueRefusedError for one that does not exist."""
    if type(value) is not int or value not in allowed:
        raise ValueRefusedError(f"{what} {value!r} does not exist; they are {allowed.start} to {allowed.stop - 1}")
    return value


def _fc_profile_only(talk: Conversation, what: str) -> None:
    """Raise NotSupported for what the PROFIdrive control word has no bits for."""
    if talk.profidrive:
        raise NotSupported(f"the PROFIdrive control word has no bits for {what}; the FC profile has")
