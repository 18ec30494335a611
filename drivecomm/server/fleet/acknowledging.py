"""Acknowledgement of an alarm in one of many plants: sent over the broker to its server, which checks the rights."""

from __future__ import annotations

import asyncio
import secrets
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.client import json_text, parsed
from drivecomm.errors import NotAllowedError, ServerLostError, UsageError, suggestion
from drivecomm.server.broker import BrokerMessage, VersionRefused, connect_to_broker
from drivecomm.server.fleet.following import OLDER, FleetSubscription
from drivecomm.server.mqtt import BRIDGE, level

if TYPE_CHECKING:
    from drivecomm.server.broker import BrokerSettings, ReceivedMessage
    from drivecomm.server.fleet.plants import Fleet

ANSWER_S = 5.0
"""Timeout for the response of the plant's server."""


async def acknowledge_over_broker(
    settings: BrokerSettings, fleet: Fleet, plant: str, alarm: str, token: str = ""
) -> dict[str, Any]:
    """Acknowledge an alarm by its id, and return it in plain form.

    token: token of a user of the plant, empty for an anonymous caller. Raises UsageError for an unknown plant,
    NotAllowedError with the server's reason if it refuses, ServerLostError if it does not respond, LinkError for a
    broker that cannot be reached.
    """
    await FleetSubscription(settings, fleet).known()
    if plant not in fleet.plants:
        raise UsageError(
            f"no plant {plant!r} below {fleet.prefix}; {suggestion(plant, sorted(fleet.plants), 'there are')}"
        )
    known = fleet.plants[plant]
    if known.gateway != "online":
        raise ServerLostError(f"the server of {plant} is not connected with the broker; nothing was acknowledged")
    asked = {"id": secrets.token_urlsafe(9), "session": known.session, "alarm": alarm}
    if token:
        asked["token"] = token
    bridge = f"{fleet.prefix}/{level(plant, frozenset())}/{BRIDGE}"
    try:
        answer = await _answer(settings, bridge, asked)
    except VersionRefused:
        answer = await _answer(replace(settings, version=OLDER), bridge, asked)
    if answer["outcome"] != "done":
        error = answer.get("error") or {}
        raise NotAllowedError(f"{plant} refuses: {error.get('text', 'it gave no reason')}")
    return dict(answer["result"])


async def _answer(settings: BrokerSettings, bridge: str, asked: dict[str, str]) -> dict[str, Any]:
    answered: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

    def hear(received: ReceivedMessage) -> None:
        content = parsed(received.payload)
        if content.get("id") == asked["id"] and not answered.done():
            answered.set_result(content)

    name = f"drivecomm-fleet-{secrets.token_urlsafe(6)}"
    async with connect_to_broker(settings, settings.client_id or name, hear) as connection:
        await connection.subscribe(f"{bridge}/response/acknowledge")
        await connection.publish(BrokerMessage(topic=f"{bridge}/request/acknowledge", payload=json_text(asked)))
        try:
            async with asyncio.timeout(ANSWER_S):
                return await answered
        except TimeoutError:
            raise ServerLostError(
                "the server of the plant does not answer; it listens where its door has a role or the plant has users"
            ) from None
