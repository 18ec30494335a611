"""Stops while the plant file is read again: each goes to the line as it was, or to the one that is there instead."""

import asyncio
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial

import pytest
from served_core import ENGINEER, VIEWER, asked, awaited, core_of, runs, until

from drivecomm.line import Rank
from drivecomm.protocol import Stop
from drivecomm.server.commands import Commands


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


def faster(plant):
    """Every line has other settings."""
    return replace(plant, lines=tuple(replace(each, settings={"baudrate": 19200}) for each in plant.lines))


@asynccontextmanager
async def turning(core, drive, line):
    """Serve a plant one of whose motors turns, and whose lines cannot be closed yet, because somebody has one."""
    async with core() as (served, control):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        if drive == "pump":
            await asked(served, ENGINEER, drive, "set_reference", arguments={"percent": 50})
        assert (await asked(served, ENGINEER, drive, "start")).outcome == "done"
        await until(lambda: runs(control, drive))
        bus = served.lines[line].bus
        turn = await asyncio.create_task(bus.line.taken(Rank.COMMAND))
        yield served, control, partial(bus.line.turns.give_back, turn)


@pytest.mark.soak
@awaited
async def test_a_line_that_is_not_closed_yet_is_stopped_on(core):
    async with turning(core, "pump", "hall") as (served, control, give_back):
        bus = served.lines["hall"].bus
        changing = asyncio.create_task(served.changed(faster(served.plant)))
        await asyncio.sleep(0.1)
        stopping = asyncio.create_task(asked(served, VIEWER, "pump", "stop"))
        await asyncio.sleep(0.05)
        give_back()
        answer = await stopping
        assert answer.outcome == "done", answer.error
        await until(lambda: not runs(control, "pump"), 2)
        await changing
        assert served.lines["hall"].bus is not bus


@pytest.mark.soak
@awaited
async def test_a_line_that_waits_to_be_closed_holds_up_no_other_one(core):
    async with turning(core, "fan", "hall") as (served, control, give_back):
        changing = asyncio.create_task(served.changed(faster(served.plant)))
        await asyncio.sleep(0.3)
        answer = await asked(served, VIEWER, "fan", "stop")
        assert answer.outcome == "done", answer.error
        await until(lambda: not runs(control, "fan"), 2)
        assert not changing.done()
        give_back()
        await changing


@pytest.mark.soak
@awaited
async def test_a_stop_that_meets_the_end_of_its_line_is_sent_on_the_next_one(core):
    async with turning(core, "pump", "hall") as (served, control, give_back):
        changing = asyncio.create_task(served.changed(faster(served.plant)))
        await asyncio.sleep(0.1)
        give_back()
        # It is asked for in the moment in which closing has its turn.
        answer = await asked(served, VIEWER, "pump", "stop")
        assert answer.outcome == "done", answer.error
        await until(lambda: not runs(control, "pump"), 2)
        await changing


@pytest.mark.soak
@awaited
async def test_a_drive_whose_line_is_not_there_yet_is_waited_for(core):
    async with turning(core, "fan", "yard") as (served, control, give_back):
        port_of = served._port_of
        served._port_of = lambda line: port_of(replace(line, name=line.name.replace("court", "yard")))
        lines = tuple(replace(each, name=each.name.replace("yard", "court")) for each in served.plant.lines)
        drives = tuple(replace(each, line=each.line.replace("yard", "court")) for each in served.plant.drives)
        changing = asyncio.create_task(served.changed(replace(served.plant, lines=lines, drives=drives)))
        await asyncio.sleep(0.1)
        stopping = asyncio.create_task(asked(served, VIEWER, "fan", "stop"))
        await asyncio.sleep(0.05)
        give_back()
        answer = await stopping
        assert answer.outcome == "done", answer.error
        await until(lambda: not runs(control, "fan"), 2)
        assert "line court is new" in await changing


@pytest.mark.soak
@awaited
async def test_all_drives_are_stopped(core):
    async with turning(core, "pump", "hall") as (served, control, give_back):
        changing = asyncio.create_task(served.changed(faster(served.plant)))
        await asyncio.sleep(0.1)
        stopping = asyncio.create_task(Commands(served).stop_all(VIEWER, Stop.RAMP))
        await asyncio.sleep(0.05)
        give_back()
        stopped = {each.drive: each.answer.outcome for each in await stopping}
        assert {name: stopped[name] for name in ("pump", "fan", "mixer")} == dict.fromkeys(
            ("pump", "fan", "mixer"), "done"
        )
        await until(lambda: not runs(control, "pump"), 2)
        await changing


class BrokenError(Exception):
    pass


def breaks(*_):
    raise BrokenError


@awaited
async def test_what_goes_wrong_in_a_reload_leaves_the_drives_to_be_commanded(core):
    async with core() as (served, _):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        release, served.kept.release_all = served.kept.release_all, breaks
        with pytest.raises(BrokenError):
            await served.changed(replace(served.plant, drives=served.plant.drives[:2]))
        served.kept.release_all = release
        for name in ("pump", "fan"):
            assert (await asked(served, ENGINEER, name, "reset")).outcome == "done"


@awaited
async def test_a_line_that_cannot_be_exchanged_is_told_and_polled_on(core):
    async with core() as (served, _):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        yard = served.lines["yard"]
        yard.has = breaks
        told = await served.changed(faster_hall(replace(served.plant, drives=served.plant.drives[:2])))
        assert told == ["line hall is opened anew", "line yard could not be exchanged: BrokenError"]
        before = yard.state().polls
        await until(lambda: yard.state().polls > before)
        await until(lambda: served.drive("pump").reachability == "answers")


def faster_hall(plant):
    hall, yard = plant.lines
    return replace(plant, lines=(replace(hall, settings={"baudrate": 19200}), yard))
