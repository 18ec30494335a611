"""The parameter that a request concerns, and the value in its reply, as a drive's model names them.

No decoding is repeated here: the exchange that reads a parameter defines its request and converts the reply to a
reading.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError
from drivecomm.protocol import Ask, Tell, fields_of, run_with_answers

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.protocol import Message, Model, ParameterInfo, Protocol, Reading


class _AnotherReplyNeeded(Exception):  # noqa: N818 - control flow, not an error
    pass


class HeardParameterNames:
    """The parameters of one drive. options: the protocol's drive options."""

    def __init__(self, protocol: Protocol, address: int, model: Model, options: Any) -> None:
        self._protocol = protocol
        self._operations = protocol.operations(address, options, model)
        asks = [(info, asked) for info in model.parameters.values() if (asked := self._asked(info)) is not None]
        self._naming = _naming_fields([asked for _, asked in asks])
        self._known: dict[tuple[Any, ...], ParameterInfo] = {}
        for info, asked in asks:
            self._known.setdefault(self._key(asked), info)

    def parameter(self, request: Message) -> ParameterInfo | None:
        """Return the parameter that a request reads or writes; None if it is not in the model."""
        return self._known.get(self._key(fields_of(request))) if self._naming else None

    def reading(self, request: Message, reply: Message) -> Reading | None:
        """Return the value in a reply; None if it has none, or if reading it takes more than one reply.

        Raises DriveError if the drive refused.
        """
        info = self.parameter(request)
        if info is None:
            return None
        replies = [reply]

        def answer(command: Ask | Tell) -> Message | None:
            if isinstance(command, Tell):
                # The master sends this afterwards and no drive answers it.
                return None
            if not replies or self._protocol.mismatch(_addressed_as(request, command.message), reply):
                raise _AnotherReplyNeeded
            return replies.pop()

        try:
            return run_with_answers(self._operations.read(info.address), answer)
        except _AnotherReplyNeeded:
            return None

    def _asked(self, info: ParameterInfo) -> dict[str, Any] | None:
        """Return the fields of the request that reads a parameter; None if the parameter cannot be read."""
        try:
            exchange = self._operations.read(info.address)
            command = next(exchange)
        except (DriveCommError, StopIteration):
            return None
        exchange.close()
        return fields_of(command.message) if isinstance(command, Ask) else None

    def _key(self, asked: Mapping[str, Any]) -> tuple[Any, ...]:
        return tuple(_hashable(asked.get(name)) for name in self._naming)


def _addressed_as(heard: Message, own: Message) -> Message:
    """Return our own request with the address fields of the request on the line."""
    names = {field.name for field in fields(own) if field.name.startswith("address")}
    return replace(own, **{name: getattr(heard, name) for name in names if hasattr(heard, name)})


def _naming_fields(asks: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return a minimal list of fields that distinguish the parameters, without fields such as the command.

    A write request has the same values in these fields as the read request of its parameter.
    """
    values: dict[str, set[Any]] = {}
    rows = list(asks)
    for name in {name for row in rows for name in row}:
        values[name] = {_hashable(row.get(name)) for row in rows}
    # Try to drop the fields with the fewest different values first.
    names = sorted((name for name in values if len(values[name]) > 1), key=lambda name: (-len(values[name]), name))
    for name in reversed(names[1:]):
        fewer = [other for other in names if other != name]
        if _told_apart(rows, fewer) == _told_apart(rows, names):
            names = fewer
    return names


def _told_apart(rows: Iterable[Mapping[str, Any]], names: Iterable[str]) -> int:
    return len({tuple(_hashable(row.get(name)) for name in names) for row in rows})


def _hashable(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
