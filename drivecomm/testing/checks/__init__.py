"""The checks of the conformance kit, a module a theme; what finds a mistake soonest comes first."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

_MODULES = (
    "contract",
    "documents",
    "telegrams",
    "framing",
    "schemas",
    "virtual_drives",
    "exchanges",
    "parameters",
    "motion",
    "lost_replies",
    "intents",
    "guarding",
    "confusion",
    "foreign",
    "live",
)

HAS_PROPERTIES = find_spec("hypothesis") is not None

for _name in (*_MODULES, "properties") if HAS_PROPERTIES else _MODULES:
    import_module(f"{__name__}.{_name}")
