"""Reloads of the plant file during operation: removed drives and lines leave nothing behind."""

import asyncio
from dataclasses import replace
from functools import partial

import pytest
from served_core import PLANT, NoteBook, awaited, core_of, until

from drivecomm.errors import UsageError
from drivecomm.plant import read_plant
from drivecomm.server.core import Core
from drivecomm.server.kept_motor import MOST_TOLD, MotorStory
from drivecomm.virtual import VirtualPlant


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


def names(core):
    return {value.drive for value in core.table.values()}


@pytest.mark.soak
@awaited
async def test_value_read_while_its_drive_is_removed_is_dropped(core):
    async with core() as (served, _):
        whole, without = served.plant, replace(served.plant, drives=served.plant.drives[:2])
        for _ in range(5):
            await until(lambda: names(served) == {"pump", "fan", "mixer"})
            pause = served.lines["yard"].pause

            async def late(pause=pause):
                mixer = next(value for value in served.table.values() if value.drive == "mixer")
                served.table.put_value(mixer)
                await pause()

            served.lines["yard"].pause = late
            await served.changed(without)
            del served.lines["yard"].pause
            await asyncio.sleep(0.05)
            assert names(served) == {"pump", "fan"}
            await served.changed(whole)


@awaited
async def test_line_without_a_port_can_be_changed_and_removed(tmp_path):
    shed = '[[line]]\nname = "shed"\n[[drive]]\nname = "saw"\ndrive = "vabus:7"\nline = "shed"\n'
    drill = '[[drive]]\nname = "drill"\ndrive = "vabus:8"\nline = "shed"\n'
    plants = []
    for number, more in enumerate(("", shed, shed + drill)):
        file = tmp_path / f"{number}.toml"
        file.write_text(PLANT + more)
        plants.append(read_plant(file))

    def port_of(line):
        if line.name == "shed":
            raise UsageError("line shed has no port")
        return lambda: VirtualPlant(plants[0]).line(line.name).port()

    core = Core(plants[0], session="this run", audit=NoteBook(), port_of=port_of)
    async with core:
        for plant in (plants[1], plants[2], plants[0]):
            await core.changed(plant)
            assert set(core.lines) == {"hall", "yard"}
        assert "line shed has no port" in {event.text for event in core.table.events()}


@awaited
async def test_story_keeps_the_latest_items_in_order():
    story, heard = MotorStory(), []
    for number in range(MOST_TOLD + 50):
        story.tell({"number": number})

    async def listen():
        nonlocal heard
        async for item in story:
            heard += (item["number"],)

    listening = asyncio.create_task(listen())
    await until(lambda: len(heard) == MOST_TOLD)
    for number in range(MOST_TOLD + 50, 3 * MOST_TOLD):
        story.tell({"number": number})
        await asyncio.sleep(0)
    story.end()
    await asyncio.wait_for(listening, 5)
    assert heard == list(range(50, 3 * MOST_TOLD))
    assert len(story._told) == MOST_TOLD
