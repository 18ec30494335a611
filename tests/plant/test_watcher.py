"""The watcher of a plant: states, values, trends and events of its drives."""

import asyncio
from dataclasses import replace

import pytest
from plants import FAN, HALL, PUMP, WELL, YARD, dark, plant_of, tripped, virtual_lines, watched

import drivecomm
from drivecomm.errors import PortError, UsageError
from drivecomm.plant import Plant
from drivecomm.plant.watching import WatchedLine, Watcher, lines_of
from drivecomm.protocol import DriveConfig, DriveState, LinkLossPolicy, installed


def test_board_holds_states_values_and_counters():
    board = watched(plant_of(PUMP, FAN), 5).board()
    pump, fan = board.drives
    assert (pump.name, pump.line, pump.reachability, pump.fault, pump.error) == ("pump", "hall", "answers", "", "")
    assert pump.status.state is DriveState.NOT_READY
    assert fan.status is not None
    frequency = pump.values["output_frequency"]
    assert (str(frequency.reading), frequency.quality) == ("0.00 Hz", "good")
    assert set(pump.values) == {"output_frequency", "output_current", "output_power"}
    assert pump.counters["requests"] == pump.counters["replies"] == 20
    assert 0 < pump.reply_s < 0.1
    assert 0 <= pump.age_s <= 1
    assert 4 < board.elapsed_s <= 5
    assert (board.faults, board.silent, board.events) == (0, 0, ())
    assert board.view("fan") == fan


def test_only_the_requested_names_are_read():
    pump = watched(plant_of(PUMP), 3, names=["output_current", "torque"]).board().view("pump")
    assert list(pump.values) == ["output_current"]


def test_trend_follows_a_motor_that_runs_up():
    plant = plant_of(replace(PUMP, motor={"ramp_up_s": 10}))
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        pump = bus.drive("vabus", 1, model="agile")
        pump.set_reference(hz=30)
        pump.start()
    watcher = watched(plant, 12)
    course = watcher.cells("pump", "output_frequency", 60)
    assert len(course) == 60
    assert course[:47] == [None] * 47
    there = [value for value in course if value is not None]
    assert there == sorted(there)
    assert there[0] < 5
    assert there[-1] == 30
    assert watcher.cells("pump", "torque", 4) == [None] * 4


def test_fault_is_reported_with_its_text_and_its_end():
    plant = plant_of(PUMP, FAN, script=[tripped("fan", 14, 2.5)])

    async def watch():
        async with Watcher(virtual_lines(plant)) as watcher:
            await watcher.run(duration_s=5)
            during = watcher.board()
            await watcher.drive("fan").reset()
            await watcher.run(duration_s=5)
            return during, watcher.board()

    during, after = asyncio.run(watch())
    assert during.view("fan").fault == "14 earth fault"
    assert during.faults == 1
    (happened,) = during.events
    assert (happened.drive, happened.kind, happened.text) == ("fan", "fault", "fault: 14 earth fault")
    assert 2.4 < happened.time_s < 4
    assert after.view("fan").fault == ""
    assert "the fault is gone" in [one.text for one in after.events]


@pytest.mark.parametrize(("protocol", "code"), [("vabus", 5), ("danfoss-fc", 14), ("vlt3500", 14), ("fuji", 7)])
def test_fault_is_shown_with_every_protocol(protocol, code):
    drive = replace(PUMP, protocol=protocol, options={})
    pump = watched(plant_of(drive, script=[tripped("pump", code, 1)]), 4).board().view("pump")
    assert pump.reachability == "answers"
    assert pump.fault


def test_silent_drive_is_shown_and_does_not_delay_others():
    alone = watched(plant_of(PUMP), 30).board().view("pump").counters["replies"]
    plant = plant_of(PUMP, FAN, script=[dark("fan", 5, 20)])
    watcher = watched(plant, 30)
    board = watcher.board()
    assert board.view("pump").counters["replies"] >= alone - 4
    assert board.view("fan").reachability == "answers"
    silent, again = reversed([one for one in board.events if one.drive == "fan"])
    assert silent.kind == "silent"
    assert "did not answer within" in silent.text
    assert "danfoss-fc:3" not in silent.text
    assert 5 <= silent.time_s < 8
    assert again.text == "answers again"
    assert 20 <= again.time_s < 31


def test_drive_that_never_answers_is_shown_as_silent():
    board = watched(plant_of(PUMP, FAN, script=[dark("fan", 0)]), 10).board()
    fan = board.view("fan")
    assert (fan.reachability, fan.status, fan.age_s, fan.fault) == ("silent", None, None, "")
    assert "not answer" in fan.error
    assert board.silent == 1


def test_status_and_fault_of_a_silent_drive_are_unknown():
    fan = watched(plant_of(PUMP, FAN, script=[tripped("fan", 14, 2), dark("fan", 5)]), 12).board().view("fan")
    assert (fan.reachability, fan.status, fan.fault) == ("silent", None, "")


def test_trend_has_a_gap_while_the_drive_is_silent():
    watcher = watched(plant_of(PUMP, script=[dark("pump", 10, 14)]), 30)
    course = watcher.cells("pump", "output_frequency", 60)[-29:]
    assert None in course[8:20]
    assert None not in course[:7] + course[-3:]


def test_drives_with_one_address_on_two_lines_are_kept_apart():
    plant = plant_of(PUMP, WELL)
    plant.trip("well", 5)
    watcher = watched(plant, 4)
    board = watcher.board()
    assert not board.view("pump").fault
    assert board.view("well").fault == "code 5"
    assert watcher.telegrams("pump")
    assert {event.drive for event in watcher.telegrams("pump")} == {"vabus:1"}
    times = [event.time for event in watcher.telegrams("well")]
    assert times == sorted(times)


def test_line_that_cannot_be_opened_is_retried(monkeypatch):
    monkeypatch.setattr("drivecomm.plant.watching.watcher.REOPEN_LONGEST_S", 0.02)
    plant = plant_of(PUMP, WELL)
    hall, yard = virtual_lines(plant)
    tries = []

    def late():
        tries.append(1)
        if len(tries) < 3:
            raise PortError("port yard does not exist; plug the adapter in")
        return plant.line("yard").port()

    async def watch():
        async with Watcher([hall, replace(yard, port=late)]) as watcher:
            before = watcher.board().view("well")
            await watcher.run(duration_s=3)
            return before, watcher.board()

    before, after = asyncio.run(watch())
    assert (before.reachability, before.error) == ("silent", "port yard does not exist; plug the adapter in")
    assert after.view("well").reachability == "answers"
    assert after.view("pump").reachability == "answers"
    assert len(tries) == 3
    (happened,) = after.events[:-1]
    assert (happened.drive, happened.text) == ("well", "answers again")
    assert happened.time_s >= 2 * 0.02


def test_watching_an_unopened_line_ends_after_its_duration():
    plant = plant_of(PUMP, WELL)
    hall, yard = virtual_lines(plant)

    def broken():
        raise PortError("port yard does not exist; plug the adapter in")

    async def watch():
        async with Watcher([hall, replace(yard, port=broken)]) as watcher:
            await asyncio.wait_for(watcher.run(duration_s=0.1), 5)
            return watcher.board()

    assert asyncio.run(watch()).view("well").reachability == "silent"


def test_trend_continues_when_watching_resumes():
    plant = plant_of(PUMP)

    async def watch():
        async with Watcher(virtual_lines(plant)) as watcher:
            await watcher.run(duration_s=5)
            await watcher.run(duration_s=5)
            return watcher

    course = asyncio.run(watch()).cells("pump", "output_frequency", 60)
    assert course[-9:] == [0.0] * 9


def test_watcher_raises_if_no_line_can_be_opened():
    def broken():
        raise PortError("port hall does not exist; plug the adapter in")

    async def watch():
        line = WatchedLine(name="hall", port=broken, drives=(DriveConfig(protocol="vabus", address=1),))
        async with Watcher([line]):
            pytest.fail("it must not be entered")

    with pytest.raises(PortError, match="plug the adapter in"):
        asyncio.run(watch())


def test_results_are_passed_to_the_callback():
    results = []
    plant = plant_of(PUMP)

    async def watch():
        async with Watcher(virtual_lines(plant), told=results.append) as watcher:
            await watcher.run(duration_s=2)

    asyncio.run(watch())
    assert {result.parameter for result in results} == {"status", "output_frequency", "output_current", "output_power"}
    status = next(result.reading for result in results if result.parameter == "status")
    assert (status.value, status.name) == ("not_ready", "status")
    assert isinstance(status.raw, int)
    assert {result.drive for result in results} == {"pump"}


@pytest.mark.soak
def test_watcher_sends_no_command():
    plant = plant_of(PUMP, FAN)
    watcher = watched(plant, 5)
    assert not any(state.running for state in plant.states())
    assert {event.drive for event in watcher.telegrams("pump")} == {"vabus:1"}
    assert {event.drive for event in watcher.telegrams("fan")} == {"danfoss-fc:3"}
    sent = [event.message for name in ("pump", "fan") for event in watcher.telegrams(name) if event.what == "sent"]
    for message in sent:
        plugin = next(plugin for plugin in installed.working() if type(message).__module__.startswith(plugin.package))
        assert plugin.intent(message).only_asks, message


def test_watcher_refuses_wrong_arguments():
    line = WatchedLine(name="hall", port="x", drives=(DriveConfig(protocol="vabus", address=1),))
    for lines, options, message in (
        ([], {}, "there is nothing to watch"),
        ([line, line], {}, "two drives are named 'vabus:1'"),
        ([line], {"names": ["colour"]}, "unknown common name 'colour'"),
        ([line], {"period_s": 0}, "invalid period of 0 s"),
    ):
        with pytest.raises(UsageError, match=message):
            Watcher(lines, **options)
    with pytest.raises(UsageError, match="line hall has no drives to watch"):
        WatchedLine(name="hall", port="x", drives=())


def test_watched_lines_are_made_from_a_plant():
    echoing = replace(HALL, echo=True, settings={"baudrate": 9600})
    plant = Plant(lines=(echoing, YARD), drives=(PUMP,))
    (line,) = lines_of(plant, {"baudrate": 19200, "attempts": 2, "parity": None})
    assert line.options == {"echo": "expect", "baudrate": 19200, "attempts": 2}
    assert (line.port, line.name) == ("/dev/ttyUSB0", "hall")
    (drive,) = line.drives
    assert (drive.name, str(drive), drive.armed, drive.link_loss) == ("pump", "vabus:1", False, None)
    with pytest.raises(UsageError, match="the plant has no drives to watch"):
        lines_of(Plant(lines=(HALL,)))
    with pytest.raises(UsageError, match="line hall has no port"):
        lines_of(Plant(lines=(replace(HALL, port=""),), drives=(PUMP,)))


def test_watched_drive_keeps_its_arming_and_link_loss_policy():
    line = replace(HALL, port="", listen="tcp:127.0.0.1:4001")
    drive = replace(PUMP, armed=True, link_loss=LinkLossPolicy(policy="hold"))
    (watched_line,) = lines_of(Plant(lines=(line,), drives=(drive,)))
    assert watched_line.port == "socket://127.0.0.1:4001"
    assert (watched_line.drives[0].armed, watched_line.drives[0].link_loss.policy) == (True, "hold")
