"""`keep` on a drive of a server: the motor runs only while the program lives, and stops within its time limit."""

import asyncio
import signal
import subprocess
import sys
import threading
import time

import pytest
from processes import serving

import drivecomm
from drivecomm.errors import LeaseError, NotSupported, ReadOnlyError, UsageError
from drivecomm.plant import async_bus_of_server, read_plant
from drivecomm.protocol import Stop

WATCHDOG_S = 2
POLICIES = {"fan": "ramp", "pump": "trip"}

PROGRAM = """
import sys, threading
import drivecomm

plant, name, policy, watchdog_s = sys.argv[1:]
with drivecomm.open_plant(plant) as opened:
    drive = opened.drive(name)
    with drivecomm.keep(drive, policy, watchdog_s=int(watchdog_s)):
        drive.set_reference(percent=50)
        drive.start()
        print("started", flush=True)
        threading.Event().wait()
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """Yield a server process, shared by all tests of this module."""
    with serving(tmp_path_factory.mktemp("keep")) as one:
        for name in POLICIES:
            one.until(lambda name=name: one.drive(name)["reachability"] == "answers")
        yield one


@pytest.fixture
def opened(served):
    with drivecomm.open_plant(served.plant) as plant:
        yield plant


def is_at_rest(served, name):
    """Return whether a motor stands still, without a keep order and without a lease."""
    state = served.drive(name)
    return not served.runs(name) and state["kept"] == "" and state["lease"] is None


@pytest.mark.parametrize("name", POLICIES)
def test_kept_motor_stops_within_its_time_when_its_program_is_killed(served, name):
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(served.plant), name, POLICIES[name], str(WATCHDOG_S)],
        env=served.environment, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert program.stdout.readline() == "started\n"
        served.until(lambda: served.runs(name))
        assert served.drive(name)["kept"] == POLICIES[name]
    finally:
        program.send_signal(signal.SIGKILL)
        died_at = time.monotonic()
        program.wait()
        program.stdout.close()
    served.until(lambda: not served.runs(name))
    # Limit: the lease expires, then the virtual motor ramps down in less than three seconds.
    assert time.monotonic() - died_at < WATCHDOG_S + 4.0
    served.until(lambda: is_at_rest(served, name))
    assert any("did not renew" in each["text"] for each in served.events("link loss"))


@pytest.mark.parametrize("name", POLICIES)
def test_kept_motor_outlasts_one_lease_time_and_stops_after_the_block(served, opened, name):
    drive, heard = opened.drive(name), threading.Semaphore(0)
    before = drivecomm.read_watchdog(drive)
    with drivecomm.keep(drive, POLICIES[name], watchdog_s=WATCHDOG_S, on_status=lambda _: heard.release()) as kept:
        assert kept.watchdog.policy == POLICIES[name]
        assert float(kept.watchdog.time_s) == WATCHDOG_S
        drive.set_reference(percent=20)
        drive.start()
        # Three refreshes take one lease time, so that four exceed it.
        for _ in range(4):
            assert heard.acquire(timeout=10)
        assert served.runs(name)
        kept.sleep(0.0)
    assert kept.stopped
    served.until(lambda: is_at_rest(served, name))
    assert drivecomm.read_watchdog(drive) == before


def test_kept_motor_is_stopped_and_started_again_within_the_block(served, opened):
    fan = opened.drive("fan")
    with drivecomm.keep(fan, "ramp", watchdog_s=WATCHDOG_S):
        for _ in range(2):
            fan.set_reference(percent=20)
            fan.start()
            served.until(lambda: served.runs("fan"))
            fan.stop(Stop.COAST)
            served.until(lambda: not served.runs("fan"))
            assert served.drive("fan")["kept"] == "ramp"
    served.until(lambda: is_at_rest(served, "fan"))


def test_second_keeper_is_refused_and_learns_the_holder(served, opened):
    with drivecomm.open_plant(served.plant) as others:
        with drivecomm.keep(opened.drive("fan"), "ramp", watchdog_s=WATCHDOG_S):
            with pytest.raises(LeaseError, match=r"fan is commanded by .* for another \d+ s, by another program"):
                drivecomm.keep(others.drive("fan"), "ramp", watchdog_s=WATCHDOG_S).__enter__()
            with pytest.raises(LeaseError, match="is commanded by"):
                others.drive("fan").start()
        with drivecomm.keep(others.drive("fan"), "ramp", watchdog_s=WATCHDOG_S):
            pass


def test_stop_of_another_program_ends_keeping_and_the_motor_stays_stopped(served, opened):
    fan = opened.drive("fan")

    def kept_until_it_ends():
        with drivecomm.open_plant(served.plant) as others, drivecomm.keep(fan, "ramp", watchdog_s=WATCHDOG_S) as kept:
            fan.set_reference(percent=20)
            fan.start()
            others.drive("fan").stop()
            with pytest.raises(LeaseError):
                fan.start()
            kept.until(threading.Event())

    with pytest.raises(LeaseError, match="no longer kept"):
        kept_until_it_ends()
    served.until(lambda: is_at_rest(served, "fan"))


def test_error_in_the_block_stops_the_motor(served, opened):
    def fail():
        with drivecomm.keep(opened.drive("fan"), "ramp", watchdog_s=WATCHDOG_S):
            opened.drive("fan").set_reference(percent=20)
            opened.drive("fan").start()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    served.until(lambda: is_at_rest(served, "fan"))


def test_keeping_with_an_unsupported_policy_is_refused_without_a_lease(served, opened):
    with pytest.raises(NotSupported, match="it can hold or trip"), drivecomm.keep(opened.drive("pump"), "ramp"):
        pass
    with pytest.raises(NotSupported, match="on_leaving"):
        drivecomm.keep(opened.drive("pump"), "trip", on_leaving="hold")
    with pytest.raises(UsageError, match="not in the plant"):
        drivecomm.keep(opened.bus("hall").drive("vabus", 2, model="agile"), "trip")
    with pytest.raises(ReadOnlyError):
        drivecomm.keep(opened.bus("hall").drive("vabus", 1, model="agile", read_only=True), "trip")
    assert is_at_rest(served, "pump")


def test_keep_async_works_through_a_server(served):
    async def kept():
        (line,) = (each for each in read_plant(served.plant).lines if each.name == "yard")
        async with async_bus_of_server(line.reached_at) as bus:
            fan, heard = bus.drive("danfoss-fc", 3), asyncio.Semaphore(0)
            async with drivecomm.keep_async(fan, "ramp", watchdog_s=WATCHDOG_S, on_status=lambda _: heard.release()):
                await fan.set_reference(percent=20)
                await fan.start()
                for _ in range(4):
                    await asyncio.wait_for(heard.acquire(), 10)
                return served.runs("fan")

    assert asyncio.run(kept())
    served.until(lambda: is_at_rest(served, "fan"))
