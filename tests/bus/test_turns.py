"""Turns on a line: one call at a time, the more urgent first, otherwise in the order of arrival."""

import gc
import random
import signal
import sys
import threading
import time
from contextlib import suppress

import pytest
from benches import Mortal, Recorder
from extents import extents

import drivecomm
import drivecomm.protocol
from drivecomm.errors import OvertakenError
from drivecomm.virtual import VirtualLine
from drivecomm_vabus.options import VabusOptions
from drivecomm_vabus.telegrams import Ack, Enquiry, Select, Value

THREADS = 20
INTERRUPTS = 3000


class QuickPort:
    """A port with drives that answer immediately, and that no interrupt can confuse."""

    paced, real_time, descriptor = False, True, None
    now = wall_time = staticmethod(time.monotonic)

    def __init__(self):
        codec = drivecomm.protocol.installed["vabus"].codec(VabusOptions())
        self._replies = {}
        for address in (3, 4):
            for sent, reply in (
                (Enquiry(address=address, parameter=481), Value(address=address, parameter=481, data="000003E8")),
                (Select(address=address, parameter=410, data="0007"), Ack(address=address)),
                (Select(address=address, parameter=410, data="0006"), Ack(address=address)),
                (Enquiry(address=address, parameter=11), Value(address=address, parameter=11, data="0000")),
                (Enquiry(address=address, parameter=412), Value(address=address, parameter=412, data="0001")),
                (Select(address=address, parameter=410, data="0000"), Ack(address=address)),
            ):
                self._replies[codec.encode(sent)] = codec.encode(reply)
        self._waiting = b""

    def configure(self, _settings):
        return ""

    def write(self, data):
        self._waiting = self._replies.get(data, b"")

    def read(self, until, _at_least):
        data, self._waiting = self._waiting, b""
        if not data:
            self.wait(until)
        return data

    def take(self):
        return self.read(0.0, 1)

    def hold_back(self, at_least):
        pass

    def wait(self, until):
        while time.monotonic() < until:
            time.sleep(0)

    def close(self):
        pass


@pytest.mark.soak
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no timer that sends signals")
@pytest.mark.timeout(180, method="thread")  # the test itself has the timer
@extents(INTERRUPTS // 10, INTERRUPTS)
def test_ctrl_c_at_any_instruction_loses_no_turn(extent):
    """Thousands of interrupts at random instructions of a call; the next call still gets its turn."""
    interrupted, seed = 0, random.Random(5)

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    over, others = threading.Event(), []
    with drivecomm.open_bus(QuickPort, gap_s=0.0) as bus:
        drive, other = bus.drive("vabus", 3), bus.drive("vabus", 4)

        def ask():
            while not over.is_set():
                with suppress(OvertakenError):
                    others.append(other.read("481"))

        thread = threading.Thread(target=ask)
        thread.start()
        try:
            for _ in range(extent):
                try:
                    signal.setitimer(signal.ITIMER_REAL, seed.uniform(1e-6, 800e-6))
                    while True:
                        drive.read("481")
                except KeyboardInterrupt:
                    interrupted += 1
                    # Handled where the interrupted call is still known, as a program does to stop its motors.
                    drive.stop()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
            over.set()
        thread.join(10)
        assert not thread.is_alive()
        assert drive.read("481").raw == "000003E8"
    assert interrupted == extent
    assert len(others) > 100


@pytest.fixture
def _often_interrupted():
    """Switch between threads as often as possible."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


class TestBus:
    def crowd(self, work, number=THREADS):
        """Run `work` in many threads that begin together; return the errors raised."""
        raised, gate = [], threading.Barrier(number)

        def run(name):
            gate.wait(10)
            try:
                work(name)
            except BaseException as error:  # noqa: BLE001 - the test checks any error
                raised.append(error)

        threads = [threading.Thread(target=run, args=(name,)) for name in range(number)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
            assert not thread.is_alive()
        return raised

    def test_reading_has_the_time_of_its_own_reply(self):
        """The time is right although the thread continues late, and another caller has the line by then."""
        line = VirtualLine([Mortal("danfoss-fc", address) for address in (1, 2)])
        recorder = Recorder()
        with drivecomm.open_bus(line.port, trace=recorder) as bus:
            first, second = (bus.drive("danfoss-fc", address) for address in (1, 2))
            hand_on, others = bus.line.turns.hand_on, [True]

            def hand_on_and_be_slow():
                hand_on()
                if others:
                    others.clear()
                    thread = threading.Thread(target=second.status)
                    thread.start()
                    thread.join(10)

            bus.line.turns.hand_on = hand_on_and_be_slow
            reading = first.read("3-10[3]")
        own, other = recorder.of("received")
        assert (own.drive, other.drive) == (first.name, second.name)
        assert reading.time_s == own.time

    @pytest.mark.usefixtures("_often_interrupted")
    def test_drives_can_be_made_while_others_are_commanded(self):
        line = VirtualLine([Mortal("danfoss-fc", address) for address in (1, 2)])
        with drivecomm.open_bus(line.port) as bus:
            kept = [bus.drive("danfoss-fc", 1 + number % 126) for number in range(300)]

            def work(name):
                for number in range(30):
                    if name % 2:
                        kept.append(bus.drive("danfoss-fc", 1 + (7 * name + number) % 126))
                        assert bus.health is not None
                    else:
                        assert bus.command(kept[0].peer).cancelled is False
                        assert bus.counters is not None

            assert self.crowd(work, 8) == []

    def test_drives_can_be_added_while_the_counters_are_read(self):
        """Python may collect garbage whenever an object is made, and other code runs during the collection."""
        with drivecomm.open_bus(VirtualLine([]).port) as bus:
            to_add = iter(range(1, 127))

            def add_one(phase, _):
                if phase == "start" and (address := next(to_add, None)):
                    bus.drive("danfoss-fc", address, set_up={"3-41": 1})

            add_one("start", None)
            before = gc.get_threshold()
            seen, hoard = [], []
            gc.callbacks.append(add_one)
            try:
                for read in (lambda: bus.counters, lambda: bus.health, lambda: bus.statistics) * 12:
                    # Python keeps discarded tuples for reuse; only newly allocated ones trigger a collection.
                    hoard.append([(number, hoard) for number in range(2100)])
                    gc.set_threshold(1)
                    seen.append(len(read()))
                    gc.set_threshold(*before)
            finally:
                gc.callbacks.remove(add_one)
                gc.set_threshold(*before)
            assert seen == sorted(seen)
            assert seen[-1] > seen[0]
