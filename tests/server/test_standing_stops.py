"""Standing stops: an unconfirmed stop is retried until the drive confirms it, is started again, or is removed."""

import asyncio
from contextlib import suppress
from dataclasses import replace

import pytest
from cut_lines import FAN, FAN_AND_MIXER, cut_core, event_texts, run, stops_sent
from served_core import ENGINEER, OPERATOR, VIEWER, asked, awaited, runs, until

from drivecomm.errors import NoReplyError, OvertakenError, StateError
from drivecomm.protocol import Stop
from drivecomm.server import standing_stops
from drivecomm.server.commands import CommandExecutor
from drivecomm.server.standing_stops import StandingStops
from drivecomm.server.table import ValueTable

RETRYING = "stop (ramp) not confirmed; retrying until the drive answers: "


async def stop(core, drive="fan", caller=VIEWER, **arguments):
    """Request a stop that is not confirmed; return its result."""
    answer = await asked(core, caller, drive, "stop", arguments=arguments)
    assert answer.outcome == "open"
    return answer


class TestOnALine:
    @awaited
    async def test_stop_missed_by_a_silent_drive_is_sent_when_it_answers(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, cable):
            await run(core)
            cable.deaf = True
            answer = await stop(core)
            assert isinstance(answer.error, NoReplyError)
            stands = core.drive("fan").standing_stop
            assert (stands.how, stands.who, stands.confirmed) == (Stop.RAMP, str(VIEWER), False)
            assert [text.startswith(RETRYING) for text in event_texts(core, "warning")] == [True]
            assert runs(control, "fan")
            cable.deaf = False
            await until(lambda: not runs(control, "fan"), 15)
            await until(lambda: core.drive("fan").standing_stop is None)
            assert "stop (ramp) confirmed" in event_texts(core, "command")

    @awaited
    async def test_running_status_sends_the_standing_stop_immediately(self, tmp_path, monkeypatch):
        for pause in ("AGAIN_FIRST_S", "AGAIN_LONGEST_S"):
            monkeypatch.setattr(standing_stops, pause, 600.0)
        async with cut_core(tmp_path) as (core, control, cable):
            await run(core)
            cable.deaf = True
            await stop(core)
            cable.deaf = False
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_confirmed_stop_is_not_sent_again_while_the_motor_ramps_down(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, _):
            await run(core)
            await until(lambda: core.drive("fan").status.at_reference, 15)
            sent = stops_sent(core)
            assert (await asked(core, VIEWER, "fan", "stop")).outcome == "done"
            statuses = []
            seen = core.lines["yard"]._status_seen
            core.lines["yard"]._status_seen = lambda drive, status: (
                statuses.append(status.running),
                seen(drive, status),
            )
            await until(lambda: not runs(control, "fan"), 15)
            assert statuses.count(True) > 5
            assert sent == ["danfoss-fc:3"]
            assert not event_texts(core, "warning")

    @awaited
    async def test_stop_on_an_unplugged_port_is_sent_when_the_port_returns(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, cable):
            await run(core)
            cable.pulled = True
            await until(lambda: not core.lines["yard"].state().up)
            await stop(core)
            cable.pulled = False
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_stop_works_after_a_failed_opening(self, tmp_path):
        async with cut_core(tmp_path, pulled=True) as (core, _, cable):
            await stop(core)
            cable.pulled = False
            await until(lambda: core.lines["yard"].state().up, 15)
            assert (await asked(core, VIEWER, "fan", "stop")).outcome == "done"
            assert core.drive("fan").standing_stop is None

    @awaited
    async def test_unsupported_kind_of_stop_stands_as_a_ramp(self, tmp_path):
        """The kinds that the drive supports are unknown while its line is closed."""
        text = FAN.replace("danfoss-fc:3", "vabus:1").replace('"fc302"', '"agile"')
        async with cut_core(tmp_path, text, pulled=True) as (core, _, cable):
            await stop(core, how="dc_brake")
            cable.pulled = False
            await until(lambda: core.drive("fan").standing_stop is None, 15)
            assert any(text.endswith("confirmed") for text in event_texts(core, "command"))

    @pytest.mark.parametrize("how", ["coast", "quick"])
    @awaited
    async def test_stop_is_retried_with_the_requested_kind(self, tmp_path, how):
        async with cut_core(tmp_path) as (core, _, cable):
            hows, operations = [], core.lines["yard"].drive("fan")._exchanges.operations
            send = operations.stop
            cable.deaf = True
            await stop(core, how=how)
            assert core.drive("fan").standing_stop.how is Stop(how)
            operations.stop = lambda how: hows.append(how) or send(how)
            cable.deaf = False
            await until(lambda: core.drive("fan").standing_stop is None, 15)
            assert set(hows) == {Stop(how)}

    @awaited
    async def test_later_stop_replaces_the_retried_kind(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, cable):
            await run(core)
            hows, operations = [], core.lines["yard"].drive("fan")._exchanges.operations
            send = operations.stop
            operations.stop = lambda how: hows.append(how) or send(how)
            cable.deaf = True
            await stop(core)
            await stop(core, how="coast", caller=OPERATOR)
            assert core.drive("fan").standing_stop.how is Stop.COAST
            cable.deaf = False
            await until(lambda: core.drive("fan").standing_stop is None, 15)
            assert Stop.RAMP in hows
            assert set(hows[hows.index(Stop.COAST) :]) == {Stop.COAST}
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_confirmed_later_stop_ends_the_standing_stop(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, cable):
            cable.deaf = True
            await stop(core)
            cable.deaf = False
            assert (await asked(core, VIEWER, "fan", "stop", arguments={"how": "coast"})).outcome == "done"
            assert core.drive("fan").standing_stop is None
            sent = stops_sent(core)
            await run(core)
            await until(lambda: core.drive("fan").status.at_reference, 15)
            assert not sent
            assert runs(control, "fan")

    @awaited
    async def test_broadcast_stop_stands_for_each_drive_of_the_plant(self, tmp_path):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, control, cable):
            await run(core)
            cable.deaf = True
            # No drive replies to a broadcast, so the failure is not noticed.
            answer = await asked(core, ENGINEER, "danfoss-fc:*", "stop", line="yard")
            assert answer.outcome == "done"
            await until(lambda: len(event_texts(core, "warning")) == 2)
            assert [each.standing_stop is not None for each in core.drives()] == [True, True]
            cable.deaf = False
            await until(lambda: [each.standing_stop for each in core.drives()] == [None, None], 15)
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_broadcast_that_all_drives_confirm_causes_no_warning(self, tmp_path):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, _, _cable):
            sent = stops_sent(core)
            assert (await asked(core, ENGINEER, "danfoss-fc:*", "stop", line="yard")).outcome == "done"
            await until(lambda: len(sent) == 3)
            await until(lambda: not core.standing_stops.drives)
            assert not event_texts(core, "warning")

    @awaited
    async def test_stop_of_all_stands_for_drives_that_did_not_confirm(self, tmp_path):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, control, cable):
            await run(core)
            cable.deaf = True
            told = await CommandExecutor(core).stop_all(VIEWER, Stop.RAMP)
            assert {each.answer.outcome for each in told} == {"open"}
            assert all(each.standing_stop for each in core.drives())
            cable.deaf = False
            await until(lambda: not any(each.standing_stop for each in core.drives()), 15)
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_new_start_ends_the_standing_stop(self, tmp_path, monkeypatch):
        monkeypatch.setattr(standing_stops, "AGAIN_FIRST_S", 600.0)
        monkeypatch.setattr(standing_stops, "AGAIN_LONGEST_S", 600.0)
        # No status is polled, which would trigger the stop.
        async with cut_core(tmp_path, status_period_s=600) as (core, control, cable):
            cable.deaf = True
            await stop(core)
            cable.deaf = False
            sent = stops_sent(core)
            await run(core)
            assert core.drive("fan").standing_stop is None
            assert any("was started by eva (local)" in text for text in event_texts(core, "warning"))
            assert not sent
            assert runs(control, "fan")

    @awaited
    async def test_unconfirmed_start_keeps_the_standing_stop(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, cable):
            await run(core)
            cable.deaf = True
            await stop(core)
            assert (await asked(core, ENGINEER, "fan", "start")).outcome in ("open", "failed")
            assert core.drive("fan").standing_stop is not None
            cable.deaf = False
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_reload_keeps_the_standing_stop_of_an_unchanged_drive(self, tmp_path):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, control, cable):
            await run(core)
            cable.deaf = True
            await stop(core)
            await core.changed(replace(core.plant, drives=core.plant.drives[:1]))
            assert core.drive("fan").standing_stop is not None
            cable.deaf = False
            await until(lambda: not runs(control, "fan"), 15)

    @pytest.mark.parametrize("change", ["gone", "another address"])
    @awaited
    async def test_removed_drive_ends_its_standing_stop_with_an_event(self, tmp_path, change):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, _, cable):
            cable.deaf = True
            await stop(core)
            fan, mixer = core.plant.drives
            drives = (mixer,) if change == "gone" else (replace(fan, address=5), mixer)
            await core.changed(replace(core.plant, drives=drives))
            assert core.standing_stops.of("fan") is None
            assert any(
                "is retried no longer: the plant file was read again" in text for text in event_texts(core, "warning")
            )

    @awaited
    async def test_shutdown_retries_standing_stops_once_and_names_the_rest(self, tmp_path):
        async with cut_core(tmp_path) as (core, _, cable):
            cable.deaf = True
            await stop(core)
            sent = stops_sent(core)
            await core.release_all()
            assert sent
            assert "stop (ramp) was not confirmed, and is retried no longer: the server ends" in event_texts(
                core, "warning"
            )
            assert (await asked(core, VIEWER, "fan", "stop")).outcome == "open"
            assert core.standing_stops.of("fan") is None
        assert asyncio.all_tasks() == {asyncio.current_task()}


class Drive:
    """Counter of stop attempts, each of which raises `error`, or is confirmed if it is None."""

    def __init__(self, error):
        self.error, self.hows = error, []
        self.table = ValueTable(lambda *_: None)
        self.stops = StandingStops(self.table, self.send)

    async def send(self, drive, how):
        self.hows.append(how)
        self.stops.sent([drive], how)
        if self.error is not None:
            raise self.error
        self.stops.confirmed(drive)


class TestRules:
    @pytest.mark.parametrize("error", [StateError("no"), OvertakenError("later"), OSError(24, "no descriptors")])
    @awaited
    async def test_stop_stands_after_any_error_until_confirmed(self, monkeypatch, error):
        monkeypatch.setattr(standing_stops, "AGAIN_FIRST_S", 0.01)
        monkeypatch.setattr(standing_stops, "LEAST_GAP_S", 0.01)
        drive = Drive(error)
        drive.stops.stand("fan", Stop.QUICK, "x", drive.stops.sent(["fan"], Stop.QUICK), error)
        await until(lambda: len(drive.hows) > 1)
        assert drive.stops.of("fan").how is Stop.QUICK
        drive.error = None
        async with asyncio.timeout(5):
            await drive.stops.until_over("fan")
        assert drive.stops.of("fan") is None

    @awaited
    async def test_earlier_stop_does_not_stand_after_a_later_stop(self):
        drive = Drive(NoReplyError("silent"))
        earlier = drive.stops.sent(["fan"], Stop.RAMP)
        drive.stops.sent(["fan"], Stop.COAST)
        drive.stops.stand("fan", Stop.RAMP, "x", earlier, drive.error)
        assert drive.stops.of("fan") is None

    @awaited
    async def test_standing_stop_waits_for_a_start_and_is_sent_if_the_start_fails(self):
        drive = Drive(NoReplyError("silent"))
        drive.stops.stand("fan", Stop.RAMP, "x", drive.stops.sent(["fan"], Stop.RAMP), drive.error)
        with suppress(ZeroDivisionError), drive.stops.giving_way("fan", "eva"):
            drive.stops.seen("fan", running=True)
            for _ in range(20):
                await asyncio.sleep(0)
            assert not drive.hows
            raise ZeroDivisionError
        drive.error = None
        await until(lambda: drive.hows == [Stop.RAMP], 0.4)
        assert drive.stops.of("fan") is None

    @awaited
    async def test_stop_requested_during_a_start_stands_after_it(self):
        drive = Drive(NoReplyError("silent"))
        drive.stops.stand("fan", Stop.RAMP, "x", drive.stops.sent(["fan"], Stop.RAMP), drive.error)
        with drive.stops.giving_way("fan", "eva"):
            drive.stops.stand("fan", Stop.RAMP, "x", drive.stops.sent(["fan"], Stop.RAMP), drive.error)
        assert drive.stops.of("fan") is not None
        await drive.stops.finish()

    @awaited
    async def test_standing_stops_of_many_silent_drives_leave_half_of_the_line_free(self, monkeypatch):
        for pause in ("AGAIN_FIRST_S", "AGAIN_LONGEST_S", "LEAST_GAP_S"):
            monkeypatch.setattr(standing_stops, pause, 0.001)
        drive, took = Drive(NoReplyError("silent")), []
        loop = asyncio.get_running_loop()
        stops = StandingStops(drive.table, lambda *_: unanswered())

        async def unanswered():
            began_s = loop.time()
            await asyncio.sleep(0.01)
            took.append(loop.time() - began_s)
            raise drive.error

        for number in range(5):
            stops.stand(f"fan {number}", Stop.RAMP, "x", stops.sent([f"fan {number}"], Stop.RAMP), drive.error)
        began_s = loop.time()
        await until(lambda: len(took) >= 20, 30)
        # Without pauses between attempts the line would be busy all the time.
        assert sum(took) < 0.5 * (loop.time() - began_s)
        await stops.finish()

    @awaited
    async def test_refusing_drive_gets_no_stop_with_each_status_while_at_rest(self):
        drive = Drive(StateError("no"))
        drive.stops.stand("fan", Stop.RAMP, "x", drive.stops.sent(["fan"], Stop.RAMP), drive.error)
        for _ in range(50):
            drive.stops.seen("fan", running=False)
            await asyncio.sleep(0)
        assert not drive.hows
        await drive.stops.finish()
