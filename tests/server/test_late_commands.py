"""Second check of a command when its turn on the line comes: by then it may be too old, or no longer allowed."""

import asyncio
import time
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest
from served_core import ANOTHER, ENGINEER, OPERATOR, NoteBook, asked, awaited, core_of, runs, until

from drivecomm.errors import LeaseError, NotAllowedError, UsageError
from drivecomm.line import Rank
from drivecomm.protocol import LineSettings
from drivecomm.server.pending_command import PendingCommand, keeping_takes_s


@pytest.fixture
def core(tmp_path):
    return partial(core_of, tmp_path)


@asynccontextmanager
async def busy(served, line, seconds):
    """Occupy a line for a number of seconds."""
    await until(lambda: all(each.reachability == "answers" for each in served.drives()))
    bus = served.lines[line].bus
    turn = await asyncio.create_task(bus.line.taken(Rank.COMMAND))
    asyncio.get_running_loop().call_later(seconds, bus.line.turns.give_back, turn)
    yield


def leased(served, caller, drive, seconds=5.0):
    return served.leases.take(caller, drive, seconds, now=time.monotonic(), time_s=time.time())


def with_drive(plant, name, **changes):
    drives = tuple(replace(each, **changes) if each.name == name else each for each in plant.drives)
    return replace(plant, drives=drives)


class TestTooOld:
    @pytest.mark.soak
    @pytest.mark.parametrize(("verb", "arguments"), [("start", {}), ("set_reference", {"percent": 90})])
    @awaited
    async def test_command_that_waited_too_long_is_refused(self, core, verb, arguments):
        async with core() as (served, control):
            lease = leased(served, ENGINEER, "fan")
            async with busy(served, "yard", 0.5):
                answer = await asked(served, ENGINEER, "fan", verb, lease=lease.key, arguments=arguments, valid_s=0.2)
            assert answer.outcome == "refused"
            assert isinstance(answer.error, NotAllowedError)
            assert "is valid for only 0.2 s; it was not sent" in str(answer.error)
            assert not runs(control, "fan")

    @pytest.mark.soak
    @awaited
    async def test_command_that_waited_within_its_validity_is_sent(self, core):
        async with core() as (served, control):
            lease = leased(served, ENGINEER, "fan")
            async with busy(served, "yard", 0.3):
                answer = await asked(served, ENGINEER, "fan", "start", lease=lease.key, issued_s=time.time())
            assert answer.outcome == "done", answer.error
            await until(lambda: runs(control, "fan"))

    @pytest.mark.soak
    @awaited
    async def test_keep_order_that_waited_too_long_is_refused(self, core, monkeypatch):
        monkeypatch.setattr("drivecomm.server.commands.keeping_takes_s", lambda _: 0.1)
        async with core() as (served, control):
            lease = leased(served, OPERATOR, "pump")
            async with busy(served, "hall", 0.5):
                answer = await asked(
                    served, OPERATOR, "pump", "start", lease=lease.key, valid_s=0.2, issued_s=time.time()
                )
            assert (answer.outcome, type(answer.error)) == ("refused", NotAllowedError)
            assert not runs(control, "pump")
            await until(lambda: "pump" not in served.kept)

    def test_own_exchanges_of_a_keep_order_do_not_count_as_waiting(self):
        told = []
        came_s = time.monotonic() - 3
        wanted = PendingCommand(
            core=None, lease=None, found=None, config=None, call=None, fresh=lambda **times: told.append(times),
            came_s=came_s, own_s=2,
        )  # fmt: skip
        wanted.check_fresh()
        assert told[0]["waited_s"] == pytest.approx(1, abs=0.1)
        assert told[0]["time_s"] == pytest.approx(time.time() - 2, abs=0.1)
        # A command that has just arrived must not get a time in the future.
        replace(wanted, came_s=time.monotonic()).check_fresh()
        assert told[1]["waited_s"] == pytest.approx(0, abs=0.1)
        assert told[1]["time_s"] == pytest.approx(time.time(), abs=0.1)

    def test_keep_order_takes_longer_on_a_slower_line(self):
        fast, slow = (
            keeping_takes_s(
                SimpleNamespace(settings=LineSettings(baudrate=baudrate, bytesize=8, parity="E", stopbits=1))
            )
            for baudrate in (19200, 1200)
        )
        assert 1 < fast < 2
        assert 5 < slow < 10


@pytest.mark.soak
@pytest.mark.parametrize("verb", ["start", "keep"])
@awaited
async def test_waiting_start_is_refused_if_its_lease_expires(core, verb):
    async with core() as (served, control):
        lease = leased(served, OPERATOR, "pump", 0.2)
        async with busy(served, "hall", 0.8):
            starting = asyncio.create_task(
                asked(
                    served, OPERATOR, "pump", verb, lease=lease.key, arguments={"percent": 50} if verb == "keep" else {}
                )
            )
            await asyncio.sleep(0.4)
            leased(served, ANOTHER, "pump")
        answer = await starting
        assert answer.outcome == "refused"
        assert not runs(control, "pump")


@pytest.mark.soak
@awaited
async def test_waiting_start_by_a_local_caller_is_refused_if_its_lease_expires(core):
    async with core() as (served, control):
        lease = leased(served, ENGINEER, "fan", 0.2)
        async with busy(served, "yard", 0.5):
            answer = await asked(served, ENGINEER, "fan", "start", lease=lease.key)
        assert (answer.outcome, type(answer.error)) == ("refused", LeaseError)
        assert not runs(control, "fan")


class Gate(NoteBook):
    """An audit that delays its records until the test opens it."""

    def __init__(self):
        super().__init__()
        self.open, self.waits = asyncio.Event(), asyncio.Event()

    async def record_command(self, caller, command, lease=None):
        self.waits.set()
        await self.open.wait()
        return await super().record_command(caller, command, lease)


CHANGES = {
    "it is read-only": (ENGINEER, lambda plant: with_drive(plant, "fan", armed=False)),
    "it is another drive": (
        ENGINEER,
        lambda plant: with_drive(replace(plant, drives=plant.drives[:2]), "fan", address=4),
    ),
    "it has gone": (ENGINEER, lambda plant: replace(plant, drives=(plant.drives[0], plant.drives[2]))),
}


@pytest.mark.parametrize("change", CHANGES)
@awaited
async def test_reloaded_plant_file_applies_to_waiting_commands(core, change):
    caller, changed = CHANGES[change]
    gate = Gate()
    async with core(audit=gate) as (served, control):
        await until(lambda: served.drive("fan").reachability == "answers")
        starting = asyncio.create_task(asked(served, caller, "fan", "start"))
        await gate.waits.wait()
        await served.changed(changed(served.plant))
        gate.open.set()
        answer = await starting
        assert answer.outcome == "refused"
        assert isinstance(answer.error, UsageError)
        assert not any(each["running"] for each in control.order("show")["drives"])


@awaited
async def test_waiting_start_is_refused_if_its_door_loses_the_right(core):
    gate = Gate()
    async with core(audit=gate) as (served, control):
        lease = leased(served, OPERATOR, "pump")
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        starting = asyncio.create_task(asked(served, OPERATOR, "pump", "start", lease=lease.key))
        await gate.waits.wait()
        pump = served.plant.drive("pump")
        await served.changed(with_drive(served.plant, "pump", network=type(pump.network)()))
        gate.open.set()
        answer = await starting
        assert answer.outcome == "refused", answer.error
        assert not runs(control, "pump")


@awaited
async def test_reload_without_a_change_does_not_affect_waiting_commands(core, monkeypatch):
    # A busy machine may take longer for the reload than a command is valid.
    monkeypatch.setattr("drivecomm.server.commands.check_fresh", lambda *_, **__: None)
    gate = Gate()
    async with core(audit=gate) as (served, control):
        await until(lambda: all(each.reachability == "answers" for each in served.drives()))
        starting = asyncio.create_task(asked(served, ENGINEER, "fan", "start", options={"attempts": 2}))
        await gate.waits.wait()
        await served.changed(replace(served.plant, drives=served.plant.drives[:2]))
        gate.open.set()
        answer = await starting
        assert answer.outcome == "done", answer.error
        await until(lambda: runs(control, "fan"))
