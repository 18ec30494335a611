"""A poll plan stays fresh while readers request more than the line can carry."""

import asyncio

import pytest

from drivecomm.bus import open_bus_async
from drivecomm.line import PollItem
from drivecomm.virtual import VirtualLine, virtual_drive

READERS = 40
READ = {"danfoss-fc": ("16-13", "16-14"), "fuji": ("M09", "M11")}
MODELS = {"danfoss-fc": "fc302", "fuji": "frenic"}


@pytest.mark.parametrize("protocol", READ)
def test_poll_plan_below_half_of_the_line_stays_fresh_in_a_flood_of_reads(protocol):
    first, second = READ[protocol]

    async def main():
        line = VirtualLine([virtual_drive(protocol, 2, model=MODELS[protocol])])
        async with open_bus_async(line.port) as bus:
            drive, found, reads = bus.drive(protocol, 2, model=MODELS[protocol]), [], 0

            async def read():
                nonlocal reads
                # The limit ends the loop even if the polls get no turn.
                while reads < 5000:
                    await drive.read(first)
                    reads += 1

            readers = [asyncio.create_task(read()) for _ in range(READERS)]
            plan = [PollItem(drive=drive, parameter=each, period_s=0.5) for each in (first, second)]
            found += [result async for result in bus.poll(plan, duration_s=30)]
            for each in readers:
                each.cancel()
            await asyncio.gather(*readers, return_exceptions=True)
        assert {result.quality for result in found} <= {"good", "uncertain"}, (
            "how sure the model is of a value counts too"
        )
        assert sum(result.missed for result in found) == 0
        assert len(found) >= 2 * 59
        assert reads > len(found)

    asyncio.run(main())
