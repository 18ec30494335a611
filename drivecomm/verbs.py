"""The verbs of a drive as exchanges, the same for callers that block and callers that await."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import NotSupported, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.exchange import Exchange
    from drivecomm.protocol import Operations
    from drivecomm.reading import Reading, Value

T = TypeVar("T")


class Verbs:
    """Turns what a caller asks of a drive into exchanges; what cannot be is a UsageError before anything is sent."""

    def __init__(self, name: str, operations: Operations) -> None:
        self._name = name
        self.operations = operations

    def read(self, parameter: str, options: Mapping[str, Any]) -> Exchange[Reading]:
        """Read a parameter."""
        return bound(self.operations.read, parameter, **options)

    def write(self, parameter: str, value: Value | float, options: Mapping[str, Any]) -> Exchange[Reading | None]:
        """Write a parameter."""
        return bound(self.operations.write, parameter, value, **options)

    def set_reference(self, percent: Value | float | None, hz: Value | float | None) -> Exchange[None]:
        """Set the reference in one of its units."""
        if percent is not None and hz is None:
            return self.operations.set_reference_percent(percent)
        if hz is not None and percent is None:
            return self.operations.set_reference_hz(hz)
        raise UsageError("a reference is set with percent or with hz, one of the two")

    def call(self, verb: str, arguments: Mapping[str, Any]) -> Exchange[Any]:
        """Carry out a verb that only this protocol has."""
        extra = self.operations.extra
        if verb not in extra:
            raise NotSupported(f"{self._name} has no verb {verb!r}; it has {', '.join(sorted(extra)) or 'none'}")
        return bound(extra[verb], **arguments)


def setting_up(operations: Operations, writes: Mapping[str, Any]) -> Exchange[None]:
    """Write these parameters to a drive that was away."""
    for parameter, value in writes.items():
        yield from operations.write(parameter, value)


def bound(operation: Callable[..., Exchange[T]], *values: Any, **options: Any) -> Exchange[T]:
    """Call an operation; options that it does not have are a UsageError that lists those it has."""
    try:
        return operation(*values, **options)
    except TypeError:
        _refuse(operation, values, options)
        raise


def _refuse(operation: Callable[..., Any], values: tuple[Any, ...], options: Mapping[str, Any]) -> None:
    """Say which option is unknown or missing, if that is why the call failed."""
    parameters = inspect.signature(operation).parameters
    takes_any = any(one.kind is one.VAR_KEYWORD for one in parameters.values())
    unknown = [] if takes_any else sorted(set(options) - set(parameters))
    name = getattr(operation, "__name__", "it")
    if unknown:
        known = [name for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY or not values]
        raise UsageError(f"{name} has no option {unknown[0]!r} here; it has {', '.join(known) or 'none'}") from None
    missing = [
        name
        for name, one in list(parameters.items())[len(values) :]
        if one.default is one.empty and one.kind is not one.VAR_KEYWORD and name not in options
    ]
    if missing:
        raise UsageError(f"{name} needs {', '.join(missing)}") from None
