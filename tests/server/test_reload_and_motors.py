"""Reloads of the plant file: changed lines and drives are replaced, others continue, and no motor runs unkept."""

import asyncio
import time
from dataclasses import replace
from functools import partial

import pytest
from served_core import ENGINEER, OPERATOR, VIEWER, asked, awaited, core_of, runs, until

from drivecomm.errors import UsageError


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


async def keep(served, drive="pump", **arguments):
    lease = served.leases.take(OPERATOR, drive, 20, now=time.monotonic(), time_s=time.time())
    answer = await asked(served, OPERATOR, drive, "keep", lease=lease.key, arguments={"percent": 50, **arguments})
    assert answer.outcome == "done", answer.error
    return lease


def with_line(plant, name, **changes):
    return replace(plant, lines=tuple(replace(each, **changes) if each.name == name else each for each in plant.lines))


def with_drive(plant, name, **changes):
    drives = tuple(replace(each, **changes) if each.name == name else each for each in plant.drives)
    return replace(plant, drives=drives)


def without(plant, name):
    return replace(plant, drives=tuple(each for each in plant.drives if each.name != name))


CHANGES = {
    "its line has other settings": lambda plant: with_line(plant, "hall", settings={"baudrate": 19200}),
    "its line goes": lambda plant: replace(
        without(plant, "pump"), lines=tuple(each for each in plant.lines if each.name != "hall")
    ),
    "it goes": lambda plant: without(plant, "pump"),
    "it is read-only": lambda plant: with_drive(plant, "pump", armed=False),
}


@pytest.mark.soak
@pytest.mark.parametrize("change", CHANGES)
@awaited
async def test_motor_is_stopped_before_its_drive_is_replaced(core, change):
    async with core() as (served, control):
        await keep(served)
        await until(lambda: runs(control, "pump"))
        await served.changed(CHANGES[change](served.plant))
        assert "pump" not in served.kept
        await until(lambda: not runs(control, "pump"), 1)
        assert not any("not confirmed" in each.text for each in served.table.events())


@awaited
async def test_motor_keeps_running_when_only_its_groups_change(core):
    async with core() as (served, control):
        await keep(served)
        assert await served.changed(with_drive(served.plant, "pump", groups=("wet",))) == []
        assert served.drive("pump").kept == "trip"
        await until(lambda: runs(control, "pump"))
        assert [each.name for each in served.plant.group("wet")] == ["pump"]


@pytest.mark.parametrize("verb", ["start", "keep", "stop", "read", "reset"])
@awaited
async def test_group_is_refused_in_place_of_a_drive(core, verb):
    async with core() as (served, control):
        await served.changed(with_drive(served.plant, "pump", groups=("wet",)))
        answer = await asked(served, ENGINEER, "wet", verb)
        assert answer.outcome == "refused"
        assert "'wet' is a group, of pump; name one of its drives" in str(answer.error)
        assert not runs(control, "pump")


@pytest.mark.soak
@awaited
async def test_motor_with_unchanged_line_and_drive_keeps_running(core):
    async with core() as (served, control):
        await keep(served)
        await served.changed(without(served.plant, "mixer"))
        await asyncio.sleep(0.3)
        assert served.drive("pump").kept == "trip"
        assert runs(control, "pump")


@pytest.mark.soak
@awaited
async def test_motor_is_not_started_while_its_drive_is_replaced(core):
    async with core() as (served, control):
        lease = await keep(served)
        changing = asyncio.create_task(served.changed(without(served.plant, "pump")))
        await asyncio.sleep(0)
        answer = await asked(served, OPERATOR, "pump", "keep", lease=lease.key)
        assert answer.outcome == "refused"
        await changing
        await asyncio.sleep(0.2)
        assert not runs(control, "pump")


@pytest.mark.soak
@awaited
async def test_silent_drive_delays_a_reload_for_a_limited_time(core):
    async with core() as (served, control):
        await keep(served)
        control.order("power", drive="pump", state="off")
        async with asyncio.timeout(12):
            await served.changed(without(served.plant, "pump"))
        assert [each.name for each in served.drives()] == ["fan", "mixer"]


@awaited
async def test_values_of_a_removed_drive_do_not_return(core):
    async with core() as (served, _):
        await until(lambda: {each.drive for each in served.table.values()} == {"pump", "fan", "mixer"})
        await served.changed(without(served.plant, "fan"))
        await asyncio.sleep(0.2)
        assert {each.drive for each in served.table.values()} == {"pump", "mixer"}


@awaited
async def test_values_of_a_line_that_fails_to_reopen_are_removed(core):
    async with core() as (served, _):
        await until(lambda: {each.drive for each in served.table.values()} == {"pump", "fan", "mixer"})

        def no_port(_line):
            raise UsageError("no port")

        served._port_of = no_port
        await served.changed(with_line(served.plant, "yard", settings={"baudrate": 19200}))
        assert {each.drive for each in served.table.values()} == {"pump"}
        with pytest.raises(UsageError):
            served.drive("fan")
        # A later reload can bring the line back.
        assert await served.changed(with_line(served.plant, "yard", settings={"baudrate": 9600})) != []


@awaited
async def test_command_for_a_closed_line_is_answered(core):
    async with core() as (served, _):
        line = served.lines["yard"]
        await served.changed(replace(without(without(served.plant, "fan"), "mixer"), lines=served.plant.lines[:1]))
        async with asyncio.timeout(2):
            for name in ("fan", "pump"):
                answer = await asked(served, ENGINEER, name, "stop")
                assert answer.outcome == ("refused" if name == "fan" else "done")
            with pytest.raises(UsageError):
                await line.opened()


@pytest.mark.soak
@awaited
async def test_commands_are_carried_out_during_reloads(core):
    async with core() as (served, _):
        plants = [served.plant, without(served.plant, "mixer")]
        await until(lambda: {each.drive for each in served.table.values()} == {"pump", "fan", "mixer"})
        for number in range(6):
            changing = asyncio.create_task(served.changed(plants[(number + 1) % 2]))
            answers = await asyncio.gather(*(asked(served, VIEWER, name, "stop") for name in ("pump", "fan", "mixer")))
            assert [(answer.outcome, answer.error) for answer in answers[:2]] == [("done", None)] * 2
            assert answers[2].outcome in {"done", "refused"}
            await changing
