"""The verbs that start, stop and steer the motor of a Fuji inverter.

S01 beats S05 as soon as it is not zero (FVR-E11S manual 9-20), reading either returns what was sent and not what is
effective, and any master may have set the other one. So it is set to zero each time, and what holds is read back: M05
in hertz, M01 as a share of the maximum frequency.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, RefusedError, StateError, UsageError, ValueRefusedError
from drivecomm.protocol import Stop, exact, needs_answer, unscaled
from drivecomm_fuji import words
from drivecomm_fuji.asking import Asking
from drivecomm_fuji.memory import FujiMemory
from drivecomm_fuji.parameters import command_word
from drivecomm_fuji.telegrams import BROADCAST
from drivecomm_fuji.words import FREQUENCY, FREQUENCY_PU, RUN

if TYPE_CHECKING:
    from drivecomm.profiles import Commander, ControlProfile
    from drivecomm.protocol import Exchange, Value
    from drivecomm_fuji.options import FujiOptions

_NEAR_PU = 10
"""How far S01 and what is shown of it may lie apart, in steps of 0.005 %: 0.01 Hz of 20 Hz."""

_HUNDREDTH_HZ, _STEP_PU = Decimal("0.01"), Decimal("0.005")


class Motion:
    """The motor of one inverter, or of all at station 99, who show no reference."""

    def __init__(self, address: int, options: FujiOptions, memory: FujiMemory | None) -> None:
        self.answers = address != BROADCAST
        self._options = options
        self._profile = options.generation
        self._memory = memory or FujiMemory()
        self._asking = Asking(address, options, self._memory)

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Set FWD or REV in S06, unless the inverter has an alarm."""
        return self._by(self._control).start(reverse=reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Clear FWD and REV in S06; to coast, also set the terminal that is assigned to it."""
        if how not in self._control.stops:
            raise NotSupported(
                f"S06 has no bit to stop by {how.value}; "
                + (
                    "to coast, assign a terminal to it in the inverter and name it, such as coast_terminal=X1"
                    if how is Stop.COAST
                    else "it can stop by ramp, and by coast with a terminal for it, such as coast_terminal=X1"
                ),
                says="coast_terminal=X1",
            )
        return self._by(self._control).stop(how)

    def reset(self) -> Exchange[None]:
        """Acknowledge an alarm through bit 15 of S06; does nothing on an inverter without one."""
        return self._reset(self._control)

    def reset_by_command(self, command: str = "E") -> Exchange[None]:
        """Acknowledge an alarm by command E, or by the optional frame m; does nothing on an inverter without one."""
        if command not in ("E", "m"):
            raise UsageError(f"{command!r} resets nothing; the commands that do are E and m")
        before, *_, last = self._control.reset
        return self._reset(replace(self._control, reset=(before, replace(last, place=command))))

    def terminals(self, **states: bool) -> Exchange[None]:
        """Switch the terminals X1... (frenic also XF and XR) in S06; those not named stay as they are.

        S06 carries the run command, too, so an inverter whose motor runs is asked for it. Raises StateError where it is
        not the one of this program that holds, for then this would command the motor.
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
        """Write S05 = 0, and S01, 0.005 % steps of the maximum frequency, -100 to 100 %.

        Raises StateError when the inverter then shows another reference.
        """
        number = exact(percent, FREQUENCY_PU)
        if not -100 <= number <= 100:
            raise ValueRefusedError(f"{number} % is outside -100 to 100 %")
        return self._set_per_unit(unscaled(number, _STEP_PU, FREQUENCY_PU, "%"))

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Write S01 = 0, which would beat it, and S05, 0.01 Hz steps, 0 to 400 Hz.

        Raises StateError when the inverter then shows another reference: it limits S05 to its maximum frequency F03
        without saying so. Where S05 is no frequency, S01 is written as a share of the option maximum_frequency_hz.
        """
        number = exact(hz, FREQUENCY)
        if self._profile.s05_is_frequency:
            if not 0 <= number <= 400:
                raise ValueRefusedError(f"{number} Hz is outside 0 to 400 Hz; a motor is reversed by its start")
            return self._set_frequency(unscaled(number, _HUNDREDTH_HZ, FREQUENCY, "Hz"))
        if self._options.maximum_frequency_hz is None:
            raise NotSupported(
                f"S05 of {self._profile.title} is a position; give what F03 holds, such as maximum_frequency_hz=50, "
                "or the reference in percent",
                says="maximum_frequency_hz=50",
            )
        maximum = exact(self._options.maximum_frequency_hz, "F03")
        if not -maximum <= number <= maximum:
            raise ValueRefusedError(f"{number} Hz is outside -{maximum} to {maximum} Hz, the maximum frequency")
        return self._set_per_unit(unscaled(number, maximum / words.FULL_SCALE, FREQUENCY_PU, "Hz"))

    # Conversations

    @cached_property
    def _control(self) -> ControlProfile:
        """The control profile, with the terminal that is assigned to coasting: set by that stop, cleared by a start."""
        known, name = words.control_profile(), self._options.coast_terminal
        if not name:
            return known
        coast = 1 << self._profile.terminals[name]
        start, backwards = (
            tuple(replace(step, mask=RUN | coast) for step in steps) for steps in (known.start, known.start_reverse)
        )
        stops = {**known.stops, Stop.COAST: (profiles.Step(word=coast, mask=RUN | coast, repeats=True),)}
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

    def _set_frequency(self, data: int) -> Exchange[None]:
        yield from self._asking.write(FREQUENCY_PU, 0)
        yield from self._asking.write(FREQUENCY, data)
        yield from self._confirm(words.FINAL, data, 1, _HUNDREDTH_HZ, "Hz")

    def _set_per_unit(self, data: int) -> Exchange[None]:
        """Write S01, signed, in 20000ths of the maximum."""
        if self._profile.s05_is_frequency:
            yield from self._asking.write(FREQUENCY, 0)
        yield from self._asking.write(FREQUENCY_PU, data % 0x10000)
        # What an inverter keeps in hundredths of a hertz, it shows as so many steps of its maximum frequency.
        yield from self._confirm(words.FINAL_PU, abs(data), _NEAR_PU, _STEP_PU, "%")

    def _confirm(self, function: str, meant: int, near: int, scale: Decimal, unit: str) -> Exchange[None]:
        """Read back what the inverter makes of its references. Raises StateError when it is something else."""
        if not self._options.reference_read_back or not self.answers:
            return
        remedy = "if it shows no reference in standstill, use the option reference_read_back=False"
        try:
            reply: Any = yield from self._asking.ask_for(function)
        except RefusedError as error:
            raise StateError(f"the inverter took the reference and does not show it: {error}; {remedy}") from None
        shown = 0x10000 - reply.data if reply.data >= 0x8000 and function == words.FINAL_PU else reply.data
        if abs(shown - meant) > near:
            raise StateError(
                f"the inverter took a reference of {meant * scale} {unit}, and its final reference ({function}) is "
                f"{shown * scale} {unit}: it is limited (F03, F15), or comes from elsewhere (H30, F01); {remedy}"
            )
