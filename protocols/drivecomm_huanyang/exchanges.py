"""The conversations of a master with a Huanyang drive."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, RefusedError, ValueRefusedError
from drivecomm.profiles import Commander, check_needs
from drivecomm.protocol import Ask, Capabilities, Stop, Tell, exact, kept, unless_refused, unscaled
from drivecomm_huanyang import parameters as pd, telegrams as fn
from drivecomm_huanyang.telegrams import Request

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.profiles import Step, Target, Words
    from drivecomm.protocol import DriveStatus, Exchange, Model, Reading, Value
    from drivecomm_huanyang.options import HuanyangOptions
    from drivecomm_huanyang.telegrams import Reply

_IDENTITY = {"software": "PD181", "serial": "PD183"}


class Conversation:
    """Asks and tells one drive, or all drives at address 0; carries the words of the control profile."""

    def __init__(self, address: int) -> None:
        self._address = address
        self._is_there = False

    def asking_status(self, item: int, attempts: int | None = None) -> Ask:
        """Return the request for a status value; its reply is longer than it, so that no echo passes for it."""
        self._must_be_one()
        message = Request(address=self._address, function=fn.STATUS, length=1, parameter=item)
        return Ask(message=message, attempts=attempts, distinct=True)

    def raw(self, wanted: Target) -> Exchange[int]:
        """Read a parameter or a status value."""
        number = wanted.place.start
        if wanted.place.kind:
            reply = yield self.asking_status(number)
            self._is_there = True
            return int(reply.value or 0)
        ask = Ask(message=self._naming(fn.READ, number, 0), mirrored=True)
        reply = yield ask
        if reply.value == 0 and not self._is_there:
            # That may have been an echo; after this it is known whether there is one.
            yield from self.look()
            reply = yield ask
        self._is_there = True
        return int(self._taken(reply, number).value or 0)

    def write(self, wanted: Target, raw: int) -> Exchange[None]:
        """Write a parameter; the drive repeats it."""
        yield from self._heard()
        number = wanted.place.start
        self._taken((yield Ask(message=self._naming(fn.WRITE, number, raw), acts=True, mirrored=True)), number)

    def set_frequency(self, raw: int) -> Exchange[None]:
        """Tell the drive a frequency, in steps of 0.01 Hz, that a running motor goes to at once."""
        yield from self._heard()
        message = Request(address=self._address, function=fn.FREQUENCY, length=2, value=raw)
        yield Ask(message=message, acts=True, mirrored=True)

    def look(self) -> Exchange[Words]:
        """Read the output frequency; nothing else tells without a command whether the motor turns."""
        hz = yield from self.raw(pd.target(pd.OUTPUT_FREQUENCY, None))
        return {pd.OUTPUT_FREQUENCY: hz, pd.TURNS: int(hz > 0)}

    def send(self, step: Step, *, urgent: bool) -> Exchange[Words | None]:
        """Send control data: once, unless they stop the motor."""
        message = Request(address=self._address, function=fn.CONTROL, length=1, value=step.word)
        if self._address == fn.BROADCAST:
            yield Tell(message=message)
            return None
        if not urgent:
            yield from self._heard()
        attempts = None if urgent else 1
        ask = Ask(message=message, acts=True, attempts=attempts, urgent=urgent, nameless=True, mirrored=True)
        reply = yield ask
        if not self._is_there:
            # The echo of an adapter may have passed for the reply. A stop is out by now; the drive confirms this one.
            yield from self._heard()
            reply = yield ask
        if reply.function == fn.CONTROL_REFUSED:
            raise RefusedError("CNTR", reply.function, "it does not take its commands from here, or not now")
        return {pd.CNST: reply.value}

    def _heard(self) -> Exchange[None]:
        """Ask once for what no echo answers, before anything is believed that an echo could be."""
        if not self._is_there:
            yield from self.look()

    def _must_be_one(self) -> None:
        if self._address == fn.BROADCAST:
            raise NotSupported("that is for one drive; all Huanyang drives of a line can only be stopped")

    def _naming(self, function: int, number: int, value: int) -> Request:
        self._must_be_one()
        return Request(address=self._address, function=function, length=3, parameter=number, value=value)

    @staticmethod
    def _taken(reply: Reply, number: int) -> Reply:
        if reply.function == fn.REFUSED:
            raise RefusedError(f"PD{number:03d}", reply.function, "it has no such parameter, or does not take this now")
        return reply


class HuanyangOperations:
    """The verbs of one drive, or, at address 0, the stop of all drives on the line."""

    capabilities = Capabilities(
        stops=frozenset({Stop.RAMP}),
        reverse=True,
        reference_percent=True,
        reference_hz=True,
        stored_writes=True,
        volatile_writes=False,
        broadcast=True,
        faults=False,
    )

    def __init__(self, address: int, options: HuanyangOptions, model: Model | None) -> None:
        self.extra: Mapping[str, Callable[..., Exchange[Any]]] = {}
        self._model = model
        self._known = kept(self._target)
        self._drive = Conversation(address)
        self._commander = Commander(
            pd.PROFILE,
            self._drive,
            state_timeout_s=options.state_timeout_s,
            advice="its display for a fault, which it does not tell",
            answers=address != fn.BROADCAST,
        )

    def read(self, parameter: str) -> Exchange[Reading]:
        """Read a parameter or a status value."""
        return self._reading(self._known(parameter))

    def write(self, parameter: str, value: Value | float, *, store: bool = False) -> Exchange[None]:
        """Write a parameter, with store=True since it stays without mains; or CFG0, the frequency, which does not."""
        wanted = self._known(parameter)
        raw = int(wanted.format.raw_for(value, wanted.address, wanted.info))
        if wanted.place.kind:
            if wanted.place.start or store:
                raise NotSupported("of the status values only CFG0 can be written, and not stored", says="store")
            return self._set_frequency(lambda _most: raw)
        if not store:
            raise NotSupported(
                f"a write to {wanted.address} stays in the drive when mains is off; write with store=True",
                says="store=True",
            )
        return self._drive.write(wanted, raw)

    def address_of(self, parameter: str, **_options: Any) -> str:
        """Return the address as manual and model write it."""
        return self._known(parameter).address

    def status(self) -> Exchange[DriveStatus]:
        """Read output frequency and set frequency; a drive tells no fault, and not which way it turns."""
        seen = yield from self._drive.look()
        told = yield from self._drive.raw(self._known(pd.SET_FREQUENCY))
        hz = seen[pd.OUTPUT_FREQUENCY]
        return (yield from self._commander.status(
            self._model, seen, actual_hz=hz * pd.STEP_HZ, at_reference=hz == told > 0
        ))  # fmt: skip

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Start a drive that takes its commands from the line; taken back where the motor does not turn."""
        needs = pd.NEEDS_TO_REVERSE if reverse else pd.NEEDS_TO_START
        return self._commander.start(reverse=reverse, prepare=check_needs(needs, self.read))

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop down the ramp, or as PD026 says."""
        return self._commander.stop(how)

    def reset(self) -> Exchange[None]:
        """Not possible: no telegram is documented that acknowledges a fault."""
        raise NotSupported("no telegram acknowledges a fault of a Huanyang drive; use its keypad or its RST terminal")

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the frequency as a share of PD005, the maximum operating frequency, rounded to 0.01 Hz."""
        share = exact(percent, "reference")
        if not 0 <= share <= 100:
            raise ValueRefusedError(f"a reference of {share} % is not 0 to 100 % of PD005; to reverse is a start")
        return self._set_frequency(lambda most: int((share * most / 100).to_integral_value()))

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the frequency in hertz, up to PD005, the maximum operating frequency."""
        raw = unscaled(exact(hz, "reference"), pd.STEP_HZ, "reference", "Hz")
        if raw not in range(0x10000):
            raise ValueRefusedError(f"a reference of {hz} Hz is not 0 Hz to PD005; to reverse is a start")
        return self._set_frequency(lambda _most: raw)

    def probe(self) -> Exchange[None]:
        """Ask once for the output frequency."""
        yield self._drive.asking_status(1, attempts=1)

    def identify(self, only: Collection[str] = ()) -> Exchange[Mapping[str, str]]:
        """Read software version and serial number, as numbers whose digits no page explains."""
        found = {}
        for name, address in _IDENTITY.items():
            if only and name not in only:
                continue
            found[name] = yield from unless_refused(self.read(address))
        return {name: str(told) for name, told in found.items() if told is not None}

    def _reading(self, wanted: Target) -> Exchange[Reading]:
        return wanted.reading((yield from self._drive.raw(wanted)))

    def _set_frequency(self, wanted: Callable[[int], int]) -> Exchange[None]:
        """Set the frequency that a function makes of the highest one, both in steps of 0.01 Hz."""
        yield from check_needs(pd.NEEDS_FOR_REFERENCE, self.read)
        most = yield from self._drive.raw(self._known(pd.MAXIMUM_HZ))
        raw = wanted(most)
        if raw > most:
            limit = most * pd.STEP_HZ
            raise ValueRefusedError(f"a reference of {raw * pd.STEP_HZ} Hz is above PD005, which is {limit} Hz")
        yield from self._drive.set_frequency(raw)

    def _target(self, parameter: str) -> Target:
        return pd.target(parameter, self._model)
