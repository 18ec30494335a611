"""Stops that a door demands until it releases them: starts are refused, and a running motor is stopped again."""

import asyncio
import time

import pytest
from cut_lines import cut_core, event_texts, run, stops_sent
from served_core import ENGINEER, OPERATOR, asked, awaited, runs, until

from drivecomm.errors import LeaseError
from drivecomm.protocol import Stop
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.stop_demands import AGAIN_FIRST_S, StopDemands
from drivecomm.server.table import ValueTable


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def sent():
    return []


@pytest.fixture
def demands(clock, sent):
    return StopDemands(ValueTable(lambda *_: None), lambda *what: sent.append(what), clock)


class TestRules:
    def test_start_is_refused_until_every_demand_is_released(self, demands):
        ends = [demands.hold("fan", Stop.RAMP, "10.0.0.4 (modbus-tcp)"), demands.hold("fan", Stop.COAST, "10.0.0.5")]
        for end in ends:
            with pytest.raises(LeaseError, match="fan is not started while a stop of it is demanded by 10"):
                demands.check("fan")
            end()
            # A second release has no effect.
            end()
        demands.check("fan")
        assert demands.of("fan", None) is None

    def test_other_drives_may_be_started(self, demands):
        demands.hold("fan", Stop.RAMP, "plc")
        demands.check("pump")

    def test_drive_that_runs_again_is_stopped_immediately(self, demands, sent):
        demands.hold("fan", Stop.QUICK, "plc")
        demands.seen("fan", running=False)
        assert demands.of("fan", None).confirmed
        demands.seen("fan", running=True)
        assert sent == [("fan", Stop.QUICK, "plc")]
        assert not demands.of("fan", None).confirmed
        demands.seen("fan", running=False)
        assert demands.of("fan", None).confirmed

    def test_drive_that_ramps_down_gets_repeated_stops_at_growing_intervals(self, demands, sent, clock):
        demands.hold("fan", Stop.RAMP, "plc")
        for _ in range(100):
            demands.seen("fan", running=True)
        assert not sent
        assert demands.of("fan", None).confirmed
        for _ in range(100):
            clock.now += AGAIN_FIRST_S
            demands.seen("fan", running=True)
        assert 10 <= len(sent) <= 15

    def test_no_stop_is_sent_after_the_demand_is_released(self, demands, sent):
        demands.hold("fan", Stop.RAMP, "plc")()
        demands.seen("fan", running=False)
        demands.seen("fan", running=True)
        assert not sent


@awaited
async def test_drive_started_despite_a_demand_is_stopped_until_its_release(tmp_path):
    async with cut_core(tmp_path) as (core, control, _):
        plant = PlantForDoors(core, "hall")
        release = plant.hold_stop(OPERATOR, "fan", "ramp")
        await until(lambda: core.drive("fan").standing_stop is not None)
        stands = core.drive("fan").standing_stop
        assert (stands.demanded, stands.confirmed, stands.who) == (True, True, str(OPERATOR))
        answer = await asked(core, ENGINEER, "fan", "start")
        assert (answer.outcome, type(answer.error)) == ("refused", LeaseError)
        assert str(OPERATOR) in str(answer.error)
        sent = stops_sent(core)
        polled = core.lines["yard"].state().polls
        await until(lambda: core.lines["yard"].state().polls > polled)
        # Simulates a start by another master, or at the keypad.
        await core.lines["yard"].drive("fan").start()
        await until(lambda: sent)
        await until(lambda: not runs(control, "fan"), 15)
        assert any(text.startswith("runs although a stop is demanded") for text in event_texts(core, "warning"))
        release()
        await until(lambda: core.drive("fan").standing_stop is None)
        await run(core)


STARTS = {
    "start": {},
    "reverse": {},
    "jog": {},
    "keep": {"policy": "ramp"},
    "call": {"verb": "control_word", "word": 0x047C},
}


@pytest.mark.parametrize("verb", STARTS)
@awaited
async def test_demand_refuses_every_verb_that_may_start_the_motor(tmp_path, verb):
    async with cut_core(tmp_path) as (core, control, _):
        core.stop_demands.hold("fan", Stop.RAMP, "plc")
        lease = core.leases.take(ENGINEER, "fan", 30, now=time.monotonic(), time_s=time.time())
        answer = await asked(core, ENGINEER, "fan", verb, arguments=STARTS[verb], lease=lease.key)
        assert (answer.outcome, "demanded by plc" in str(answer.error)) == ("refused", True), answer.error
        for other, arguments in (("set_reference", {"percent": 40}), ("reset", {}), ("stop", {})):
            answer = await asked(core, ENGINEER, "fan", other, arguments=arguments, lease=lease.key)
            assert answer.outcome == "done", answer.error
        assert not runs(control, "fan")


@awaited
async def test_waiting_start_is_refused_by_a_later_demand(tmp_path):
    class Gate:
        def __init__(self, trail):
            self._trail, self.open, self.waits = trail, asyncio.Event(), asyncio.Event()

        def __getattr__(self, name):
            return getattr(self._trail, name)

        async def record_command(self, *given):
            self.waits.set()
            await self.open.wait()
            return await self._trail.record_command(*given)

    async with cut_core(tmp_path) as (core, control, _):
        core.audit = gate = Gate(core.audit)
        starting = asyncio.create_task(asked(core, ENGINEER, "fan", "start"))
        await gate.waits.wait()
        core.stop_demands.hold("fan", Stop.RAMP, "plc")
        gate.open.set()
        answer = await starting
        assert (answer.outcome, type(answer.error)) == ("refused", LeaseError)
        assert not runs(control, "fan")
