"""The core of a server: knowledge of drives, outcomes of commands, and kept motors."""

import asyncio
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from served_core import ANOTHER, ENGINEER, OPERATOR, PLANT, VIEWER, NoteBook, asked, awaited, core_of, runs, until

import drivecomm
from drivecomm.errors import NotAllowedError
from drivecomm.protocol import Stop
from drivecomm.server.commands import CommandExecutor


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


def state(core, name):
    return core.drive(name)


def value(core, drive, name="output_frequency"):
    return next((each for each in core.table.values() if (each.drive, each.name) == (drive, name)), None)


def leased(core, caller, drive, seconds, key=""):
    return core.leases.take(caller, drive, seconds, now=time.monotonic(), time_s=time.time(), key=key)


class TestDriveKnowledge:
    @awaited
    async def test_values_have_quality_and_source_time(self, core):
        async with core() as (served, _):
            await until(lambda: value(served, "pump") is not None and value(served, "fan") is not None)
            found = value(served, "pump")
            assert found.quality == found.reading.quality
            assert found.reading.unit == "Hz"
            assert found.source_s == found.reading.time_s > 1e9
            await until(lambda: value(served, "pump").source_s > found.source_s)

    @awaited
    async def test_status_of_every_drive_is_polled_without_a_poll_plan(self, core):
        async with core() as (served, _):
            await until(lambda: state(served, "mixer").status is not None)
            assert state(served, "mixer").reachability == "answers"
            assert value(served, "mixer", "status").reading.value == state(served, "mixer").status.state.value

    @pytest.mark.soak
    @awaited
    async def test_drive_without_power_is_silent_and_does_not_delay_others(self, core):
        async with core() as (served, control):
            await until(lambda: state(served, "mixer").status is not None)
            control.order("power", drive="mixer", state="off")
            await until(lambda: state(served, "mixer").reachability == "silent", 20)
            assert state(served, "mixer").status is None
            before = value(served, "pump").source_s
            await until(lambda: value(served, "pump").source_s > before)
            control.order("power", drive="mixer", state="on")
            await until(lambda: state(served, "mixer").reachability == "answers", 20)
            kinds = [event.kind for event in served.table.events() if event.drive == "mixer"]
            assert kinds == ["silent", "answers"]

    @pytest.mark.soak
    @awaited
    async def test_fault_is_reported_as_one_event(self, core):
        async with core() as (served, control):
            await until(lambda: state(served, "fan").status is not None)
            control.order("trip", drive="fan", code=4)
            await until(lambda: state(served, "fan").fault)
            await asyncio.sleep(0.3)
            faults = [event for event in served.table.events() if event.kind == "fault"]
            assert [(event.drive, event.line) for event in faults] == [("fan", "yard")]


class TestCommands:
    @awaited
    async def test_read_needs_only_the_role_view(self, core):
        async with core() as (served, _):
            answer = await asked(served, VIEWER, "pump", "read", arguments={"parameter": "output_frequency"})
            assert answer.outcome == "done"
            assert answer.result.unit == "Hz"

    @awaited
    async def test_viewer_may_stop_but_not_command(self, core):
        book = NoteBook()
        async with core(audit=book) as (served, _):
            refused = await asked(served, VIEWER, "pump", "set_reference", arguments={"percent": 10})
            assert refused.outcome == "refused"
            stopped = await asked(served, VIEWER, "pump", "stop")
            assert stopped.outcome == "done"
            assert book.stops == [("pump", "ramp")]
            assert book.asked_for == []

    @awaited
    async def test_audit_failure_refuses_commands_but_not_a_stop(self, core):
        book = NoteBook()
        book.refuses = NotAllowedError("the audit cannot be written, so that nothing is commanded but a stop")
        async with core(audit=book) as (served, _):
            answer = await asked(served, ENGINEER, "pump", "set_reference", arguments={"percent": 10})
            assert answer.outcome == "refused"
            assert (await asked(served, ENGINEER, "pump", "stop")).outcome == "done"

    @awaited
    async def test_repeated_command_id_acts_once(self, core):
        book = NoteBook()
        async with core(audit=book) as (served, _):
            order = {"id": "7", "arguments": {"percent": 10}}
            first = await asked(served, ENGINEER, "pump", "set_reference", **order)
            again = await asked(served, ENGINEER, "pump", "set_reference", **order)
            assert first.outcome == again.outcome == "done"
            assert len(book.asked_for) == 1

    @awaited
    async def test_lease_of_another_caller_refuses_a_command(self, core):
        async with core() as (served, _):
            lease = leased(served, OPERATOR, "pump", 10)
            theirs = await asked(served, ANOTHER, "pump", "set_reference", arguments={"percent": 10})
            assert theirs.outcome == "refused"
            assert "otto" in str(theirs.error)
            mine = await asked(served, OPERATOR, "pump", "set_reference", arguments={"percent": 10}, lease=lease.key)
            assert mine.outcome == "done"

    @awaited
    async def test_invalid_arguments_are_refused(self, core):
        async with core() as (served, _):
            for arguments in ({"per_cent": 10}, {}, {"percent": 1, "hz": 2}):
                answer = await asked(served, ENGINEER, "pump", "set_reference", arguments=arguments)
                assert answer.outcome == "refused", arguments

    @awaited
    async def test_unarmed_drive_is_commanded_only_with_arm_true(self, core):
        async with core() as (served, _):
            order = {"arguments": {"percent": 10}}
            assert (await asked(served, ENGINEER, "mixer", "set_reference", **order)).outcome == "refused"
            assert (await asked(served, ENGINEER, "mixer", "set_reference", arm=True, **order)).outcome == "done"


class TestKeptMotors:
    async def start(self, served, caller=OPERATOR, drive="pump"):
        lease = leased(served, caller, drive, 1.0)
        answer = await asked(served, caller, drive, "keep", lease=lease.key, arguments={"percent": 50})
        assert answer.outcome == "done", answer.error
        return lease

    @pytest.mark.soak
    @awaited
    async def test_kept_motor_runs_until_its_lease_expires(self, core):
        async with core() as (served, _):
            lease = await self.start(served)
            assert state(served, "pump").kept == "trip"
            for _ in range(8):
                await asyncio.sleep(0.25)
                lease = leased(served, OPERATOR, "pump", 1.0, lease.key)
            assert state(served, "pump").status.running
            await until(lambda: state(served, "pump").kept == "", 3)
            await until(lambda: not state(served, "pump").status.running)
            assert any(event.kind == "link loss" for event in served.table.events())

    @pytest.mark.soak
    @awaited
    async def test_stop_of_another_caller_releases_a_kept_motor(self, core):
        async with core() as (served, _):
            await self.start(served)
            assert (await asked(served, VIEWER, "pump", "stop")).outcome == "done"
            await until(lambda: state(served, "pump").status and not state(served, "pump").status.running)
            assert state(served, "pump").kept == ""
            story = [item["done"] async for item in served.kept.following("pump")]
            assert story == ["watchdog set", "started", "stop commanded"]

    @pytest.mark.soak
    @awaited
    async def test_network_start_is_kept_by_the_policy_of_the_plant(self, core):
        async with core() as (served, _):
            without = await asked(served, OPERATOR, "pump", "start")
            assert without.outcome == "refused"
            assert "lease" in str(without.error)
            lease = leased(served, OPERATOR, "pump", 5)
            answer = await asked(served, OPERATOR, "pump", "start", lease=lease.key)
            assert answer.outcome == "done", answer.error
            assert state(served, "pump").kept == "trip"

    @pytest.mark.soak
    @awaited
    async def test_shutdown_stops_kept_motors(self, core):
        async with core() as (served, _):
            await self.start(served)
            await until(lambda: state(served, "pump").status.running)
            await served.release_all()
            status = (await asked(served, VIEWER, "pump", "status")).result
            assert not status.running or status.state.value == "stopping"
            answer = await asked(served, ENGINEER, "pump", "set_reference", arguments={"percent": 1})
            assert answer.outcome == "refused"


class TestReload:
    @awaited
    async def test_reload_keeps_unchanged_lines_open(self, core):
        async with core() as (served, _):
            await until(lambda: value(served, "pump") is not None)
            hall, yard = served.lines["hall"], served.lines["yard"]
            bus = yard.bus
            plant = replace(served.plant, drives=served.plant.drives[:2])
            told = await served.changed(plant)
            assert served.lines["hall"] is hall
            assert served.lines["yard"].bus is bus
            assert told == ["line yard has other drives, or other values to poll"]
            assert [each.name for each in served.drives()] == ["pump", "fan"]
            await until(lambda: value(served, "fan") is not None)
            before = value(served, "fan").source_s
            await until(lambda: value(served, "fan").source_s > before)


@pytest.mark.soak
def test_server_imports_every_package_before_starting_threads(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(PLANT)
    package = Path(drivecomm.__file__).parent
    rooms = {".".join(each.parent.relative_to(package).parts) for each in package.rglob("__init__.pyi")} - {""}
    project = tomllib.loads((package.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    doors = {
        each.partition(":")[0].removeprefix("drivecomm.")
        for each in project["entry-points"]["drivecomm.doors"].values()
    }
    # Doors are imported when their plant file entries are read; the local door belongs to the HTTP door.
    rooms -= doors - {"server.http"}
    # Packages for doors on brokers, and for separate programs.
    rooms -= {"server.broker", "server.fleet", "server.record", "commissioning.importing"}
    needed = sorted(
        room for room in rooms if room.partition(".")[0] not in ("testing", "traffic", "judge", "proving", "cli")
    )
    program = (
        "import sys; from pathlib import Path; from drivecomm.server import Serving; Serving(Path(sys.argv[1]));"
        "print([room for room in sys.argv[2:] if f'drivecomm.{room}' not in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", program, str(file), *needed], capture_output=True, text=True, check=True
    )  # fmt: skip
    assert found.stdout == "[]\n"


@awaited
async def test_stop_all_sends_broadcasts_first(core):
    book = NoteBook()
    async with core(audit=book) as (served, _):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        sent = []
        served.lines["yard"].bus.listen(sent.append)
        told = await CommandExecutor(served).stop_all(OPERATOR, Stop.RAMP)
        assert [(each.line, each.drive, each.how, each.answer.outcome) for each in told] == [
            ("hall", "pump", Stop.RAMP, "done"),
            ("yard", "danfoss-fc:*", Stop.RAMP, "open"),
            ("yard", "fan", Stop.RAMP, "done"),
            ("yard", "mixer", Stop.RAMP, "done"),
        ]
        order = [each.drive for each in sent if each.what == "sent"]
        first = order.index("danfoss-fc:*")
        # After the broadcast each drive is stopped singly; a late reply leads to a retry.
        assert [*dict.fromkeys(order[first + 1 :])][:2] == ["danfoss-fc:3", "danfoss-fc:4"]
        assert book.stops == [("pump", "ramp"), ("danfoss-fc:*", "ramp"), ("fan", "ramp"), ("mixer", "ramp")]
        told = await CommandExecutor(served).stop_all(OPERATOR, Stop.COAST, ["hall"])
        assert [each.drive for each in told] == ["vabus:*", "pump"]


@awaited
async def test_anonymous_caller_may_not_stop_all(core):
    book, nobody = NoteBook(), replace(VIEWER, name="anonymous")
    async with core(audit=book) as (served, _):
        told = await CommandExecutor(served).stop_all(nobody, Stop.COAST)
        assert {each.answer.outcome for each in told} == {"refused"}
        assert book.stops == []


@awaited
async def test_motor_that_keeps_running_is_named_when_the_server_ends(core):
    async with core() as (served, control):
        answer = await asked(served, ENGINEER, "pump", "keep", arguments={"policy": "hold", "percent": 50})
        assert answer.outcome == "done", answer.error
        await until(lambda: state(served, "pump").status and state(served, "pump").status.running)
        key = leased(served, ENGINEER, "fan", 5).key
        order = {"policy": "ramp", "percent": 50}
        assert (await asked(served, ENGINEER, "fan", "keep", lease=key, arguments=order)).outcome == "done"
        await until(lambda: state(served, "fan").status and state(served, "fan").status.running)
        await served.release_all()
        told = [(each.drive, each.kind) for each in served.table.events() if "keeps running without" in each.text]
        assert told == [("pump", "warning")]
        assert runs(control, "pump")


@awaited
async def test_unsupported_policy_is_reported_at_the_start(core):
    async with core(PLANT.replace('policy = "trip"', 'policy = "ramp"')) as (served, _):
        told = [each for each in served.table.events() if each.kind == "link loss"]
        assert [each.drive for each in told] == ["pump", "fan"]
        assert told[0].text == (
            "pump, a drive of model agile, cannot be started with the link_loss policy ramp of the plant file; "
            "write hold or trip there"
        )
        assert state(served, "pump").policies == ("hold", "trip")
        assert set(state(served, "fan").policies) == {"hold", "ramp", "trip"}
        assert state(served, "mixer").policies == ("hold",)


@pytest.mark.soak
@awaited
async def test_fault_log_of_a_drive_is_shown(core):
    async with core() as (served, control):
        await until(lambda: state(served, "fan").reachability == "answers")
        assert state(served, "fan").fault_log == ()
        control.order("trip", drive="fan", code=14)
        await until(lambda: state(served, "fan").fault_log)
        first = state(served, "fan").fault_log[0]
        assert (first.place, first.value, first.text) == (1, "14", "earth fault")
        assert {each.text for each in state(served, "fan").fault_log if each.value == "0"} <= {"no fault"}
