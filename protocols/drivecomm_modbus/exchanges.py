"""The verbs of a master for a Modbus drive, by what the table [control] of its model says."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NoReplyError, NotSupported, RefusedError, ReplyError
from drivecomm.profiles import Commander, OrderCarrier, Place, check_needs
from drivecomm.protocol import Ask, SeriesFound, Stop, asked_once, kept, unless_refused
from drivecomm_modbus import functions as fn
from drivecomm_modbus.control import control_of
from drivecomm_modbus.conversation import Conversation
from drivecomm_modbus.evidence import candidates, evidence_for
from drivecomm_modbus.memory import ModbusMemory
from drivecomm_modbus.messages import Request
from drivecomm_modbus.parameters import by_place, counting_hint, target
from drivecomm_modbus.references import References
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from drivecomm.profiles import Target, WayOfWriting
    from drivecomm.protocol import DriveStatus, Exchange, Model, ParameterInfo, Reading, Value
    from drivecomm_modbus.options import ModbusOptions

_OBJECTS = {0: "vendor", 1: "product", 2: "software"}


class ModbusOperations:
    """The verbs of one drive, or, at address 0, the stop of all drives of a series on the line."""

    def __init__(
        self, address: int, options: ModbusOptions, model: Model | None, memory: ModbusMemory | None = None
    ) -> None:
        self.extra: Mapping[str, Callable[..., Exchange[Any]]] = {}
        self._address, self._options, self._model = address, options, model
        self._memory, self._known = memory or ModbusMemory(), kept(self._target)
        control = self._control = control_of(model, options)
        self._drive = Conversation(address, options, control, model, self._memory)
        self._carrier = OrderCarrier(control, self._drive, self._memory)
        self._commander = Commander(
            control.profile,
            self._carrier,
            state_timeout_s=options.state_timeout_s,
            advice="what the drive needs to obey the bus",
            answers=address != BROADCAST,
            fault_code=self._drive.fault_code,
            busy=(5, 6),
        )
        self._references = References(control, options, control.capabilities(model, broadcast=True), self.read)
        self.capabilities = self._references.capabilities

    def read(self, parameter: str, *, type: str = "") -> Exchange[Reading]:
        """Read a parameter; an invalid one is refused at once. type: instead of the model's, of WORD_TYPES."""
        return self._reading(self._known(parameter, type))

    def _reading(self, wanted: Target) -> Exchange[Reading]:
        raw, info = (yield from self._drive.raw(wanted)), wanted.info
        if info is not None and (place := info.extra.get("decimals")):
            decimals = int((yield from self._drive.raw(self._known(place))))
            wanted = replace(wanted, info=replace(info, factor=Decimal(1).scaleb(-decimals)))
        return self._told(wanted, raw)

    def _told(self, wanted: Target, raw: int | str) -> Reading:
        reading = wanted.reading(raw)
        if self._model is None and (hint := counting_hint(wanted.address, self._options)):
            return replace(reading, note=f"{reading.note or 'no model'}; {hint}")
        return reading

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return which of these parameters one telegram reads: neighbours, as many as the drive allows."""
        wanted = [self._known(each) for each in parameters]
        return profiles.blocks_of(wanted, most=self._options.max_registers, bridged=self._options.bridged_registers)

    def read_many(self, parameters: Sequence[str]) -> Exchange[list[Reading]]:
        """Read parameters that are near each other by one telegram; their refusal is of all of them."""
        wanted = [self._known(each) for each in parameters]
        first, count = profiles.span_of(wanted)
        words = yield from self._drive.words(first, count, f"{wanted[0].address} to {wanted[-1].address}")
        return [self._told(each, each.raw_in(words, first)) for each in wanted]

    def write(self, parameter: str, value: Value | float, *, store: bool = False, type: str = "") -> Exchange[None]:
        """Write a parameter; the drive only confirms it."""
        wanted = self._known(parameter, type)
        return self._write(wanted, wanted.raw_for(value), store=store)

    def address_of(self, parameter: str, **options: Any) -> str:
        """Return the address as the model writes it, in decimal without one."""
        return self._target(parameter, options.get("type", "")).address

    def status(self) -> Exchange[DriveStatus]:
        """Read the status registers; only for a watchdog that is on, and needs it, is a command repeated."""
        if not self._control.status:
            if self._model is None:
                raise NotSupported("Modbus has no status word of its own; name the drive's model")
            raise NotSupported(f"model {self._model.name} knows no status, so nothing tells whether the motor runs")
        profile, seen = self._control.profile, (yield from self._carrier.look())
        running = any(profile.says(each, seen) for each in ("running", "stopping")) and not profile.says("fault", seen)
        further: dict[str, Any] = {"running": running}
        if running and self._control.direction:
            further["reverse"] = yield from self._turns_backwards()
        told = yield from self._commander.status(self._model, seen, **further)
        yield from self._carrier.feed(seen)
        return told

    def _turns_backwards(self) -> Exchange[bool | None]:
        """Read in which direction the motor turns, None where it does not turn or the drive does not tell."""
        found = yield from unless_refused(self.read(self._control.direction))
        turns = 0 if found is None or isinstance(found.value, str) else found.value
        return turns < 0 if turns else None

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start, unless the drive has a fault or is not set up to obey."""
        profile = self._control.profile
        self._drive.must_be_one()
        self._must_have("start reverse" if reverse else "start", profile.start_reverse if reverse else profile.start)
        return self._commander.start(reverse=reverse, prepare=check_needs(self._control.needs, self.read))

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop in a way that the series has, or by its sure stop where another could start something."""
        self._must_have("stop", self._control.profile.stops)
        if self._address == BROADCAST:
            return self._commander.stop(Stop(self._control.sure_stop or how))
        return profiles.stop_for_sure(how, self._commander, self._control, self._memory, self.read)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault; where there is none, nothing is sent that could stop a running motor."""
        self._drive.must_be_one()
        self._must_have("reset", self._control.profile.reset)
        return self._commander.reset()

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the reference in per cent, rounded; a share of the highest frequency where a drive takes hertz only."""
        control = self._control
        self._must_have("reference", control.reference_percent or control.reference_hz)
        if control.reference_percent:
            return self._set_reference(control.reference_percent, percent, rounded=True)
        self._references.must_have("per cent")
        return self._set_converted(control.reference_hz, self._references.hz_for(percent))

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the reference in hertz; rounded, as a share of the full scale, where a drive takes per cent only."""
        control = self._control
        self._must_have("reference", control.reference_percent or control.reference_hz)
        if control.reference_hz:
            return self._set_reference(control.reference_hz, hz, rounded=False)
        self._references.must_have("hertz")
        return self._set_converted(control.reference_percent, self._references.percent_for(hz))

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Whether a write may start the motor; not known without a model."""
        wanted = self._known(arguments["parameter"], arguments.get("type", ""))
        words = wanted.words_for(wanted.raw_for(arguments["value"]), 0)
        return verb == "write" and self._control.may_start(wanted, words)

    def probe(self) -> Exchange[None]:
        """Read one register once; a refusal comes from a drive, too."""
        yield self._drive.asking(self._control.probe, 1, attempts=1)

    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read what the model says identifies the drive; without one, the standard identification or function 11H."""
        self._drive.must_be_one()
        found = {}
        for name, address in self._control.identity.items():
            if only and name not in only:
                continue
            if (reading := (yield from unless_refused(self.read(address)))) is not None:
                found[name] = str(reading)
        if only and self._control.identity.keys() >= set(only):
            return found
        tried = (fn.IDENTIFICATION, fn.REPORT_ID) if self._model is None else (self._control.identification,)
        for function in filter(None, tried):
            told = yield from unless_refused(self._identification(function), ReplyError)
            if told is None:
                break  # it is silent about a strange function
            if told:
                return {**found, **told}
        return found

    def check_series(self, others: Sequence[Model]) -> Exchange[SeriesFound]:
        """Read the status and what the model has and the others lack; a refusal speaks against the model."""
        model = self._model
        if model is None:
            return SeriesFound()
        plan = evidence_for(model, self._options, tuple(others))
        for number, wanted in enumerate(plan.present):
            try:
                yield from self._drive.raw(wanted)
            except RefusedError as error:
                if error.code == fn.BUSY:
                    raise
                fitting = candidates(others, plan.present[:number], wanted)
                return SeriesFound(against=str(error), candidates=fitting)
        for wanted in plan.absent:
            told = yield from unless_refused(asked_once(self._drive.raw(wanted)), NoReplyError)
            if told is not None:
                return SeriesFound(
                    against=f"it has register {wanted.place.name} of the telegram, which such a drive lacks",
                    candidates=candidates(others, [*plan.present, wanted]),
                )
        if plan.knows and not (yield from self._identification(plan.knows)):
            return SeriesFound(
                against=f"it does not know function {plan.knows}, by which such a drive tells what it is"
            )
        if plan.lacks and (texts := (yield from unless_refused(self._identification(plan.lacks), NoReplyError))):
            return SeriesFound(against=f"it tells what it is, {', '.join(texts.values())}, which such a drive does not")
        if plan.titled:
            named = yield from unless_refused(self._identification(fn.IDENTIFICATION), NoReplyError)
            name = plan.titled.get((named or {}).get("product", ""))
            if name == model.name:
                return SeriesFound()
            if name:
                return SeriesFound(against=f"it tells that it is of model {name}", candidates=(name,))
        return SeriesFound(open=plan.open)

    def _identification(self, function: int) -> Exchange[dict[str, str]]:
        """Return what the drive tells, nothing where it refuses."""
        code, first = (1, 0) if function == fn.IDENTIFICATION else (None, None)
        request = Request(address=self._address, function=function, read_code=code, object_id=first)
        reply = yield Ask(message=request, attempts=1, nameless=True)
        if reply.exception is not None:
            return {}
        if function == fn.REPORT_ID:
            return {"id": reply.data}
        pairs = zip(reply.object_ids, reply.texts, strict=True)
        return {_OBJECTS.get(number, f"object {number}"): text.strip() for number, text in pairs}

    def _write(self, wanted: Target, raw: int | str, *, store: bool) -> Exchange[None]:
        self._drive.must_be_one()
        return self._written(wanted, raw, self._control.way_of_writing(wanted.address, wanted.info, store=store))

    def _written(self, wanted: Target, raw: int | str, way: WayOfWriting) -> Exchange[None]:
        place, drive = wanted.place, self._drive
        for step in way.before:
            yield from drive.carry(step)
        goal = Place(place.kind, place.start + way.offset)
        # What is to be done at once may not be done twice.
        once = wanted.info is not None and wanted.info.kind == "command" and not way.offset
        yield from drive.write(goal, wanted.format.words_of(raw), wanted.address, attempts=1 if once else None)
        for step in way.after:
            yield from drive.carry(step)

    def _set_converted(self, address: str, converted: Exchange[Decimal]) -> Exchange[None]:
        yield from self._set_reference(address, (yield from converted), rounded=True)

    def _set_reference(self, address: str, value: Value | float, *, rounded: bool) -> Exchange[None]:
        wanted = self._known(address)
        return self._write(wanted, wanted.raw_for(value, rounded=rounded), store=False)

    @cached_property
    def _places(self) -> Mapping[Place, ParameterInfo]:
        return by_place(self._model, self._options)

    def _target(self, parameter: str, type: str = "") -> Target:
        return target(parameter, self._model, self._options, type, places=self._places)

    def _must_have(self, command: str, steps: object) -> None:
        if self._model is None:
            raise NotSupported(f"Modbus has no {command} of its own; name the drive's model")
        self._control.must_have_orders()
        if not steps:
            raise NotSupported(f"model {self._model.name} has no {command} over Modbus")
