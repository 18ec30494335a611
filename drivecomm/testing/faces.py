"""Carrying out the calls of an exchange vector, with the blocking face and with the awaited one."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.bus import open_bus, open_bus_async
from drivecomm.errors import DriveCommError, NotSupported
from drivecomm.protocol import Stop
from drivecomm.testing.known_models import known_model
from drivecomm.testing.outcomes import Outcome, judge
from drivecomm.testing.report import CheckFailure

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.bus import AsyncBroadcast, AsyncBus, AsyncDrive, Broadcast, Bus, Drive, Verbs
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
                outcome = Outcome(_verb(partner, call)(**_arguments(call)))
            except DriveCommError as error:
                outcome = Outcome(error=error)
            judge(call, outcome)


def call_awaited(plugin: Protocol, vector: ExchangeVector, line: Line) -> None:
    """Do the same with the awaited face, in an event loop of its own. Raises CheckFailure."""
    asyncio.run(_call_awaited(plugin, vector, line))


async def _call_awaited(plugin: Protocol, vector: ExchangeVector, line: Line) -> None:
    async with open_bus_async(line.port, echo=line.echo) as bus:
        partner = _partner(bus, plugin, vector)
        line.ready(_reply_time_s(plugin, vector, partner))
        for call in vector.calls:
            try:
                outcome = Outcome(await _verb(partner, call)(**_arguments(call)))
            except DriveCommError as error:
                outcome = Outcome(error=error)
            judge(call, outcome)


def exchange_of(verbs: Verbs, call: Call) -> Exchange[Any]:
    """Return the exchange behind a call, as both faces make it."""
    given = _arguments(call)
    if call.call not in VERBS:
        return verbs.call(call.call, given)
    if call.call == "read":
        return verbs.read(given.pop("parameter"), given)
    if call.call == "write":
        return verbs.write(given.pop("parameter"), given.pop("value"), {"store": False, **given})
    if call.call == "set_reference":
        return verbs.set_reference(given.get("percent"), given.get("hz"))
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
    return 0.0 if vector.address == plugin.broadcast_address else partner.party.facts.timing.reply_timeout_s


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
