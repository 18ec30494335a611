"""A broker that accepts a client and rejects its messages; rejected messages must not count as delivered."""

import asyncio

import pytest
from mosquitto import mosquitto, needs_mosquitto

from drivecomm.errors import LinkDownError
from drivecomm.server.broker import BROKER_KEYS, BrokerMessage, broker_settings
from drivecomm.server.broker.connection import connect_to_broker
from drivecomm.tomlfile import TomlTable

pytestmark = needs_mosquitto


def test_message_rejected_by_the_broker_raises_an_error(tmp_path):
    folder = tmp_path / "broker"
    folder.mkdir()
    (folder / "rights").write_text("topic readwrite allowed/#\n")

    async def test():
        with mosquitto(folder, f"acl_file {folder / 'rights'}") as broker:
            table = TomlTable({"broker": broker.url}, "x.toml")
            settings = broker_settings(table, table.take(BROKER_KEYS))
            async with connect_to_broker(settings, "client", print) as connection:
                await connection.publish(BrokerMessage(topic="allowed/value", payload="1"))
                with pytest.raises(
                    LinkDownError, match="does not accept what this client publishes, such as plant/value"
                ):
                    await connection.publish(BrokerMessage(topic="plant/value", payload="1"))

    asyncio.run(test())
