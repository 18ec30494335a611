"""A reload that assigns a name to another drive, or polls less: old values are not reported for the new drive."""

import time
from dataclasses import replace
from functools import partial

import pytest
from served_core import OPERATOR, asked, awaited, core_of, until

from drivecomm.errors import LeaseError


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


def with_exchanged_fan(plant):
    """Return the plant with the drive of the mixer under the name fan."""
    return replace(plant, drives=(plant.drives[0], replace(plant.drives[1], address=4)))


def with_fewer_polls(plant):
    """Return the plant with only the status of the fan polled."""
    return replace(plant, drives=(plant.drives[0], replace(plant.drives[1], poll=()), plant.drives[2]))


def leased(served, drive):
    return served.leases.take(OPERATOR, drive, 20, now=time.monotonic(), time_s=time.time())


async def all_answer(served):
    await until(lambda: all(each.reachability == "answers" for each in served.drives()))


def suspend_polling(served):
    """Suspend polling on the line of the fan."""
    served.lines["yard"].start = lambda: None


@awaited
async def test_exchanged_drive_inherits_no_state_faults_or_lease(core):
    async with core() as (served, control):
        await all_answer(served)
        control.order("trip", drive="fan", code=13)
        await until(lambda: served.drive("fan").fault_log and served.drive("fan").fault)
        lease = leased(served, "fan")
        suspend_polling(served)
        await served.changed(with_exchanged_fan(served.plant))
        fan = served.drive("fan")
        assert (fan.config.address, fan.reachability, fan.status, fan.fault) == (4, "asking", None, "")
        assert fan.fault_log == ()
        assert fan.lease is None
        answer = await asked(served, OPERATOR, "fan", "reset", lease=lease.key)
        assert answer.outcome == "refused"


@pytest.mark.soak
@awaited
async def test_fault_log_being_read_is_dropped_when_the_drive_is_exchanged(core):
    async with core(status_period_s=60) as (served, _):
        await all_answer(served)
        served._tripped("fan")
        await served.changed(with_exchanged_fan(served.plant))
        await until(lambda: not served._reading_fault_logs)
        assert served.drive("fan").fault_log == ()


@pytest.mark.soak
@awaited
async def test_drive_with_changed_settings_keeps_its_state_and_lease(core):
    async with core() as (served, control):
        await all_answer(served)
        control.order("trip", drive="fan", code=13)
        await until(lambda: served.drive("fan").fault_log and served.drive("fan").fault)
        lease = leased(served, "fan")
        suspend_polling(served)
        await served.changed(with_fewer_polls(served.plant))
        fan = served.drive("fan")
        assert fan.fault
        assert fan.reachability == "answers"
        assert fan.fault_log
        assert fan.lease == lease


@pytest.mark.parametrize("change", [with_exchanged_fan, with_fewer_polls])
@awaited
async def test_listeners_receive_bad_values_after_the_reload(core, change):
    async with core() as (served, _):
        await all_answer(served)
        await until(lambda: ("fan", "output_frequency") in {(each.drive, each.name) for each in served.table.values()})
        told = {}
        served.table.listen(lambda values, _: told.update({(each.drive, each.name): each for each in values}))
        suspend_polling(served)
        await served.changed(change(served.plant))
        await until(lambda: ("fan", "output_frequency") in told and told["fan", "output_frequency"].quality == "bad")
        value = told["fan", "output_frequency"]
        assert value.reading is None
        assert value.cause == "the plant file was read again"
        assert not any(each.drive == "fan" for each in served.table.values())


@awaited
async def test_lease_ended_by_a_reload_can_be_acquired_again(core):
    async with core() as (served, _):
        await all_answer(served)
        lease = leased(served, "fan")
        await served.changed(with_exchanged_fan(served.plant))
        with pytest.raises(LeaseError, match="has expired"):
            served.leases.renew(OPERATOR, "fan", lease.key, 5, now=time.monotonic(), time_s=time.time())
        assert leased(served, "fan").key != lease.key
