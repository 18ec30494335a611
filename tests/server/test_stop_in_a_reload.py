"""Stops during a reload of the plant file: each is sent on the old line, or on the line that replaces it."""

import asyncio
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial

import pytest
from served_core import ENGINEER, VIEWER, asked, awaited, core_of, runs, until

from drivecomm.line import Rank
from drivecomm.protocol import Stop
from drivecomm.server.commands import CommandExecutor


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


def faster(plant):
    """Return the plant with other settings for every line."""
    return replace(plant, lines=tuple(replace(each, settings={"baudrate": 19200}) for each in plant.lines))


@asynccontextmanager
async def turning(core, drive, line):
    """Serve a plant with one running motor, and occupy a line, so that the line cannot be closed yet.

    Yields the core, the control of its virtual drives, and a function that frees the line.
    """
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
async def test_stop_is_sent_on_a_line_that_waits_to_be_closed(core):
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
async def test_line_that_waits_to_be_closed_does_not_delay_another(core):
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
async def test_stop_requested_as_its_line_closes_is_sent_on_the_new_line(core):
    async with turning(core, "pump", "hall") as (served, control, give_back):
        changing = asyncio.create_task(served.changed(faster(served.plant)))
        await asyncio.sleep(0.1)
        give_back()
        # The stop is requested at the moment when the line closes.
        answer = await asked(served, VIEWER, "pump", "stop")
        assert answer.outcome == "done", answer.error
        await until(lambda: not runs(control, "pump"), 2)
        await changing


@pytest.mark.soak
@awaited
async def test_stop_waits_for_a_line_that_is_not_open_yet(core):
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
async def test_stop_all_works_during_a_reload(core):
    async with turning(core, "pump", "hall") as (served, control, give_back):
        changing = asyncio.create_task(served.changed(faster(served.plant)))
        await asyncio.sleep(0.1)
        stopping = asyncio.create_task(CommandExecutor(served).stop_all(VIEWER, Stop.RAMP))
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
async def test_drives_accept_commands_after_a_failed_reload(core):
    async with core() as (served, _):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        release, served.kept.release_all = served.kept.release_all, breaks
        with pytest.raises(BrokenError):
            await served.changed(replace(served.plant, drives=served.plant.drives[:2]))
        served.kept.release_all = release
        for name in ("pump", "fan"):
            assert (await asked(served, ENGINEER, name, "reset")).outcome == "done"


@awaited
async def test_line_that_cannot_be_replaced_is_reported_and_still_polled(core):
    async with core() as (served, _):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        yard = served.lines["yard"]
        yard.set_drives = breaks
        told = await served.changed(faster_hall(replace(served.plant, drives=served.plant.drives[:2])))
        assert told == ["line hall is opened anew", "line yard could not be replaced: BrokenError"]
        before = yard.state().polls
        await until(lambda: yard.state().polls > before)
        await until(lambda: served.drive("pump").reachability == "answers")


def faster_hall(plant):
    hall, yard = plant.lines
    return replace(plant, lines=(replace(hall, settings={"baudrate": 19200}), yard))
