"""Verbs of a master for a VLT: read, write, command, status.

VLT Series 3500 manual, printed pages 85 to 92; VLT 3000 manual MG.30.A7.02, pages 74 to 80.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, StateError, TelegramError, UsageError, ValueRefusedError
from drivecomm.protocol import Capabilities, Stop, cached, check_store, exact, needs_answer, unless_refused
from drivecomm_vlt3500 import words
from drivecomm_vlt3500.commands import VltConversation, VltMemory
from drivecomm_vlt3500.parameters import VltTarget, data_for, reading_of, target
from drivecomm_vlt3500.telegrams import BROADCAST, telegrams
from drivecomm_vlt3500.words import profile

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.profiles import Commander, ControlProfile
    from drivecomm.protocol import DriveStatus, Exchange, Model, Reading, Value
    from drivecomm_vlt3500.options import VltOptions

BUS_REFERENCE = "516"
SOFTWARE_VERSION = "502[19]"
_EXTRA = ("jog", "slow_down", "catch_up", "hold", "select_setup", "control_word")


class VltOperations:
    """Verbs of one VLT, or of all drives at address 0. Reads, writes and status requests never command."""

    def __init__(self, address: int, options: VltOptions, model: Model | None, memory: VltMemory | None = None) -> None:
        self.answers = address != BROADCAST
        self._options = options
        self._model = model
        self._memory = memory or VltMemory()
        self._talk = VltConversation(address, options, self._memory)
        self._known = cached(lambda parameter: target(parameter, model))

    @property
    def capabilities(self) -> Capabilities:
        """The abilities of a VLT.

        No known source describes whether a write survives power-off, so neither stored nor volatile writes are
        promised. The bus reference, parameter 516, is meant to be written cyclically.
        """
        return Capabilities(
            stops=frozenset(self._profile.stops),
            reverse=True,
            reference_percent=True,
            reference_hz=self._options.maximum_hz is not None,
            stored_writes=False,
            volatile_writes=False,
            broadcast=True,
            reference_limit=self._options.frequency("reference_limit"),
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """Verbs beyond those of all drives: bits 5, 8, 9, 11 to 14 of the control word, and the word itself."""
        return {name: getattr(self, name) for name in _EXTRA}

    @needs_answer
    def read(self, parameter: str, *, index: tuple[int, ...] | int | str | None = None) -> Exchange[Reading]:
        """Read a parameter (R), or one element of an indexed one (I): `502[17]`, `602[13,5]`, or index=(13, 5)."""
        return self._read(self._known(parameter) if index is None else target(parameter, self._model, index))

    def write(
        self,
        parameter: str,
        value: Value | float,
        *,
        store: bool = False,
        decimals: int | None = None,
        attempts: int = 1,
    ) -> Exchange[Reading | None]:
        """Write a parameter (U) and return the value that the drive reports, perhaps rounded or limited.

        decimals: number of digits after the point to send; None for the model's number or the fewest that are exact.
        attempts: number of times to send it while no reply comes. store=True is refused, because no known manual
        describes whether a write survives power-off (parameter 517 of a VLT 2000, "save data values", suggests that it
        does not unless that is on). Do not write cyclically, apart from 516.
        """
        wanted = target(parameter, self._model)
        if wanted.index is not None:
            raise NotSupported(f"{wanted.address} cannot be written: indexed parameters are read-only")
        check_store(wanted.address, "unknown", store=store)
        if type(attempts) is not int or attempts < 1:
            raise UsageError(f"attempts of {attempts!r} would never send anything, use 1 or more", says="attempts")
        sent, places = data_for(wanted, value, decimals)
        return self._write(wanted, sent, places, attempts)

    def address_of(self, parameter: str, **_: Any) -> str:
        """Return number and index of a parameter."""
        return target(parameter, self._model).address

    @needs_answer
    def status(self) -> Exchange[DriveStatus]:
        """Read the status word with a C telegram that commands nothing."""
        return self._commander(self._profile).status(self._model)

    @needs_answer
    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start with the present reference, and wait until the drive reports that it runs.

        If the drive reports "start not possible", that is released first, 0x047E before 0x047F. A start that is not
        obeyed is withdrawn with a ramp stop, so that it cannot take effect later. Raises StateError.
        """
        return self._commander(self._profile).start(reverse=reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: bit 6 = 0 (ramp), OFF2 (coast), OFF3 (quick stop), or bit 4 = 0 if that is DC braking.

        The quick stop is OFF3 and not bit 4, because bit 4 may have another meaning (514) or belong to a digital input
        (504). Raises StateError if the drive does not report the commanded state.
        """
        if how not in self._profile.stops:
            remedy = "; VLT 2000 can with parameter 514 = 1, then use dc_brake=True" if how is Stop.DC_BRAKE else ""
            raise NotSupported(f"this VLT cannot stop by {how.value}{remedy}", says="dc_brake=True")
        return self._stop(how)

    @needs_answer
    def reset(self) -> Exchange[None]:
        """Acknowledge a trip: bit 7 from 0 to 1 and back, in words that stop the motor; do nothing without a trip."""
        return self._commander(self._profile).reset()

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Write the bus reference, parameter 516: percent of the maximum frequency, negative for the other direction.

        Raises StateError if the drive reports another value than the one sent.
        """
        number = exact(percent, BUS_REFERENCE)
        limit = self._options.frequency("reference_limit")
        if abs(number) > limit:
            raise ValueRefusedError(f"a reference of {percent} % is outside -{limit} to {limit} %")
        wanted = target(BUS_REFERENCE, self._model)
        sent, places = data_for(wanted, number, None)
        return self._set_reference(wanted, sent, places)

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Write the bus reference as a frequency; needs the drive's maximum frequency, option maximum_hz."""
        if self._options.maximum_hz is None:
            raise NotSupported(
                "a VLT takes its bus reference in percent; give the drive's maximum frequency, such as maximum_hz=50, "
                "to use Hz",
                says="maximum_hz=50",
            )
        return self.set_reference_percent(self._options.percent_of(exact(hz, BUS_REFERENCE)))

    @needs_answer
    def probe(self) -> Exchange[None]:
        """Read the status word once."""
        yield from self._talk.status_word(attempts=1)

    @needs_answer
    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:  # noqa: ARG002 - one read returns everything
        """Read the state, and the software version if the drive numbers its read-outs as VLT 2000 does."""
        status = yield from self._talk.status_word()
        version = yield from unless_refused(self._read(target(SOFTWARE_VERSION, None)))
        state = {"state": ", ".join(profile().flags_of(status))}
        return state if version is None else {**state, "software": str(version.raw)}

    # Additional verbs

    @needs_answer
    def jog(self, *, number: int = 1) -> Exchange[None]:
        """Run at bus jog 1 or 2 (bit 8 or 9; 511 and presumably 512), without bit 6, so that any stop ends it."""
        if number not in (1, 2):
            raise UsageError(f"jog {number!r} does not exist; there are jog 1 and jog 2")
        *before, last = self._profile.start
        jogs = replace(last, word=last.word & ~words.START | (words.JOG_1 if number == 1 else words.JOG_2))
        return self._commander(replace(self._profile, start=(*before, jogs))).start()

    @needs_answer
    def slow_down(self) -> Exchange[None]:
        """Lower the reference by one step (bit 11 to 1 and back); requires an earlier command through this object."""
        return self._talk.step(words.SLOW_DOWN, "slow_down")

    @needs_answer
    def catch_up(self) -> Exchange[None]:
        """Raise the reference by one step (bit 12 to 1 and back); requires an earlier command through this object."""
        return self._talk.step(words.CATCH_UP, "catch_up")

    @needs_answer
    def hold(self) -> Exchange[None]:
        """Freeze the output frequency (bit 5 = 0) until the next command; `start` releases it."""
        yield from self._talk.command((yield from self._talk.confirmed("hold")) & ~words.RAMP_ENABLED)

    @needs_answer
    def select_setup(self, *, number: int) -> Exchange[None]:
        """Select set-up 1 to 4 (bits 13 and 14) in this and every later control word of this object."""
        if number not in range(1, self._options.setups + 1):
            raise UsageError(f"set-up {number!r} does not exist; this drive has 1 to {self._options.setups}")
        return self._select(number)

    @needs_answer
    def control_word(self, *, word: int, mask: int | None = None) -> Exchange[DriveStatus]:
        """Send any control word once. mask: the bits that it gives, in groups of four; the others stay unchanged (`P`).

        The word is sent unchanged, so it may start the motor. Raises UsageError for a word that no telegram can carry.
        """
        try:
            telegrams().encode(self._talk.request(word, mask))
        except TelegramError as error:
            raise UsageError(f"no telegram can carry it: {error}") from None
        return self._any_word(word, mask)

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Whether a call may start the motor: a jog, or a control word that neither stops nor resets."""
        word = arguments.get("word")
        if verb == "control_word" and isinstance(word, int) and arguments.get("mask") is None:
            return self._profile.may_start(word)
        return verb in ("jog", "control_word")

    # Exchanges

    def _read(self, wanted: VltTarget) -> Exchange[Reading]:
        return reading_of(wanted, (yield from self._talk.read(wanted)))

    def _write(self, wanted: VltTarget, sent: Decimal, places: int, attempts: int) -> Exchange[Reading | None]:
        reported = yield from self._talk.write(wanted, sent, places, attempts)
        if reported is None:
            return None
        note = "" if reported == sent else f"the drive reports {reported} instead of {sent}"
        return reading_of(wanted, reported, note)

    def _set_reference(self, wanted: VltTarget, sent: Decimal, places: int) -> Exchange[None]:
        taken = yield from self._write(wanted, sent, places, 1)
        if taken is not None and Decimal(taken.raw) != sent:
            raise StateError(f"the drive reports a bus reference of {taken.raw} % instead of {sent} %")

    def _fault_code(self) -> Exchange[int | None]:
        found = yield from unless_refused(self._read(target(self._options.fault_parameter, self._model)))
        return found.value if found is not None and isinstance(found.value, int) else None

    def _any_word(self, word: int, mask: int | None) -> Exchange[DriveStatus]:
        return profile().status({profiles.SOLE_PLACE: (yield from self._talk.command(word, mask=mask, attempts=1))})

    # Control words

    @cached_property
    def _profile(self) -> ControlProfile:
        known, dc_brake = profile(), self._options.dc_brake
        return replace(
            known, stops={how: steps for how, steps in known.stops.items() if how is not Stop.DC_BRAKE or dc_brake}
        )

    def _commander(self, known: ControlProfile) -> Commander:
        return profiles.Commander(
            known,
            self._talk,
            state_timeout_s=self._options.state_timeout_s,
            advice="its digital inputs and parameters 503 to 510",
            answers=self.answers,
            fault_code=self._fault_code if self._options.fault_parameter else None,
        )

    def _stop(self, how: Stop) -> Exchange[None]:
        yield from self._commander(self._profile).stop(how)
        seen = self._talk.seen
        status = self._profile.status({profiles.SOLE_PLACE: seen})
        if status.running and not status.remote:
            raise StateError(
                f"the drive got the stop and does not report it: status word 0x{seen:04X}; in local operation it does "
                "not obey the bus"
            )

    def _select(self, number: int) -> Exchange[None]:
        """Select a set-up in the last control word and in all later ones; bit 13 is the low bit, as on later drives."""
        word = yield from self._talk.confirmed("set_up")
        yield from self._talk.command(word & ~words.SETUP | (number - 1) * words.SETUP_LOW)
