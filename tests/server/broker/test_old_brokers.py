"""A broker like NATS: it speaks only MQTT 3.1.1 and refuses client ids with a space."""

import asyncio
import json
import subprocess
import sys
from contextlib import asynccontextmanager

import pytest

from drivecomm.errors import PortError
from drivecomm.server.broker import BROKER_KEYS, Broker, VersionRefused, broker_settings, connect_to_broker
from drivecomm.server.fleet import Fleet, FleetSubscription
from drivecomm.tomlfile import TomlTable

STATE = b'{"state":"online","session":"s"}'
CONNECT, PUBLISH, SUBSCRIBE, PING, DISCONNECT = 0x10, 0x30, 0x82, 0xC0, 0xE0
BAD_VERSION, BAD_ID, BAD_USER = 1, 2, 5


class OldBroker:
    """Broker played by the test. refuses: the return code sent to every client; 0 to accept them."""

    def __init__(self, refuses=0):
        self.refuses = refuses
        self.clients = []

    async def serve(self, reader, writer):
        try:
            while True:
                kind, content = await _packet(reader)
                if kind == CONNECT:
                    writer.write(self._connack(content))
                elif kind == SUBSCRIBE:
                    topics = _texts(content[2:])
                    writer.write(bytes([0x90, 2 + len(topics)]) + content[:2] + bytes(len(topics)))
                    topic = b"drivecomm/Mill%20north/bridge/state"
                    writer.write(bytes([PUBLISH | 1, 2 + len(topic) + len(STATE), 0, len(topic)]) + topic + STATE)
                elif kind & 0xF0 == PUBLISH:
                    self._publish(kind, content, writer)
                elif kind == PING:
                    writer.write(b"\xd0\x00")
                elif kind == DISCONNECT:
                    return
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            return
        finally:
            writer.close()

    def _publish(self, kind, content, writer):
        """Acknowledge a message, and send it back to its publisher."""
        place = 2 + int.from_bytes(content[:2])
        if kind & 0x06:
            writer.write(bytes([0x40, 2]) + content[place : place + 2])
            content = content[:place] + content[place + 2 :]
        if kind & 0x01 == 0 and len(content) < 128:
            writer.write(bytes([PUBLISH, len(content)]) + content)

    def _connack(self, content):
        level = content[6]
        length = int.from_bytes(content[10:12])
        client = content[12 : 12 + length].decode()
        self.clients.append((level, client))
        code = self.refuses or (BAD_VERSION if level != 4 else BAD_ID if " " in client else 0)
        return bytes([0x20, 2, 0, code])


async def _packet(reader):
    kind, size, shift = (await reader.readexactly(1))[0], 0, 0
    while True:
        byte = (await reader.readexactly(1))[0]
        size |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            return kind, await reader.readexactly(size)


def _texts(content):
    found = []
    while content:
        length = int.from_bytes(content[:2])
        found.append(content[2 : 2 + length])
        content = content[3 + length :]
    return found


@asynccontextmanager
async def served(broker):
    server = await asyncio.start_server(broker.serve, "127.0.0.1", 0)
    async with server:
        yield f"mqtt://127.0.0.1:{server.sockets[0].getsockname()[1]}"


def settings_of(url, **more):
    table = TomlTable({"broker": url, **more}, "x.toml")
    return broker_settings(table, table.take(BROKER_KEYS))


def test_error_names_the_mqtt_version_that_the_broker_refuses():
    async def test():
        async with served(OldBroker()) as url:
            with pytest.raises(VersionRefused, match=r'does not speak MQTT 5; write version = "3\.1\.1" if it speaks'):
                async with connect_to_broker(settings_of(url), "client", print):
                    pass

    asyncio.run(test())


def test_error_mentions_the_user_only_if_the_user_was_refused():
    async def test():
        async with served(OldBroker(refuses=BAD_USER)) as url:
            with pytest.raises(PortError, match=r"is user = right\?"):
                async with connect_to_broker(settings_of(url, version="3.1.1"), "client", print):
                    pass
        async with served(OldBroker(refuses=3)) as url:
            with pytest.raises(PortError) as refused:
                async with connect_to_broker(settings_of(url, version="3.1.1"), "client", print):
                    pass
            assert "user = right" not in str(refused.value)

    asyncio.run(test())


def test_fleet_falls_back_to_mqtt_3_1_1():
    async def test():
        broker = OldBroker()
        async with served(broker) as url:
            following = FleetSubscription(settings_of(url), Fleet("drivecomm"))
            await asyncio.wait_for(following.known(), 10)
            assert list(following.fleet.plants) == ["Mill north"]
            assert [level for level, _ in broker.clients] == [5, 4]

    asyncio.run(test())


def test_fleet_command_shows_plants_of_an_old_broker():
    async def test():
        async with served(OldBroker()) as url:
            running = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "drivecomm", "fleet", url, "--json"), stdout=subprocess.PIPE
            )
            return (await running.communicate())[0]

    assert json.loads(asyncio.run(test()))["name"] == "Mill north"


def test_client_id_derived_from_a_plant_name_has_no_space():
    class Nothing:
        def will(self):
            return None

        async def serve(self, _connection):
            served_once.set()
            await asyncio.sleep(60)

        def received(self, received):
            pass

        async def farewell(self, connection):
            pass

    async def test():
        old = OldBroker()
        async with served(old) as url:
            settings = settings_of(url, version="3.1.1")
            broker = Broker(settings, Nothing(), topic="t/bridge", client_id="drivecomm-Mill north", tell=print)
            running = asyncio.create_task(broker.run(lambda: None))
            await asyncio.wait_for(served_once.wait(), 10)
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
        assert (4, "drivecomm-Mill%20north") in old.clients
        assert not [client for _, client in old.clients if " " in client]

    served_once = asyncio.Event()
    asyncio.run(test())
