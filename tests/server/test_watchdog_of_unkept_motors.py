"""The drive watchdog of a motor that the server does not keep: no request of the server feeds it."""

import asyncio
import time
from functools import partial

import pytest
from served_core import ENGINEER, asked, awaited, core_of, runs, until

from drivecomm.bus import read_watchdog_async, set_watchdog_async


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


@pytest.mark.soak
@awaited
async def test_server_polls_do_not_feed_the_watchdog_of_a_dead_program(core):
    async with core() as (served, control):
        for parameter, value in (("8-04", 2), ("8-03", 0.5)):
            answer = await asked(served, ENGINEER, "fan", "stop")
            answer = await asked(served, ENGINEER, "fan", "write", arguments={"parameter": parameter, "value": value})
            assert answer.outcome == "done", answer.error
        refused = await asked(served, ENGINEER, "fan", "watched", arguments={"silence_s": 0.5})
        assert refused.outcome == "refused"
        await asked(served, ENGINEER, "fan", "set_reference", arguments={"percent": 20})
        assert (await asked(served, ENGINEER, "fan", "start")).outcome == "done"
        await until(lambda: runs(control, "fan"))
        await until(lambda: not runs(control, "fan"), 2)


@pytest.mark.soak
@awaited
async def test_watchdog_of_a_formerly_kept_motor_is_not_fed(core):
    async with core() as (served, control):
        await until(lambda: served.drive("fan").reachability == "answers")
        fan = served.lines["yard"].drive("fan")
        await fan.stop()
        await set_watchdog_async(fan, "ramp", 0.5)
        lease = served.leases.take(ENGINEER, "fan", 20, now=time.monotonic(), time_s=time.time())
        kept = await asked(
            served,
            ENGINEER,
            "fan",
            "keep",
            lease=lease.key,
            arguments={"policy": "ramp", "watchdog_s": 1, "percent": 9},
        )
        assert kept.outcome == "done", kept.error
        await asked(served, ENGINEER, "fan", "stop")
        await until(lambda: "fan" not in served.kept)
        assert (await asked(served, ENGINEER, "fan", "start", lease=lease.key)).outcome == "done"
        await until(lambda: runs(control, "fan"))
        await until(lambda: not runs(control, "fan"), 2)


@pytest.mark.soak
@awaited
async def test_watchdog_of_a_kept_motor_is_fed(core):
    async with core() as (served, control):
        lease = served.leases.take(ENGINEER, "fan", 20, now=time.monotonic(), time_s=time.time())
        kept = await asked(
            served,
            ENGINEER,
            "fan",
            "keep",
            lease=lease.key,
            arguments={"policy": "ramp", "watchdog_s": 0.3, "percent": 9},
        )
        assert kept.outcome == "done", kept.error
        await asyncio.sleep(0.8)
        assert runs(control, "fan")
        assert (await read_watchdog_async(served.lines["yard"].drive("fan"))).policy == "ramp"
