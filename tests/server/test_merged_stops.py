"""Repeated stops of one drive are merged into one job on its line, and every caller gets the result."""

import asyncio
from contextlib import asynccontextmanager

from cut_lines import cut_core, run, stops_sent
from served_core import ENGINEER, OPERATOR, VIEWER, asked, awaited, runs, until

from drivecomm.line import Rank
from drivecomm.protocol import Stop
from drivecomm.server import merged_stops
from drivecomm.server.merged_stops import MergedStops, StopKey

RAMP = StopKey("yard", "danfoss-fc:3", Stop.RAMP)


@asynccontextmanager
async def busy(core):
    """Occupy the line during the block."""
    bus = core.lines["yard"].bus
    turn = await asyncio.create_task(bus.line.taken(Rank.COMMAND))
    try:
        yield
    finally:
        bus.line.turns.give_back(turn)


class Line:
    """Line that sends stops when the test allows it. begun: jobs that wait for it or are being sent."""

    def __init__(self):
        self.begun, self.ends = [], asyncio.Event()

    async def send(self, job):
        self.begun.append(job)
        await self.ends.wait()


async def turns():
    for _ in range(10):
        await asyncio.sleep(0)


class TestOnALine:
    @awaited
    async def test_stops_requested_while_the_line_is_busy_share_one_telegram(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, _):
            await run(core)
            sent = stops_sent(core)
            async with busy(core):
                asking = [
                    asyncio.create_task(asked(core, caller, "fan", "stop", id=str(number)))
                    for number, caller in enumerate((VIEWER, OPERATOR, ENGINEER) * 20)
                ]
                await turns()
            answers = await asyncio.gather(*asking)
            assert {each.outcome for each in answers} == {"done"}
            assert [each.id for each in answers] == [str(number) for number in range(60)]
            assert sent == ["danfoss-fc:3"]
            # The audit has one record per caller, however often the stop is repeated.
            assert core.audit.stops == [("fan", "ramp")] * 3
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_silent_drive_gets_at_most_two_jobs_for_many_callers(self, tmp_path):
        async with cut_core(tmp_path) as (core, _, cable):
            cable.deaf = True
            sent = stops_sent(core)
            first = asyncio.create_task(asked(core, VIEWER, "fan", "stop"))
            await until(lambda: sent)
            answers = await asyncio.gather(*(asked(core, VIEWER, "fan", "stop") for _ in range(60)))
            assert {each.outcome for each in (await first, *answers)} == {"open"}
            # Each job may take a separate turn for each of its attempts.
            assert len(sent) <= 4

    @awaited
    async def test_another_kind_of_stop_is_a_separate_job(self, tmp_path):
        async with cut_core(tmp_path) as (core, _, _cable):
            sent = stops_sent(core)
            async with busy(core):
                asking = [
                    asyncio.create_task(asked(core, VIEWER, "fan", "stop", arguments={"how": how}))
                    for how in ("ramp", "coast")
                ]
                await turns()
            assert {each.outcome for each in await asyncio.gather(*asking)} == {"done"}
            assert len(sent) == 2

    @awaited
    async def test_stop_right_after_a_start_is_sent_immediately(self, tmp_path, monkeypatch):
        monkeypatch.setattr(merged_stops, "STOP_REST_S", 600.0)
        async with cut_core(tmp_path) as (core, control, _):
            assert (await asked(core, VIEWER, "fan", "stop")).outcome == "done"
            await run(core)
            async with asyncio.timeout(5):
                assert (await asked(core, VIEWER, "fan", "stop")).outcome == "done"
            await until(lambda: not runs(control, "fan"), 15)


class TestRules:
    @awaited
    async def test_stop_joins_a_job_until_its_telegram_is_sent(self):
        line, stops = Line(), MergedStops()
        first = stops.job(RAMP, line.send)
        await turns()
        assert stops.job(RAMP, line.send) is first
        first.goes_out()
        later = stops.job(RAMP, line.send)
        assert later is not first
        assert stops.job(RAMP, line.send) is later
        await stops.close()

    @awaited
    async def test_flood_of_stops_pauses_between_two_jobs(self, monkeypatch):
        monkeypatch.setattr(merged_stops, "STOP_REST_S", 600.0)
        line, stops = Line(), MergedStops()
        first = stops.job(RAMP, line.send)
        await turns()
        first.goes_out()
        line.ends.set()
        later = stops.job(RAMP, line.send)
        await turns()
        assert first.task.done()
        assert line.begun == [first]
        # A stop requested before a command has to be sent before that command.
        stops.commanded("yard")
        await turns()
        assert line.begun == [first, later]
        await stops.close()

    @awaited
    async def test_pause_ends_and_applies_to_one_kind_and_drive(self, monkeypatch):
        monkeypatch.setattr(merged_stops, "STOP_REST_S", 0.01)
        line, stops = Line(), MergedStops()
        line.ends.set()
        await stops.job(RAMP, line.send).task
        coast, other = RAMP._replace(how=Stop.COAST), RAMP._replace(drive="danfoss-fc:4")
        begun = [stops.job(coast, line.send), stops.job(other, line.send)]
        await turns()
        assert line.begun[1:] == begun
        async with asyncio.timeout(5):
            await stops.job(RAMP, line.send).task
        await stops.close()

    @awaited
    async def test_failed_job_fails_for_all_callers_and_accepts_no_more(self):
        async def send(_):
            raise OSError(24, "no descriptors")

        stops = MergedStops()
        jobs = [stops.job(RAMP, send) for _ in range(3)]
        results = await asyncio.gather(*(each.task for each in jobs), return_exceptions=True)
        assert [type(each) for each in results] == [OSError] * 3
        assert stops.job(RAMP, send) not in jobs
        await stops.close()
