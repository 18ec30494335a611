"""One drive on a bus: the one interface to drives of every maker."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from drivecomm.errors import NotSupported, UsageError
from drivecomm.status import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.exchange import Exchange
    from drivecomm.line import LineFacts
    from drivecomm.link import Party
    from drivecomm.models import Model
    from drivecomm.protocol import Capabilities, Operations
    from drivecomm.reading import Reading, Value
    from drivecomm.status import DriveStatus

T = TypeVar("T")


class Runs(Protocol):
    """What a drive needs of its bus."""

    def run(self, party: Party, exchange: Exchange[T]) -> T:
        """Carry out an exchange."""
        ...

    def wall_time(self) -> float:
        """Return the time for people."""
        ...

    def commanding(self, who: Drive | Broadcast) -> None:
        """Let all others who speak to the same drive know that it is being commanded."""
        ...


class Drive:
    """One addressed drive, made by `Bus.drive`; every verb is one exchange on the bus.

    A verb may raise LinkError (port or line), ReplyError (no believable reply), DriveError (the drive said no), and
    UsageError before anything is sent.
    """

    def __init__(self, bus: Runs, party: Party, operations: Operations, model: Model | None) -> None:
        self._bus = bus
        self._party = party
        self._operations = operations
        self.model = model

    @property
    def name(self) -> str:
        """The drive as the command line names it, such as "vabus:1"."""
        return self._party.name

    @property
    def facts(self) -> LineFacts:
        """Line settings and timing of this drive."""
        return self._party.facts

    @property
    def capabilities(self) -> Capabilities:
        """What this drive can be asked to do."""
        return self._operations.capabilities

    def read(self, parameter: str, **options: Any) -> Reading:
        """Read a parameter, by its address in the protocol's form or by its name in the drive's model.

        options: the protocol's own, such as type= (vabus, danfoss-fc) or dataset= (vabus).
        """
        reading = self._run(bound(self._operations.read, parameter, **options))
        return replace(reading, time_s=self._bus.wall_time())

    @property
    def party(self) -> Party:
        """The drive as the link sees it."""
        return self._party

    def commanded_elsewhere(self) -> None:
        """Forget the last command, because somebody else has commanded this drive since; the bus calls it."""
        self._operations.commanded_elsewhere()

    def write(self, parameter: str, value: Value | float, *, store: bool = False, **options: Any) -> Reading | None:
        """Write a parameter; returns what the drive reports back, None where it only confirms.

        store: keep the value over power-off (EEPROM) where the protocol makes the difference. A value that does not fit
        raises ValueRefusedError before anything is sent.
        """
        reading = self._command(bound(self._operations.write, parameter, value, store=store, **options))
        return None if reading is None else replace(reading, time_s=self._bus.wall_time())

    def status(self) -> DriveStatus:
        """Read the status word; commands nothing."""
        return self._run(self._operations.status())

    def start(self, *, reverse: bool = False) -> None:
        """Start the motor with the reference that is set.

        What stops it when this program falls silent is a setting of the drive: see `capabilities.link_loss`.
        """
        self._command(self._operations.start(reverse=reverse))

    def stop(self, how: Stop = Stop.RAMP) -> None:
        """Stop the motor."""
        self._command(self._operations.stop(how))

    def reset(self) -> None:
        """Acknowledge a fault. The motor does not start again by this."""
        self._command(self._operations.reset())

    def set_reference(self, *, percent: Value | float | None = None, hz: Value | float | None = None) -> None:
        """Set the reference, as a share of the reference range or as output frequency; never stored.

        Raises UsageError unless exactly one of the two is given.
        """
        if percent is not None and hz is None:
            self._command(self._operations.set_reference_percent(percent))
        elif hz is not None and percent is None:
            self._command(self._operations.set_reference_hz(hz))
        else:
            raise UsageError("a reference is set with percent or with hz, one of the two")

    def probe(self) -> None:
        """Ask once whether a drive is there, with something that cannot move a motor. Raises ReplyError if not."""
        self._run(self._operations.probe())

    def identify(self) -> Mapping[str, str]:
        """Read what the drive tells of itself: name plate, software, address; empty when it tells nothing."""
        return self._run(self._operations.identify())

    def call(self, verb: str, **arguments: Any) -> Any:
        """Carry out a verb that only this protocol has, such as jogging or choosing a set-up.

        The protocol's documentation lists them with their arguments. Raises NotSupported for a verb that it lacks.
        """
        extra = self._operations.extra
        if verb not in extra:
            raise NotSupported(f"{self.name} has no verb {verb!r}; it has {', '.join(sorted(extra)) or 'none'}")
        return self._command(bound(extra[verb], **arguments))

    def _command(self, exchange: Exchange[T]) -> T:
        self._bus.commanding(self)
        return self._run(exchange)

    def _run(self, exchange: Exchange[T]) -> T:
        return self._bus.run(self._party, exchange)

    def __repr__(self) -> str:
        return f"<Drive {self.name}>"


class Broadcast:
    """All drives of one protocol on a bus at once. Nobody answers, so nothing is known of what they did."""

    def __init__(self, bus: Runs, party: Party, operations: Operations) -> None:
        self._bus = bus
        self._party = party
        self._operations = operations

    @property
    def party(self) -> Party:
        """All drives as the link sees them."""
        return self._party

    def write(self, parameter: str, value: Value | float, **options: Any) -> None:
        """Write a parameter of all drives; returns when the telegram is sent."""
        self._bus.commanding(self)
        self._bus.run(self._party, bound(self._operations.write, parameter, value, **options))

    def stop(self, how: Stop = Stop.RAMP) -> None:
        """Stop all motors; returns when the telegram is sent."""
        self._bus.commanding(self)
        self._bus.run(self._party, self._operations.stop(how))


def bound(operation: Callable[..., Exchange[T]], *values: Any, **options: Any) -> Exchange[T]:
    """Call an operation; options that it does not have are a UsageError that lists those it has."""
    parameters = inspect.signature(operation).parameters
    takes_any = any(one.kind is one.VAR_KEYWORD for one in parameters.values())
    unknown = [] if takes_any else sorted(set(options) - set(parameters))
    if unknown:
        known = [name for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY or not values]
        raise UsageError(f"{operation.__name__} has no option {unknown[0]!r} here; it has {', '.join(known) or 'none'}")
    missing = [
        name
        for name, one in list(parameters.items())[len(values) :]
        if one.default is one.empty and one.kind is not one.VAR_KEYWORD and name not in options
    ]
    if missing:
        raise UsageError(f"{operation.__name__} needs {', '.join(missing)}")
    return operation(*values, **options)
