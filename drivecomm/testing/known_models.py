"""Models of the protocol packages, read once: the checks need each of them many times."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from drivecomm.models import load_model

if TYPE_CHECKING:
    from drivecomm.protocol import Model, Protocol


def known_model(plugin: Protocol, name: str) -> Model:
    """Return a model of the protocol's package. Raises what `load_model` raises."""
    return _loaded(plugin.package, plugin.name, name)


@lru_cache
def _loaded(package: str, protocol: str, name: str) -> Model:
    return load_model(package, protocol, name)
