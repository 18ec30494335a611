"""Operations of a drive that may be read and stopped, and nothing else.

Writes and commands are refused before anything is sent. The protocol's own verbs are carried out as far as they only
read. Nothing is remembered from one call to the next, so that no later call carries a command: neither that of a
refused verb, nor the word of a stop, which would stop another master's motor again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from drivecomm.bus.exchanges import COMMON_VERBS
from drivecomm.errors import ReadOnlyError
from drivecomm.protocol import Pause, ReadsMany, Stop, with_each_command

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import (
        Ask,
        Exchange,
        Intent,
        Message,
        Operations,
        Tell,
    )

T = TypeVar("T")


class ReadOnly:
    """The operations of a drive without those that write or command; a stop is always possible.

    new: makes the drive's operations with an empty memory; each stop and each verb gets its own. reason: the sentence
    of a refusal. intent: the protocol's function that classifies telegrams; None if it has none, and then none of its
    own verbs is allowed.
    """

    def __init__(self, new: Callable[[], Operations], reason: str, intent: Callable[[Message], Intent] | None) -> None:
        operations = new()
        self.reason = reason
        self._new = new
        self._intent = intent
        self._extra = operations.extra
        self.capabilities = operations.capabilities
        self.read = operations.read
        self.address_of = operations.address_of
        self.status = operations.status
        self.probe = operations.probe
        self.identify = operations.identify
        if isinstance(operations, ReadsMany):
            self.blocks, self.read_many = operations.blocks, operations.read_many
        self.write = self._refused
        self.start = self._refused
        self.reset = self._refused
        self.set_reference_percent = self._refused
        self.set_reference_hz = self._refused

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """The protocol's own verbs, as far as they only read; the verbs common to many makers all command."""
        return {name: self._refused if name in COMMON_VERBS else self._asking(name) for name in self._extra}

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop the motor."""
        return self._new().stop(how)

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:  # noqa: ARG002 - nothing here commands
        """Return False, because no call can start the motor."""
        return False

    def _refused(self, *_: object, **__: object) -> NoReturn:
        raise ReadOnlyError(self.reason)

    def _asking(self, verb: str) -> Callable[..., Exchange[Any]]:
        def asked(*values: Any, **options: Any) -> Exchange[Any]:
            return self._as_long_as_it_asks(self._new().extra[verb](*values, **options))

        return asked

    def _as_long_as_it_asks(self, exchange: Exchange[T]) -> Exchange[T]:
        """Run an exchange up to the first telegram that does more than read, which is not sent.

        A verb that sends nothing itself would take effect by a later telegram, so it is refused, too.
        """
        asked = False

        def checked(command: Ask | Tell | Pause) -> Ask | Tell | Pause:
            nonlocal asked
            asked = True
            if not isinstance(command, Pause) and not (self._intent and self._intent(command.message).moves_nothing):
                self._refused()
            return command

        result = yield from with_each_command(exchange, checked)
        if not asked:
            self._refused()
        return result
