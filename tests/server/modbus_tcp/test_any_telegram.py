"""Any telegram of a master gets a normal reply or an exception reply, and moves no motor."""

import asyncio
import struct
from random import Random

import pytest
from fake_plant import value
from fake_units import Plant, table

from drivecomm.server.modbus_tcp import modbus_tcp_door
from drivecomm.server.modbus_tcp.sessions import ModbusSession, Units

TELEGRAMS = 4000


def telegrams(random):
    """Yield random telegrams: garbage, nearly valid ones, and valid ones with random numbers."""
    while True:
        function = random.choice([1, 3, 4, 4, 6, 16, 16, 16, 23, 43, random.randrange(256)])
        address = random.choice([0, 8, 1000, 1001, 1002, 1006, random.randrange(1010), random.randrange(65536)])
        words = [
            random.choice([0, 1, 2, 5, 99, 0x7FC0, random.randrange(65536)]) for _ in range(random.randrange(1, 12))
        ]
        packed = struct.pack(f">{len(words)}H", *words)
        yield random.choice(
            [
                bytes([function]) + random.randbytes(random.randrange(250)),
                struct.pack(">BHH", function, address, random.choice([1, 2, 8, 120, 125, 126])),
                struct.pack(">BHHB", 16, address, len(words), len(packed)) + packed,
                struct.pack(">BHH", 6, address, words[0]),
                struct.pack(">BHHHHB", 23, 0, 8, address, len(words), len(packed)) + packed,
                struct.pack(">BHHB", 16, address, len(words), len(packed)) + packed[: random.randrange(len(packed))],
            ]
        )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("commands_from", [[], ["127.0.0.1"]], ids=["only-read", "commanded"])
def test_any_telegram_is_answered(seed, commands_from):
    async def answer_all():
        plant, random = Plant(), Random(seed)
        plant.change(value("pump", "output_frequency", "10"))
        units = Units(plant, modbus_tcp_door(table(commands_from=commands_from)).settings, "modbus-tcp 127.0.0.1:1")
        session = ModbusSession(units, "127.0.0.1")
        for _, telegram in zip(range(TELEGRAMS), telegrams(random), strict=False):
            answer = session.answer(random.choice([0, 1, 1, 1, 2, 9, 255]), telegram)
            assert len(answer) <= 253
            assert answer[0] & 0x7F == telegram[0] & 0x7F
            if answer[0] & 0x80:
                assert len(answer) == 2
                assert answer[1] in (1, 2, 3, 10, 11), telegram.hex(" ")
        await asyncio.sleep(0)
        return plant

    plant = asyncio.run(answer_all())
    verbs = {command.verb for _, command in plant.commands}
    # The event loop has no time to grant a lease meanwhile, and without a lease only stops are sent.
    assert verbs <= ({"stop"} if commands_from else set())
