"""The verbs of a host for a Fuji inverter: read, write, run, reset, status.

FVR-E11S manual 9-18 to 9-20; FRENIC-VG option manual 5-13; HVAC/AQUA RS-485 manual 4-17; section 5 of the
specification.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, StateError, UsageError, ValueRefusedError
from drivecomm.protocol import Capabilities, Stop, cached, check_store, exact, needs_answer, unless_refused, unscaled
from drivecomm_fuji import words
from drivecomm_fuji.inverter_requests import FujiMemory, FujiRequests
from drivecomm_fuji.parameters import FujiFunction, command_word, reading_of, target, word_for
from drivecomm_fuji.telegrams import BROADCAST, StandardFrame
from drivecomm_fuji.words import COMMAND, FREQUENCY, FREQUENCY_PU, RUN

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.profiles import Commander, ControlProfile
    from drivecomm.protocol import DriveStatus, Exchange, Model, Reading, Value
    from drivecomm_fuji.options import FujiOptions

_NAME_PLATE = {"type code": "M23", "capacity code": "M24", "ROM version": "M25"}
_EXTRA = ("terminals", "digital_outputs", "reset_by_command")


class FujiOperations:
    """Verbs of one Fuji inverter, or of all inverters at station 99, which show no reference.

    S06 carries terminals and run command together, so its word is remembered.
    """

    def __init__(
        self, address: int, options: FujiOptions, model: Model | None, memory: FujiMemory | None = None
    ) -> None:
        self.answers = address != BROADCAST
        self._options = options
        self._profile = options.generation
        self._model = model
        self._memory = memory or FujiMemory()
        self._asking = FujiRequests(address, options, self._memory)
        self._known = cached(lambda parameter, name=None: target(parameter, model, options, name))

    @property
    def capabilities(self) -> Capabilities:
        """Operations that a Fuji inverter supports."""
        return Capabilities(
            stops=frozenset(self._control.stops),
            reverse=True,
            reference_percent=True,
            reference_hz=self._profile.s05_is_frequency or self._options.maximum_frequency_hz is not None,
            stored_writes=True,
            volatile_writes=True,
            broadcast=True,
            reference_maximum=words.MAXIMUM_FREQUENCY if self._profile.s05_is_frequency and self._model else "",
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """Verbs that only this protocol has."""
        return {name: getattr(self, name) for name in _EXTRA}

    @needs_answer
    def read(self, parameter: str, *, format: str | int | None = None) -> Exchange[Reading]:
        """Read a function.

        format: its data format in the manual's numbering, such as "[5]", instead of the model's.
        """
        return self._read(self._known(parameter, format))

    def write(
        self, parameter: str, value: Value | float, *, store: bool = False, format: str | int | None = None
    ) -> Exchange[Reading | None]:
        """Write a function.

        format: its data format in the manual's numbering, such as "[5]", instead of the model's. S codes are volatile.
        All other writes go to the inverter's non-volatile memory, so they need `store=True`. The result is a reading
        with a note if the write has no effect: a write of S05 after an S01 that was written here and is not zero.
        """
        wanted = self._known(parameter, format)
        function, is_command = wanted.function, wanted.function[0] == "S"
        if function[0] == "M" or (wanted.info is not None and "w" not in wanted.info.access):
            raise NotSupported(f"{function} is read only")
        check_store(function, "never" if is_command else "always", store=store)
        data = word_for(wanted, value, self._options)
        if not self.answers and not self._profile.takes_from_all(function):
            allowed = self._profile.broadcast_functions
            known = "S codes" if allowed is None else ", ".join(sorted(allowed))
            raise NotSupported(f"{function} cannot be broadcast to all stations; {known} can")
        return self._write(wanted, data)

    def address_of(self, parameter: str, **_: Any) -> str:
        """Return the function code of a parameter."""
        return self._known(parameter).function

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read the operation status M14, and the latest alarm M16 if the status shows an alarm."""
        seen, known = (yield from self._asking.look()), words.control_profile()
        reverse = known.says("reverse", seen) if known.says("running", seen) else None
        flags = words.flags_of(seen[profiles.SOLE_PLACE], self._profile)
        return (yield from self._by(known).status(self._model, seen, reverse=reverse, flags=flags))

    def digital_outputs(self, **states: bool) -> Exchange[Reading | None]:
        """Set the universal outputs Y1 to Y5 with S07; outputs that are not named are switched off."""
        if self._profile.name == "e11s":
            raise NotSupported("FVR-E11S has no universal outputs (S07)")
        word = 0
        for name, state in states.items():
            if name not in ("Y1", "Y2", "Y3", "Y4", "Y5"):
                raise UsageError(f"{name!r} is not an output; they are Y1 to Y5")
            word |= bool(state) << int(name[1]) - 1
        return self.write("S07", word, format="[15]")

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Request the status once; a NAK also proves that there is an inverter."""
        return self._asking.probe()

    @needs_answer
    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read type code, capacity code and ROM version; entries that the inverter does not have are left out."""
        found = {}
        for name, function in _NAME_PLATE.items():
            reply = (yield from unless_refused(self._asking.ask_for(function))) if not only or name in only else None
            if reply is None:
                continue
            text = words.word_text("[17]", reply.data, self._profile, {}) if name == "type code" else ""
            found[name] = f"{reply.data:04X} ({text})" if text else str(reply.data)
        return found

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Set FWD or REV in S06, unless the inverter has an alarm."""
        return self._by(self._control).start(reverse=reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Clear FWD and REV in S06; to coast, also set the terminal that is assigned to coasting."""
        if how not in self._control.stops:
            raise NotSupported(
                f"this inverter has no {how.value} stop over the bus; use ramp, or coast with the terminal "
                "that is assigned to it in the inverter, such as coast_terminal=X1",
                says="coast_terminal=X1",
            )
        return self._by(self._control).stop(how)

    def reset(self) -> Exchange[None]:
        """Acknowledge an alarm through bit 15 of S06; does nothing on an inverter without an alarm."""
        return self._reset(self._control)

    def reset_by_command(self, command: str = "E") -> Exchange[None]:
        """Acknowledge an alarm by command E or by the optional frame m; does nothing without an alarm."""
        if command not in ("E", "m"):
            raise UsageError(f"{command!r} resets nothing; the commands that do are E and m")
        before, *_, last = self._control.reset
        return self._reset(replace(self._control, reset=(before, replace(last, place=command))))

    def terminals(self, **states: bool) -> Exchange[None]:
        """Switch the terminals X1... (frenic also XF and XR) in S06; terminals that are not named keep their state.

        S06 also carries the run command, so it is read first if the motor runs. Raises StateError if the run command in
        the inverter is not the one of this program, because the write would then command the motor.
        """
        on = off = 0
        for name, state in states.items():
            if name not in self._profile.terminals:
                known = ", ".join(self._profile.terminals)
                raise UsageError(f"{self._profile.title} has no terminal {name!r} in S06; it has {known}")
            mask = 1 << self._profile.terminals[name]
            on, off = (on | mask, off) if state else (on, off | mask)
        return self._asking.switch(command_word(on, self._options), off)

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the reference in per cent of the maximum frequency, -100 to 100 %: write S05 = 0, then S01.

        S01 has steps of 0.005 %. Raises StateError if the inverter then shows another reference.
        """
        number = exact(percent, FREQUENCY_PU)
        if not -100 <= number <= 100:
            raise ValueRefusedError(f"{number} % is outside -100 to 100 %")
        return self._asking.set_per_unit(unscaled(number, words.STEP_PU, FREQUENCY_PU, "%"))

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the reference in hertz, 0 to 400 Hz in steps of 0.01 Hz: write S01 = 0, then S05.

        S01 would override S05 if it were not zero. Raises StateError if the inverter then shows another reference: it
        limits S05 to its maximum frequency F03 without reporting that. If S05 is not a frequency, S01 is written as a
        share of the option maximum_frequency_hz.
        """
        number = exact(hz, FREQUENCY)
        if self._profile.s05_is_frequency:
            if not 0 <= number <= 400:
                raise ValueRefusedError(f"{number} Hz is outside 0 to 400 Hz; a motor is reversed by its start")
            return self._asking.set_frequency(unscaled(number, words.HUNDREDTH_HZ, FREQUENCY, "Hz"))
        if self._options.maximum_frequency_hz is None:
            raise NotSupported(
                f"S05 of {self._profile.title} is a position; give what F03 holds, such as maximum_frequency_hz=50, "
                "or the reference in percent",
                says="maximum_frequency_hz=50",
            )
        maximum = exact(self._options.maximum_frequency_hz, "F03")
        if not -maximum <= number <= maximum:
            raise ValueRefusedError(f"{number} Hz is outside -{maximum} to {maximum} Hz, the maximum frequency")
        return self._asking.set_per_unit(unscaled(number, maximum / words.FULL_SCALE, FREQUENCY_PU, "Hz"))

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Return whether a call may start the motor: S06 with a run bit, or with a terminal.

        A terminal may be assigned to running in the inverter.
        """
        if verb == "terminals":
            return any(arguments.values())
        if verb != "write":
            return False
        wanted = self._known(arguments["parameter"])
        return wanted.function == COMMAND and bool(word_for(wanted, arguments["value"], self._options) & ~words.RESET)

    # Helpers

    @cached_property
    def _control(self) -> ControlProfile:
        """Control profile, with the terminal that is assigned to coasting: set by that stop, cleared by a start."""
        known, name = words.control_profile(), self._options.coast_terminal
        if not name:
            return known
        coast = 1 << self._profile.terminals[name]
        start, backwards = (
            tuple(replace(step, mask=RUN | coast) for step in steps) for steps in (known.start, known.start_reverse)
        )
        stops = {**known.stops, Stop.COAST: (profiles.ControlStep(word=coast, mask=RUN | coast, repeats=True),)}
        return replace(known, start=start, start_reverse=backwards, stops=stops)

    def _by(self, known: ControlProfile) -> Commander:
        return profiles.Commander(
            known,
            self._asking,
            state_timeout_s=self._options.reset_timeout_s,
            answers=self.answers,
            fault_code=self._asking.alarm_code,
        )

    def _reset(self, known: ControlProfile) -> Exchange[None]:
        try:
            yield from self._by(known).reset()
        except StateError as error:
            raise StateError(f"the alarm is still there: {error}") from None

    def _read(self, wanted: FujiFunction) -> Exchange[Reading]:
        asking, function = self._asking, wanted.function
        ask = asking.read_ask(function)
        # Most reads of an inverter come through here, and a nested generator would cost time.
        reply: Any = yield ask
        if reply.kind != "ack":
            reply = yield from asking.again(ask, reply, function)
        data, negative, note = reply.data, isinstance(reply, StandardFrame) and reply.negative, ""
        if reply.command == "j":
            note = "from the optional frame j, which has no room for a sign"
            negative = self._options.signed_j and data >= 0x8000
            data = 0x10000 - data if negative else data
        return reading_of(wanted, data, self._options, self._model, negative=negative, note=note)

    def _write(self, wanted: FujiFunction, data: int) -> Exchange[Reading | None]:
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
