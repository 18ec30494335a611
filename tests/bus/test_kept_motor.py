"""Keeping a drive: its watchdog is fed, its motor is stopped on every way out, and errors are raised."""

import asyncio
import threading
import time
from contextlib import ExitStack, contextmanager
from functools import partial

import pytest
from two_faces import FACES, carry_out_on, keep_on, open_on

import drivecomm
from drivecomm.bus import keep, keep_async, read_watchdog, set_watchdog
from drivecomm.errors import NoReplyError, NotSupported, RefusedError, ReplyError, StateError, UsageError
from drivecomm.protocol import DriveState, Stop
from drivecomm.virtual import VirtualLine, virtual_drive

EVERYBODY = [("vabus", "agile", "trip"), ("danfoss-fc", "fc300", "ramp"), ("fuji", "frenic", "trip")]


class Bench:
    def __init__(self, face, protocol="danfoss-fc", model="fc300"):
        self.virtual = virtual_drive(protocol, 2, model=model)
        self.line = VirtualLine([self.virtual])
        self.bus = open_on(face, self.line.port)
        self.drive = self.bus.drive(protocol, 2, model=model)
        # Another master, which reads and sets the watchdog.
        self._other = drivecomm.open_bus(self.line.port).drive(protocol, 2, model=model)
        self.drive.set_reference(percent=50)

    def after(self, seconds):
        self.line.advance(seconds)
        self.virtual.follow(self.line.time)
        motor = self.virtual.motor
        return motor.running, round(motor.output_hz, 2), bool(motor.fault)

    def watchdog(self):
        return read_watchdog(self._other)

    def set_watchdog(self, policy, time_s):
        return set_watchdog(self._other, policy, time_s)

    @contextmanager
    def line_cut(self):
        hear, self.virtual.hear = self.virtual.hear, lambda *_: None
        try:
            yield
        finally:
            self.virtual.hear = hear


@pytest.fixture(params=FACES)
def face(request):
    return request.param


@pytest.fixture
def make(face):
    return partial(Bench, face)


@pytest.mark.parametrize(("protocol", "model", "policy"), EVERYBODY)
def test_motor_turns_until_the_keep_block_ends(make, protocol, model, policy):
    bench = make(protocol, model)
    statuses = []
    with keep_on(bench.drive, policy, watchdog_s=3, on_status=statuses.append) as kept:
        assert (kept.watchdog.policy, kept.watchdog.time_s) == (policy, 3)
        bench.drive.start()
        kept.sleep(60)
        assert bench.after(0)[0]
        assert 59 <= len(statuses) <= 60, "three times in its time"
        assert statuses[-1].state is DriveState.RUNNING
    assert bench.after(30) == (False, 0, False)
    assert bench.watchdog().time_s is None, "as it was before"


@pytest.mark.parametrize(("protocol", "model", "policy"), EVERYBODY)
def test_watchdog_of_a_kept_drive_acts_on_silence(make, protocol, model, policy):
    bench = make(protocol, model)
    with keep_on(bench.drive, policy, watchdog_s=3):
        bench.drive.start()
        bench.line.advance(2)
        bench.drive.status()
        assert bench.after(2)[0], "the time counts from the last telegram"
        running, _, fault = bench.after(15)
        assert not running
        assert fault is (policy == "trip")


@pytest.mark.parametrize("policy", ["ramp", "trip"])
def test_watchdog_set_long_after_the_last_command_does_not_trip_immediately(make, policy):
    bench = make()
    other = bench.bus.drive("danfoss-fc", 2, model="fc300")
    other.start()
    other.stop()
    bench.line.advance(1000)
    fresh = bench.bus.drive("danfoss-fc", 2, model="fc300")
    with keep_on(fresh, policy, watchdog_s=3) as kept:
        kept.sleep(10)
        assert not fresh.status().fault
        fresh.start()
        kept.sleep(10)
        assert bench.after(0)[0]


def test_entering_keep_does_not_stop_a_running_motor(make):
    bench = make("vabus", "agile")
    bench.drive.start()
    bench.line.advance(20)
    with keep_on(bench.drive, "trip", watchdog_s=3) as kept:
        kept.sleep(10)
        assert bench.after(0)[:2] == (True, 25)


def test_tripped_drive_can_be_kept_and_refuses_the_start(make):
    bench = make()
    bench.virtual.trip(13, bench.line.time)
    with pytest.raises(StateError, match="reset it first"), keep_on(bench.drive, "ramp"):
        bench.drive.start()


def test_entering_keep_sends_no_stop_to_a_tripped_drive(make):
    bench = make()
    bench.virtual.trip(13, bench.line.time)
    stops = []
    bench.drive.stop = stops.append
    with keep_on(bench.drive, "ramp"):
        assert stops == []


def test_leaving_keep_restores_the_earlier_watchdog(make):
    bench = make()
    earlier = bench.set_watchdog("trip", 30)
    with keep_on(bench.drive, "ramp", watchdog_s=3):
        pass
    assert bench.watchdog() == earlier


def test_error_in_the_keep_block_stops_the_motor(make):
    bench = make()

    def program():
        with keep_on(bench.drive, "ramp") as kept:
            bench.drive.start()
            kept.sleep(10)
            assert bench.after(0)[:2] == (True, 25), "its watchdog has not stopped it already"
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        program()
    assert bench.after(30) == (False, 0, False)


@pytest.mark.parametrize(
    ("policy", "on_leaving", "expected"),
    [
        ("ramp", None, "ramps"),
        ("trip", None, "ramps"),
        ("ramp", "coast", "off"),
        ("trip", "coast", "off"),
        ("ramp", "hold", "runs"),
        ("hold", None, "runs"),
        ("hold", "ramp", "ramps"),
    ],
)
def test_leaving_keep_stops_the_motor_as_chosen(make, policy, on_leaving, expected):
    bench = make()
    with keep_on(bench.drive, policy, on_leaving=on_leaving):
        bench.drive.start()
        bench.line.advance(4)
    running, hz, _ = bench.after(1)
    assert {"ramps": 0 < hz < 25, "off": not running, "runs": hz == 25}[expected], (running, hz)
    if expected != "runs":
        bench.line.advance(60)
        assert not bench.drive.status().running
    else:
        assert bench.after(1000)[0]


def test_keep_with_hold_refuses_an_active_watchdog(make):
    bench = make()
    bench.set_watchdog("ramp", 7)
    with (
        pytest.raises(StateError, match=r"on .ramp after 7.0 s., which differs from hold"),
        keep_on(bench.drive, "hold"),
    ):
        pytest.fail("the block was entered")


@pytest.mark.parametrize(("protocol", "model"), [("vabus", None), ("vlt3500", "vlt3500"), ("fuji", "g11s")])
def test_keep_with_hold_and_no_known_watchdog_sends_nothing(face, protocol, model):
    line = VirtualLine([])
    with open_on(face, line.port) as bus, keep_on(bus.drive(protocol, 2, model=model), "hold") as kept:
        assert kept.watchdog is None
    assert line.time == 0


@pytest.mark.parametrize(
    ("drive", "options", "error", "sentence"),
    [
        (("vabus", "agile"), {"policy": "jump"}, UsageError, "unknown policy 'jump'; use hold, ramp, coast or trip"),
        (("vabus", "agile"), {"policy": "ramp"}, NotSupported, "cannot ramp; it can hold or trip"),
        (("vabus", None), {"policy": "trip"}, UsageError, "has no model"),
        (("fuji", "frenic"), {"policy": "trip", "on_leaving": "coast"}, NotSupported, "it can by ramp"),
        (("fuji", "frenic"), {"policy": "trip", "on_leaving": "fall"}, UsageError, "unknown policy 'fall'"),
        (("vabus", "agile"), {"policy": "trip", "watchdog_s": 0.5}, UsageError, "steps of 1 s"),
        (("vabus", "agile"), {"policy": "trip", "watchdog_s": "x"}, UsageError, "not a number"),
    ],
)
def test_keep_refuses_impossible_options_before_sending(face, drive, options, error, sentence):
    line = VirtualLine([])
    protocol, model = drive
    with open_on(face, line.port) as bus:
        one = bus.drive(protocol, 2, model=model)
        with pytest.raises(error, match=sentence), keep_on(one, **options):
            pytest.fail("the block was entered")
    assert line.time == 0


def test_failed_refresh_is_raised_at_the_end_after_stopping_the_motor(make):
    bench = make()

    def program():
        with keep_on(bench.drive, "ramp", watchdog_s=60) as kept:
            bench.drive.start()
            with bench.line_cut():
                carry_out_on(bench.drive, kept._passing(20.5))
            carry_out_on(bench.drive, kept._passing(1))

    with pytest.raises(
        NoReplyError, match=r"1 of 1 refreshes of danfoss-fc:2 have failed, .* may have acted; the first"
    ):
        program()
    assert bench.after(60) == (False, 0, False)


def test_sleep_raises_a_failed_refresh_immediately_and_once(make):
    bench = make()
    with keep_on(bench.drive, "ramp", watchdog_s=60) as kept:
        with bench.line_cut(), pytest.raises(NoReplyError, match="1 of 1 refreshes"):
            kept.sleep(20.5)
        kept.sleep(1)


def test_on_failure_callback_gets_the_error_immediately_instead_of_a_raise(make):
    bench = make()
    failures = []
    with keep_on(bench.drive, "ramp", watchdog_s=6, on_failure=failures.append) as kept:
        with bench.line_cut():
            kept.sleep(3.9)
        kept.sleep(6)
    assert [type(failure) for failure in failures] == [NoReplyError]


def test_error_of_a_callback_is_raised_at_the_end(make):
    def fall(_):
        raise ZeroDivisionError

    bench = make()

    def program():
        with keep_on(bench.drive, "ramp", watchdog_s=3, on_status=fall) as kept:
            bench.drive.start()
            carry_out_on(bench.drive, kept._passing(10))
            assert bench.after(0)[0], "the drive is spoken to all the same"

    with pytest.raises(ZeroDivisionError):
        program()
    assert not bench.after(60)[0]


def test_error_of_a_callback_does_not_end_the_feeding(make):
    told = []

    def fall(_):
        told.append(True)
        raise ZeroDivisionError

    bench = make()
    with keep_on(bench.drive, "ramp", watchdog_s=3, on_status=fall) as kept:
        bench.drive.start()
        with pytest.raises(ZeroDivisionError):
            kept.sleep(10)
        assert len(told) >= 9
        assert bench.after(0)[0]


def test_error_of_the_block_takes_precedence_over_a_failed_refresh(make):
    bench = make()

    def program():
        with keep_on(bench.drive, "ramp", watchdog_s=60) as kept:
            with bench.line_cut():
                carry_out_on(bench.drive, kept._passing(20.5))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        program()


def test_motor_stopped_by_its_watchdog_is_not_restarted_by_a_refresh(make):
    bench = make()
    failures = []
    with keep_on(bench.drive, "ramp", watchdog_s=3, on_failure=failures.append) as kept:
        bench.drive.start()
        kept.sleep(20)
        bench.line.advance(3.5)
        assert bench.after(0)[1] < 25
        kept.sleep(60)
        assert bench.after(0) == (False, 0, False)
        assert [type(failure) for failure in failures] == [StateError]
        assert "received no request for 3.6 s" in str(failures[0])
        bench.drive.start()
        kept.sleep(60)
        assert bench.after(0)[:2] == (True, 25), "until somebody starts it"


def test_silence_beyond_the_watchdog_time_is_reported_once(make):
    bench = make()
    failures = []
    with keep_on(bench.drive, "ramp", watchdog_s=6, on_failure=failures.append) as kept:
        bench.drive.start()
        with bench.line_cut():
            kept.sleep(30)
        kept.sleep(6)
        told = [failure for failure in failures if isinstance(failure, StateError)]
        assert len(told) == 1
        with bench.line_cut():
            kept.sleep(30)
    told = [failure for failure in failures if isinstance(failure, StateError)]
    assert len(told) == 2, "each time anew"


def test_unanswered_stop_is_retried(make):
    bench = make()
    asked = []

    def deaf(how):
        asked.append(how)
        if len(asked) < 3:
            raise ReplyError("nothing")

    with keep_on(bench.drive, "ramp", watchdog_s=3):
        bench.drive.start()
        bench.drive.stop = deaf
    assert asked == [Stop.RAMP] * 3


def test_failed_stop_leaves_the_motor_to_the_watchdog(make):
    bench = make()

    def program():
        with keep_on(bench.drive, "trip", watchdog_s=3):
            bench.drive.start()
            bench.line.advance(2)
            cut.enter_context(bench.line_cut())

    with ExitStack() as cut, pytest.raises(NoReplyError):
        program()
    assert bench.after(60) == (False, 0, True), "it is for the watchdog then"


def test_unconfirmed_stop_leaves_the_watchdog_on(make):
    bench = make()

    def deaf(_):
        raise NoReplyError("nothing came")

    def program():
        with keep_on(bench.drive, "trip", watchdog_s=3):
            bench.drive.start()
            bench.drive.stop = deaf

    with pytest.raises(NoReplyError):
        program()
    assert bench.watchdog().policy == "trip"
    assert bench.after(60) == (False, 0, True)


def test_second_cancellation_does_not_prevent_the_stop():
    bench = Bench("threads")

    async def program():
        async with drivecomm.open_bus_async(bench.line.port) as bus:
            drive = bus.drive("danfoss-fc", 2, model="fc300")
            stop, started, stopping, go_on = drive.stop, asyncio.Event(), asyncio.Event(), asyncio.Event()

            async def slow(how):
                stopping.set()
                await asyncio.wait_for(go_on.wait(), 5)
                await stop(how)

            async def keeping():
                async with keep_async(drive, "ramp", watchdog_s=3):
                    await drive.start()
                    drive.stop = slow
                    started.set()
                    await asyncio.Event().wait()

            task = asyncio.create_task(keeping())
            await started.wait()
            assert bench.after(1)[0]
            task.cancel()
            await stopping.wait()
            task.cancel()
            await asyncio.sleep(0)
            go_on.set()
            with pytest.raises(asyncio.CancelledError):
                await task
            for _ in range(1000):
                await asyncio.sleep(0)

    asyncio.run(program())
    assert bench.after(60) == (False, 0, False)
    assert bench.watchdog().time_s is None, "as it was before"


def test_drive_that_refuses_its_watchdog_is_not_started(make):
    bench = make()
    bench.virtual.store.factory_set_up = True
    with pytest.raises(RefusedError), keep_on(bench.drive, "ramp"):
        pytest.fail("the block was entered")


def test_kept_until_returns_when_the_event_is_set():
    bench = Bench("threads")
    done = threading.Event()
    bench.line.call_at(bench.line.time + 30, done.set)
    with keep(bench.drive, "ramp", watchdog_s=3) as kept:
        bench.drive.start()
        kept.until(done)
    assert 30 < bench.line.time < 40


# In real time: a thread and a task


@pytest.fixture
def served(serving):
    virtual = virtual_drive("danfoss-fc", 2, model="fc300")
    with serving([virtual], "tcp") as server:
        yield virtual, server.address


@pytest.mark.soak
def test_thread_feeds_the_watchdog(served):
    virtual, port = served
    statuses = []
    before = set(threading.enumerate())
    with drivecomm.open_bus(port) as bus:
        drive = bus.drive("danfoss-fc", 2, model="fc300")
        drive.set_reference(percent=50)
        with keep(drive, "ramp", watchdog_s=0.6, on_status=statuses.append) as kept:
            drive.start()
            time.sleep(1.2)
            kept.sleep(0.3)
            done = threading.Event()
            threading.Timer(0.1, done.set).start()
            kept.until(done)
            assert virtual.motor.target_hz == 25
            assert not virtual.machine.timed_out
        assert len(statuses) >= 4
    assert set(threading.enumerate()) <= before
    assert virtual.motor.target_hz == 0


@pytest.mark.soak
def test_thread_keeps_feeding_after_an_error_of_a_callback(served):
    virtual, port = served
    told, late, often = [], [], threading.Event()

    def fall(_):
        told.append(True)
        if len(told) == 4:
            often.set()
        raise ZeroDivisionError

    with drivecomm.open_bus(port) as bus:
        drive = bus.drive("danfoss-fc", 2, model="fc300")

        def program():
            # On a busy machine a refresh may be late; the test does not judge that.
            with keep(drive, "ramp", watchdog_s=0.6, on_status=fall, on_failure=late.append):
                assert often.wait(5), "the thread has ended"

        with pytest.raises(ZeroDivisionError):
            program()
    assert virtual.peek("8-04", 0) == 0


@pytest.mark.soak
def test_keep_block_waits_for_the_end_of_its_thread(served):
    _, port = served
    entered, go_on, told, late = threading.Event(), threading.Event(), [], []

    def slow(_):
        entered.set()
        assert go_on.wait(5)
        told.append(True)

    with drivecomm.open_bus(port) as bus:
        drive = bus.drive("danfoss-fc", 2, model="fc300")
        with keep(drive, "ramp", watchdog_s=0.6, on_status=slow, on_failure=late.append):
            assert entered.wait(5)
            threading.Timer(0.1, go_on.set).start()
        assert told == [True]


@pytest.mark.soak
def test_thread_reports_a_failed_refresh(served):
    virtual, port = served
    with drivecomm.open_bus(port, reply_timeout_s=0.05, attempts=1) as bus:
        drive = bus.drive("danfoss-fc", 2, model="fc300")
        with keep(drive, "ramp", watchdog_s=3) as kept:
            drive.start()
            hear, virtual.hear = virtual.hear, lambda *_: None
            began = time.monotonic()
            with pytest.raises(NoReplyError, match="1 of 1 refreshes"):
                kept.sleep(30)
            assert time.monotonic() - began < 10
            virtual.hear = hear


@pytest.mark.soak
def test_task_feeds_the_watchdog(served):
    virtual, port = served
    statuses = []

    async def program():
        async with drivecomm.open_bus_async(port) as bus:
            drive = bus.drive("danfoss-fc", 2, model="fc300")
            await drive.set_reference(percent=50)
            async with keep_async(drive, "ramp", watchdog_s=0.6, on_status=statuses.append) as kept:
                assert kept.watchdog.policy == "ramp"
                await drive.start()
                await asyncio.sleep(1.0)
                await kept.sleep(0.3)
                assert not virtual.machine.timed_out
                assert virtual.motor.target_hz == 25
            assert (await drive.read("8-04")).raw == 0

    asyncio.run(program())
    assert len(statuses) >= 4
    assert virtual.motor.target_hz == 0


@pytest.mark.soak
def test_watchdog_is_fed_while_200_tasks_read_on_the_line(served):
    virtual, port = served

    async def program():
        async with drivecomm.open_bus_async(port) as bus:
            drive = bus.drive("danfoss-fc", 2, model="fc300")

            async def read():
                while True:
                    await drive.read("16-13")

            # The stop at the end may cut a refresh off.
            async with keep_async(drive, "ramp", watchdog_s=0.6, on_failure=lambda _: None):
                await drive.start()
                readers = [asyncio.create_task(read()) for _ in range(200)]
                await asyncio.sleep(1.2)
                for each in readers:
                    each.cancel()
                await asyncio.gather(*readers, return_exceptions=True)
                assert not virtual.machine.timed_out

    asyncio.run(program())


def test_cancelled_task_stops_the_motor(served):
    virtual, port = served

    async def program():
        async with drivecomm.open_bus_async(port) as bus:
            drive = bus.drive("danfoss-fc", 2, model="fc300")

            started = asyncio.Event()

            async def keeping():
                async with keep_async(drive, "ramp", watchdog_s=3):
                    await drive.set_reference(percent=50)
                    await drive.start()
                    started.set()
                    await asyncio.sleep(60)

            task = asyncio.create_task(keeping())
            await started.wait()
            assert virtual.motor.target_hz == 25
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

    asyncio.run(program())
    assert virtual.motor.target_hz == 0
    assert virtual.peek("8-04", 0) == 0
