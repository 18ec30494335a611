"""The verbs of a drive as exchanges, the same for callers that block and callers that await."""

from __future__ import annotations

import inspect
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import NotSupported, ParameterAddressError, UsageError
from drivecomm.quantities import CommonName, not_said, quantities

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivecomm.exchange import Exchange
    from drivecomm.models import Model
    from drivecomm.protocol import Operations
    from drivecomm.reading import Reading, Value

T = TypeVar("T")


class Verbs:
    """Turns what a caller asks of a drive into exchanges; what cannot be is a UsageError before anything is sent."""

    def __init__(self, name: str, operations: Operations, model: Model | None = None) -> None:
        self._name = name
        self.operations = operations
        self._model = model
        self._common = {common: CommonName(common, model) for common in model.quantities} if model else {}

    def read(self, parameter: str, options: Mapping[str, Any]) -> Exchange[Reading]:
        """Read a parameter, by its address, its name in the model or a common name."""
        common = self._common.get(parameter)
        if common is not None:
            return _told(bound(self.operations.read, common.address, **options), common)
        with self._common_names_explained(parameter):
            return bound(self.operations.read, parameter, **options)

    def write(self, parameter: str, value: Value | float, options: Mapping[str, Any]) -> Exchange[Reading | None]:
        """Write a parameter, named as for `read`; by a common name, the value is in the unit of the quantity."""
        common = self._common.get(parameter)
        if common is not None:
            return _confirmed(bound(self.operations.write, common.address, common.given(value), **options), common)
        with self._common_names_explained(parameter):
            return bound(self.operations.write, parameter, value, **options)

    @contextmanager
    def _common_names_explained(self, parameter: str) -> Iterator[None]:
        try:
            yield
        except ParameterAddressError as error:
            if parameter in quantities():
                raise not_said(parameter, self._model) from error
            raise

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


def _told(exchange: Exchange[Reading], common: CommonName) -> Exchange[Reading]:
    return common.told((yield from exchange))


def _confirmed(exchange: Exchange[Reading | None], common: CommonName) -> Exchange[Reading | None]:
    reading = yield from exchange
    return None if reading is None else common.told(reading)


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
