"""Telegrams as code outside the protocol packages sees them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from decimal import Decimal
from functools import cache
from typing import Any, ClassVar, Literal, Protocol, TypeAlias

Direction: TypeAlias = Literal["request", "reply"]
"""request: master to drive; reply: drive to master."""


class Message(Protocol):
    """The content of a telegram: a frozen dataclass of its protocol, one field for each field of the telegram.

    A field that is None is not in the telegram. `address` is the address of the drive; if vectors use another name for
    a field, its metadata holds that name, `field(metadata={"shown": "station"})`.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def kind(self) -> str:
        """The kind of the telegram among those of the protocol, in the manual's word."""


def fields_of(message: Message) -> dict[str, Any]:
    """Return the fields of a message by name, as test vectors write them: exact decimals as text."""
    named: dict[str, Any] = {"kind": message.kind}
    for shown, name in _names_of(type(message)).items():
        value = getattr(message, name)
        if value is not None:
            named[shown] = value if type(value) is int or type(value) is str else _as_written(value)
    return named


def difference(request: Message, reply: Message, *names: str) -> str:
    """Return the name of the first of these fields that differs between two messages; empty if all are equal."""
    # A link also compares telegrams of other protocols, which have other fields.
    return next((name for name in names if getattr(request, name) != getattr(reply, name, ...)), "")


@cache
def _names_of(kind: type[Message]) -> dict[str, str]:
    """Return the field names of a message class, by the names that vectors use."""
    return {field.metadata.get("shown", field.name): field.name for field in fields(kind)}


def _as_written(value: object) -> object:
    if isinstance(value, Decimal):
        return str(value)
    return list(value) if isinstance(value, tuple) else value


@dataclass(frozen=True, slots=True, kw_only=True)
class Telegram:
    """One message on the line: its bytes and their meaning.

    protocol: the protocol's name. direction: request or reply. data: the bytes as they are on the line. message: the
    content as the protocol's own dataclass.
    """

    protocol: str
    direction: Direction
    data: bytes
    message: Message

    @property
    def kind(self) -> str:
        """The kind of the telegram among those of the protocol."""
        return self.message.kind

    @property
    def fields(self) -> dict[str, Any]:
        """The decoded fields by name; fields that this telegram does not have are absent."""
        return fields_of(self.message)
