"""A stop that was not confirmed stands: it is retried until the drive confirms it, or is started anew, or is gone."""

import asyncio
from contextlib import suppress
from dataclasses import replace

import pytest
from cut_lines import FAN, FAN_AND_MIXER, cut_core, run, said, stops_sent
from served_core import ENGINEER, OPERATOR, VIEWER, asked, awaited, runs, until

from drivecomm.errors import NoReplyError, OvertakenError, StateError
from drivecomm.protocol import Stop
from drivecomm.server import standing_stops
from drivecomm.server.commands import Commands
from drivecomm.server.standing_stops import StandingStops
from drivecomm.server.table import Table

RETRYING = "stop (ramp) not confirmed; retrying until the drive answers: "


async def stop(core, drive="fan", caller=VIEWER, **arguments):
    """Ask for a stop that is not confirmed."""
    answer = await asked(core, caller, drive, "stop", arguments=arguments)
    assert answer.outcome == "open"
    return answer


class TestOnALine:
    @awaited
    async def test_stop_that_a_silent_drive_missed_goes_out_when_it_answers(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, cable):
            await run(core)
            cable.deaf = True
            answer = await stop(core)
            assert isinstance(answer.error, NoReplyError)
            stands = core.drive("fan").standing_stop
            assert (stands.how, stands.who, stands.confirmed) == (Stop.RAMP, str(VIEWER), False)
            assert [text.startswith(RETRYING) for text in said(core, "warning")] == [True]
            assert runs(control, "fan")
            cable.deaf = False
            await until(lambda: not runs(control, "fan"), 15)
            await until(lambda: core.drive("fan").standing_stop is None)
            assert "stop (ramp) confirmed" in said(core, "command")

    @awaited
    async def test_status_that_says_running_sends_it_without_waiting(self, tmp_path, monkeypatch):
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
            assert not said(core, "warning")

    @awaited
    async def test_stop_of_a_pulled_port_goes_out_when_it_is_back(self, tmp_path):
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
    async def test_kind_that_the_drive_lacks_stands_as_a_ramp(self, tmp_path):
        """Nobody could ask the drive while its line was not open."""
        text = FAN.replace("danfoss-fc:3", "vabus:1").replace('"fc302"', '"agile"')
        async with cut_core(tmp_path, text, pulled=True) as (core, _, cable):
            await stop(core, how="dc_brake")
            cable.pulled = False
            await until(lambda: core.drive("fan").standing_stop is None, 15)
            assert any(text.endswith("confirmed") for text in said(core, "command"))

    @pytest.mark.parametrize("how", ["coast", "quick"])
    @awaited
    async def test_stop_is_retried_by_the_kind_that_was_asked_for(self, tmp_path, how):
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
    async def test_later_stop_replaces_the_kind_that_is_retried(self, tmp_path):
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
    async def test_later_stop_that_is_confirmed_ends_it(self, tmp_path):
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
    async def test_stop_of_all_of_a_protocol_stands_for_each_drive_of_the_plant(self, tmp_path):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, control, cable):
            await run(core)
            cable.deaf = True
            # A broadcast is answered by none, so it does not find out.
            answer = await asked(core, ENGINEER, "danfoss-fc:*", "stop", line="yard")
            assert answer.outcome == "done"
            await until(lambda: len(said(core, "warning")) == 2)
            assert [each.standing_stop is not None for each in core.drives()] == [True, True]
            cable.deaf = False
            await until(lambda: [each.standing_stop for each in core.drives()] == [None, None], 15)
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_broadcast_that_all_drives_confirm_is_no_warning(self, tmp_path):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, _, _cable):
            sent = stops_sent(core)
            assert (await asked(core, ENGINEER, "danfoss-fc:*", "stop", line="yard")).outcome == "done"
            await until(lambda: len(sent) == 3)
            await until(lambda: not core.standing_stops.drives)
            assert not said(core, "warning")

    @awaited
    async def test_stop_of_everything_stands_where_it_was_not_confirmed(self, tmp_path):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, control, cable):
            await run(core)
            cable.deaf = True
            told = await Commands(core).stop_all(VIEWER, Stop.RAMP)
            assert {each.answer.outcome for each in told} == {"open"}
            assert all(each.standing_stop for each in core.drives())
            cable.deaf = False
            await until(lambda: not any(each.standing_stop for each in core.drives()), 15)
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_start_anew_ends_it(self, tmp_path, monkeypatch):
        monkeypatch.setattr(standing_stops, "AGAIN_FIRST_S", 600.0)
        monkeypatch.setattr(standing_stops, "AGAIN_LONGEST_S", 600.0)
        # Nothing is polled that would wake the stop up.
        async with cut_core(tmp_path, status_period_s=600) as (core, control, cable):
            cable.deaf = True
            await stop(core)
            cable.deaf = False
            sent = stops_sent(core)
            await run(core)
            assert core.drive("fan").standing_stop is None
            assert any("was started by eva (local)" in text for text in said(core, "warning"))
            assert not sent
            assert runs(control, "fan")

    @awaited
    async def test_start_that_is_not_confirmed_lets_it_go_out(self, tmp_path):
        async with cut_core(tmp_path) as (core, control, cable):
            await run(core)
            cable.deaf = True
            await stop(core)
            assert (await asked(core, ENGINEER, "fan", "start")).outcome in ("open", "failed")
            assert core.drive("fan").standing_stop is not None
            cable.deaf = False
            await until(lambda: not runs(control, "fan"), 15)

    @awaited
    async def test_plant_file_that_is_read_again_changes_nothing_for_the_same_drive(self, tmp_path):
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
    async def test_drive_that_leaves_the_plant_ends_it_with_an_event(self, tmp_path, change):
        async with cut_core(tmp_path, FAN_AND_MIXER) as (core, _, cable):
            cable.deaf = True
            await stop(core)
            fan, mixer = core.plant.drives
            drives = (mixer,) if change == "gone" else (replace(fan, address=5), mixer)
            await core.changed(replace(core.plant, drives=drives))
            assert core.standing_stops.of("fan") is None
            assert any("is retried no longer: the plant file was read again" in text for text in said(core, "warning"))

    @awaited
    async def test_server_that_ends_tries_once_more_and_names_what_remains(self, tmp_path):
        async with cut_core(tmp_path) as (core, _, cable):
            cable.deaf = True
            await stop(core)
            sent = stops_sent(core)
            await core.release_all()
            assert sent
            assert "stop (ramp) was not confirmed, and is retried no longer: the server ends" in said(core, "warning")
            assert (await asked(core, VIEWER, "fan", "stop")).outcome == "open"
            assert core.standing_stops.of("fan") is None
        assert asyncio.all_tasks() == {asyncio.current_task()}


class Drive:
    """Counts attempts, each of which raises what stands in `error`; None: it is confirmed."""

    def __init__(self, error):
        self.error, self.hows = error, []
        self.table = Table(lambda *_: None)
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
    async def test_whatever_does_not_confirm_it_lets_it_stand(self, monkeypatch, error):
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
    async def test_earlier_stop_does_not_stand_after_a_later_one_was_sent(self):
        drive = Drive(NoReplyError("silent"))
        earlier = drive.stops.sent(["fan"], Stop.RAMP)
        drive.stops.sent(["fan"], Stop.COAST)
        drive.stops.stand("fan", Stop.RAMP, "x", earlier, drive.error)
        assert drive.stops.of("fan") is None

    @awaited
    async def test_nothing_is_sent_while_a_start_is_under_way_and_at_once_if_it_fails(self):
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
    async def test_stop_that_comes_during_a_start_outlives_it(self):
        drive = Drive(NoReplyError("silent"))
        drive.stops.stand("fan", Stop.RAMP, "x", drive.stops.sent(["fan"], Stop.RAMP), drive.error)
        with drive.stops.giving_way("fan", "eva"):
            drive.stops.stand("fan", Stop.RAMP, "x", drive.stops.sent(["fan"], Stop.RAMP), drive.error)
        assert drive.stops.of("fan") is not None
        await drive.stops.finish()

    @awaited
    async def test_many_silent_drives_leave_the_line_to_others(self, monkeypatch):
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
        # Without rests they would take more than four times as long as there is.
        assert sum(took) < 0.5 * (loop.time() - began_s)
        await stops.finish()

    @awaited
    async def test_resting_drive_that_refuses_is_not_sent_it_with_each_status(self):
        drive = Drive(StateError("no"))
        drive.stops.stand("fan", Stop.RAMP, "x", drive.stops.sent(["fan"], Stop.RAMP), drive.error)
        for _ in range(50):
            drive.stops.seen("fan", running=False)
            await asyncio.sleep(0)
        assert not drive.hows
        await drive.stops.finish()
