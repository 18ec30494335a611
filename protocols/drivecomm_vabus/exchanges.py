"""The conversations of a VABus master: read, write, control, status.

Short description sections 6.1, 6.2, 6.5; timing and error handling Agile VABus manual p. 26-33.
"""

from __future__ import annotations

from decimal import Decimal
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from drivecomm.errors import (
    NotSupported,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    StateError,
    UnexpectedReplyError,
    UsageError,
)
from drivecomm.exchange import Ask, Exchange, Pause, Tell
from drivecomm.numbers import exact, unscaled
from drivecomm.protocol import Capabilities
from drivecomm.status import DriveState, DriveStatus, Stop
from drivecomm_vabus import states
from drivecomm_vabus.errorcodes import ERROR_REGISTER, LINE_FAULTS, error_text
from drivecomm_vabus.parameters import Target, characters_for, reading, target
from drivecomm_vabus.states import State, state_of
from drivecomm_vabus.telegrams import BROADCAST, Ack, Enquiry, Eot, Nak, Select, Value, data_of, number_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.models import Model
    from drivecomm.reading import Reading
    from drivecomm.reading import Value as ParameterValue
    from drivecomm_vabus.options import VabusOptions

_CONTROL_WORDS = {
    Stop.RAMP: states.DISABLE_OPERATION,
    Stop.COAST: states.DISABLE_VOLTAGE,
    Stop.QUICK: states.QUICK_STOP,
}

_MEANINGS = {
    State.NOT_READY_TO_SWITCH_ON: DriveState.NOT_READY,
    State.SWITCH_ON_DISABLED: DriveState.NOT_READY,
    State.READY_TO_SWITCH_ON: DriveState.READY,
    State.SWITCHED_ON: DriveState.READY,
    State.OPERATION_ENABLED: DriveState.RUNNING,
    State.QUICK_STOP_ACTIVE: DriveState.STOPPING,
    State.FAULT_REACTION_ACTIVE: DriveState.FAULT,
    State.FAULT: DriveState.FAULT,
}

_POLL_S = 0.05

# A poll plan asks for the same parameters again and again; more of them than this are not kept in mind.
_KEPT = 512

_CLOSING = Tell(message=Eot(), pause_s=0.0)

# In this time a drive has answered a stop that was told without waiting for its answer: two bytes after its delay.
_ANSWERED_S = 0.05


class VabusOperations:
    """The verbs of one VABus drive, or of all drives at address 32.

    After a NAK the drive refuses every write until its error register is read, so every NAK is followed by reading it
    (short description section 6.5). When that could not be done, or when it is open whether a select was refused, the
    register is read before the next select. A NAK does not say what it refuses: the first one after a request that was
    not answered may be that one's, so the question is put once more before it is believed.
    """

    def __init__(self, address: int, options: VabusOptions, model: Model | None) -> None:
        self._address = address
        self._options = options
        self._model = model
        self._maybe_locked = False
        self._unanswered = False
        self._reversed = False
        # Model and options of a drive do not change, so that an address always means the same.
        self._known = lru_cache(_KEPT)(lambda name, kind: target(name, model, kind, None))
        self._enquiry = lru_cache(_KEPT, typed=True)(self._new_enquiry)

    @property
    def capabilities(self) -> Capabilities:
        """What a VABus drive can be asked to do."""
        return Capabilities(
            stops=frozenset(_CONTROL_WORDS),
            reverse=self._options.ram_datasets,
            reference_percent=self._options.ram_datasets,
            reference_hz=self._options.ram_datasets,
            stored_writes=True,
            volatile_writes=self._options.ram_datasets,
            broadcast=True,
            link_loss="fault F2010 after the watchdog time in parameter 413; 0 presumably means that it runs on",
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """One more verb: control_word(word=) writes parameter 410 as it stands, once."""
        return {"control_word": self._command}

    def commanded_elsewhere(self) -> None:
        """Do nothing: no telegram repeats or builds on an earlier control word."""

    def read(self, parameter: str, *, type: str = "", dataset: int | None = None) -> Exchange[Reading]:
        """Read a parameter. type: uint, int, long or string. dataset: 0 to 4."""
        wanted = self._known(parameter, type) if dataset is None else target(parameter, self._model, type, dataset)
        if wanted.dataset is not None and wanted.dataset > 4:
            raise ParameterAddressError(
                f"data set {wanted.dataset} can only be written, it is the RAM side of {wanted.dataset - 5}"
            )
        self._must_be_one_drive("read")
        return self._read(wanted)

    def write(
        self,
        parameter: str,
        value: ParameterValue | float,
        *,
        store: bool = False,
        type: str = "",
        dataset: int | None = None,
    ) -> Exchange[None]:
        """Write a parameter. type: uint, int, long or string. dataset: 0 to 4, or 5 to 9 for their RAM side."""
        wanted = target(parameter, self._model, type, dataset)
        attempts = 1 if wanted.number == states.CONTROL_WORD else None
        dataset_sent = self._write_dataset(wanted, store=store)
        return self._select(wanted.number, dataset_sent, characters_for(wanted, value), attempts=attempts)

    def status(self) -> Exchange[DriveStatus]:
        """Read the state word, and the fault code if it says fault."""
        self._must_be_one_drive("status")
        return self._status()

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Walk the state machine to "operation enabled": 0006, 0007, 000F, each state awaited.

        The control word has no bit for the direction, the sign of the references says it (Agile VABus manual p. 41): to
        run backwards, those that are positive are made negative in RAM first, and made positive again by the next
        start forwards of this object.
        """
        self._must_be_one_drive("start")
        if reverse and not self._options.ram_datasets:
            raise NotSupported(
                "this drive has no RAM data sets, and a reversed reference would go to EEPROM; "
                "set a negative reference with store=True and start forward",
                says="store=True",
            )
        return self._start_backwards() if reverse else self._start_forwards()

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: 0007 (disable operation), 0000 (coast) or 0002 (quick stop)."""
        if how not in _CONTROL_WORDS:
            raise NotSupported(f"a VABus drive cannot stop by {how.value}; it can by ramp, coast and quick")
        return self._select(states.CONTROL_WORD, 0, f"{_CONTROL_WORDS[how]:04X}", attempts=None, urgent=True)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault with a rising edge of bit 7; does nothing on a drive without a fault."""
        self._must_be_one_drive("reset")
        return self._reset()

    def set_reference_percent(self, percent: ParameterValue | float) -> Exchange[None]:
        """Write the reference percentage, 0.01 % steps, into RAM."""
        return self._set_reference(self._options.reference_percent_parameter, "int", percent)

    def set_reference_hz(self, hz: ParameterValue | float) -> Exchange[None]:
        """Write the reference frequency, 0.01 Hz steps, into RAM."""
        return self._set_reference(self._options.reference_hz_parameter, "long", hz)

    def probe(self) -> Exchange[None]:
        """Ask for the state word once; a NAK proves a drive as well as a value does."""
        self._must_be_one_drive("probe")
        return self._probe()

    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read the state; no manual that was read names a parameter with the drive's type."""
        self._must_be_one_drive("identify")
        return self._identify()

    # Conversations

    def _read(self, wanted: Target) -> Exchange[Reading]:
        reply = yield from self._enquire(wanted.number, wanted.dataset or 0, wanted.address)
        return reading(wanted, reply.data, lower_case_hex=self._options.lower_case_hex)

    def _enquire(self, number: int, dataset: int, name: str) -> Exchange[Value]:
        enquiry = self._enquiry(number, dataset)
        for last in (False, True):
            try:
                reply = yield enquiry
            except ReplyError:
                self._unanswered = True
                raise
            if self._options.trailing_eot:
                yield _CLOSING
            if isinstance(reply, Value):
                return reply
            doubtful, self._unanswered = self._unanswered, False
            code = yield from self._error_register()
            if last or not (doubtful or code in LINE_FAULTS):
                raise _refused(name, code)
        raise AssertionError  # pragma: no cover

    def _new_enquiry(self, number: int, dataset: int) -> Ask:
        return Ask(message=Enquiry(address=self._address, sys=self._options.sys, dataset=dataset, parameter=number))

    def _select(
        self, number: int, dataset: int, data: str, *, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[None]:
        select = Select(address=self._address, sys=self._options.sys, dataset=dataset, parameter=number, data=data)
        if self._address == BROADCAST:
            yield Tell(message=select)
            return
        if self._maybe_locked:
            if urgent:
                yield Tell(message=select, pause_s=_ANSWERED_S)
            yield from self._error_register()
            if urgent:
                # It acts now; that it did is confirmed when a late reply to something else can no longer be taken for
                # its own.
                yield Tell(message=select, pause_s=_ANSWERED_S)
                urgent = False
        for last in (False, True):
            try:
                reply = yield Ask(message=select, attempts=attempts, acts=True, nameless=True, urgent=urgent)
            except ReplyError:
                self._maybe_locked = self._unanswered = True
                raise
            yield from self._close()
            if isinstance(reply, Ack):
                return
            code = yield from self._error_register()
            if last or code not in LINE_FAULTS or attempts == 1:
                raise _refused(str(number), code)

    def _error_register(self) -> Exchange[int | None]:
        """Read the register, which clears it and the write lock; None when the drive does not tell.

        It belongs to the interface: system-bus node 0, data set 0. Decoded as uint, eight digits accepted.
        """
        self._maybe_locked = True
        try:
            reply = yield Ask(message=Enquiry(address=self._address, parameter=ERROR_REGISTER))
        except ReplyError:
            return None
        yield from self._close()
        if not isinstance(reply, Value):
            return None
        self._maybe_locked = False
        try:
            return number_of(reply.data[-4:], "uint", lower_case_hex=self._options.lower_case_hex)
        except ValueError:
            return None

    def _close(self) -> Exchange[None]:
        if self._options.trailing_eot:
            yield _CLOSING

    def _state_word(self) -> Exchange[int]:
        reply = yield from self._enquire(states.STATE_WORD, 0, "411, the state word")
        try:
            return number_of(reply.data, "uint", lower_case_hex=self._options.lower_case_hex)
        except ValueError as error:
            raise UnexpectedReplyError(f"the state word is no uint: {error}") from error

    def _status(self) -> Exchange[DriveStatus]:
        word = yield from self._state_word()
        state = state_of(word)
        faulted = state in (State.FAULT, State.FAULT_REACTION_ACTIVE)
        code = (yield from self._fault_code()) if faulted else None
        return DriveStatus(
            word=word,
            state=_MEANINGS[state] if state else DriveState.NOT_READY,
            running=state in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE),
            fault=faulted,
            warning=bool(word >> states.WARNING_BIT & 1 or word >> states.WARNING_2_BIT & 1),
            at_reference=bool(word >> states.REACHED_BIT & 1),
            remote=bool(word >> states.REMOTE_BIT & 1),
            fault_code=code,
            fault_text=self._model.faults.get(code, "") if self._model and code is not None else "",
            flags=(state.title if state else "unlisted state", *states.flags_of(word)),
        )

    def _fault_code(self) -> Exchange[int | None]:
        try:
            reply = yield from self._enquire(states.CURRENT_FAULT, 0, "260, the current fault")
            return number_of(reply.data, "uint", lower_case_hex=self._options.lower_case_hex)
        except (RefusedError, ValueError):
            return None

    def _start_forwards(self) -> Exchange[None]:
        if self._reversed:
            yield from self._turn_references(1)
            self._reversed = False
        yield from self._start()

    def _start_backwards(self) -> Exchange[None]:
        self._reversed = True
        yield from self._turn_references(-1)
        yield from self._start()

    def _turn_references(self, sign: int) -> Exchange[None]:
        """Give both references this sign, in RAM; one that has it, or is zero, is left alone."""
        for number, kind in self._references():
            wanted = target(str(number), self._model, kind, None)
            held = yield from self._enquire(number, 0, wanted.address)
            raw = number_of(held.data, wanted.type, lower_case_hex=self._options.lower_case_hex)
            if raw * sign < 0:
                yield from self._select(number, 5, data_of(-raw, wanted.type))

    def _references(self) -> tuple[tuple[int, str], ...]:
        return (self._options.reference_percent_parameter, "int"), (self._options.reference_hz_parameter, "long")

    def _start(self) -> Exchange[None]:
        word = yield from self._state_word()
        state = state_of(word)
        if state in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            code = yield from self._fault_code()
            raise StateError(f"the drive has a fault (code {code}) and cannot start; reset it first")
        if state is State.QUICK_STOP_ACTIVE:
            raise StateError("the drive is in a quick stop; start it again when it stands")
        path = [
            (State.READY_TO_SWITCH_ON, states.SHUTDOWN),
            (State.SWITCHED_ON, states.SWITCH_ON),
            (State.OPERATION_ENABLED, states.ENABLE_OPERATION),
        ]
        for goal, control in path:
            if state is None or state < goal:
                yield from self._command(control)
                try:
                    state = yield from self._await(goal, f"0x{control:04X}")
                except ReplyError as error:
                    if goal is not State.OPERATION_ENABLED:
                        raise
                    raise type(error)(f"{error}; the drive had been told to run before") from None

    def _reset(self) -> Exchange[None]:
        word = yield from self._state_word()
        if state_of(word) not in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            return
        yield from self._command(states.DISABLE_VOLTAGE)
        yield from self._command(states.FAULT_RESET)
        try:
            yield from self._await(State.SWITCH_ON_DISABLED, "the fault reset")
        except StateError as error:
            raise StateError(f"{error}; a fault can be acknowledged only 15 s after it occurred") from None
        # Take the bit away again, so that the next reset has an edge.
        yield from self._command(states.DISABLE_VOLTAGE)

    def _await(self, goal: State, cause: str) -> Exchange[State]:
        waited = 0.0
        while True:
            word = yield from self._state_word()
            if state_of(word) is goal:
                return goal
            if waited >= self._options.state_timeout_s:
                break
            yield Pause(seconds=_POLL_S)
            waited += _POLL_S
        raise StateError(
            f"the drive did not come to {goal.title!r} within {self._options.state_timeout_s:g} s after {cause}; its "
            f"state word is 0x{word:04X}; check the hardware enable and parameter 412 (1 = state machine)"
        )

    def _command(self, word: int) -> Exchange[None]:
        """Write the control word, once: a repeated edge or start could act twice."""
        return self._select(states.CONTROL_WORD, 0, f"{word:04X}", attempts=1)

    def _set_reference(self, number: int, type: str, value: ParameterValue | float) -> Exchange[None]:
        if not self._options.ram_datasets:
            raise NotSupported(
                f"this drive has no RAM data sets, so a reference would go to EEPROM; write {number} with store=True",
                says="store=True",
            )
        wanted = target(str(number), self._model, type, None)
        physical = Target(number=number, dataset=None, type=wanted.type, info=wanted.info)
        if wanted.info is None:
            # Both references have two decimals (short description section 7).
            value = _hundredths(value, number)
        return self._select(number, 5, characters_for(physical, value))

    def _probe(self) -> Exchange[None]:
        enquiry = Enquiry(address=self._address, sys=self._options.sys, parameter=states.STATE_WORD)
        reply = yield Ask(message=enquiry, attempts=1)
        yield from self._close()
        if isinstance(reply, Nak):
            yield from self._error_register()

    def _identify(self) -> Exchange[Mapping[str, str]]:
        try:
            word = yield from self._state_word()
        except RefusedError:
            return {}
        state = state_of(word)
        return {"state": state.title if state else f"0x{word:04X}"}

    def _write_dataset(self, wanted: Target, *, store: bool) -> int:
        dataset = wanted.dataset or 0
        if dataset > 4:
            if store:
                raise UsageError(f"data set {dataset} is in RAM; to store, write data set {dataset - 5}")
            return dataset
        if store or wanted.number == states.CONTROL_WORD:
            return dataset
        if not self._options.ram_datasets:
            raise NotSupported(
                f"this drive keeps every write in EEPROM, so {wanted.address} is only written with store=True",
                says="store=True",
            )
        return dataset + 5

    def _must_be_one_drive(self, verb: str) -> None:
        if self._address == BROADCAST:
            raise NotSupported(f"{verb} needs an answer, and nobody answers a broadcast")


def _hundredths(value: ParameterValue | float, number: int) -> int:
    return unscaled(exact(value, str(number)), Decimal("0.01"), str(number))


def _refused(parameter: str, code: int | None) -> RefusedError:
    if code is None:
        return RefusedError(parameter, None, "its error register could not be read")
    if code == 0:
        return RefusedError(parameter, None, "its error register was empty when it was read")
    return RefusedError(parameter, code, error_text(code))
