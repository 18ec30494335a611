"""Motors kept by a server: no motor runs without its keeper, and a stop wins at every moment."""

import asyncio
import time
from functools import partial

import pytest
from served_core import ENGINEER, OPERATOR, VIEWER, NoteBook, asked, awaited, core_of, runs, until

from drivecomm.bus import read_watchdog_async
from drivecomm.errors import CommandCancelledError, LeaseError

HALF = {"percent": 50}


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


def leased(core, caller, drive, seconds, key=""):
    return core.leases.take(caller, drive, seconds, now=time.monotonic(), time_s=time.time(), key=key)


async def keep(served, *, seconds=5.0, caller=OPERATOR, drive="pump", **arguments):
    lease = leased(served, caller, drive, seconds)
    answer = await asked(served, caller, drive, "keep", lease=lease.key, arguments={**HALF, **arguments})
    assert answer.outcome == "done", answer.error
    return lease


async def begun(served, drive="pump"):
    """Wait until the watchdog of a motor is set, before the motor is started."""
    await until(lambda: served.drive(drive).kept)
    async for item in served.kept.following(drive):
        assert item["done"] == "watchdog set"
        return


async def stays_stopped(control, drive="pump", seconds=0.4):
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        assert not runs(control, drive)
        await asyncio.sleep(0.01)


class Gate(NoteBook):
    """An audit that delays its records until the test opens it."""

    def __init__(self):
        super().__init__()
        self.open, self.waits = asyncio.Event(), asyncio.Event()

    async def record_command(self, caller, command, lease=None):
        self.waits.set()
        await self.open.wait()
        return await super().record_command(caller, command, lease)


class TestWhileStarting:
    @pytest.mark.soak
    @awaited
    @pytest.mark.parametrize("drive", ["pump", "vabus:1", "vabus:01", "vabus:*"])
    async def test_stop_wins_over_a_start_in_progress(self, core, drive):
        async with core() as (served, control):
            lease = leased(served, OPERATOR, "pump", 5)
            keeping = asyncio.create_task(asked(served, OPERATOR, "pump", "keep", lease=lease.key, arguments=HALF))
            await begun(served)
            line = "" if drive == "pump" else "hall"
            stopped = await asked(served, ENGINEER, drive, "stop", line=line)
            assert stopped.outcome == "done", stopped.error
            await stays_stopped(control)
            assert isinstance((await keeping).error, CommandCancelledError)
            await until(lambda: served.drive("pump").kept == "")

    @pytest.mark.soak
    @awaited
    async def test_expired_lease_releases_a_motor_being_started(self, core):
        async with core() as (served, control):
            lease = leased(served, OPERATOR, "pump", 5)
            keeping = asyncio.create_task(asked(served, OPERATOR, "pump", "keep", lease=lease.key, arguments=HALF))
            await begun(served)
            served.leases.renew(OPERATOR, "pump", lease.key, 0.001, now=time.monotonic(), time_s=time.time())
            await keeping
            await until(lambda: served.drive("pump").kept == "", 2)
            await until(lambda: not runs(control, "pump"))
            await stays_stopped(control)

    @pytest.mark.soak
    @awaited
    async def test_released_lease_releases_a_motor_being_started(self, core):
        async with core() as (served, control):
            lease = leased(served, OPERATOR, "pump", 5)
            keeping = asyncio.create_task(asked(served, OPERATOR, "pump", "keep", lease=lease.key, arguments=HALF))
            await begun(served)
            served.kept.given_back(served.leases.end(OPERATOR, "pump", lease.key, now=time.monotonic()))
            assert (await keeping).outcome == "refused"
            await stays_stopped(control)
            await until(lambda: served.drive("pump").kept == "")

    @pytest.mark.soak
    @awaited
    async def test_motor_is_not_started_after_its_caller_is_gone(self, core):
        async with core() as (served, control):
            lease = leased(served, OPERATOR, "pump", 5)
            keeping = asyncio.create_task(asked(served, OPERATOR, "pump", "keep", lease=lease.key, arguments=HALF))
            await begun(served)
            keeping.cancel()
            await stays_stopped(control)
            await until(lambda: served.drive("pump").kept == "")

    @pytest.mark.soak
    @awaited
    async def test_shutdown_wins_over_a_start_in_progress(self, core):
        async with core() as (served, control):
            lease = leased(served, OPERATOR, "pump", 5)
            keeping = asyncio.create_task(asked(served, OPERATOR, "pump", "keep", lease=lease.key, arguments=HALF))
            await begun(served)
            await served.release_all()
            await stays_stopped(control)
            assert (await keeping).outcome == "refused"

    @pytest.mark.soak
    @awaited
    async def test_failed_start_is_not_kept_and_its_events_end(self, core):
        async with core() as (served, control):
            lease = leased(served, OPERATOR, "pump", 5)
            control.order("trip", drive="pump", code=4)
            order = {"lease": lease.key, "arguments": {"percent": 5000}}
            assert (await asked(served, OPERATOR, "pump", "keep", **order)).outcome != "done"
            async with asyncio.timeout(3):
                _ = [item async for item in served.kept.following("pump")]
            assert served.drive("pump").kept == ""

    @awaited
    async def test_motor_with_policy_hold_is_not_kept_after_its_start(self, core):
        async with core() as (served, control):
            await keep(served, policy="hold", caller=ENGINEER)
            assert served.drive("pump").kept == ""
            await until(lambda: runs(control, "pump"))


class TestWhileTheAuditIsWritten:
    @pytest.mark.soak
    @pytest.mark.parametrize("verb", ["keep", "start"])
    @awaited
    async def test_stop_wins_over_a_start_that_waits_for_its_audit_record(self, core, verb):
        gate = Gate()
        async with core(audit=gate) as (served, control):
            lease = leased(served, ENGINEER, "pump", 5)
            starting = asyncio.create_task(asked(served, ENGINEER, "pump", verb, lease=lease.key))
            await gate.waits.wait()
            assert (await asked(served, VIEWER, "pump", "stop")).outcome == "done"
            gate.open.set()
            answer = await starting
            assert (answer.outcome, type(answer.error)) == ("refused", CommandCancelledError)
            await stays_stopped(control)

    @pytest.mark.soak
    @pytest.mark.parametrize("verb", ["keep", "start"])
    @awaited
    async def test_lease_expired_during_the_audit_refuses_the_start(self, core, verb):
        gate = Gate()
        async with core(audit=gate) as (served, control):
            lease = leased(served, ENGINEER, "pump", 0.05)
            starting = asyncio.create_task(asked(served, ENGINEER, "pump", verb, lease=lease.key))
            await asyncio.sleep(0.2)
            leased(served, OPERATOR, "pump", 5)
            gate.open.set()
            answer = await starting
            assert (answer.outcome, type(answer.error)) == ("refused", LeaseError)
            await stays_stopped(control)

    @pytest.mark.soak
    @pytest.mark.parametrize("verb", ["keep", "start"])
    @awaited
    async def test_shutdown_during_the_audit_refuses_the_start(self, core, verb):
        gate = Gate()
        async with core(audit=gate) as (served, control):
            lease = leased(served, ENGINEER, "pump", 5)
            starting = asyncio.create_task(asked(served, ENGINEER, "pump", verb, lease=lease.key))
            await gate.waits.wait()
            await served.release_all()
            gate.open.set()
            assert (await starting).outcome == "refused"
            await stays_stopped(control)


class TestConcurrentKeepOrders:
    @pytest.mark.soak
    @awaited
    async def test_only_one_of_concurrent_keep_orders_succeeds(self, core):
        async with core() as (served, _):
            lease = leased(served, OPERATOR, "pump", 5)
            answers = await asyncio.gather(
                *(asked(served, OPERATOR, "pump", "keep", lease=lease.key, arguments=HALF) for _ in range(3))
            )
            assert sorted(each.outcome for each in answers) == ["done", "refused", "refused"]
            assert served.drive("pump").kept == "trip"
            await until(lambda: served.drive("pump").status.running)

    @pytest.mark.soak
    @awaited
    async def test_motor_kept_again_keeps_its_own_watchdog_setting(self, core):
        """Releasing a motor restores its watchdog settings, which must not overwrite those of a new keep order."""
        async with core() as (served, _):
            lease = await keep(served)
            assert (await asked(served, VIEWER, "pump", "stop")).outcome == "done"
            again = await asked(served, OPERATOR, "pump", "keep", lease=lease.key, arguments=HALF)
            assert again.outcome == "done", again.error
            await asyncio.sleep(0.5)
            assert served.drive("pump").kept == "trip"
            assert served.drive("pump").status.running
            assert (await read_watchdog_async(served.lines["hall"].drive("pump"))).policy == "trip"


class TestReleased:
    @awaited
    async def test_tripped_motor_is_released_although_its_lease_is_valid(self, core):
        async with core() as (served, control):
            await keep(served, seconds=30.0)
            control.order("trip", drive="pump", code=4)
            await until(lambda: served.drive("pump").kept == "")
            assert served.drive("pump").lease is not None

    @pytest.mark.soak
    @awaited
    async def test_unsupported_kind_of_stop_does_not_release_the_motor(self, core):
        async with core() as (served, control):
            await keep(served)
            for how in ("dc_brake", "slowly"):
                answer = await asked(served, VIEWER, "pump", "stop", arguments={"how": how})
                assert answer.outcome == "refused"
            await asyncio.sleep(0.3)
            assert served.drive("pump").kept == "trip"
            assert runs(control, "pump")

    @pytest.mark.soak
    @awaited
    async def test_stop_of_a_released_motor_is_retried_until_confirmed(self, core):
        """Polls feed the drive's watchdog, so the motor would keep running after the line works again."""
        async with core() as (served, control):
            await keep(served, drive="fan", caller=ENGINEER, policy="ramp", seconds=1.0, watchdog_s=60)
            await until(lambda: runs(control, "fan"))
            now_s = max(line["time_s"] for line in control.order("show")["lines"])
            control.order(
                "fault", text=f'line = "yard"\nkind = "drop"\nof = "request"\nfrom_s = {now_s}\nuntil_s = {now_s + 6}'
            )
            await until(lambda: any("may be running" in each.text for each in served.table.events()), 5.5)
            assert runs(control, "fan")
            # A silent drive is polled at intervals, and stopped as soon as it answers.
            await until(lambda: not runs(control, "fan"), 25)
            await until(lambda: "fan" not in served.kept)
            assert served.drive("fan").lease is None

    @pytest.mark.soak
    @awaited
    async def test_motor_being_released_is_not_started_before_it_stands(self, core):
        async with core() as (served, control):
            await keep(served, drive="fan", caller=ENGINEER, policy="ramp", seconds=1.5, watchdog_s=60)
            control.order("power", drive="fan", state="off")
            await until(lambda: any("may be running" in each.text for each in served.table.events()), 15)
            answer = await asked(served, ENGINEER, "fan", "start", valid_s=0.3)
            assert answer.outcome == "refused"
            assert "stop" in str(answer.error)
            control.order("power", drive="fan", state="on")
            await until(lambda: served.drive("fan").reachability == "answers", 20)
            await asyncio.sleep(2.5)
            assert (await asked(served, ENGINEER, "fan", "start")).outcome == "done"

    @pytest.mark.soak
    @awaited
    async def test_shutdown_ends_despite_an_unconfirmed_stop(self, core):
        async with core() as (served, control):
            await keep(served, drive="fan", caller=ENGINEER, policy="ramp", watchdog_s=60)
            control.order("power", drive="fan", state="off")
            began = time.monotonic()
        assert time.monotonic() - began < 12
        assert {task for task in asyncio.all_tasks() if task is not asyncio.current_task()} == set()

    @pytest.mark.soak
    @pytest.mark.parametrize("drive", ["vabus:*", "vabus:01"])
    @awaited
    async def test_stop_by_another_name_of_the_drive_releases_the_motor(self, core, drive):
        async with core() as (served, control):
            await keep(served)
            assert (await asked(served, ENGINEER, drive, "stop", line="hall")).outcome == "done"
            await until(lambda: served.drive("pump").kept == "", 2)
            await until(lambda: not runs(control, "pump"))
            await stays_stopped(control)
