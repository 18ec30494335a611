"""The schemas of a protocol, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivecomm.protocol import Protocol
    from drivecomm.protocol.schema import Form


@dataclass(frozen=True, slots=True)
class NamedForm:
    """A schema of a protocol. name: the title under which the protocol shows it."""

    name: str
    form: Form[Any]


def forms_of(plugin: Protocol) -> tuple[NamedForm, ...]:
    """Return the forms of all telegrams of a protocol."""
    return tuple(NamedForm(title, form) for title, form in plugin.forms().items())
