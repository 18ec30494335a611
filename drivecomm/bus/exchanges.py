"""Verbs of a drive as exchanges, the same for blocking and asynchronous callers."""

from __future__ import annotations

import inspect
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm import models
from drivecomm.bus.reference_limits import ReferenceLimits
from drivecomm.bus.references import ReferenceExchanges
from drivecomm.bus.stored_writes import is_stored
from drivecomm.errors import (
    NotSupported,
    ParameterAddressError,
    StateError,
    UsageError,
    ValueRefusedError,
    did_you_mean,
    shortened,
    suggestion,
)
from drivecomm.protocol import KnowsStarts, exact, way_to_stop, wrong_argument

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.models import CommonName
    from drivecomm.protocol import (
        Capabilities,
        Exchange,
        MachineUnit,
        Model,
        Operations,
        Reading,
        Stop,
        StopName,
        Value,
    )

T = TypeVar("T")

COMMON_VERBS = frozenset({"jog", "hold", "select_setup", "select_preset", "set_relay"})
"""Verbs that not every drive has, but that mean the same on all drives that have them."""

STARTING_VERBS = frozenset({"start", "reverse", "jog"})
"""Verbs of every drive that start its motor."""

_LONGEST_NAME = 200
"""Maximum length of a parameter's address or name in characters; far more than any has."""


class Exchanges:
    """Factory of the exchanges for a drive's verbs; invalid arguments raise UsageError before anything is sent."""

    def __init__(
        self,
        name: str,
        operations: Operations,
        model: Model | None = None,
        machine: MachineUnit | None = None,
    ) -> None:
        self._name = name
        self.operations = operations
        self._model = model
        self._common: dict[str, CommonName] = {}
        self._plausibility = models.Plausibility()
        limits = ReferenceLimits(name, lambda: operations.capabilities, self._maximum_frequency)
        self.references = ReferenceExchanges(name, operations, limits, self._read_common, machine)

    def to_read(self, parameter: str, options: Mapping[str, Any]) -> Exchange[Reading]:
        """Read a parameter by its address, its name in the model or a common name."""
        if type(parameter) is not str or len(parameter) > _LONGEST_NAME:
            self._must_name(parameter)
        common = None if self._model is None else self._common_name(parameter)
        if common is not None:
            return self._told(call_checked(self.operations.read, common.address, **options), common)
        try:
            return (
                call_checked(self.operations.read, parameter, **options) if options else self.operations.read(parameter)
            )
        except ParameterAddressError as error:
            raise self._unknown(parameter, error) from error

    def _told(self, exchange: Exchange[Reading], common: CommonName) -> Exchange[Reading]:
        return self._plausibility.judged(common.convert((yield from exchange)))

    def reader(self, parameter: str, options: Mapping[str, Any]) -> Callable[[], Exchange[Reading]]:
        """Return a function that makes a new exchange of `to_read` at each call. Raises the errors of `to_read`."""
        self.to_read(parameter, options).close()
        if options or (self._model is not None and self._common_name(parameter)):
            return partial(self.to_read, parameter, options)
        return partial(self.operations.read, parameter)

    def check_read(self, parameter: str, options: Mapping[str, Any]) -> None:
        """Raise the errors that `read` raises before sending, and NotSupported for a write-only parameter."""
        self.to_read(parameter, options).close()
        info = models.parameter_at(self.address_of(parameter), self._model) if self._model else None
        if self._model is not None and info is not None and "r" not in info.access:
            raise NotSupported(f"{info.address} is write-only in model {self._model.name}")

    def address_of(self, parameter: str) -> str:
        """Return the parameter's name for the protocol: the address of a common name, any other name unchanged."""
        common = self._common_name(parameter)
        return common.address if common else parameter

    def converted_reading(self, parameter: str, reading: Reading) -> Reading:
        """Return a reading for the caller: converted and checked for plausibility if it was read by a common name."""
        common = self._common_name(parameter)
        return self._plausibility.judged(common.convert(reading)) if common else reading

    def to_write(self, parameter: str, value: Value | float, options: Mapping[str, Any]) -> Exchange[Reading | None]:
        """Write a parameter, named as for `read`; for a common name, the value is in the unit of its quantity."""
        self._must_name(parameter)
        self.references.forget_maximum()
        if not isinstance(value, int | float | Decimal | str):
            raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is neither a number nor a string")
        if not isinstance(value, str):
            exact(value, parameter)
        value = self._number_of(parameter, value)
        common = self._common_name(parameter)
        if common is not None:
            return _confirmed(
                call_checked(self.operations.write, common.address, common.to_drive_unit(value), **options), common
            )
        try:
            return call_checked(self.operations.write, parameter, value, **options)
        except ParameterAddressError as error:
            raise self._unknown(parameter, error) from error

    def to_start(self, *, reverse: bool) -> Exchange[None]:
        """Start the motor."""
        return call_checked(self.operations.start, reverse=reverse)

    def to_stop(self, how: Stop | StopName) -> Exchange[None]:
        """Stop the motor. Raises UsageError for an unknown way to stop."""
        return self.operations.stop(way_to_stop(how))

    def _must_name(self, parameter: object) -> None:
        if not isinstance(parameter, str) or len(parameter) > _LONGEST_NAME:
            raise ParameterAddressError(f"invalid parameter {shortened(parameter)}; give an address or a name")

    def _unknown(self, parameter: str, error: ParameterAddressError) -> ParameterAddressError:
        """Return the error for a parameter that the protocol does not know, with a suggestion."""
        if parameter in models.quantities():
            return models.unmapped_name_error(parameter, self._model)
        known = set(models.quantities())
        if self._model is not None:
            names = {info.name for info in self._model.parameters.values()}
            known = {*self._model.quantities, *self._model.parameters, *names}
        # A known parameter was refused for another reason, such as its data set.
        question = "" if parameter in known else did_you_mean(parameter, known)
        return ParameterAddressError(f"{error}; {question}" if question else str(error))

    def _number_of(self, parameter: str, value: Value | float) -> Value | float:
        """Return the number behind an option's text in the model; any other value unchanged."""
        if not isinstance(value, str) or self._model is None:
            return value
        info = self._model.find(self.address_of(parameter).partition("[")[0])
        named = [number for number, text in info.values.items() if text.casefold() == value.casefold()] if info else []
        return named[0] if len(named) == 1 else value

    def _common_name(self, parameter: str) -> CommonName | None:
        """Return the meaning of a common name on this drive, None for any other word; looked up at its first use."""
        if self._model is None or parameter not in self._model.quantities or parameter not in models.quantities():
            return None
        if parameter not in self._common:
            self._common[parameter] = models.CommonName(parameter, self._model)
        return self._common[parameter]

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of this drive, including its common verbs and its policies on link loss."""
        operations = self.operations
        verbs = COMMON_VERBS.intersection(operations.extra)
        return replace(operations.capabilities, verbs=verbs, link_loss=models.link_loss_of(self._model))

    def written_parameter(self, parameter: str, options: Mapping[str, Any]) -> tuple[str, bool]:
        """Return the address that a write with these options changes, and whether it may write to EEPROM.

        The address is the same for every name of the parameter.
        """
        address: str = call_checked(self.operations.address_of, self.address_of(parameter), **options)
        store = bool(options.get("store"))
        return address, is_stored(self.operations.capabilities, self._model, address, store=store)

    def to_write_and_read(
        self, parameter: str, value: Value | float, options: Mapping[str, Any]
    ) -> Exchange[Reading | None]:
        """Write a parameter, read it back, and compare. Raises StateError if the drive holds another value."""
        writing = self.to_write(parameter, value, options)
        known = inspect.signature(self.operations.read).parameters
        reading = self.to_read(parameter, {name: given for name, given in options.items() if name in known})
        return _compared(writing, reading, self._number_of(parameter, value))

    def to_set_reference(
        self,
        percent: Value | float | None,
        hz: Value | float | None,
        rpm: Value | float | None = None,
        machine: Value | float | None = None,
    ) -> Exchange[None]:
        """Set the reference in one of its units. Raises ValueRefusedError if it is above the drive's maximum."""
        return self.references.to_set(percent, hz, rpm, machine)

    def _read_common(self, name: str) -> Exchange[Reading] | None:
        """Return an exchange that reads a common name; None if the model does not know its parameter."""
        return None if self._common_name(name) is None else self.to_read(name, {})

    def _maximum_frequency(self) -> Exchange[Reading] | None:
        maximum = self.operations.capabilities.reference_maximum
        return self.to_read(maximum, {}) if maximum else None

    def may_start(self, verb: str, arguments: Mapping[str, Any]) -> bool:
        """Return whether a verb of the drive may start a motor at standstill; see `KnowsStarts`. Sends nothing."""
        if verb in STARTING_VERBS:
            return True
        given = dict(arguments)
        if verb == "call":
            own = str(given.pop("verb", ""))
            knows = self.operations
            return knows.may_start(own, given) if isinstance(knows, KnowsStarts) else own in self.operations.extra
        writes = verb in ("write", "write_and_read") and {"parameter", "value"} <= given.keys()
        if not writes or not isinstance(self.operations, KnowsStarts):
            return False
        parameter, value = given["parameter"], given["value"]
        common = self._common_name(parameter)
        if common is not None:
            given["parameter"], value = common.address, common.to_drive_unit(value)
        given["value"] = self._number_of(parameter, value)
        return self.operations.may_start("write", given)

    def common(self, verb: str, arguments: Mapping[str, Any]) -> Exchange[Any]:
        """Carry out a verb that means the same on every drive that has it."""
        if verb not in self.operations.extra:
            can = ", ".join(sorted(self.capabilities.verbs)) or "none of them"
            raise NotSupported(f"{self._name} does not support {verb}; supported common verbs: {can}")
        return call_checked(self.operations.extra[verb], **arguments)

    def call(self, verb: str, arguments: Mapping[str, Any]) -> Exchange[Any]:
        """Carry out a verb that only this protocol has."""
        extra = self.operations.extra
        if not isinstance(verb, str) or verb not in extra:
            known = suggestion(verb, sorted(extra), "it has")
            raise NotSupported(f"{self._name} has no verb {shortened(verb)}; {known}")
        return call_checked(extra[verb], **arguments)


def _confirmed(exchange: Exchange[Reading | None], common: CommonName) -> Exchange[Reading | None]:
    reading = yield from exchange
    return None if reading is None else common.convert(reading)


def _compared(
    writing: Exchange[Reading | None], reading: Exchange[Reading], wanted: Value | float
) -> Exchange[Reading | None]:
    yield from writing
    held = yield from reading
    if not _same(held.value, wanted):
        raise StateError(f"{held.parameter} was written as {wanted} and holds {held}; see the limits of the drive")
    return held


def _same(held: Value, wanted: Value | float) -> bool:
    if isinstance(held, str):
        return held.rstrip() == str(wanted).rstrip()
    return Decimal(held) == exact(wanted, "read back")


def setting_up(operations: Operations, writes: Mapping[str, Any]) -> Exchange[None]:
    """Write these parameters to a drive that was away."""
    for parameter, value in writes.items():
        yield from operations.write(parameter, value)


def call_checked(operation: Callable[..., T], *values: Any, **options: Any) -> T:
    """Call an operation. Raises UsageError for options that are unknown or have a wrong type."""
    if options and (wrong := wrong_argument(operation, options)):
        name, takes = wrong
        raise UsageError(f"invalid {name} = {shortened(options[name])}; it takes {takes}")
    try:
        return operation(*values, **options)
    except TypeError:
        _refuse(operation, values, options)
        raise


def _refuse(operation: Callable[..., Any], values: tuple[Any, ...], options: Mapping[str, Any]) -> None:
    """Raise UsageError for an unknown or missing option, if that is why the call failed."""
    parameters = inspect.signature(operation).parameters
    takes_any = any(one.kind is one.VAR_KEYWORD for one in parameters.values())
    unknown = [] if takes_any else sorted(set(options) - set(parameters))
    name = getattr(operation, "__name__", "it")
    if unknown:
        known = [name for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY or not values]
        there = suggestion(unknown[0], known, "it has")
        raise UsageError(f"{name} has no option {unknown[0]!r} here; {there}") from None
    missing = [
        name
        for name, one in list(parameters.items())[len(values) :]
        if one.default is one.empty and one.kind is not one.VAR_KEYWORD and name not in options
    ]
    if missing:
        raise UsageError(f"{name} needs {', '.join(missing)}") from None
