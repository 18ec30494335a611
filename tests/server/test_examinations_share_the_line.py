"""Examination of a line in use: reads, polls and stops run in between, and no drive is reported silent."""

import asyncio
import logging
from functools import partial

import pytest
from served_core import OPERATOR, VIEWER, asked, awaited, core_of, until

from drivecomm.server.line_examination import examination


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


@awaited
async def test_doctor_shares_the_line_with_polls_and_finds_the_drives(core):
    async with core() as (served, _):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        line, told, findings = served.lines["yard"], [], []
        before = line.state().polls

        async def examine():
            # The addresses without a drive make the examination last for seconds.
            choices = {"only": ["danfoss-fc"], "addresses": list(range(20, 40)), "probes": 20, "search": False}
            async for item in examination(served, "yard", "doctor", choices):
                told.append(item)
                findings.extend([item["finding"]] if "finding" in item else [])

        examining = asyncio.create_task(examine())
        await until(lambda: any("asking" in str(each) for each in told), 20.0)
        while not examining.done():
            reading = await asked(served, VIEWER, "fan", "read", arguments={"parameter": "output_frequency"})
            assert reading.outcome == "done", reading.error
            stopping = await asked(served, OPERATOR, "fan", "stop")
            assert stopping.outcome == "done", stopping.error
            assert {each.reachability for each in served.drives() if each.line == "yard"} == {"answers"}
            await asyncio.sleep(0.1)
        await examining
        assert line.state().polls > before + 10
        assert not [each for each in findings if each["weight"] == "problem"], findings
        assert len(told[-1]["measured"]["replies"]) == 2


@awaited
async def test_abandoned_examination_ends_without_an_error(core, caplog):
    errors = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: errors.append(context))
    async with core() as (served, _):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        line = served.lines["yard"]
        for at_once in (True, False):
            found = examination(served, "yard", "doctor", {"only": ["danfoss-fc"], "probes": 1000})
            async for item in found:
                if at_once or "asking" in str(item):
                    break
            await found.aclose()
            await until(lambda: not line.bus.line.queue.waiting)
            assert (await asked(served, OPERATOR, "fan", "stop")).outcome == "done"
    assert not errors
    assert not [each for each in caplog.records if each.levelno >= logging.ERROR]


@awaited
async def test_doctor_reads_the_front_panel_settings_of_drives_on_its_line(core):
    async with core() as (served, _):
        choices = {"only": ["danfoss-fc"], "addresses": [3], "probes": 2, "search": False}
        told = [item async for item in examination(served, "yard", "doctor", choices)]
        panel = [item["finding"] for item in told if item.get("finding", {}).get("about") == "panel"]
        # A start sets the watchdog of this drive, and the other drive has no model.
        assert [each["weight"] for each in panel] == ["note", "fine"]
        assert {each["drive_name"] for each in told[-1]["measured"]["panel"]} == {"fan"}
