"""Which models have no orders, so that their drives are read and never commanded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import resolve_options

if TYPE_CHECKING:
    from drivecomm.protocol import Model, Protocol

MONITORING_ONLY = "monitoring only"
"""How lists, pages and messages call such a drive."""


def is_monitoring_only(plugin: Protocol, model: Model | None) -> bool:
    """Return whether drives of this model are monitoring only, by the capabilities that their protocol states."""
    if model is None:
        return False
    _, options = resolve_options(plugin, model, {})
    return plugin.operations(plugin.addresses[0], options, model).capabilities.monitoring_only
