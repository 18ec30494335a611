"""The verbs of a drive that speaks the Danfoss FC protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, ParameterAddressError, UnexpectedReplyError, UsageError
from drivecomm.protocol import Capabilities, kept, needs_answer, unless_refused
from drivecomm_danfoss_fc import access, describing
from drivecomm_danfoss_fc.motion import Motion
from drivecomm_danfoss_fc.options import span
from drivecomm_danfoss_fc.parameters import target, text_for
from drivecomm_danfoss_fc.telegrams import LONGEST_TEXT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from decimal import Decimal

    from drivecomm.protocol import DriveStatus, Exchange, Model, ParameterInfo, Reading, Value
    from drivecomm_danfoss_fc.messages import ProcessReply
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


class DanfossFcOperations(Motion):
    """The verbs of one drive, or of all drives at address 0.

    extra: verbs beyond those that every protocol has: `jog(number=1)`, `preset(number)`, `set_up(number)`,
    `relays(relay_1=None, relay_2=None)`, `ramp(number)`, `freeze()`, `catch_up()`, `slow_down()`, `control_word(word)`,
    `release()` and `describe(parameter, option_texts=32)`.
    """

    def __init__(
        self, address: int, options: DanfossFcOptions, model: Model | None, memory: profiles.CommandMemory | None = None
    ) -> None:
        super().__init__(address, options, memory)
        self._options = options
        self._model = model
        self._known = kept(lambda name, kind: target(name, model, options, type=kind))
        self._types: dict[int, str] = {}
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
            stops=frozenset(self._words.profile.stops),
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
        asked = [name for name, given in (("option_text", option_text), ("element", element)) if given is not None]
        asked += ["an index"] if asked and (index is not None or "[" in parameter) else []
        if len(asked) > 1:
            raise UsageError(f"IND holds one thing: {' or '.join(asked)}")
        if option_text is not None:
            return access.read_option_text(self._talk, wanted, _in_ind(option_text, range(254), "option with a text"))
        if element is not None:
            return access.read_element(self._talk, wanted, _in_ind(element, range(1, 256), "description element"))
        return access.read_typed(self._talk, wanted) if type else access.read_as_it_is(self._talk, wanted, self._types)

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
            ak, pwe = access.task_that_writes(wanted, value, store=store)
            return self._talk.tell_parameter(ak, wanted.pnu, wanted.ind, pwe)
        if wanted.type != "text":
            return access.write_number(self._talk, wanted, *access.task_that_writes(wanted, value, store=store))
        if not self._options.text_writes:
            raise NotSupported("the guides of this series know AK 15 for reading texts only (FC 101, FC 360)")
        return access.write_text(self._talk, wanted, text_for(wanted, value, LONGEST_TEXT))

    def address_of(self, parameter: str, *, index: int | None = None, **_: Any) -> str:
        """Return PNU and index of a parameter, as they stand in the telegram; no index is index 0."""
        wanted = target(parameter, self._model, self._options, index=index)
        return f"{wanted.pnu}[{wanted.ind}]" if wanted.ind else str(wanted.pnu)

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read status word and actual value with a process block, and the fault code if the drive has tripped."""
        reply: ProcessReply = yield from self._words.status()
        actual, percent = reply.main_actual, _plain(self._words.profile.percent_of(reply.main_actual))
        return (
            yield from self._by(self._words.profile, fault_code=self._fault_code).status(
                self._model,
                {profiles.ONLY: reply.status_word},
                reverse=actual < 0 if actual else None,
                actual_percent=percent if self._options.actual_scaling == "reference" else None,
                actual_hz=self._frequency(percent),
            )
        )

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Ask once for the status word, without a valid control word, by the shortest telegram that there is."""
        yield from self._words.ask(attempts=1)

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
    """Return a number without the zeros behind it."""
    whole = number.to_integral_value()
    return whole if whole == number else number.normalize()


def _in_ind(number: int, allowed: range, what: str) -> int:
    """Return a number for IND. Raises ParameterAddressError for one that names nothing."""
    if type(number) is not int or number not in allowed:
        raise ParameterAddressError(f"{number!r} is no {what}: they are {allowed.start} to {allowed.stop - 1}")
    return number
