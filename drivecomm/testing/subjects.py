"""What checks are run on: a vector with what is needed to judge it, the codecs, schemas and models of a protocol."""

from __future__ import annotations

from dataclasses import dataclass, fields as dataclass_fields
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from drivecomm.models import load_model
from drivecomm.testing.checking import CheckFailure

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Codec, Direction, Model, Protocol
    from drivecomm.protocol.schema import Form
    from drivecomm.testing.vectors import Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A vector of a protocol. listed: all sound telegrams of the file and of the package, by direction."""

    plugin: Protocol
    vector: Vector
    listed: frozenset[tuple[Direction, bytes]]

    @property
    def codec(self) -> Codec:
        """A codec with the vector's options."""
        return codec_for(self.plugin, self.vector.options)


@dataclass(frozen=True, slots=True)
class NamedForm:
    """A schema of a protocol. name: the title under which the protocol shows it."""

    name: str
    form: Form[Any]


def forms_of(plugin: Protocol) -> tuple[NamedForm, ...]:
    """Return the schemas of all telegrams of a protocol."""
    return tuple(NamedForm(title, form) for title, form in plugin.forms().items())


def codec_for(plugin: Protocol, options: Mapping[str, Any]) -> Codec:
    """Return a protocol's codec with these options. Raises CheckFailure for one that the protocol does not have."""
    known = sorted(field.name for field in dataclass_fields(plugin.options))
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise CheckFailure(f"{plugin.name} has no option {unknown[0]!r}; it has {', '.join(known)}")
    return plugin.codec(plugin.options(**options))


def known_model(plugin: Protocol, name: str) -> Model:
    """Return a model of the protocol's package, read once: checks need it many times. Raises as `load_model` does."""
    return _loaded(plugin.package, plugin.name, name)


@lru_cache
def _loaded(package: str, protocol: str, name: str) -> Model:
    return load_model(package, protocol, name)
