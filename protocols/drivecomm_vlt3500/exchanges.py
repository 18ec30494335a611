"""The conversations of a master with a VLT: read, write, command, status.

VLT Series 3500 manual, printed pages 85 to 92; VLT 3000 manual MG.30.A7.02, pages 74 to 80.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, RefusedError, StateError, UsageError, ValueRefusedError
from drivecomm.protocol import Capabilities, DriveStatus, Exchange, Stop, Tell, exact, kept, needs_answer
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.causes import cause_text
from drivecomm_vlt3500.commands import Motion, VltMemory
from drivecomm_vlt3500.messages import Read, ReadIndex, Reply, Update
from drivecomm_vlt3500.parameters import Target, data_for, reading_of, target
from drivecomm_vlt3500.telegrams import BROADCAST
from drivecomm_vlt3500.words import profile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Model, Reading, Value as ParameterValue
    from drivecomm_vlt3500.options import VltOptions

BUS_REFERENCE = "516"
SOFTWARE_VERSION = "502[19]"


class VltOperations:
    """The verbs of one VLT, or of all of them at address 0.

    Reading, writing and asking for the status never command; what commands is in `Motion`.
    """

    def __init__(self, address: int, options: VltOptions, model: Model | None, memory: VltMemory | None = None) -> None:
        self.answers = address != BROADCAST
        self._address = address
        self._options = options
        self._model = model
        self._motion = Motion(address, options, memory or VltMemory())
        self._known = kept(lambda parameter: target(parameter, model))
        self._request = kept(self._new_request)

    @property
    def capabilities(self) -> Capabilities:
        """What a VLT can be asked to do.

        Whether a write survives power-off is not known of any of them, so neither stored nor volatile writes are
        promised. The bus reference, parameter 516, is meant to be written cyclically.
        """
        return Capabilities(
            stops=frozenset(self._motion.stops),
            reverse=True,
            reference_percent=True,
            reference_hz=self._options.maximum_hz is not None,
            stored_writes=False,
            volatile_writes=False,
            broadcast=True,
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """Verbs beyond those that all drives have: bits 5, 8, 9, 11 to 14 of the control word, and the word itself."""
        return {
            "jog": self.jog,
            "slow_down": self.slow_down,
            "catch_up": self.catch_up,
            "hold": self.hold,
            "select_setup": self.select_setup,
            "control_word": self.control_word,
        }

    @needs_answer
    def read(self, parameter: str, *, index: tuple[int, ...] | int | str | None = None) -> Exchange[Reading]:
        """Read a parameter (R), or one element of an indexed one (I): `502[17]`, `602[13,5]`, or index=(13, 5)."""
        wanted = self._known(parameter) if index is None else target(parameter, self._model, index)
        return self._read_target(wanted)

    def write(
        self,
        parameter: str,
        value: ParameterValue | float,
        *,
        store: bool = False,
        decimals: int | None = None,
        attempts: int = 1,
    ) -> Exchange[Reading | None]:
        """Write a parameter (U) and return what the drive then reports, which it may have rounded or limited.

        decimals: how many digits after the point to send; the model's or the fewest that are exact unless given.
        attempts: how often to send it while no reply comes. store=True is refused: no manual that was read says whether
        a write survives power-off (parameter 517 of a VLT 2000, "save data values", suggests that it does not unless
        that is on). Do not write cyclically, apart from 516.
        """
        wanted = target(parameter, self._model)
        if wanted.index is not None:
            raise NotSupported(f"{wanted.address} cannot be written: indexed parameters are read-only")
        if store:
            raise NotSupported(
                "whether a VLT keeps a write over power-off is not known, so store=True cannot be promised; write "
                "without it, and see parameter 517 where the drive has it",
                says="store=True",
            )
        if type(attempts) is not int or attempts < 1:
            raise UsageError(f"attempts of {attempts!r} would never send anything, use 1 or more", says="attempts")
        sent, places = data_for(wanted, value, decimals)
        return self._write(wanted, sent, places, attempts)

    def address_of(self, parameter: str, **_: Any) -> str:
        """Return number and index of a parameter."""
        return target(parameter, self._model).address

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Ask for the status word with a C telegram that commands nothing."""
        seen = yield from self._motion.look()
        code = None
        if profile().says("fault", seen) and self._options.fault_parameter:
            code = yield from self._fault_code()
        texts = self._model.faults if self._model else {}
        return profile().status(seen, fault_code=code, fault_text=texts.get(code, "") if code is not None else "")

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start with the reference that is set, and wait until the drive says that it runs.

        Where "start not possible" is reported it is released first, 0x047E before 0x047F. A start that is not obeyed is
        taken back with a ramp stop, so that it cannot take effect later. Raises StateError.
        """
        return self._motion.start(reverse=reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: bit 6 = 0 (ramp), OFF2 (coast), OFF3 (quick stop), or bit 4 = 0 where that is DC braking.

        The quick stop is OFF3 and not bit 4: bit 4 may be given another meaning (514) or to a digital input (504).
        Raises StateError when the drive does not report what it was told.
        """
        if how not in self._motion.stops:
            remedy = "; VLT 2000 can with parameter 514 = 1, then use dc_brake=True" if how is Stop.DC_BRAKE else ""
            raise NotSupported(f"this VLT cannot stop by {how.value}{remedy}", says="dc_brake=True")
        return self._motion.stop(how)

    @needs_answer
    def reset(self) -> Exchange[None]:
        """Acknowledge a trip: bit 7 from 0 to 1 and back, in words that stop the motor; nothing without a trip."""
        return self._motion.reset()

    def set_reference_percent(self, percent: ParameterValue | float) -> Exchange[None]:
        """Write the bus reference, parameter 516: percent of the maximum frequency, negative for the other direction.

        Raises StateError when the drive reports another value than the one sent.
        """
        number = exact(percent, BUS_REFERENCE)
        limit = self._options.frequency("reference_limit")
        if abs(number) > limit:
            raise ValueRefusedError(f"a reference of {percent} % is outside -{limit} to {limit} %")
        wanted = target(BUS_REFERENCE, self._model)
        sent, places = data_for(wanted, number, None)
        return self._set_reference(wanted, sent, places)

    def set_reference_hz(self, hz: ParameterValue | float) -> Exchange[None]:
        """Write the bus reference as a frequency; needs the drive's maximum frequency, option maximum_hz."""
        if self._options.maximum_hz is None:
            raise NotSupported(
                "a VLT takes its bus reference in percent; give the drive's maximum frequency, such as maximum_hz=50, "
                "to use Hz",
                says="maximum_hz=50",
            )
        return self.set_reference_percent(self._percent_of(exact(hz, BUS_REFERENCE)))

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Ask once for the status word."""
        yield from self._motion.status_word(attempts=1)

    @needs_answer
    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read the state and, where the drive numbers its read-outs as VLT 2000 does, its software version."""
        status = yield from self._motion.status_word()
        known = {"state": ", ".join(profile().flags_of(status))}
        try:
            version = yield from self._read_target(target(SOFTWARE_VERSION, None))
        except RefusedError:
            return known
        return {**known, "software": str(version.raw)}

    # Verbs beyond the common ones

    @needs_answer
    def jog(self, *, number: int = 1) -> Exchange[None]:
        """Run at bus jog 1 or 2 (bit 8 or 9; 511 and presumably 512), without bit 6, so that any stop ends it."""
        if number not in (1, 2):
            raise UsageError(f"jog {number!r} does not exist; there are jog 1 and jog 2")
        return self._motion.jog(words.JOG_1 if number == 1 else words.JOG_2)

    @needs_answer
    def slow_down(self) -> Exchange[None]:
        """Lower the reference a step (bit 11 to 1 and back); the drive must have been commanded by this object."""
        return self._motion.step(words.SLOW_DOWN, "slow_down")

    @needs_answer
    def catch_up(self) -> Exchange[None]:
        """Raise the reference a step (bit 12 to 1 and back); the drive must have been commanded by this object."""
        return self._motion.step(words.CATCH_UP, "catch_up")

    @needs_answer
    def hold(self) -> Exchange[None]:
        """Keep the output frequency as it is (bit 5 = 0) until the next command; `start` goes on."""
        return self._motion.amend(lambda word: word & ~words.RAMP_ENABLED, "hold")

    @needs_answer
    def select_setup(self, *, number: int) -> Exchange[None]:
        """Select set-up 1 to 4 (bits 13 and 14) in this and every further control word of this object."""
        if number not in range(1, self._options.setups + 1):
            raise UsageError(f"set-up {number!r} does not exist; this drive has 1 to {self._options.setups}")
        return self._motion.select(words.setup_bits(number))

    @needs_answer
    def control_word(self, *, word: int, mask: int | None = None) -> Exchange[DriveStatus]:
        """Send any control word, once. mask: the bits that are given, in groups of four; others stay as they are (`P`).

        It is sent as it stands: what it starts, starts. Raises UsageError for a word that no telegram can carry.
        """
        for name, value in (("control word", word), ("mask", 0xFFFF if mask is None else mask)):
            if type(value) is not int or value not in range(0x10000):
                raise UsageError(f"{name} {value!r} has not 16 bits")
        given = 0xFFFF if mask is None else mask
        if any(given >> shift & 0xF not in (0, 0xF) for shift in range(0, 16, 4)) or not given & words.VALID:
            raise UsageError(f"mask {given:04X}H: whole groups of four bits, and bits 8 to 11 among them")
        if word & ~given:
            raise UsageError(f"control word {word:04X}H has bits that mask {given:04X}H leaves as they are")
        return self._any_word(word, given)

    # Conversations

    def _read_target(self, wanted: Target) -> Exchange[Reading]:
        reply = yield from self._motion.ask_idle(self._request(wanted.number, wanted.index))
        return reading_of(wanted, _value(wanted, reply))

    def _new_request(self, number: int, index: tuple[int, ...] | None) -> Read | ReadIndex:
        if index is None:
            return Read(address=self._address, control_word=self._options.idle_word, parameter=number)
        return ReadIndex(
            address=self._address,
            control_word=self._options.idle_word,
            parameter=number,
            index=index,
            decimals=0 if len(index) == 1 else 2,
        )

    def _write(self, wanted: Target, sent: Decimal, places: int, attempts: int) -> Exchange[Reading | None]:
        request = Update(
            address=self._address,
            control_word=self._options.idle_word,
            parameter=wanted.number,
            value=sent,
            decimals=places,
        )
        if self._address == BROADCAST:
            yield Tell(message=request)
            return None
        reply = yield from self._motion.ask_idle(request, attempts=attempts, acts=True)
        reported = _value(wanted, reply)
        return reading_of(
            wanted, reported, "" if reported == sent else f"the drive reports {reported} instead of {sent}"
        )

    def _set_reference(self, wanted: Target, sent: Decimal, places: int) -> Exchange[None]:
        taken = yield from self._write(wanted, sent, places, 1)
        if taken is not None and Decimal(taken.raw) != sent:
            raise StateError(f"the drive reports a bus reference of {taken.raw} % instead of {sent} %")

    def _fault_code(self) -> Exchange[int | None]:
        wanted = target(self._options.fault_parameter, self._model)
        try:
            found = yield from self._read_target(wanted)
        except RefusedError:
            return None
        return found.value if isinstance(found.value, int) else None

    def _any_word(self, word: int, mask: int) -> Exchange[DriveStatus]:
        return profile().status({profiles.ONLY: (yield from self._motion.command(word, mask=mask, attempts=1))})

    def _percent_of(self, hz: Decimal) -> Decimal:
        highest, lowest = self._options.frequency("maximum_hz"), self._options.frequency("minimum_hz")
        if self._options.reference_span == "maximum":
            lowest = Decimal(0)
        if abs(hz) < lowest:
            raise ValueRefusedError(f"{hz} Hz is below the minimum frequency of {lowest} Hz")
        span = highest - lowest
        with localcontext() as context:
            context.prec = 60
            above = (abs(hz) - lowest) * 100
            percent = (above / span).normalize()
            if percent * span != above:
                raise ValueRefusedError(f"{hz} Hz of {highest} Hz is no exact percentage, and it is not rounded")
        return percent.copy_sign(hz)


def _value(wanted: Target, reply: Reply) -> Decimal:
    """Return the value that a reply brings. Raises RefusedError with the cause when it brings none."""
    if reply.value is None:
        code = reply.fault_code
        raise RefusedError(wanted.address, code, cause_text(code) if code is not None else "without a cause")
    return reply.value
