"""Whether drives answer, as the broker keeps it: told anew on each connection, because brokers forget."""

from doors import listening, open_door
from mosquitto import mosquitto, needs_mosquitto, until
from served_core import awaited, core_of

pytestmark = needs_mosquitto

ONLINE = {f"drivecomm/hall/{drive}/availability": b'{"state":"online"}' for drive in ("pump", "fan", "mixer")}


@awaited
async def test_availability_is_told_again_to_a_broker_that_has_forgotten_it(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with core_of(tmp_path) as (core, _), open_door(core, broker) as door:
            await until(lambda: all(each.reachability == "answers" for each in core.drives()))
            for _ in range(2):
                await until(lambda: door.broker.connected)
                async with listening(broker) as client:
                    await until(lambda client=client: latest(client).items() >= ONLINE.items())
                with broker.away():
                    await until(lambda: not door.broker.connected)


def latest(client):
    return {each.topic: bytes(each.payload) for each in client.heard}
