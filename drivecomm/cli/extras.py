"""What is installed only for those who ask for it."""

from __future__ import annotations

from importlib.util import find_spec

from drivecomm.errors import UsageError


def must_have(what: str, extra: str, *modules: str) -> None:
    """Raise UsageError where a module is not installed that something needs. extra: of drivecomm, which brings it."""
    for module in modules:
        if find_spec(module) is None:
            raise UsageError(f"{what} needs {module}, which is not installed; install drivecomm[{extra}]")
