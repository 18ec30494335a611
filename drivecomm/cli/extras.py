"""Check of optional dependencies."""

from __future__ import annotations

from importlib.util import find_spec

from drivecomm.errors import UsageError


def must_have(what: str, extra: str, *modules: str) -> None:
    """Raise UsageError if one of these modules is not installed. what: feature that needs them. extra: their extra."""
    for module in modules:
        if find_spec(module) is None:
            raise UsageError(f"{what} needs {module}, which is not installed; install drivecomm[{extra}]")
