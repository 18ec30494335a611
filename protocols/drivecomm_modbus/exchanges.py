"""The conversations of a master with a Modbus drive, by what the table [control] of its model says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, RefusedError, ReplyError, StateError
from drivecomm.protocol import Ask, Capabilities, DriveState, DriveStatus, Pause, Stop, Tell
from drivecomm_modbus import functions as fn
from drivecomm_modbus.control import STOPS, control_of
from drivecomm_modbus.messages import Request
from drivecomm_modbus.parameters import Place, target
from drivecomm_modbus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.protocol import Exchange, Model, Reading, Value
    from drivecomm_modbus.control import Step
    from drivecomm_modbus.messages import Reply
    from drivecomm_modbus.options import ModbusOptions
    from drivecomm_modbus.parameters import Target

_READS = {"": fn.READ_REGISTERS, "i": fn.READ_INPUT_REGISTERS, "c": fn.READ_COILS, "d": fn.READ_INPUTS}
_OBJECTS = {0: "vendor", 1: "product", 2: "software"}
_KEYS = {how: key for key, how in STOPS.items()}


class ModbusOperations:
    """The verbs of one drive, or, at address 0, the stop of all drives of a series on the line."""

    def __init__(self, address: int, options: ModbusOptions, model: Model | None) -> None:
        self.extra: Mapping[str, Callable[..., Exchange[Any]]] = {}
        self._address = address
        self._options = options
        self._model = model
        self._control = control_of(model, options)
        self.capabilities = Capabilities(
            # Without a model nobody knows how to stop; the call says so.
            stops=self._control.stops or frozenset({Stop.RAMP}),
            reverse="start_reverse" in self._control.steps,
            reference_percent=bool(self._control.reference_percent),
            reference_hz=bool(self._control.reference_hz),
            stored_writes=self._control.can_store,
            volatile_writes=self._control.can_keep_volatile,
            broadcast=True,
        )

    def read(self, parameter: str, *, type: str = "") -> Exchange[Reading]:
        """Read a parameter. type: u16, s16, u32, s32, f32 instead of what the model says."""
        wanted = target(parameter, self._model, self._options, type)
        self._must_be_one_drive("reading")
        return self._reading(wanted)

    def blocks(self, parameters: Sequence[str]) -> list[list[int]]:
        """Return which of these parameters one telegram reads: neighbours, as many as the drive allows."""
        wanted = [target(each, self._model, self._options) for each in parameters]
        order = sorted(range(len(wanted)), key=lambda number: (wanted[number].place.kind, wanted[number].place.start))
        blocks: list[list[int]] = []
        first = last = None
        for number in order:
            each = wanted[number]
            if first and last and self._is_near(first, last, each):
                blocks[-1].append(number)
                last = max(last, each, key=lambda one: one.end)
            else:
                blocks.append([number])
                first = last = each
        return blocks

    def read_many(self, parameters: Sequence[str]) -> Exchange[list[Reading]]:
        """Read parameters that are near each other by one telegram; their refusal is of all of them."""
        self._must_be_one_drive("reading")
        wanted = [target(each, self._model, self._options) for each in parameters]
        first = min((each.place for each in wanted), key=lambda place: place.start)
        count = max(each.end for each in wanted) - first.start
        ask = self._asking(Place(first.kind, first.start), count)
        reply = yield from self._answered(ask, f"{wanted[0].address} to {wanted[-1].address}")
        words = reply.values or ()
        return [
            each.reading(each.raw_of(words[each.place.start - first.start : each.end - first.start])) for each in wanted
        ]

    def _is_near(self, first: Target, last: Target, each: Target) -> bool:
        """Whether one telegram that reads from the first to the last of a block can read this one, too."""
        gap = each.place.start - last.end
        return (
            not first.wide
            and not each.wide
            and each.place.kind == first.place.kind
            and gap <= self._options.bridged_registers
            and each.end - first.place.start <= self._options.max_registers
        )

    def _reading(self, wanted: Target) -> Exchange[Reading]:
        return wanted.reading((yield from self._read(wanted)))

    def write(self, parameter: str, value: Value | float, *, store: bool = False, type: str = "") -> Exchange[None]:
        """Write a parameter; the drive only confirms it."""
        wanted = target(parameter, self._model, self._options, type)
        self._must_be_one_drive("writing")
        return self._write(wanted, wanted.raw_for(value), store=store)

    def address_of(self, parameter: str, **options: Any) -> str:
        """Return the address as the model writes it, in decimal without one."""
        return target(parameter, self._model, self._options, options.get("type", "")).address

    def status(self) -> Exchange[DriveStatus]:
        """Read the status registers; that commands nothing."""
        control = self._control
        if not control.status:
            raise NotSupported("Modbus has no status word of its own; name the drive's model")
        self._must_be_one_drive("a status")
        words = {}
        for place in control.status_places:
            words[place] = yield from self._read_place(place)
        said = {name: condition.holds(words[condition.place]) for name, condition in control.status.items()}
        code = None
        if control.fault_code and said.get("fault", True):
            found = (yield from self.read(control.fault_code)).raw
            code = found if isinstance(found, int) and found else None
        fault = said.get("fault", code is not None)
        running = said.get("running", False) and not fault
        return DriveStatus(
            word=words[control.status_places[0]],
            state=_state(
                fault=fault, stopping=said.get("stopping", False), running=running, ready=said.get("ready", True)
            ),
            running=running,
            fault=fault,
            warning=said.get("warning"),
            at_reference=said.get("at_reference"),
            reverse=said.get("reverse"),
            remote=said.get("remote"),
            fault_code=code if fault else None,
            fault_text=self._model.faults.get(code, "") if self._model and fault and code is not None else "",
            flags=tuple(name for name, holds in said.items() if holds and name != "always"),
        )

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start, unless the drive has a fault or is not set up to obey."""
        steps = self._steps("start_reverse" if reverse else "start")
        self._must_be_one_drive("a start")
        if self._control.status and (yield from self.status()).fault:
            raise StateError("the drive has a fault and cannot start; reset it first")
        for address, allowed in self._control.needs.items():
            found = yield from self.read(address)
            if found.raw not in allowed:
                raise StateError(
                    f"{found.name or address} is {found}, and the drive obeys the bus only with "
                    f"{' or '.join(map(str, allowed))}; set it first"
                )
        for number, step in enumerate(steps):
            if number and self._control.start_pause_s:
                yield Pause(seconds=self._control.start_pause_s)
            yield from self._carry_out(step, attempts=1)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop in a way that the series has."""
        for step in self._steps(_KEYS[how]):
            yield from self._carry_out(step, urgent=True)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault; where there is none, nothing is sent that could stop a running motor."""
        steps = self._steps("reset")
        self._must_be_one_drive("a reset")
        if self._control.status and not (yield from self.status()).fault:
            return
        for step in steps:
            yield from self._carry_out(step, attempts=1)

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the reference in per cent, rounded to the step of the drive."""
        return self._set_reference(self._control.reference_percent, percent, "percent", rounded=True)

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the reference in hertz."""
        return self._set_reference(self._control.reference_hz, hz, "hertz", rounded=False)

    def probe(self) -> Exchange[None]:
        """Read one register once; a refusal comes from a drive, too."""
        self._must_be_one_drive("a probe")
        yield self._asking(self._control.probe, 1, attempts=1)

    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read what the model says identifies the drive; without one, the standard identification or function 11H."""
        self._must_be_one_drive("an identification")
        found = {}
        for name, address in self._control.identity.items():
            try:
                found[name] = str((yield from self.read(address)))
            except RefusedError:
                continue
        tried = (fn.IDENTIFICATION, fn.REPORT_ID) if self._model is None else (self._control.identification,)
        for function in tried:
            if function:
                told = yield from self._identification(function)
                if told is None or told:
                    return {**found, **(told or {})}
        return found

    def _identification(self, function: int) -> Exchange[dict[str, str] | None]:
        """Return what the drive tells, nothing where it refuses, None where it is silent about a strange function."""
        code, first = (1, 0) if function == fn.IDENTIFICATION else (None, None)
        request = Request(address=self._address, function=function, read_code=code, object_id=first)
        try:
            reply = yield Ask(message=request, attempts=1, nameless=True)
        except ReplyError:
            return None
        if reply.exception is not None:
            return {}
        if function == fn.REPORT_ID:
            return {"id": reply.data}
        pairs = zip(reply.object_ids, reply.texts, strict=True)
        return {_OBJECTS.get(number, f"object {number}"): text.strip() for number, text in pairs}

    def _read(self, wanted: Target) -> Exchange[int | str]:
        if wanted.wide:
            request = Request(address=self._address, function=fn.READ_LONG, start=wanted.place.start)
            reply = yield from self._answered(Ask(message=request, nameless=True), wanted.address)
            return int(reply.value or 0)
        reply = yield from self._answered(self._asking(wanted.place, wanted.size), wanted.address)
        return wanted.raw_of(reply.values or (0,))

    def _read_place(self, place: Place) -> Exchange[int]:
        reply = yield from self._answered(self._asking(place, 1), f"{place.kind}{place.start}")
        return place.cut((reply.values or (0,))[0])

    def _asking(self, place: Place, count: int, attempts: int | None = None) -> Ask:
        message = Request(address=self._address, function=_READS[place.kind], start=place.start, count=count)
        # The reply names nothing of the request: a late one would pass for the next.
        return Ask(message=message, attempts=attempts, nameless=True)

    def _write(self, wanted: Target, raw: int | str, *, store: bool) -> Exchange[None]:
        control, info = self._control, wanted.info
        plain = info is not None and (info.kind == "command" or info.storage == "volatile")
        if store and (plain or not control.can_store):
            raise NotSupported(f"{wanted.address} cannot be stored; write it without store", says="store")
        if not store and not plain and control.can_store and not control.can_keep_volatile:
            raise NotSupported(
                f"a write to {wanted.address} goes to the EEPROM of the drive; write with store=True", says="store=True"
            )
        return self._written(wanted, raw, plain=plain, store=store)

    def _written(self, wanted: Target, raw: int | str, *, plain: bool, store: bool) -> Exchange[None]:
        control, info = self._control, wanted.info
        for step in () if plain else control.steps.get("store_before" if store else "volatile_before", ()):
            yield from self._carry_out(step)
        offset = 0 if store or plain else control.volatile_offset
        attempts = 1 if info is not None and info.kind == "command" and not offset else None
        message = self._writing(wanted.place, wanted.words_of(raw), offset, wide=wanted.wide)
        yield from self._confirmed(message, wanted.address, attempts=attempts)
        for step in control.steps.get("store_after", ()) if store else ():
            yield from self._carry_out(step)

    def _writing(self, place: Place, words: Sequence[int], offset: int = 0, *, wide: bool = False) -> Request:
        address, start = self._address, place.start + offset
        if place.is_bit:
            if self._options.write_function == fn.WRITE_REGISTER:
                return Request(address=address, function=fn.WRITE_COIL, start=start, value=words[0])
            return Request(address=address, function=fn.WRITE_COILS, start=start, values=tuple(words))
        if wide:
            return Request(address=address, function=fn.WRITE_LONG, start=start, value=words[0] << 16 | words[1])
        if len(words) == 1 and self._options.write_function == fn.WRITE_REGISTER:
            return Request(address=address, function=fn.WRITE_REGISTER, start=start, value=words[0])
        return Request(address=address, function=fn.WRITE_REGISTERS, start=start, values=tuple(words))

    def _carry_out(self, step: Step, *, attempts: int | None = None, urgent: bool = False) -> Exchange[None]:
        message = self._writing(step.place, (step.value,))
        if self._address == BROADCAST:
            yield Tell(message=message)
            return
        yield from self._confirmed(message, f"{step.place.kind}{step.place.start}", attempts=attempts, urgent=urgent)

    def _confirmed(
        self, message: Request, parameter: str, *, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[None]:
        mirrored = message.function in (fn.WRITE_COIL, fn.WRITE_REGISTER, fn.WRITE_LONG)
        ask = Ask(message=message, acts=True, attempts=attempts, urgent=urgent, mirrored=mirrored)
        yield from self._answered(ask, parameter)

    def _answered(self, ask: Ask, parameter: str) -> Exchange[Reply]:
        reply: Reply = yield ask
        if reply.exception is not None:
            text = self._control.exceptions.get(reply.exception, "not listed in the manual")
            raise RefusedError(parameter, reply.exception, text)
        return reply

    def _set_reference(self, address: str, value: Value | float, unit: str, *, rounded: bool) -> Exchange[None]:
        if not address:
            raise NotSupported(f"this drive takes no reference in {unit} over Modbus, as far as its model says")
        self._must_be_one_drive("a reference")
        wanted = target(address, self._model, self._options)
        return self._write(wanted, wanted.raw_for(value, rounded=rounded), store=False)

    def _steps(self, command: str) -> tuple[Step, ...]:
        if command in self._control.steps:
            return self._control.steps[command]
        if self._model is None:
            raise NotSupported(f"Modbus has no {command.replace('_', ' ')} of its own; name the drive's model")
        raise NotSupported(f"model {self._model.name} has no {command.replace('_', ' ')} over Modbus")

    def _must_be_one_drive(self, what: str) -> None:
        if self._address == BROADCAST:
            raise NotSupported(f"{what} is for one drive; all drives of a series can only be stopped")


def _state(*, fault: bool, stopping: bool, running: bool, ready: bool) -> DriveState:
    if fault:
        return DriveState.FAULT
    if stopping:
        return DriveState.STOPPING
    if running:
        return DriveState.RUNNING
    return DriveState.READY if ready else DriveState.NOT_READY
