"""Stops come before everything else, a stopped motor is never restarted, and old data is not trusted."""

import asyncio
import threading
import time
from contextlib import suppress

import pytest
from benches import ADDRESS, Mortal, Port, Recorder
from two_faces import each_face, open_on

import drivecomm
from drivecomm.bus import keep, keep_async, open_bus_async
from drivecomm.errors import (
    CommandCancelledError,
    DriveCommError,
    LinkDownError,
    OvertakenError,
    StateError,
    UsageError,
)
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def served(serving):
    virtual = virtual_drive("danfoss-fc", 2, model="fc300")
    with serving([virtual], "tcp") as server:
        yield virtual, server.address


class TestInterrupting:
    """A slow or missing drive does not delay the stop of another drive."""

    def test_reply_in_time_is_returned_although_a_stop_waits(self):
        """A read on the wire when a stop is called returns its value if the drive answers as quickly as usual."""
        line = VirtualLine([Mortal("danfoss-fc", 1)])
        sent = []
        with drivecomm.open_bus(line.port, trace=lambda event: sent.append(event.what)) as bus:
            first = bus.drive("danfoss-fc", 1)
            first.probe()
            bus._roster.link.stop_waits = lambda: sent[-1] == "sent"
            assert first.status().word


class TestCancelling:
    def test_start_task_that_has_not_begun_is_cancelled_by_a_stop(self, served):
        virtual, port = served

        async def program():
            async with open_bus_async(port) as bus:
                fan = bus.drive("danfoss-fc", 2, model="fc300")
                await fan.set_reference(percent=50)
                starting = asyncio.create_task(fan.start())
                await fan.stop()
                with pytest.raises((CommandCancelledError, OvertakenError)):
                    await starting
                assert not (await fan.status()).running

        asyncio.run(program())
        assert virtual.motor.target_hz == 0

    def test_stop_does_not_cancel_commands_for_other_drives(self):
        line = VirtualLine([Mortal("danfoss-fc", 1), Mortal("danfoss-fc", 2)])
        with drivecomm.open_bus(line.port) as bus:
            first, second = bus.drive("danfoss-fc", 1), bus.drive("danfoss-fc", 2)
            waiting = bus.command(second.peer)
            everybody = bus.command(bus.broadcast("danfoss-fc").peer)
            first.stop()
            assert not waiting.cancelled
            assert everybody.cancelled, "it would reach the drive that was stopped"
            bus.broadcast("vabus").stop()
            assert not waiting.cancelled
            bus.broadcast("danfoss-fc").stop()
            assert waiting.cancelled


class Bench:
    def __init__(self, model="fc300", **options):
        self.virtual = virtual_drive("danfoss-fc", 2, model=model)
        self.line = VirtualLine([self.virtual])
        self.recorder = Recorder()
        self.told = None
        self.bus = drivecomm.open_bus(self.line.port, trace=self.traced)
        self.drive = self.bus.drive("danfoss-fc", 2, model=model, **options)

    def traced(self, event):
        self.recorder(event)
        if self.told is not None:
            self.told(event)

    def words(self):
        """Return the valid control words sent so far."""
        messages = [event.message for event in self.recorder.events if event.what == "sent"]
        return [message.control_word for message in messages if message.control_word & 0x0400]

    def run(self, for_s=10.0):
        self.drive.set_reference(percent=50)
        self.drive.start()
        self.line.advance(for_s)
        assert self.drive.status().running

    def hz(self, after_s=10):
        self.line.advance(after_s)
        self.virtual.peek("16-13", self.line.time)
        return self.virtual.motor.output_hz


class TestNothingIsBroughtBack:
    @pytest.mark.parametrize("watched", [None, 20.0])
    @pytest.mark.parametrize("dip_s", [0.5, 5.0])
    def test_dip_of_the_mains_between_two_reads_restarts_nothing(self, watched, dip_s):
        bench = Bench()
        bench.drive.watched(watched)
        bench.run()
        bench.line.power_off(bench.virtual)
        bench.line.advance(dip_s)
        bench.line.power_on(bench.virtual)
        bench.drive.read("16-13")
        bench.drive.status()
        bench.drive.status()
        assert bench.hz() == 0

    def test_unheard_broadcast_stop_ends_the_feeding_of_the_watchdog(self):
        bench = Bench()
        bench.drive.watched(60)
        bench.run()
        before = bench.words()
        bench.drive.status()
        assert len(bench.words()) > len(before), "what the drive obeys is repeated for its watchdog"
        bench.virtual.hear, hear = (lambda *_: None), bench.virtual.hear
        bench.bus.broadcast("danfoss-fc").stop()
        bench.line.advance(0.1)
        bench.virtual.hear = hear
        before = bench.words()
        assert bench.drive.status().running
        assert bench.words() == before

    def test_start_confirmed_while_a_broadcast_stop_waits_is_not_repeated(self):
        bench = Bench()
        everybody = bench.bus.broadcast("danfoss-fc")
        bench.drive.watched(60)
        bench.drive.set_reference(percent=50)
        stopping = threading.Thread(target=everybody.stop)

        def stop_after_the_start(event):
            if event.what == "sent" and event.message.control_word == 0x047C:
                stopping.start()
                while not bench.bus._roster.link.stop_waits():
                    time.sleep(0.001)
            if event.what == "received" and stopping.ident:
                bench.virtual.hear = lambda *_: None

        hear, bench.told = bench.virtual.hear, stop_after_the_start
        bench.drive.start()
        stopping.join(5)
        bench.line.advance(0.1)
        bench.virtual.hear, bench.told = hear, None
        assert bench.virtual.motor.target_hz, "it has not heard the stop"
        before = bench.words()
        bench.drive.status()
        assert bench.words() == before

    def test_refresh_after_the_watchdog_has_acted_restarts_nothing(self):
        """The refresh was due in time but waited for the line; the motor still ramps down and reports running."""
        bench = Bench()
        failures = []
        with keep(bench.drive, "ramp", watchdog_s=1, on_failure=failures.append) as kept:
            bench.run(0.5)
            bench.line.advance(1.5)
            before = bench.words()
            kept.sleep(0.5)
            assert bench.words() == before
            assert bench.hz() == 0
        assert any("longer than its watchdog waits" in str(failure) for failure in failures)

    def test_reference_after_the_watchdog_has_acted_restarts_nothing(self):
        bench = Bench()
        drivecomm.set_watchdog(bench.drive, "ramp", 1)
        bench.drive.stop()
        bench.run(0.5)
        bench.line.advance(1.5)
        with pytest.raises(DriveCommError):
            bench.drive.set_reference(percent=80)
        assert bench.hz() == 0

    def test_refused_verb_of_a_read_only_drive_sends_no_control_word(self):
        bench = Bench(read_only=True)
        for verb, arguments in (
            ("control_word", {"word": 0x0474}),
            ("set_relay", {"number": 1, "on": True}),
            ("select_preset", {"number": 2}),
            ("ramp", {"number": 2}),
        ):
            with pytest.raises(UsageError):
                bench.drive.call(verb, **arguments)
            bench.drive.status()
            bench.drive.read("16-13")
        assert bench.words() == []
        bench.drive.stop()
        for verb, arguments in (
            ("set_relay", {"number": 1, "on": True}),
            ("select_setup", {"number": 2}),
            ("select_preset", {"number": 2}),
        ):
            with pytest.raises(UsageError):
                bench.drive.call(verb, **arguments)
        bench.drive.status()
        bench.drive.read("16-13")
        assert bench.words() == [0x043C], "nor is its stop repeated, with which another master's motor would be stopped"

    def test_motor_stopped_by_another_master_stays_stopped(self):
        """We set a reference and never start; another master starts and stops; then we read, and select a set-up."""
        bench = Bench()
        bench.drive.set_reference(percent=50)
        other = drivecomm.open_bus(bench.line.port).drive("danfoss-fc", 2, model="fc300")
        other.start()
        bench.line.advance(10)
        bench.drive.identify()
        bench.drive.status()
        other.stop()
        bench.line.advance(10)
        bench.drive.identify()
        with suppress(StateError, UsageError):
            bench.drive.select_setup(2)
        assert bench.hz() == 0

    @each_face
    def test_run_command_is_not_repeated_after_the_port_was_lost(self, face):
        virtual, closed = Mortal("danfoss-fc"), []
        line = VirtualLine([virtual])

        def port():
            return Port(line.port(), close=lambda: closed.append(line.time))

        with open_on(face, port) as bus:
            drive = bus.drive("danfoss-fc", ADDRESS)
            drive.set_reference(percent=50)
            drive.start()
            line.broken = True
            with pytest.raises(LinkDownError):
                drive.status()
            assert len(closed) == 1
            line.broken = False
            virtual.heard.clear()
            line.advance(1)
            drive.status()
            drive.read("3-10[3]")
        assert len(virtual.heard) >= 2
        assert all(not message.control_word & 1 << 10 for _, message in virtual.heard)


class TestLateReplies:
    def test_late_reply_to_an_aborted_write_does_not_confirm_the_next_one(self):
        drive = Mortal("vabus")
        line = VirtualLine([drive])
        broken = []

        def trace(event):
            if event.what == "sent" and not broken and getattr(event.message, "parameter", 0) == 481:
                broken.append(True)
                raise ZeroDivisionError

        with drivecomm.open_bus(line.port, trace=trace) as bus:
            pump = bus.drive("vabus", 3, model="agile")
            with pytest.raises(ZeroDivisionError):
                pump.write("481", 12)
            events = []
            bus._roster.link._line.trace = events.append
            pump.write("480", 3)
            received = [event for event in events if event.what == "received" and event.message.kind == "ack"]
            noise = [event for event in events if event.what == "noise"]
            assert len(received) == 1
            assert noise, "the confirmation of the first write was thrown away"
            assert (drive.peek("481", 0), drive.peek("480", 0)) == ("000004B0", "0000012C")

    def test_surplus_reply_of_a_retry_does_not_answer_the_next_request(self):
        """The drive answers after its reply timeout, but before the wait for late replies ends."""
        line = VirtualLine([Mortal("vabus")])
        with drivecomm.open_bus(line.port) as bus:
            slow = bus.drive("vabus", 3, reply_timeout_s=0.05, late_s=1.0, model="agile")
            slow.read("481")
            line.faults = Delayed(0.12)
            first = slow.read("481")
            line.drives[0].poke("481", 2500)
            assert slow.read("481").value == 25, f"not {first}, which an earlier attempt had asked for"

    def test_late_confirmation_of_an_overtaken_write_confirms_nothing_else(self):
        """The write is overtaken before its confirmation arrives; the next write to that drive lets it pass."""
        line = VirtualLine([Mortal("vabus"), Mortal("vabus", 4)])
        with drivecomm.open_bus(line.port) as bus:
            first = bus.drive("vabus", 3, model="agile", reply_timeout_s=2.0)
            line.faults = Delayed(3.0)
            bus._roster.link.stop_waits = lambda: line.time > 0.05
            with pytest.raises(OvertakenError, match="whether the drive acted on it is not known"):
                first.write("481", 12)
            bus._roster.link.stop_waits = lambda: False
            line.faults = Delayed(0.0)
            began = line.time
            first.write("480", 3)
            assert line.time - began > 0.9


class Delayed:
    """Faults that only delay replies."""

    rate = 0.0

    def __init__(self, delay_s):
        self._delay_s = delay_s

    def request(self, data):
        return [(0.0, data)]

    def reply(self, data):
        return [(self._delay_s, data)]


@pytest.mark.soak
def test_cancelled_task_leaves_the_bus_before_it_is_closed(served):
    virtual, port = served
    unhandled = []

    async def program():
        asyncio.get_running_loop().set_exception_handler(lambda _, context: unhandled.append(context))

        async def kept():
            async with open_bus_async(port) as bus:
                fan = bus.drive("danfoss-fc", 2, model="fc300")
                await fan.set_reference(percent=50)
                async with keep_async(fan, "ramp", watchdog_s=2):
                    await fan.start()
                    await asyncio.sleep(60)

        task = asyncio.create_task(kept())
        await asyncio.sleep(0.5)
        for _ in range(3):
            task.cancel()
            await asyncio.sleep(0)
        with pytest.raises(asyncio.CancelledError):
            await task
        await asyncio.sleep(0.05)

    asyncio.run(program())
    assert unhandled == []
    assert virtual.motor.target_hz == 0
