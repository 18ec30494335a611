"""Knowledge about the judged type of drive: new drives for trials, and the meaning of parameters and requests."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from functools import cached_property
from itertools import islice
from threading import RLock
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, NotSupported, ReplyError
from drivecomm.judge.judged_drive import BEFORE_S, JudgedDrive, key_of
from drivecomm.protocol import Ask, Framed, MotorCommand, fields_of, installed
from drivecomm.testing import packaged_vectors
from drivecomm.virtual import Restarts, carry_out, drive_type

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence

    from drivecomm.protocol import DriveConfig, LineFacts, Model, Protocol, Value, VirtualDrive

_MOST_STEPS = 200
_SOON_S = 1.0
_TELLING = (1234, 2345, 4321, 321, 234, 123, 45, 34, 23, 12)
"""Raw values whose digits are easy to recognise in a master's output, the longest first."""
_MOST_KNOWN = 256
_MOST_CANDIDATES = 30
_SETTLED_S = 600.0


class KnownDrive:
    """A type of drive, as named on the command line. Raises UsageError for an invalid one.

    New drives are in their factory state. All methods work without a line, and return immediately.
    """

    def __init__(self, config: DriveConfig) -> None:
        self.config = config
        self.plugin: Protocol = installed[config.protocol]
        options = dict(config.options)
        model = options.pop("model", None)
        self.type = drive_type(config.protocol, config.address, model=model, options=options)
        self.model: Model = self.type.model
        self._known: dict[Hashable, tuple[str, ...]] = {}
        self._guard = RLock()
        self.codec = self.plugin.codec(self.type.options)
        self.fresh()

    @property
    def facts(self) -> LineFacts:
        """Line facts that the master has to follow."""
        return self.type.master_facts

    @cached_property
    def refusals(self) -> Mapping[int, str]:
        """Refusal codes of the protocol, with their meanings."""
        return dict(self.plugin.refusals(self.type.options, self.model))

    @cached_property
    def kinds(self) -> list[str]:
        """Kinds of telegrams in the protocol's vectors, requests and replies."""
        found = set()
        for vector in packaged_vectors(self.plugin).vectors:
            if vector.valid:
                with suppress(DriveCommError):
                    found.add(self.codec.decode(vector.data, vector.direction).kind)
        return sorted(found)

    def fresh(self) -> VirtualDrive:
        """Return a new drive."""
        return self.type.new()

    def judged(self) -> JudgedDrive:
        """Return a new drive for a line."""
        drive = self.fresh()
        return JudgedDrive(self.plugin, drive, self.type.rules(str(self.config), drive=drive))

    # Operations, carried out as by a correct master

    def operations(self, address: int | None = None) -> Any:
        """Return the operations of the drive, or of a drive of its type at another address."""
        address = self.config.address if address is None else address
        return self.plugin.operations(address, self.type.options, self.model)

    def start(self, drive: VirtualDrive, now: float) -> bool:
        """Start a drive's motor as a correct master does; return whether it runs."""
        self.set_reference(drive, now)
        with suppress(DriveCommError):
            carry_out(self.operations().start(), drive, self.codec, now)
        return drive.motor.command is MotorCommand.RUN

    def set_reference(self, drive: VirtualDrive, now: float) -> None:
        """Set some reference of a drive, in the first unit that it takes."""
        for verb, value in (("set_reference_percent", 40), ("set_reference_hz", 20)):
            with suppress(DriveCommError):
                carry_out(getattr(self.operations(), verb)(value), drive, self.codec, now)
                return

    def set_ready(self, drive: JudgedDrive) -> None:
        """Set some reference before the line begins, so that a plain start runs the motor."""
        self.set_reference(drive.inner, 0.0)

    def set_running(self, drive: JudgedDrive) -> bool:
        """Start the motor some time before the line begins; return whether it runs."""
        runs = self.start(drive.inner, BEFORE_S - _SOON_S)
        drive.motor.advance(BEFORE_S)
        return runs

    def set_tripped(self, drive: JudgedDrive) -> int:
        """Trip the drive long before the line begins; return the fault code, or 0 if the drive does not trip."""
        code = next((each for each in sorted(self.model.faults) if each), 1)
        drive.inner.trip(code, BEFORE_S - _SETTLED_S)
        return code if drive.motor.fault else 0

    # Parameters

    def physical(self, parameter: str, raw: int | str) -> Value | None:
        """Return the value that a correct master shows for a raw value; None if it cannot be read."""
        spare = self.fresh()
        try:
            spare.poke(parameter, raw)
            return self.read(spare, parameter)
        except (DriveCommError, ValueError):
            return None

    def read(self, drive: VirtualDrive, parameter: str, now: float = BEFORE_S) -> Value | None:
        """Return the value that a correct master reads, or None if the drive refuses."""
        try:
            value: Value = carry_out(self.operations().read(parameter), drive, self.codec, now).value
        except (DriveCommError, ValueError):
            return None
        return value

    def candidates(self, parameter: str) -> Iterator[int]:
        """Yield raw values that the drive takes for a parameter; those with recognisable digits come first."""
        info = self.model.find(parameter)
        if info is None or isinstance(info.start, str):
            return
        address = info.address
        start = _whole((info.start or Decimal(0)) / info.factor)
        step = max(1, abs(start) // 7)
        place = self._place(self.fresh())
        near = (
            raw
            for number in range(1, _MOST_STEPS)
            for raw in (start + number * step, start - number * step, start + number, start - number)
        )
        for raw in (*_TELLING, *near):
            if not info.allows(raw * info.factor) or (info.values and raw not in info.values):
                continue
            spare = self.fresh()
            with suppress(DriveCommError, ValueError):
                before = spare.peek(address, BEFORE_S)
                spare.poke(address, raw)
                if spare.peek(address, BEFORE_S) != before and self._place(spare) == place:
                    yield raw

    def two_values(self, parameter: str, taken: Collection[int] = ()) -> tuple[int, ...]:
        """Return two different raw values for a parameter; fewer if it does not take them.

        taken: values of other parameters, which are avoided if possible.
        """
        found = [raw for raw in islice(self.candidates(parameter), _MOST_CANDIDATES) if raw > 0]
        free = [raw for raw in dict.fromkeys(found) if raw not in taken]
        return tuple((free if len(free) > 1 else list(dict.fromkeys(found)))[:2])

    def holds(self, drive: VirtualDrive, parameter: str, now: float) -> int | str:
        """Return a parameter's raw value in a drive. Raises ParameterAddressError."""
        return drive.peek(parameter, now)

    def all_held(self, drive: VirtualDrive, now: float) -> dict[str, int | str]:
        """Return the raw values of all parameters of the model in a drive."""
        held = {}
        for address in self.model.parameters:
            with suppress(DriveCommError):
                held[address] = drive.peek(address, now)
        return held

    # Requests

    def reading(self, parameter: str, address: int | None = None) -> Any:
        """Return the first request of reading a parameter, or None if it cannot be read."""
        try:
            command = next(self.operations(address).read(parameter))
        except (DriveCommError, StopIteration):
            return None
        return command.message if isinstance(command, Ask) else None

    def reads(self, heard: Hashable, parameter: str) -> bool:
        """Whether the request with this key is the one that reads a parameter."""
        message = self.reading(parameter)
        return message is not None and key_of(self.codec.decode(self.codec.encode(message), "request")) == heard

    def is_write(self, find: Framed) -> bool:
        """Whether a request writes a parameter."""
        return self.plugin.intent is not None and self.plugin.intent(find.message).access == "write"

    def only_asks(self, find: Framed) -> bool:
        """Whether a request changes nothing."""
        return self.plugin.intent is not None and self.plugin.intent(find.message).moves_nothing

    def parameters_read_by(self, find: Framed) -> tuple[str, ...]:
        """Return the addresses of the parameters whose values determine the reply to a request."""
        return self._once("told", find, self._depending)

    def parameter_written_by(self, find: Framed) -> str:
        """Return the parameter that a request writes, or "" if it writes none."""
        return next(iter(self._once("written", find, self._writing)), "")

    def parameter_stored_by(self, find: Framed) -> str:
        """Return the parameter that a request stores in EEPROM, or "" if it stores none."""
        return next(iter(self._once("stored", find, self._storing)), "")

    def _once(self, what: str, find: Framed, look: Callable[[Framed], Iterable[str]]) -> tuple[str, ...]:
        key = what, key_of(find.message)
        with self._guard:
            if key not in self._known:
                if len(self._known) >= _MOST_KNOWN:
                    self._known.clear()
                self._known[key] = tuple(look(find))
            return self._known[key]

    def reply_of_another(self, find: Framed, raws: Mapping[str, int]) -> bytes | None:
        """Return the reply of a drive at another address to the same request, or None if it would be the same drive.

        raws: the raw values of that drive.
        """
        address = next((each for each in self.plugin.addresses if each != self.config.address), None)
        if address is None:
            return None
        spare = self.plugin.virtual(address, self.type.options, self.model)
        _poke(spare, raws)
        return self._reply_to(self._changed_request(find, address=address), spare)

    def reply_to_another(self, find: Framed, parameter: str, raws: Mapping[str, int]) -> bytes | None:
        """Return the drive's reply to the request for another parameter; None if a master could not tell it apart.

        raws: the raw values of the drive.
        """
        spare = self.fresh()
        _poke(spare, raws)
        message = self.reading(parameter)
        data = None if message is None else self._reply_to(message, spare)
        if data is None:
            return None
        with suppress(DriveCommError):
            if not self.plugin.mismatch(find.message, self.codec.decode(data, "reply")):
                return None
        return data

    def sound(self, data: bytes) -> bool:
        """Whether these bytes are a valid reply."""
        try:
            self.codec.decode(data, "reply")
        except DriveCommError:
            return False
        return True

    def answer(self, find: Framed, raws: Mapping[str, int]) -> bytes | None:
        """Return the reply of a new drive with these raw values to a request."""
        spare = self.fresh()
        _poke(spare, raws)
        reply = spare.hear(find, BEFORE_S)
        return None if reply is None else reply.data

    def _depending(self, find: Framed) -> Iterator[str]:
        usual = self.answer(find, {})
        if usual is None:
            return
        for info in self.model.parameters.values():
            for raw in _near(info):
                spare = self.fresh()
                with suppress(DriveCommError, ValueError, TypeError):
                    spare.poke(info.address, raw)
                    reply = spare.hear(find, BEFORE_S)
                    if reply is not None and reply.data != usual:
                        yield info.address
                        break

    def _writing(self, find: Framed) -> list[str]:
        if self.only_asks(find):
            return []
        return list(self._changes(find, self.fresh())) or list(self._changes(find, self._changed()))

    def _storing(self, find: Framed) -> list[str]:
        if self.only_asks(find):
            return []
        return self._kept(find, self.fresh()) or self._kept(find, self._changed())

    def _changes(self, find: Framed, spare: VirtualDrive) -> dict[str, int | str]:
        """Return the settings that a request changes in a drive, with their new values."""
        before = self.all_held(spare, BEFORE_S)
        spare.hear(find, BEFORE_S)
        after = self.all_held(spare, BEFORE_S)
        return {each: raw for each, raw in after.items() if raw != before.get(each) and self._can(each)}

    def _kept(self, find: Framed, spare: VirtualDrive) -> list[str]:
        """Return the settings that a request changes and that survive a power cut."""
        changed = self._changes(find, spare)
        if not changed or not isinstance(spare, Restarts):
            return []
        spare.power_cycle(BEFORE_S)
        after = self.all_held(spare, BEFORE_S)
        return [each for each, raw in changed.items() if after.get(each) == raw]

    def _can(self, parameter: str) -> bool:
        """Whether a parameter can be written, unlike a measured value."""
        info = self.model.find(parameter)
        return info is None or "w" in info.access

    def _changed(self) -> VirtualDrive:
        """Return a drive whose settings all differ from the factory state, as far as possible."""
        spare = self.fresh()
        place = self._place(spare)
        for info in self.model.parameters.values():
            if info.kind != "setting":
                continue
            for raw in _near(info):
                before = None
                with suppress(DriveCommError, ValueError, TypeError):
                    before = spare.peek(info.address, BEFORE_S)
                    spare.poke(info.address, raw)
                if before is not None and self._place(spare) != place:
                    spare.poke(info.address, before)
                break
        return spare

    def _changed_request(self, find: Framed, **changed: Any) -> Any:
        try:
            return replace(find.message, **changed)
        except TypeError:
            pass
        fields = fields_of(find.message)
        names = [name for name in ("address", "node") if name in fields]
        try:
            return self.plugin.message({**fields, **dict.fromkeys(names, changed["address"])}, "request")
        except (DriveCommError, TypeError, ValueError, KeyError):
            return None

    def _reply_to(self, message: Any, drive: VirtualDrive) -> bytes | None:
        if message is None:
            return None
        try:
            data = self.codec.encode(message)
            reply = drive.hear(Framed(data, drive.codec.decode(data, "request")), BEFORE_S)
        except (DriveCommError, ReplyError, NotSupported, ValueError):
            return None
        return None if reply is None else reply.data

    @staticmethod
    def _place(drive: VirtualDrive) -> tuple[int, Any]:
        return drive.address, drive.settings


def _whole(value: Decimal) -> int:
    with suppress(InvalidOperation, ValueError):
        return int(value)
    return 0


def _near(info: Any) -> Sequence[int]:
    """Return other raw values near the start value of a parameter, within its range."""
    if isinstance(info.start, str):
        return ()
    start = _whole((info.start or Decimal(0)) / info.factor)
    raws = [raw for raw in info.values if raw != start] if info.values else [start + 3, start - 3, start + 1, start - 1]
    return [raw for raw in raws if info.allows(raw * info.factor)][:2]


def _poke(drive: VirtualDrive, raws: Mapping[str, int]) -> None:
    for parameter, raw in raws.items():
        with suppress(DriveCommError, ValueError):
            drive.poke(parameter, raw)
