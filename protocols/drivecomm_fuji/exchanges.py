"""The conversations of a host with a Fuji inverter: read, write, run, reset, status.

FVR-E11S manual 9-18 to 9-20; FRENIC-VG option manual 5-13; HVAC/AQUA RS-485 manual 4-17; section 5 of the
specification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, UsageError
from drivecomm.protocol import (
    Capabilities,
    DriveStatus,
    Exchange,
    kept,
    needs_answer,
    unless_refused,
)
from drivecomm_fuji import words
from drivecomm_fuji.motion import Motion
from drivecomm_fuji.parameters import reading_of, target, word_for
from drivecomm_fuji.telegrams import Poll
from drivecomm_fuji.words import COMMAND, FREQUENCY, FREQUENCY_PU, flags_of, word_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Model, Reading, Value as ParameterValue
    from drivecomm_fuji.memory import FujiMemory
    from drivecomm_fuji.options import FujiOptions
    from drivecomm_fuji.parameters import Target

_NAME_PLATE = {"type code": "M23", "capacity code": "M24", "ROM version": "M25"}


class FujiOperations(Motion):
    """The verbs of one Fuji inverter, or of all of them at station 99.

    S06 carries terminals and run command together, so its word is remembered. S01 beats S05 as soon as it is not zero,
    so whoever sets the one sets the other to zero, and reads back which reference holds.
    """

    def __init__(
        self, address: int, options: FujiOptions, model: Model | None, memory: FujiMemory | None = None
    ) -> None:
        super().__init__(address, options, memory)
        self._model = model
        self._known = kept(lambda parameter: target(parameter, model, options))

    @property
    def capabilities(self) -> Capabilities:
        """What a Fuji inverter can be asked to do."""
        hz = self._profile.s05_is_frequency or self._options.maximum_frequency_hz is not None
        return Capabilities(
            stops=frozenset(self._control.stops),
            reverse=True,
            reference_percent=True,
            reference_hz=hz,
            stored_writes=True,
            volatile_writes=True,
            broadcast=True,
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """The verbs that only this protocol has."""
        return {
            "terminals": self.terminals,
            "digital_outputs": self.digital_outputs,
            "reset_by_command": self.reset_by_command,
        }

    @needs_answer
    def read(self, parameter: str, *, format: str | int | None = None) -> Exchange[Reading]:
        """Read a function. format: its data format in the manual's numbering, such as "[5]", instead of the model's."""
        wanted = self._known(parameter) if format is None else target(parameter, self._model, self._options, format)
        return self._read_target(wanted)

    def write(
        self,
        parameter: str,
        value: ParameterValue | float,
        *,
        store: bool = False,
        format: str | int | None = None,
    ) -> Exchange[Reading | None]:
        """Write a function. format: its data format in the manual's numbering, such as "[5]", instead of the model's.

        S codes are volatile. No other write can be kept out of the inverter's non-volatile memory, so it needs
        `store=True`. The result is a reading with a note where the write has no effect: of S05, after an S01
        that was written here and is not zero.
        """
        wanted = target(parameter, self._model, self._options, format)
        function = wanted.function
        if function[0] == "M" or (wanted.info is not None and "w" not in wanted.info.access):
            raise NotSupported(f"{function} is read only")
        if wanted.is_command and store:
            raise NotSupported(
                f"{function} is a command, which no inverter stores; write it without store=True", says="store=True"
            )
        if not wanted.is_command and not store:
            raise NotSupported(
                f"an inverter may keep every write of {function} in its non-volatile memory, which wears out; "
                "it is only written with store=True",
                says="store=True",
            )
        data = word_for(wanted, value, self._options)
        if not self.answers:
            self._check_broadcast(function)
        return self._write(wanted, data)

    def address_of(self, parameter: str, **_: Any) -> str:
        """Return the function code of a parameter."""
        return target(parameter, self._model, self._options).function

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read the operation status M14, and the latest alarm M16 if it says alarm."""
        seen, known = (yield from self._asking.look()), words.control_profile()
        reverse = known.says("reverse", seen) if known.says("running", seen) else None
        flags = flags_of(seen[profiles.ONLY], self._profile)
        return (yield from self._by(known).status(self._model, seen, reverse=reverse, flags=flags))

    def digital_outputs(self, **states: bool) -> Exchange[Reading | None]:
        """Set the universal outputs Y1 to Y5 with S07; those not named are switched off."""
        if self._profile.name == "e11s":
            raise NotSupported("FVR-E11S has no universal outputs (S07)")
        word = 0
        for name, state in states.items():
            if name not in ("Y1", "Y2", "Y3", "Y4", "Y5"):
                raise UsageError(f"{name!r} is no output; they are Y1 to Y5")
            word |= bool(state) << int(name[1]) - 1
        return self.write("S07", word, format="[15]")

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Ask for the status once; a NAK proves an inverter as well as a value does."""
        return self._asking.probe()

    @needs_answer
    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read type code, capacity code and ROM version; what the inverter does not have is left out."""
        found = {}
        for name, function in _NAME_PLATE.items():
            reply = yield from unless_refused(self._asking.ask_for(function))
            if reply is None:
                continue
            text = word_text("[17]", reply.data, self._profile, {}) if name == "type code" else ""
            found[name] = f"{reply.data:04X} ({text})" if text else str(reply.data)
        return found

    # Conversations

    def _read_target(self, wanted: Target) -> Exchange[Reading]:
        reply = yield from self._asking.ask_for(wanted.function)
        data: int = reply.data
        if not isinstance(reply, Poll):
            return reading_of(wanted, data, self._options, self._model, negative=reply.negative)
        if reply.command != "j":
            return reading_of(wanted, data, self._options, self._model)
        note = "from the optional frame j, which has no room for a sign"
        negative = self._options.signed_j and data >= 0x8000
        data = 0x10000 - data if negative else data
        return reading_of(wanted, data, self._options, self._model, negative=negative, note=note)

    def _write(self, wanted: Target, data: int) -> Exchange[Reading | None]:
        function = wanted.function
        if function == COMMAND:
            yield from self._asking.command(data)
            return None
        yield from self._asking.write(function, data)
        if function == FREQUENCY_PU:
            self._memory.s01_beats = data != 0
        if function == FREQUENCY and data and self._memory.s01_beats and self._profile.s05_is_frequency:
            note = "S01 is not zero and beats S05, so S05 has no effect"
            return reading_of(wanted, data, self._options, self._model, note=note)
        return None

    def _check_broadcast(self, function: str) -> None:
        allowed = self._profile.broadcast_functions
        if not self._profile.takes_from_all(function):
            known = "S codes" if allowed is None else ", ".join(sorted(allowed))
            raise NotSupported(f"{function} cannot be written to all stations at once; {known} can")
