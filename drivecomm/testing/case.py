"""One telegram under judgement, with what is needed to judge it."""

from __future__ import annotations

from dataclasses import dataclass, fields as dataclass_fields
from typing import TYPE_CHECKING, Any

from drivecomm.testing.report import CheckFailure

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Codec, Direction, Protocol
    from drivecomm.testing.forms import NamedForm
    from drivecomm.testing.vectors import Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A vector of a protocol.

    listed: all sound telegrams of the file and of the package, by direction. forms: the protocol's schemas.
    """

    plugin: Protocol
    vector: Vector
    listed: frozenset[tuple[Direction, bytes]]
    forms: tuple[NamedForm, ...]

    @property
    def codec(self) -> Codec:
        """A codec with the vector's options."""
        return codec_for(self.plugin, self.vector.options)


def codec_for(plugin: Protocol, options: Mapping[str, Any]) -> Codec:
    """Return a protocol's codec with these options. Raises CheckFailure for one that the protocol does not have."""
    known = sorted(field.name for field in dataclass_fields(plugin.options))
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise CheckFailure(f"{plugin.name} has no option {unknown[0]!r}; it has {', '.join(known)}")
    return plugin.codec(plugin.options(**options))


def shown(data: bytes) -> str:
    """Return bytes as messages show them."""
    return data.hex(" ").upper() or "nothing"


def expect(condition: object, failure: str) -> None:
    """Raise CheckFailure with this reason unless the condition holds."""
    if not condition:
        raise CheckFailure(failure)
