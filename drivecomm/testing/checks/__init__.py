"""Checks of the conformance kit, one module per theme; checks that find mistakes soonest come first."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

HAS_PROPERTIES = find_spec("hypothesis") is not None

_OF_TELEGRAMS = ("contract", "variants", "documents", "telegrams", "schemas", "virtual_drives", "exchanges")
_OF_DRIVES = (
    "parameters",
    "blocks",
    "motion",
    "requests",
    "watchdogs",
    "acting_requests",
    "drive_rules",
    "monitoring",
    "ambiguous_replies",
    "confusion",
)

for _name in (*_OF_TELEGRAMS, *_OF_DRIVES, *(["properties"] if HAS_PROPERTIES else [])):
    import_module(f"{__name__}.{_name}")
