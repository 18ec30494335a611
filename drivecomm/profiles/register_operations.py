"""A master's verbs for a drive whose parameters are registers, by the table [control] of its model."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DoubtfulReplyError, NotSupported, RefusedError
from drivecomm.profiles.commander import Commander, check_needs
from drivecomm.profiles.references import ReferenceConverter
from drivecomm.profiles.register_command_carrier import RegisterCommandTransport
from drivecomm.profiles.register_command_memory import RegisterCommandMemory, stop_safely
from drivecomm.profiles.register_conversation import RegisterConversation
from drivecomm.profiles.registers import RegisterPlace, blocks_of, span_of
from drivecomm.protocol import Stop, cached, unless_refused

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from drivecomm.profiles.control_table import WritePlan
    from drivecomm.profiles.dialect import Dialect
    from drivecomm.profiles.registers import RegisterParameter
    from drivecomm.protocol import DriveStatus, Exchange, Reading, Value


class RegisterOperations:
    """Verbs of one drive, or, at the broadcast address, the stop of all drives of a series on the line."""

    def __init__(
        self, dialect: Dialect, memory: RegisterCommandMemory | None = None, drive: RegisterConversation | None = None
    ) -> None:
        self._dialect, self._model, self._control = dialect, dialect.model, dialect.control
        self._memory, self._known = memory or RegisterCommandMemory(), cached(dialect.target)
        self._drive = drive or RegisterConversation(dialect, self._memory)
        self._carrier = RegisterCommandTransport(self._control, self._drive, self._memory)
        self._commander = Commander(
            self._control.profile,
            self._carrier,
            state_timeout_s=dialect.state_timeout_s,
            advice=dialect.advice,
            answers=self._drive.answers,
            fault_code=self._drive.fault_code,
            busy={*dialect.busy, *dialect.stop_again},
        )
        self._references = ReferenceConverter(dialect, self.read)
        self.capabilities, self.extra = self._references.capabilities, dialect.verbs(self._drive)

    def read(self, parameter: str, *, type: str = "") -> Exchange[Reading]:
        """Read a parameter; an invalid one is refused before anything is sent.

        type: overrides the type of the model; one of WORD_TYPES.
        """
        return self._reading(self._known(parameter, type))

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return groups of parameters that one telegram reads: neighbours, as many as the drive allows."""
        wanted = [self._known(each) for each in parameters]
        its = self._dialect
        return blocks_of(wanted, most=its.most, bridged=its.bridged, whole=its.whole)

    def read_many(self, parameters: Sequence[str]) -> Exchange[list[Reading]]:
        """Read neighbouring parameters by one telegram; a refusal applies to all of them."""
        wanted = [self._known(each) for each in parameters]
        first, count = span_of(wanted)
        words = yield from self._drive.words(first, count, f"{wanted[0].address} to {wanted[-1].address}")
        return [self._told(each, each.raw_in(words, first)) for each in wanted]

    def write(self, parameter: str, value: Value | float, *, store: bool = False, type: str = "") -> Exchange[None]:
        """Write a parameter; the drive only confirms it."""
        wanted = self._known(parameter, type)
        return self._write(wanted, wanted.raw_for(value), store=store)

    def address_of(self, parameter: str, **options: Any) -> str:
        """Return the address as the model writes it, or as the protocol does without a model."""
        return self._dialect.target(parameter, options.get("type", "")).address

    def status(self) -> Exchange[DriveStatus]:
        """Read the status registers; repeat the last command only for a watchdog that is on and needs it."""
        if not self._control.status:
            if self._model is None:
                raise NotSupported(f"{self._dialect.title} has no status word of its own; name the drive's model")
            raise NotSupported(f"model {self._model.name} has no status, so nothing shows whether the motor runs")
        profile, seen = self._control.profile, (yield from self._carrier.look())
        running = any(profile.says(each, seen) for each in ("running", "stopping")) and not profile.says("fault", seen)
        further: dict[str, Any] = {"running": running}
        if running and self._control.direction:
            further["reverse"] = yield from self._turns_backwards()
        told = yield from self._commander.status(self._model, seen, **further)
        yield from self._carrier.feed(seen)
        return told

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start the motor, unless the drive has a fault or is not set up to obey."""
        control, profile = self._control, self._control.profile
        self._drive.must_be_one()
        self._must_have("start reverse" if reverse else "start", profile.start_reverse if reverse else profile.start)
        needs = {**control.needs, **control.needs_reverse} if reverse else control.needs
        return self._commander.start(reverse=reverse, prepare=check_needs(needs, self.read))

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop the motor in a way of the series, or by its sure stop if another way could start something."""
        self._must_have("stop", self._control.profile.stops)
        if not self._drive.answers:
            return self._commander.stop(Stop(self._control.sure_stop or how))
        return stop_safely(how, self._commander, self._control, self._memory, self.read)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault; without a fault, send nothing that could stop a running motor."""
        self._drive.must_be_one()
        self._must_have("reset", self._control.profile.reset)
        return self._commander.reset()

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the reference in per cent, rounded; converted to hertz if the drive takes only hertz."""
        control = self._control
        self._must_have("reference", control.reference_percent or control.reference_hz)
        if control.reference_percent:
            return self._set_reference(control.reference_percent, percent, rounded=True)
        self._references.must_have("per cent")
        return self._set_converted(control.reference_hz, self._references.hz_for(percent))

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the reference in hertz; converted to per cent and rounded if the drive takes only per cent."""
        control = self._control
        self._must_have("reference", control.reference_percent or control.reference_hz)
        if control.reference_hz:
            return self._set_reference(control.reference_hz, hz, rounded=False)
        self._references.must_have("hertz")
        return self._set_converted(control.reference_percent, self._references.percent_for(hz))

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Return whether a call may start the motor.

        A write may do so if the model lists it as a start; without a model, none does. The
        protocol's own verbs count as possible starts.
        """
        if verb != "write":
            return verb in self.extra
        wanted = self._known(arguments["parameter"], arguments.get("type", ""))
        return self._control.may_start(wanted, wanted.words_for(wanted.raw_for(arguments["value"]), 0))

    def probe(self) -> Exchange[None]:
        """Read one register once; a refusal is a reply of a drive, too."""
        self._drive.must_be_one()
        yield replace(self._dialect.reading(self._dialect.probe, 1), attempts=1)

    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read the entries that identify the drive; refused ones are left out."""
        self._drive.must_be_one()
        found = {}
        for name, address in self._dialect.identity.items():
            if only and name not in only:
                continue
            if (reading := (yield from unless_refused(self.read(address)))) is not None:
                found[name] = str(reading)
        return found

    def _reading(self, wanted: RegisterParameter) -> Exchange[Reading]:
        raw, info = (yield from self._drive.raw(wanted)), wanted.info
        if info is not None and (place := info.extra.get("decimals")):
            decimals = int((yield from self._drive.raw(self._known(place))))
            wanted = replace(wanted, info=replace(info, factor=Decimal(1).scaleb(-decimals)))
        return self._told(wanted, raw)

    def _told(self, wanted: RegisterParameter, raw: int | str) -> Reading:
        return wanted.reading(raw)

    def _turns_backwards(self) -> Exchange[bool | None]:
        """Read whether the motor turns backwards; None if it does not turn or the drive does not show it."""
        found = yield from unless_refused(self.read(self._control.direction))
        turns = 0 if found is None or isinstance(found.value, str) else found.value
        return turns < 0 if turns else None

    def _write(self, wanted: RegisterParameter, raw: int | str, *, store: bool) -> Exchange[None]:
        self._drive.must_be_one()
        control = self._control
        writing = self._written(wanted, raw, control.write_plan(wanted.address, wanted.info, store=store))
        refers = wanted.address in (control.reference_hz, control.reference_percent)
        return self._once_set_up(writing) if refers and control.needs_reference else writing

    def _written(self, wanted: RegisterParameter, raw: int | str, way: WritePlan) -> Exchange[None]:
        place, drive = wanted.place, self._drive
        for step in way.before:
            yield from drive.carry(step)
        goal = RegisterPlace(place.kind, place.start + way.offset)
        # A write that acts immediately must not be sent twice.
        acts = wanted.info is not None and wanted.info.kind == "command"
        once = not way.offset and (acts or self._control.may_start(wanted, wanted.words_for(raw, 0)))
        try:
            yield from drive.put(wanted, raw, goal, attempts=1 if once else None, unseen=True)
        except DoubtfulReplyError:
            # The value in the drive shows whether the doubtful confirmation belongs to this write.
            if not (once and (yield from self._holds(wanted, raw))):
                raise
        for step in way.after:
            yield from drive.carry(step)

    def _holds(self, wanted: RegisterParameter, raw: int | str) -> Exchange[bool]:
        try:
            return (yield from self._drive.raw(wanted)) == raw
        except (NotSupported, RefusedError):
            return False

    def _set_converted(self, address: str, converted: Exchange[Decimal]) -> Exchange[None]:
        yield from self._set_reference(address, (yield from converted), rounded=True)

    def _set_reference(self, address: str, value: Value | float, *, rounded: bool) -> Exchange[None]:
        wanted = self._known(address)
        return self._write(wanted, wanted.raw_for(value, rounded=rounded), store=False)

    def _once_set_up(self, writing: Exchange[None]) -> Exchange[None]:
        yield from check_needs(self._control.needs_reference, self.read)
        yield from writing

    def _must_have(self, command: str, steps: object) -> None:
        self._control.must_have_orders()
        if not steps and self._model is None:
            raise NotSupported(f"{self._dialect.title} has no {command} of its own; name the drive's model")
        if not steps:
            raise NotSupported(f"model {self._control.profile.name} has no {command} over {self._dialect.title}")
