"""Failures of parts of a server: packages, the audit, the journal, and listeners. The other parts keep working."""

import asyncio
import threading
import time
from dataclasses import replace
from functools import partial

import pytest
from served_core import ENGINEER, OPERATOR, VIEWER, NoteBook, asked, awaited, core_of, runs, until

from drivecomm.bus import AsyncDrive
from drivecomm.errors import UsageError
from drivecomm.protocol import Stop
from drivecomm.server import CurrentValue
from drivecomm.server.commands import CommandExecutor
from drivecomm.server.table import ValueTable

QUICK_S = 0.2


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


def leased(core, caller, drive, seconds, key=""):
    return core.leases.take(caller, drive, seconds, now=time.monotonic(), time_s=time.time(), key=key)


@pytest.fixture
def breaks(monkeypatch):
    """Return a function that makes a verb of one drive raise an unexpected exception."""

    def let_break(verb, drive):
        usual = getattr(AsyncDrive, verb)

        async def broken(self, *values, **options):
            if self.name == drive:
                raise KeyError("a mistake")
            return await usual(self, *values, **options)

        monkeypatch.setattr(AsyncDrive, verb, broken)

    return let_break


class FailingAudit(NoteBook):
    """An audit whose record of a stop raises an unexpected exception."""

    def record_stop(self, *_):
        raise RuntimeError("a mistake")

    refused = outcome = record_stop


class Journal:
    def add_values(self, *_, **__):
        raise RuntimeError("a mistake")

    add_events = add_command = add_fault_log = add_values


class TestBrokenPackage:
    @pytest.mark.parametrize(("verb", "outcome"), [("set_reference", "open"), ("read", "failed"), ("stop", "open")])
    @awaited
    async def test_broken_verb_is_answered_and_recorded(self, core, breaks, verb, outcome):
        book = NoteBook()
        given = {"set_reference": {"percent": 5}, "read": {"parameter": "output_frequency"}, "stop": {}}
        async with core(audit=book) as (served, _):
            breaks(verb, "vabus:1")
            answer = await asked(served, ENGINEER, "pump", verb, arguments=given[verb])
            assert (answer.outcome, "mistake" in str(answer.error)) == (outcome, True)
            assert book.ended_with == ([] if verb == "read" else [("pump", verb, "open")])
            assert served.leases.all(now=time.monotonic()) == []

    @awaited
    async def test_stop_of_all_reaches_the_other_drives(self, core, breaks):
        async with core() as (served, _):
            breaks("stop", "danfoss-fc:3")
            answers = await CommandExecutor(served).stop_all(VIEWER, Stop.RAMP)
            assert {each.drive: each.answer.outcome for each in answers if "*" not in each.drive} == {
                "pump": "done",
                "fan": "open",
                "mixer": "done",
            }

    @awaited
    async def test_polls_of_the_other_drives_continue(self, core, monkeypatch):
        usual = AsyncDrive.to_status

        def broken(self, rank):
            if self.name == "danfoss-fc:3":
                raise KeyError("a mistake")
            return usual(self, rank)

        monkeypatch.setattr(AsyncDrive, "to_status", broken)
        async with core() as (served, _):
            await until(lambda: served.drive("mixer").status is not None)
            await until(lambda: any(each.drive == "fan" and each.quality == "bad" for each in served.table.values()))
            before = served.drive("mixer").answered_s
            await until(lambda: served.drive("mixer").answered_s > before)

    @awaited
    async def test_motor_whose_start_raises_is_stopped(self, core, breaks):
        async with core() as (served, control):
            breaks("start", "vabus:1")
            lease = leased(served, OPERATOR, "pump", 5)
            answer = await asked(served, OPERATOR, "pump", "keep", lease=lease.key)
            assert answer.outcome == "open"
            await until(lambda: "pump" not in served.kept)
            assert not runs(control, "pump")

    @awaited
    async def test_drive_that_cannot_be_created_is_reported_and_others_are_served(self, core, monkeypatch):
        async with core() as (served, _):
            line = served.lines["yard"]
            usual = line.bus.drive

            def broken(protocol, address, **options):
                if address == 4:
                    raise KeyError("a mistake")
                return usual(protocol, address, **options)

            monkeypatch.setattr(line.bus, "drive", broken)
            await line.pause()
            line.set_drives(line.drives)
            line.start()
            assert "a mistake" in served.drive("mixer").error
            (told,) = [each for each in served.table.events() if each.kind == "line" and each.drive == "mixer"]
            assert "cannot be served: mixer cannot be made: KeyError('a mistake')" in told.text
            assert (await asked(served, VIEWER, "mixer", "status")).outcome == "refused"
            assert (await asked(served, VIEWER, "fan", "status")).outcome == "done"


class TestBrokenAudit:
    @awaited
    async def test_stop_is_sent_despite_a_broken_audit(self, core):
        async with core(audit=FailingAudit()) as (served, _):
            assert (await asked(served, VIEWER, "pump", "stop")).outcome == "done"
            answer = await asked(served, ENGINEER, "pump", "set_reference", arguments={"percent": 5})
            assert answer.outcome == "done"
            assert (await asked(served, VIEWER, "pump", "start")).outcome == "refused"


class TestBrokenJournal:
    @awaited
    async def test_broken_journal_does_not_affect_other_listeners(self, core):
        async with core(journal=Journal()) as (served, control):
            told = []
            served.table.listen(lambda values, _: told.extend(values))
            control.order("trip", drive="fan", code=4)
            await until(lambda: served.drive("fan").fault)
            assert (await asked(served, VIEWER, "pump", "stop")).outcome == "done"
            told.clear()
            await until(lambda: told)
            told.clear()
            await until(lambda: told)


class TestUnpollableLine:
    @pytest.mark.soak
    @awaited
    async def test_polling_error_marks_values_bad_and_polling_restarts(self, core, monkeypatch):
        async with core() as (served, _):
            await until(lambda: any(each.quality == "good" for each in served.table.values() if each.drive == "fan"))
            line = served.lines["yard"]
            usual, broken = line._take, []

            def take(result):
                if not broken:
                    broken.append(result)
                    raise RuntimeError("a mistake")
                usual(result)

            monkeypatch.setattr(line, "_take", take)
            await until(lambda: served.drive("fan").reachability == "silent")
            of_fan = [each for each in served.table.values() if each.drive == "fan"]
            assert {each.quality for each in of_fan} == {"bad"}
            assert {each.reading for each in of_fan} == {None}
            await until(lambda: served.drive("fan").reachability == "answers")

    @awaited
    async def test_unexpected_port_error_is_reported(self, tmp_path):
        def port_of(_line):
            def opened():
                raise OSError("a mistake")

            return opened

        async with core_of(tmp_path, port_of=port_of) as (served, _):
            async with asyncio.timeout(3):
                answer = await asked(served, VIEWER, "pump", "stop")
            assert answer.outcome == "open"
            assert "a mistake" in served.drive("pump").error

    @awaited
    async def test_line_without_a_port_refuses_commands_and_allows_a_reload(self, tmp_path):
        def port_of(line):
            raise UsageError(f"line {line.name} has no port")

        async with core_of(tmp_path, port_of=port_of) as (served, _):
            assert (await asked(served, VIEWER, "pump", "stop")).outcome == "refused"
            assert await served.changed(replace(served.plant, drives=served.plant.drives[:1])) == []


class TestReadsFromThreads:
    @awaited
    async def test_leases_can_be_listed_by_a_thread_while_they_change(self, core):
        async with core() as (served, _):
            failed, ends = [], threading.Event()

            def look():
                while not ends.is_set():
                    try:
                        served.leases.all(now=time.monotonic())
                        served.drives()
                    except Exception as error:  # noqa: BLE001 - any exception counts
                        failed.append(error)

            looking = threading.Thread(target=look)
            looking.start()
            until_s = time.monotonic() + QUICK_S
            while time.monotonic() < until_s:
                for name in "abcdefghij":
                    leased(served, OPERATOR, name, 1)
                for lease in served.leases.all(now=time.monotonic()):
                    served.leases.release(lease)
                served.lines["yard"].set_drives(served.lines["yard"].drives)
            ends.set()
            looking.join()
            assert failed == []

    def test_listeners_added_concurrently_are_all_called(self):
        table, heard = ValueTable(lambda *_: None), set()

        def begin(number):
            for each in range(50):
                table.listen(lambda *_, name=(number, each): heard.add(name))

        threads = [threading.Thread(target=begin, args=(number,)) for number in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        table.put_value(CurrentValue(time_s=1.0, drive="pump", name="status", reading=None, quality="bad"))
        table._tell()
        assert len(heard) == 400
