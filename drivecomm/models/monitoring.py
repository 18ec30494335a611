"""Models without commands, whose drives are only read and never commanded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import resolve_options

if TYPE_CHECKING:
    from drivecomm.protocol import Model, Protocol

MONITORING_ONLY = "monitoring only"
"""Name for such a drive in lists, pages and messages."""


def is_monitoring_only(plugin: Protocol, model: Model | None) -> bool:
    """Return whether drives of this model are monitoring only, by the capabilities that their protocol states."""
    if model is None:
        return False
    _, options = resolve_options(plugin, model, {})
    return plugin.operations(plugin.addresses[0], options, model).capabilities.monitoring_only
