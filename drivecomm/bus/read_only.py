"""The operations of a drive that may be asked and stopped, and nothing else.

What writes or commands is refused before anything is sent. Verbs of the protocol's own are carried out as far as they
only ask. Nothing is remembered from one call to the next, so that no later one carries a command: neither what a verb
wanted before it was refused, nor the word of a stop, with which another master's motor would be stopped again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from drivecomm.bus.exchanges import COMMON_VERBS
from drivecomm.errors import ReadOnlyError, UsageError
from drivecomm.protocol import Pause, Stop, with_each_command

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import (
        Ask,
        Capabilities,
        DriveStatus,
        Exchange,
        Intent,
        Message,
        Operations,
        Reading,
        Tell,
        Value,
    )

T = TypeVar("T")


class ReadOnly:
    """The operations of a drive without those that write or command; stopping it stays, always.

    new: makes the drive's operations, with nothing remembered; each stop and each verb gets its own. why: the sentence
    that a refusal gives. intent: the protocol's, None where it has none: then no verb of its own is let through.
    """

    def __init__(self, new: Callable[[], Operations], why: str, intent: Callable[[Message], Intent] | None) -> None:
        self._operations = new()
        self._new = new
        self._why = why
        self._intent = intent

    @property
    def capabilities(self) -> Capabilities:
        """What this drive could be asked to do."""
        return self._operations.capabilities

    @property
    def read(self) -> Callable[..., Exchange[Reading]]:
        """Read one parameter."""
        return self._operations.read

    @property
    def write(self) -> Callable[..., Exchange[Reading | None]]:
        """Refuse to write."""
        return self._refused

    def address_of(self, parameter: str, **options: Any) -> str:
        """Return the address of the value that a write would change."""
        return self._operations.address_of(parameter, **options)

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """The protocol's own verbs, as far as they only ask; those that every maker's drives have all command."""
        return {name: self._refused if name in COMMON_VERBS else self._asking(name) for name in self._operations.extra}

    def status(self) -> Exchange[DriveStatus]:
        """Read the status word."""
        return self._operations.status()

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Refuse to start."""
        self._refused(reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop the motor."""
        return self._new().stop(how)

    def reset(self) -> Exchange[None]:
        """Refuse to acknowledge a fault."""
        self._refused()

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Refuse to set the reference."""
        self._refused(percent)

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Refuse to set the reference."""
        self._refused(hz)

    def probe(self) -> Exchange[None]:
        """Ask whether a drive is there."""
        return self._operations.probe()

    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read what the drive tells of itself."""
        return self._operations.identify()

    def _refused(self, *_: object, **__: object) -> NoReturn:
        raise ReadOnlyError(self._why)

    def _asking(self, verb: str) -> Callable[..., Exchange[Any]]:
        def asked(*values: Any, **options: Any) -> Exchange[Any]:
            return self._as_long_as_it_asks(self._new().extra[verb](*values, **options))

        return asked

    def _as_long_as_it_asks(self, exchange: Exchange[T]) -> Exchange[T]:
        """Carry out an exchange up to the first telegram that does more than ask; that one is not sent.

        A verb that sends nothing at all means to be carried out by what is sent later, and is refused, too.
        """
        asked = False

        def checked(command: Ask | Tell | Pause) -> Ask | Tell | Pause:
            nonlocal asked
            asked = True
            if not isinstance(command, Pause) and not (self._intent and self._intent(command.message).only_asks):
                raise UsageError(self._why)
            return command

        result = yield from with_each_command(exchange, checked)
        if not asked:
            raise UsageError(self._why)
        return result
