"""Many concurrent callers with random actions: no unkept motor runs, and a confirmed stop lasts."""

import asyncio
import time
from dataclasses import replace
from random import Random

import pytest
from extents import LONG, every
from served_core import ANOTHER, OPERATOR, VIEWER, NoteBook, asked, awaited, core_of, runs, until

from drivecomm.errors import LeaseError

RUN_S = 4.0


async def commander(served, caller, random, until_s):
    """Acquire leases, keep the motor, set references, stop, and sometimes fail to renew."""
    while time.monotonic() < until_s:
        try:
            lease = served.leases.take(
                caller, "pump", random.uniform(0.05, 0.6), now=time.monotonic(), time_s=time.time()
            )
        except LeaseError:
            await asyncio.sleep(random.uniform(0, 0.05))
            continue
        for _ in range(random.randrange(4)):
            verb, given = random.choice(
                [("keep", {"percent": 50}), ("set_reference", {"percent": 20}), ("reset", {}), ("stop", {})]
            )
            await asked(served, caller, "pump", verb, lease=lease.key, arguments=given)
            await asyncio.sleep(random.uniform(0, 0.1))


async def disturber(served, control, random, until_s):
    """Stop from outside, trip the drive, and reload the plant file."""
    whole = served.plant
    while time.monotonic() < until_s:
        await asyncio.sleep(random.uniform(0, 0.4))
        match random.randrange(4):
            case 0:
                await asked(served, VIEWER, "pump", "stop")
            case 1:
                control.order("trip", drive="pump", code=4)
            case 2:
                drives = whole.drives if len(served.plant.drives) < len(whole.drives) else whole.drives[:2]
                await served.changed(replace(whole, drives=drives))
            case _:
                await served.changed(
                    replace(whole, drives=(replace(whole.drives[0], title="other"), *whole.drives[1:]))
                )


async def watch(served, control, until_s):
    """Check that the motor runs only while it is kept or being released."""
    while time.monotonic() < until_s:
        if runs(control, "pump") and "pump" not in served.kept:
            # A stop was sent, and the motor takes some time to ramp down.
            await until(lambda: not runs(control, "pump") or "pump" in served.kept, 2)
        await asyncio.sleep(0.01)


@pytest.mark.soak
@pytest.mark.parametrize("seed", every(30, range(1, 30 if LONG else 9)))
@awaited
async def test_random_callers_leave_no_unkept_motor_running(tmp_path, seed):
    random, book = Random(seed), NoteBook()
    async with core_of(tmp_path, audit=book) as (served, control):
        until_s = time.monotonic() + RUN_S
        await asyncio.gather(
            commander(served, OPERATOR, Random(random.random()), until_s),
            commander(served, ANOTHER, Random(random.random()), until_s),
            disturber(served, control, Random(random.random()), until_s),
            watch(served, control, until_s),
        )
        await until(lambda: "pump" not in served.kept, 3)
        await until(lambda: not runs(control, "pump"), 2)
        assert {"keep", "set_reference"} & {verb for _, _, verb in book.asked_for}
        await served.release_all()
    assert asyncio.all_tasks() == {asyncio.current_task()}
