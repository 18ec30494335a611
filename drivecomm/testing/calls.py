"""Calls of an exchange vector: carried out blocking or awaited, and compared with the expected results."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from decimal import Decimal
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm import errors
from drivecomm.bus import open_bus, open_bus_async
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.protocol import Stop
from drivecomm.testing.checking import CheckFailure, expect, known_model

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus import AsyncBus, Bus, Exchanges
    from drivecomm.link import Echo, Port
    from drivecomm.protocol import Exchange, Model, Protocol
    from drivecomm.testing.exchange_vectors import ExchangeVector, VectorCall

VERBS = ("read", "write", "status", "start", "stop", "reset", "set_reference", "probe", "identify")
"""The verbs that every drive has; any other verb belongs to one protocol."""


class VectorPort(NamedTuple):
    """Port on which the vectors are played.

    port: as `open_bus` takes it. ready: called with the drive's reply timeout in seconds before the first call.
    """

    port: str | Callable[[], Port]
    ready: Callable[[float], None]
    echo: Echo = "off"


def call_blocking(plugin: Protocol, vector: ExchangeVector, line: VectorPort) -> None:
    """Carry out the calls in order, blocking, and check each result. Raises CheckFailure."""
    with open_bus(line.port, echo=line.echo) as bus:
        partner = _partner(bus, plugin, vector, line)
        for call in vector.calls:
            try:
                result = _verb(partner, call)(**_arguments(call))
            except DriveCommError as error:
                check_call_error(call, error)
            else:
                check_call_result(call, result)


def call_awaited(plugin: Protocol, vector: ExchangeVector, line: VectorPort) -> None:
    """Carry out the calls in order, awaited in a new event loop, and check each result. Raises CheckFailure."""
    asyncio.run(_call_awaited(plugin, vector, line))


async def _call_awaited(plugin: Protocol, vector: ExchangeVector, line: VectorPort) -> None:
    async with open_bus_async(line.port, echo=line.echo) as bus:
        partner = _partner(bus, plugin, vector, line)
        for call in vector.calls:
            try:
                result = await _verb(partner, call)(**_arguments(call))
            except DriveCommError as error:
                check_call_error(call, error)
            else:
                check_call_result(call, result)


def exchange_of(verbs: Exchanges, call: VectorCall) -> Exchange[Any]:
    """Return the exchange behind a call, as `Drive` and `AsyncDrive` create it."""
    given = _arguments(call)
    if call.call not in VERBS:
        return verbs.call(call.call, given)
    if call.call == "read":
        return verbs.to_read(given.pop("parameter"), given)
    if call.call == "write":
        return verbs.to_write(given.pop("parameter"), given.pop("value"), {"store": False, **given})
    if call.call == "set_reference":
        return verbs.to_set_reference(given.get("percent"), given.get("hz"))
    exchange: Exchange[Any] = getattr(verbs.operations, call.call)(**given)
    return exchange


def model_of(plugin: Protocol, vector: ExchangeVector) -> Model | None:
    """Return the model that an exchange vector names, or None."""
    return known_model(plugin, vector.model) if vector.model else None


def _partner(bus: Bus | AsyncBus, plugin: Protocol, vector: ExchangeVector, line: VectorPort) -> Any:
    """Return the drive of the vector, or the broadcast object if it has the broadcast address."""
    try:
        model = model_of(plugin, vector)
        if vector.address == plugin.broadcast_address:
            everybody = bus.broadcast(plugin.name, model=model, **vector.options)
            line.ready(0.0)
            return everybody
        options = dict(vector.options)
        if model is not None:
            # A vector covers the exchange alone, without the requests that first confirm the drive's series.
            model, options["confirmed"] = replace(model, identified_by={}), model.name
        drive = bus.drive(plugin.name, vector.address, model=model, **options)
    except DriveCommError as error:
        raise CheckFailure(f"there is no such drive: {error}") from error
    if vector.watched_s is not None:
        drive.watched(vector.watched_s)
    line.ready(drive.peer.facts.timing.reply_timeout_s)
    return drive


def _verb(partner: Any, call: VectorCall) -> Callable[..., Any]:
    known = call.call in VERBS
    verb: Callable[..., Any] | None = getattr(partner, call.call if known else "call", None)
    if verb is None:
        raise NotSupported(f"a broadcast has no verb {call.call!r}")
    return verb if known else partial(verb, call.call)


def _arguments(call: VectorCall) -> dict[str, Any]:
    """Return the arguments as the drive takes them; only the way of stopping needs conversion."""
    given = dict(call.arguments)
    if call.call == "stop" and "how" in given:
        try:
            given["how"] = Stop(given["how"])
        except ValueError as error:
            ways = ", ".join(way.value for way in Stop)
            raise CheckFailure(f"unknown way of stopping {given['how']!r}; known are {ways}") from error
    return given


def check_call_error(call: VectorCall, error: DriveCommError) -> None:
    """Raise CheckFailure unless the call was expected to raise this error."""
    expected = call.expected
    if not expected.error:
        raise CheckFailure(f"{call.call} raises {type(error).__name__}: {error}") from error
    expect(
        isinstance(error, getattr(errors, expected.error)) and expected.error_text in str(error),
        f"{call.call} raises {type(error).__name__} ({error}), expected {expected.error}"
        + (f" with {expected.error_text!r}" if expected.error_text else ""),
    )


def check_call_result(call: VectorCall, result: object) -> None:
    """Raise CheckFailure unless the call was expected to return this result."""
    found, wanted = as_data(result), call.expected.result
    if call.expected.error:
        raise CheckFailure(f"{call.call} gives {found!r}, expected {call.expected.error}")
    if wanted is None:
        return
    if not wanted:
        expect(found is None or found == {}, f"{call.call} gives {found!r}, expected nothing")
        return
    if not isinstance(found, dict):
        found = {"value": found}
    for key, value in wanted.items():
        expect(key in found, f"{call.call} does not give {key}; it gives {found}")
        expect(is_same_data(found[key], value), f"{call.call} gives {key} = {found[key]!r}, expected {value!r}")


def as_data(value: object) -> Any:
    """Return a value as vectors write it: exact decimals as text, enums as their values."""
    if isinstance(value, Decimal):
        return f"{value:f}"
    if isinstance(value, Enum):
        return as_data(value.value)
    if isinstance(value, Mapping):
        return {str(as_data(key)): as_data(each) for key, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: as_data(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, set | frozenset):
        return sorted(map(as_data, value))
    if isinstance(value, list | tuple):
        return [as_data(each) for each in value]
    return value


def is_same_data(found: object, wanted: object) -> bool:
    """Whether two pieces of data are equal and of the same type; True is not equal to 1."""
    if isinstance(found, list) and isinstance(wanted, list):
        return len(found) == len(wanted) and all(map(is_same_data, found, wanted))
    if isinstance(found, dict) and isinstance(wanted, dict):
        return found.keys() == wanted.keys() and all(is_same_data(found[key], wanted[key]) for key in wanted)
    return type(found) is type(wanted) and found == wanted
