"""The calls of an exchange vector: carried out with either face, and compared with what is expected of them."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from decimal import Decimal
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm import errors
from drivecomm.bus import open_bus, open_bus_async
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.protocol import Stop
from drivecomm.testing.checking import CheckFailure, expect
from drivecomm.testing.subjects import known_model

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus import AsyncBroadcast, AsyncBus, AsyncDrive, Broadcast, Bus, Drive, Exchanges
    from drivecomm.link import Echo, Port
    from drivecomm.protocol import Exchange, Protocol
    from drivecomm.testing.exchange_vectors import Call, ExchangeVector

VERBS = ("read", "write", "status", "start", "stop", "reset", "set_reference", "probe", "identify")
"""The verbs of a drive; any other is one that only its protocol has."""


class Line(NamedTuple):
    """Where to play. port: as `open_bus` takes it. ready: told the reply time of the drive before the first call."""

    port: str | Callable[[], Port]
    ready: Callable[[float], None]
    echo: Echo = "off"


def call_blocking(plugin: Protocol, vector: ExchangeVector, line: Line) -> None:
    """Carry out the calls one after the other and judge what comes of each. Raises CheckFailure."""
    with open_bus(line.port, echo=line.echo) as bus:
        partner = _partner(bus, plugin, vector)
        line.ready(_reply_time_s(plugin, vector, partner))
        for call in vector.calls:
            try:
                outcome = CallResult(_verb(partner, call)(**_arguments(call)))
            except DriveCommError as error:
                outcome = CallResult(error=error)
            compare(call, outcome)


def call_awaited(plugin: Protocol, vector: ExchangeVector, line: Line) -> None:
    """Do the same with the awaited face, in an event loop of its own. Raises CheckFailure."""
    asyncio.run(_call_awaited(plugin, vector, line))


async def _call_awaited(plugin: Protocol, vector: ExchangeVector, line: Line) -> None:
    async with open_bus_async(line.port, echo=line.echo) as bus:
        partner = _partner(bus, plugin, vector)
        line.ready(_reply_time_s(plugin, vector, partner))
        for call in vector.calls:
            try:
                outcome = CallResult(await _verb(partner, call)(**_arguments(call)))
            except DriveCommError as error:
                outcome = CallResult(error=error)
            compare(call, outcome)


def exchange_of(verbs: Exchanges, call: Call) -> Exchange[Any]:
    """Return the exchange behind a call, as both faces make it."""
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


def _partner(bus: Bus | AsyncBus, plugin: Protocol, vector: ExchangeVector) -> Any:
    """Return the drive of the vector, or all drives."""
    options = dict(vector.options)
    try:
        model = known_model(plugin, vector.model) if vector.model else None
        if vector.address == plugin.broadcast_address:
            return bus.broadcast(plugin.name, model=model, **options)
        return bus.drive(plugin.name, vector.address, model=model, **options)
    except DriveCommError as error:
        raise CheckFailure(f"there is no such drive: {error}") from error


def _reply_time_s(
    plugin: Protocol, vector: ExchangeVector, partner: Drive | AsyncDrive | Broadcast | AsyncBroadcast
) -> float:
    """Return how long the master must wait for a reply; to all drives it waits for none."""
    return 0.0 if vector.address == plugin.broadcast_address else partner.peer.facts.timing.reply_timeout_s


def _verb(partner: Any, call: Call) -> Callable[..., Any]:
    if call.call in VERBS:
        verb: Callable[..., Any] | None = getattr(partner, call.call, None)
        if verb is None:
            raise NotSupported(f"all drives at once have no verb {call.call!r}")
        return verb
    extra: Callable[..., Any] | None = getattr(partner, "call", None)
    if extra is None:
        raise NotSupported(f"all drives at once have no verb {call.call!r}")
    return lambda **arguments: extra(call.call, **arguments)


def _arguments(call: Call) -> dict[str, Any]:
    """Return the arguments as the drive takes them; the way of stopping is the only one that is no plain value."""
    given = dict(call.arguments)
    if call.call == "stop" and "how" in given:
        try:
            given["how"] = Stop(given["how"])
        except ValueError as error:
            ways = ", ".join(way.value for way in Stop)
            raise CheckFailure(f"there is no way of stopping named {given['how']!r}; there are {ways}") from error
    return given


@dataclass(frozen=True, slots=True)
class CallResult:
    """The result of a call, or the error that it raised."""

    result: Any = None
    error: DriveCommError | None = None


def compare(call: Call, outcome: CallResult) -> None:
    """Compare what came of a call with what was expected. Raises CheckFailure."""
    expected, error = call.expected, outcome.error
    if expected.error:
        kind: type[DriveCommError] = getattr(errors, expected.error)
        if error is None:
            raise CheckFailure(f"{call.call} gives {as_data(outcome.result)!r}, expected is {expected.error}")
        expect(
            isinstance(error, kind) and expected.error_text in str(error),
            f"{call.call} raises {type(error).__name__} ({error}), expected is {expected.error}"
            + (f" with {expected.error_text!r}" if expected.error_text else ""),
        )
        return
    if error is not None:
        raise CheckFailure(f"{call.call} raises {type(error).__name__}: {error}") from error
    if expected.result is not None:
        _compare_result(call.call, outcome.result, expected.result)


def as_data(value: object) -> Any:
    """Return a value as vectors write it: exact decimals as text, enums by their values."""
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


def _compare_result(name: str, result: object, wanted: Mapping[str, Any]) -> None:
    found = as_data(result)
    if not wanted:
        expect(found is None or found == {}, f"{name} gives {found!r}, expected is nothing")
        return
    if not isinstance(found, dict):
        found = {"value": found}
    for key, value in wanted.items():
        expect(key in found, f"{name} gives nothing named {key}; it gives {found}")
        expect(same(found[key], value), f"{name} gives {key} = {found[key]!r}, expected is {value!r}")


def same(found: object, wanted: object) -> bool:
    """Whether two pieces of data are equal and of one type: a flag is no number."""
    if isinstance(found, list) and isinstance(wanted, list):
        return len(found) == len(wanted) and all(map(same, found, wanted))
    if isinstance(found, dict) and isinstance(wanted, dict):
        return found.keys() == wanted.keys() and all(same(found[key], wanted[key]) for key in wanted)
    return type(found) is type(wanted) and found == wanted
