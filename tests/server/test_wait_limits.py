"""Waits for a state of a drive: polled with the lowest priority, ended with their caller, limited in number."""

import asyncio
import time

import pytest
from served_core import ENGINEER, PLANT, VIEWER, asked, awaited, core_of, until

from drivecomm.bus import AsyncDrive
from drivecomm.errors import OvertakenError
from drivecomm.line import FRESH
from drivecomm.server import CommandRequest
from drivecomm.server.commands import CommandExecutor
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.wait_limits import LONGEST_S, MOST

PACED = PLANT.replace("paced = false\n", "").replace("period_s = 0.05", "period_s = 0.2")


def waiting(**further):
    return CommandRequest(drive="pump", verb="wait", arguments={"goal": "fault", "timeout_s": 60, **further})


@pytest.mark.soak
@awaited
async def test_polls_continue_beside_many_waits_which_end_with_their_callers(tmp_path):
    async with core_of(tmp_path, PACED, status_period_s=0.2) as (core, _):
        plant = PlantForDoors(core, "hall")
        await until(lambda: core.drive("pump").reachability == "answers")
        before = asyncio.all_tasks()
        callers = [
            asyncio.create_task(plant.command(VIEWER, CommandRequest(drive="pump", verb="wait", id=f"{number}",
                                                              arguments={"goal": "fault", "timeout_s": 60})))
            for number in range(MOST)
        ]  # fmt: skip
        await asyncio.sleep(0.1)
        found = []
        end = core.table.listen(lambda values, _: found.extend(each for each in values if each.drive == "pump"))
        await asyncio.sleep(1.0)
        end()
        assert len([each for each in found if each.name == "output_frequency"]) >= 3
        assert {each.quality for each in found} <= FRESH
        for each in callers:
            each.cancel()
        await asyncio.gather(*callers, return_exceptions=True)
        await asyncio.sleep(0.1)
        assert not {each for each in asyncio.all_tasks() - before if "carry_out" in repr(each)}
        questions = core.drive("pump").counters["requests"]
        await asyncio.sleep(0.2)
        assert core.drive("pump").counters["requests"] - questions < 6


@pytest.mark.soak
@awaited
async def test_wait_ends_at_its_goal_or_its_timeout(tmp_path):
    async with core_of(tmp_path) as (core, control):
        await until(lambda: core.drive("pump").status)
        state = core.drive("pump").status.state
        answer = await asked(core, VIEWER, "pump", "wait", arguments={"goal": state.value})
        assert (answer.outcome, answer.result.state) == ("done", state)
        late = asyncio.create_task(CommandExecutor(core).carry_out(VIEWER, waiting()))
        await asyncio.sleep(0.02)
        control.order("trip", drive="pump", code=3)
        assert (await late).outcome == "done"
        answer = await asked(core, VIEWER, "fan", "wait", arguments={"goal": "running", "timeout_s": 0.2})
        assert (answer.outcome, "did not reach 'running'" in str(answer.error)) == ("failed", True)


@pytest.mark.parametrize(
    ("wanted", "sentence"),
    [
        (waiting(timeout_s=LONGEST_S + 1), "timeout_s is at most 600"),
        (waiting(timeout_s="soon"), "invalid timeout_s = 'soon'"),
        (waiting(goal="asleep"), "cannot wait for 'asleep'"),
        (waiting(hours=1), "unknown key 'hours'"),
    ],
)
@awaited
async def test_invalid_wait_is_refused(tmp_path, wanted, sentence):
    async with core_of(tmp_path) as (core, _):
        answer = await CommandExecutor(core).carry_out(VIEWER, wanted)
        assert answer.outcome == "refused"
        assert sentence in str(answer.error)


@awaited
async def test_wait_continues_after_a_stop_overtakes_its_status_request(tmp_path, monkeypatch):
    asked = []

    def to_status(drive, rank):
        asked.append(rank)
        if len(asked) == 1:
            raise OvertakenError("a stop went first")
        return real(drive, rank)

    async with core_of(tmp_path) as (core, _):
        await until(lambda: core.drive("pump").status)
        real = AsyncDrive.to_status
        monkeypatch.setattr(AsyncDrive, "to_status", to_status)
        goal = core.drive("pump").status.state.value
        answer = await CommandExecutor(core).carry_out(VIEWER, waiting(goal=goal))
        assert answer.outcome == "done"


@awaited
async def test_wait_for_a_broadcast_address_is_refused(tmp_path):
    async with core_of(tmp_path) as (core, _):
        everybody = CommandRequest(drive="danfoss-fc:*", line="yard", verb="wait", arguments={"goal": "ready"})
        answer = await CommandExecutor(core).carry_out(ENGINEER, everybody)
        assert "wait for each drive" in str(answer.error)


@pytest.mark.soak
@awaited
async def test_number_of_waits_for_a_drive_is_limited(tmp_path):
    async with core_of(tmp_path) as (core, _):
        commands = CommandExecutor(core)
        callers = [asyncio.create_task(commands.carry_out(VIEWER, waiting())) for _ in range(MOST)]
        await asyncio.sleep(0.1)
        answer = await commands.carry_out(VIEWER, waiting())
        assert answer.outcome == "refused"
        assert "wait for vabus:1 already" in str(answer.error)
        callers[0].cancel()
        await asyncio.gather(callers[0], return_exceptions=True)
        began = time.monotonic()
        answer = await commands.carry_out(VIEWER, waiting(timeout_s=0))
        assert answer.outcome == "failed"
        assert time.monotonic() - began < 5
        for each in callers:
            each.cancel()
        await asyncio.gather(*callers, return_exceptions=True)
