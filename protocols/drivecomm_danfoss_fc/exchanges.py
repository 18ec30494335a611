"""The verbs of a drive that speaks the Danfoss FC protocol."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import (
    NotSupported,
    ParameterAddressError,
    StateError,
    UnexpectedReplyError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.profiles import SOLE_PLACE, CommandMemory, ProcessWords
from drivecomm.protocol import Capabilities, Stop, Tell, cached, exact, needs_answer, reference_limit_of, unless_refused
from drivecomm_danfoss_fc import access, parameter_description, words
from drivecomm_danfoss_fc.frames import BROADCAST, DanfossFcFrames
from drivecomm_danfoss_fc.functions import FUNCTIONS, Functions
from drivecomm_danfoss_fc.options import span
from drivecomm_danfoss_fc.parameters import target, text_for
from drivecomm_danfoss_fc.telegrams import LONGEST_TEXT

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from decimal import Decimal

    from drivecomm.profiles import Commander
    from drivecomm.protocol import DriveStatus, Exchange, Message, Model, ParameterInfo, Reading, Value
    from drivecomm_danfoss_fc.messages import ProcessReply
    from drivecomm_danfoss_fc.options import DanfossFcOptions

_NAME_PLATE = {
    "15-40": "FC type",
    "15-41": "power section",
    "15-43": "software version",
    "15-46": "ordering number",
    "15-51": "serial number",
}
_OLD_NAME_PLATE = {"621": "unit type"}
"""Texts that are read without a model (FC 102 Design Guide section 8.4.10; VLT 5000 Design Guide p. 87)."""


class DanfossFcOperations:
    """Verbs of one drive, or of all drives at address 0.

    extra: verbs beyond those of every protocol: those of `Functions`, `release()`, which ends the repetition of the
    control word so that another master can take over, and `describe(parameter, option_texts=32)`.
    """

    def __init__(
        self, address: int, options: DanfossFcOptions, model: Model | None, memory: CommandMemory | None = None
    ) -> None:
        self.answers = address != BROADCAST
        self._frames = DanfossFcFrames(address, options, lambda **task: self._talk.ask(**task))  # noqa: PLW0108 - `_talk` does not exist yet
        profile = partial(words.profile, profidrive=options.profile == "profidrive")
        self._talk = ProcessWords(profile, self._frames, memory or CommandMemory())
        self._options = options
        self._model = model
        self._known = cached(lambda name, kind: target(name, model, options, type=kind))
        self._types: dict[int, str] = {}
        self._range = span("reference", options.reference_minimum_hz, options.reference_maximum_hz)
        self._limits = span("output", options.output_minimum_hz, options.output_maximum_hz)
        functions = Functions(self._talk, options, answers=self.answers)
        self.extra: Mapping[str, Callable[..., Exchange[Any]]] = {
            **{function: getattr(functions, function) for function in FUNCTIONS},
            "release": self._talk.release,
            "describe": self.describe,
        }

    @property
    def capabilities(self) -> Capabilities:
        """Operations that the drive supports.

        Reverse works only if 8-54 (506) leaves it to the bus; the factory setting often does not. A reference in per
        cent is rounded to the nearest step of 100/16384 %, about 0.0061 %. A reference in Hz needs the option
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
            reference_limit=reference_limit_of(self._options.reference_limit),
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
        is repeated with the type that the drive reports. index: index of an array's element. option_text: read the text
        of this value of an option parameter instead. element: read this element of the parameter's description instead
        (1 basic characteristics, 2 number of array elements, 4 conversion index and unit, 6 name, 7 and 8 limits, 20
        default value, 21 additional characteristics).
        """
        if index is None:
            wanted = self._known(parameter, type)
        else:
            wanted = target(parameter, self._model, self._options, type=type, index=index)
        asked = [name for name, given in (("option_text", option_text), ("element", element)) if given is not None]
        asked += ["an index"] if asked and (index is not None or "[" in parameter) else []
        if len(asked) > 1:
            raise UsageError(f"IND holds one thing: {' or '.join(asked)}")
        if option_text is not None:
            return access.read_option_text(self._talk, wanted, _in_ind(option_text, range(254), "option with a text"))
        if element is not None:
            return access.read_element(self._talk, wanted, _in_ind(element, range(1, 256), "description element"))
        return (
            access.read_typed(self._talk, wanted)
            if type
            else access.read_as_reported_type(self._talk, wanted, self._types)
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
        """Write a parameter to RAM, or with store to EEPROM as well; return the value that the drive reports.

        type: int16, int32, uint8, uint16, uint32 or text. index: index of an array's element. EEPROM cells wear out:
        never store in a cycle. Whether a text is kept over power-off depends on the drive.
        """
        wanted = target(parameter, self._model, self._options, type=type, index=index)
        if not self.answers:
            if not self._options.broadcast_parameters or wanted.type == "text":
                raise NotSupported(
                    "no manual says that drives obey a parameter write to all; the option broadcast_parameters forces "
                    "it for numbers"
                )
            ak, pwe = access.task_that_writes(wanted, value, store=store)
            return _told(self._frames.block(0, 0, ak=ak, pnu=wanted.pnu, ind=wanted.ind, pwe=pwe))
        if wanted.type != "text":
            return access.write_number(self._talk, wanted, *access.task_that_writes(wanted, value, store=store))
        if not self._options.text_writes:
            raise NotSupported("the guides of this series know AK 15 for reading texts only (FC 101, FC 360)")
        return access.write_text(self._talk, wanted, text_for(wanted, value, LONGEST_TEXT))

    def address_of(self, parameter: str, *, index: int | None = None, **_: Any) -> str:
        """Return PNU and index of a parameter as in the telegram; no index means index 0."""
        wanted = target(parameter, self._model, self._options, index=index)
        return f"{wanted.pnu}[{wanted.ind}]" if wanted.ind else str(wanted.pnu)

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read status word and actual value with a process block, and the fault code if the drive has tripped."""
        reply: ProcessReply = yield from self._talk.status()
        actual, percent = reply.main_actual, _plain(self._talk.profile.percent_of(reply.main_actual))
        return (
            yield from self._commander().status(
                self._model,
                {SOLE_PLACE: reply.status_word},
                reverse=actual < 0 if actual else None,
                actual_percent=percent if self._options.actual_scaling == "reference" else None,
                actual_hz=self._frequency(percent),
            )
        )

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start with 047C, or with 047E and 047F in PROFIdrive; refused for a tripped or locally operated drive.

        reverse: sets bit 15, which works only if 8-54 (506) leaves reversing to the bus. The reference is the one that
        was set here, or else the one that the drive shows. Raises StateError if the drive shows none, since the
        reference would be zero.
        """
        talk = self._talk
        return self._commander().start(reverse=reverse, prepare=talk.take_over_reference())

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: 043C (ramp), 0474 (coast), 046C (quick stop) or 0478 (DC brake), with unchanged functions."""
        talk = self._talk
        if not self.answers and how in talk.profile.stops:
            yield Tell(message=self._frames.block(talk.profile.stops[how][-1].word, 0))
            return
        yield from self._commander().stop(how)
        if not talk.says("remote"):
            raise StateError(
                "the drive is in local operation, where bus commands have no effect; stop it at its keypad"
            )

    @needs_answer
    def reset(self) -> Exchange[None]:
        """Acknowledge a trip with 043C, 04BC, 043C; does nothing on a drive that has not tripped."""
        talk = self._talk
        try:
            yield from self._commander().reset()
        except StateError as error:
            if self._options.profile == "profidrive" or not words.has(talk.seen, words.TRIP_LOCK):
                raise
            raise StateError(f"{error}; it is trip-locked: switch its mains off and on") from None

    @needs_answer
    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the bus reference, a share of the reference range, to the nearest step of 0.0061 %.

        It is sent immediately with the control word in force: the last one from here, or the ramp-stop word for a drive
        at standstill. Raises StateError for a motor that was not started from here, or has stopped running.
        """
        return self._talk.set_reference(self._talk.profile.steps_of(exact(percent, "reference")))

    @needs_answer
    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the bus reference as a frequency within the reference range of the options."""
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
        return self._talk.set_reference(self._talk.profile.steps_of((number - lowest) * 100 / (highest - lowest)))

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Request the status word once, without a valid control word, by the shortest possible telegram."""
        yield from self._talk.ask(attempts=1)

    @needs_answer
    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read the name plate: the read-only texts of the model, or without a model the texts of both families."""
        plates: tuple[Mapping[str, str], ...] = (_NAME_PLATE, _OLD_NAME_PLATE)
        if self._model is not None:
            known = self._model.parameters.values()
            plates = ({info.address: info.title for info in known if info.type == "text" and info.access == "r"},)
        found: Mapping[str, str] = {}
        for plate in plates:
            wanted = {address: title for address, title in plate.items() if not only or title in only}
            found = found or (yield from self._texts(wanted))
        return found

    @needs_answer
    def describe(self, parameter: str, *, option_texts: int = 32) -> Exchange[ParameterInfo]:
        """Read the description of a parameter from the drive: name, type, unit, scale, limits, access and option texts.

        option_texts: the number of option values whose text is read, 0 to 254, one telegram each. Changes nothing.
        """
        return parameter_description.describe(self._talk, self._known(parameter, ""), option_texts)

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Return whether a call may start the motor: a jog, or a control word that neither stops nor resets."""
        word = arguments.get("word")
        if verb == "control_word" and isinstance(word, int):
            return self._talk.profile.may_start(word)
        return verb in ("jog", "control_word")

    # Helpers

    def _commander(self) -> Commander:
        return self._talk.commander(state_timeout_s=self._options.state_timeout_s, fault_code=self._fault_code)

    def _frequency(self, percent: Decimal) -> Decimal | None:
        span = self._range if self._options.actual_scaling == "reference" else self._limits
        if span is None or (percent < 0 and span[0]):
            return None
        return _plain(span[0] + (span[1] - span[0]) * percent / 100)

    def _fault_code(self) -> Exchange[int | None]:
        if not self._options.fault_code_parameter:
            return None
        wanted = target(self._options.fault_code_parameter, self._model, self._options, type="uint16")
        found = yield from unless_refused(access.read_number(self._talk, wanted), UnexpectedReplyError)
        return None if found is None else int(found.raw)

    def _texts(self, parameters: Mapping[str, str]) -> Exchange[Mapping[str, str]]:
        found = {}
        for parameter, title in parameters.items():
            wanted = target(parameter, self._model, self._options, type="text")
            reading = yield from unless_refused(access.read_text(self._talk, wanted), UnexpectedReplyError)
            if reading and reading.value:
                found[title] = str(reading.value)
        return found


def _plain(number: Decimal) -> Decimal:
    """Return a number without trailing zeros."""
    whole = number.to_integral_value()
    return whole if whole == number else number.normalize()


def _told(message: Message) -> Exchange[None]:
    """Send a telegram to all drives."""
    yield Tell(message=message)


def _in_ind(number: int, allowed: range, what: str) -> int:
    """Return a number for IND. Raises ParameterAddressError for one that is not allowed there."""
    if type(number) is not int or number not in allowed:
        raise ParameterAddressError(f"there is no {what} {number!r}; they are {allowed.start} to {allowed.stop - 1}")
    return number
