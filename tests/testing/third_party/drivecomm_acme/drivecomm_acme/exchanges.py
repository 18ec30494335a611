"""Exchanges of a master with an Acme drive, A10 line manual, sections 3 and 4."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, RefusedError, StateError, UnexpectedReplyError, ValueRefusedError
from drivecomm.protocol import Ask, Capabilities, DriveState, DriveStatus, Exchange, Stop, Tell, exact, unscaled
from drivecomm_acme import words
from drivecomm_acme.parameters import number_of, reading, word_for
from drivecomm_acme.telegrams import ALL_DRIVES, Accepted, Order, Poll, Preset, Query, Refusal, State, Value

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.protocol import Model, Reading, Value as ParameterValue
    from drivecomm_acme.options import AcmeOptions

REFERENCE, SOFTWARE = 1, 900
_HIGHEST_HZ = Decimal(400)
_STOPS = {Stop.RAMP: 0, Stop.COAST: words.COAST, Stop.QUICK: words.QUICK}


class AcmeOperations:
    """The verbs of one Acme drive, or of all drives at address 0."""

    def __init__(self, address: int, _options: AcmeOptions, model: Model | None) -> None:
        self._address = address
        self._model = model

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of an Acme drive."""
        return Capabilities(
            stops=frozenset(_STOPS),
            reverse=True,
            reference_percent=False,
            reference_hz=True,
            stored_writes=True,
            volatile_writes=True,
            broadcast=True,
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """Extra verbs: none."""
        return {}

    def read(self, parameter: str) -> Exchange[Reading]:
        """Read a parameter, 000 to 999 or a name of the model."""
        number, info = number_of(parameter, self._model)
        self._must_be_one_drive("read")

        def conversation() -> Exchange[Reading]:
            reply = yield from self._ask(Ask(message=Query(address=self._address, parameter=number)))
            return reading(number, info, _data_of(reply))

        return conversation()

    def write(self, parameter: str, value: ParameterValue | float, *, store: bool = False) -> Exchange[Reading | None]:
        """Write a parameter; return the value that the drive then holds, or None from a broadcast."""
        number, info = number_of(parameter, self._model)
        if store and self._address == ALL_DRIVES:
            raise NotSupported("all Acme drives at once cannot be made to store; write without store, or to each drive")
        data = word_for(parameter, info, value)
        preset = Preset(kind="store" if store else "write", address=self._address, parameter=number, data=data)

        def conversation() -> Exchange[Reading | None]:
            reply = yield from self._say(preset)
            return None if reply is None else reading(number, info, _data_of(reply))

        return conversation()

    def address_of(self, parameter: str, **_: Any) -> str:
        """Return the number of a parameter."""
        return f"{number_of(parameter, self._model)[0]:03d}"

    def status(self) -> Exchange[DriveStatus]:
        """Read status word and fault code; the poll telegram commands nothing."""
        self._must_be_one_drive("status")
        return self._status()

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start the motor, unless the drive has a fault."""
        self._must_be_one_drive("start")
        return self._start(words.RUN | (words.REVERSE if reverse else 0))

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop by the ramp, by the quick ramp, or by coasting."""
        if how not in _STOPS:
            raise NotSupported(f"an Acme drive cannot stop by {how.value}; it can by ramp, quick and coast")
        return self._command(_STOPS[how], urgent=True, attempts=None)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault by an edge of the reset bit; do nothing without a fault."""
        self._must_be_one_drive("reset")
        return self._reset()

    def set_reference_percent(self, percent: ParameterValue | float) -> Exchange[None]:
        """Raise NotSupported: the drive takes no reference in percent (section 4.2)."""
        raise NotSupported(f"an Acme drive takes its reference in hertz, not as {percent} %")

    def set_reference_hz(self, hz: ParameterValue | float) -> Exchange[None]:
        """Write the reference frequency in steps of 0.01 Hz, without storing it."""
        raw = unscaled(exact(hz, "reference"), Decimal("0.01"), "reference", "Hz")
        if not 0 <= raw <= _HIGHEST_HZ * 100:
            raise ValueRefusedError(f"a reference of {hz} Hz is not 0 to {_HIGHEST_HZ} Hz; start turns the motor round")
        preset = Preset(kind="write", address=self._address, parameter=REFERENCE, data=raw)

        def conversation() -> Exchange[None]:
            yield from self._say(preset)

        return conversation()

    def probe(self) -> Exchange[None]:
        """Poll the drive once."""
        self._must_be_one_drive("probe")

        def conversation() -> Exchange[None]:
            yield Ask(message=Poll(address=self._address), attempts=1)

        return conversation()

    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:  # noqa: ARG002 - there is only one entry
        """Read the software version."""
        self._must_be_one_drive("identify")

        def conversation() -> Exchange[Mapping[str, str]]:
            reply = yield from self._ask(Ask(message=Query(address=self._address, parameter=SOFTWARE)))
            version = _data_of(reply)
            return {"software": f"{version // 100}.{version % 100:02}"}

        return conversation()

    # Conversations

    def _status(self) -> Exchange[DriveStatus]:
        reply = yield Ask(message=Poll(address=self._address))
        if not isinstance(reply, State):
            raise UnexpectedReplyError(f"an Acme drive answers a poll with its state, not with {reply}")
        return words.status(reply.status_word, reply.fault_code, self._model.faults if self._model else {})

    def _start(self, control_word: int) -> Exchange[None]:
        status = yield from self._status()
        if status.state is DriveState.FAULT:
            raise StateError(f"the drive has a fault (code {status.fault_code}) and cannot start; reset it first")
        yield from self._command(control_word, attempts=1)

    def _reset(self) -> Exchange[None]:
        if not (yield from self._status()).fault:
            return
        yield from self._command(words.RESET, attempts=1)
        # Clear the reset bit, so that the next reset has an edge.
        yield from self._command(0, attempts=None)

    def _command(self, control_word: int, *, attempts: int | None, urgent: bool = False) -> Exchange[None]:
        yield from self._say(Order(address=self._address, control_word=control_word), attempts=attempts, urgent=urgent)

    def _say(
        self, request: Preset | Order, *, attempts: int | None = None, urgent: bool = False
    ) -> Exchange[Value | Accepted | State | None]:
        """Send a request to one drive and return its reply, or broadcast it and return None."""
        if self._address == ALL_DRIVES:
            yield Tell(message=request)
            return None
        return (yield from self._ask(Ask(message=request, acts=True, attempts=attempts, urgent=urgent)))

    def _ask(self, ask: Ask) -> Exchange[Value | Accepted | State]:
        reply = yield ask
        if isinstance(reply, Refusal):
            name = f"{reply.parameter:03}" if reply.of != "order" else "control word"
            raise RefusedError(name, reply.code, words.REFUSALS.get(reply.code, "not listed in the manual"))
        answer: Value | Accepted | State = reply
        return answer

    def _must_be_one_drive(self, verb: str) -> None:
        if self._address == ALL_DRIVES:
            raise NotSupported(f"{verb} needs the answer of one drive; all drives at once only hear write and stop")


def _data_of(reply: Value | Accepted | State) -> int:
    if not isinstance(reply, Value):
        raise UnexpectedReplyError(f"an Acme drive gives a value or refuses, it does not say {reply}")
    return reply.data
