"""Whose turn it is on a line: one at a time, the more urgent first, otherwise in the order of coming."""

import asyncio
import gc
import random
import signal
import sys
import threading
import time
from collections import Counter
from contextlib import suppress

import pytest
from benches import PROTOCOLS, READABLE, Mortal, Port, Recorder
from extents import extents

import drivecomm
import drivecomm.protocol
from drivecomm.bus import AsyncPriorityLock, PriorityLock, Rank, Turn
from drivecomm.errors import DriveCommError, OvertakenError, UsageError
from drivecomm.virtual import VirtualLine
from drivecomm_vabus.options import VabusOptions
from drivecomm_vabus.telegrams import Ack, Enquiry, Select, Value

THREADS = 20
INTERRUPTS = 3000


def wait_for(condition):
    until = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < until, "nothing happens"
        time.sleep(0.001)


class QuickPort:
    """Drives that answer at once whatever they are asked, and that no interrupt can confuse."""

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


class Interrupted:
    """A lock at which Ctrl-C comes."""

    def locked(self):
        return True

    def acquire(self, timeout=None):
        if timeout is not None:
            raise KeyboardInterrupt


def has_turn(turns, turn, seconds):
    """Ask for a turn that is held and wait for it, as a bus does; returns whether it came in time."""
    return turns.ask(turn) or turns.wait(turn, seconds)


def take(turns, rank, seconds=0.0):
    """Take a turn as a bus does; returns it, None when it has not come in time."""
    turn = Turn(rank)
    turn.held.acquire()
    if has_turn(turns, turn, seconds):
        return turn
    turn.held.release()
    return None


def give_back(turns, turn):
    turn.held.release()
    turns.hand_on()


class Crowd:
    """Threads that take turns; each notes when it is called, and gives back."""

    def __init__(self, turns):
        self.turns = turns
        self.called = []
        self.threads = []

    def join(self, name, rank, seconds=10.0):
        """Let one more wait, and see that it does."""
        waiting = len(self.turns.waiting)

        def wait():
            if turn := take(self.turns, rank, seconds):
                self.called.append(name)
                give_back(self.turns, turn)
            else:
                self.called.append(f"not {name}")

        thread = threading.Thread(target=wait)
        thread.start()
        self.threads.append(thread)
        wait_for(lambda: len(self.turns.waiting) > waiting)

    def leave(self):
        for thread in self.threads:
            thread.join(10)
            assert not thread.is_alive()


class TestThreads:
    def test_a_free_line_is_taken_at_once(self):
        turns = PriorityLock()
        turn = take(turns, Rank.POLL)
        assert turn
        assert not take(turns, Rank.STOP)
        give_back(turns, turn)
        assert take(turns, Rank.POLL)

    def test_a_turn_that_comes_right_after_it_was_asked_for_is_no_other_one(self):
        lock, first, mine = PriorityLock(), Turn(Rank.POLL), Turn(Rank.STOP)
        with mine.held:
            with first.held:
                assert lock.ask(first)
                assert lock.is_mine_besides(mine)
                assert not lock.ask(mine)
            lock.hand_on()
            assert lock.has_come(mine)
            assert not lock.is_mine_besides(mine)

    def test_ranks_overtake_and_equals_do_not(self):
        crowd = Crowd(PriorityLock())
        turn = take(crowd.turns, Rank.READ)
        for number, rank in enumerate([Rank.POLL, Rank.READ, Rank.COMMAND, Rank.READ, Rank.STOP, Rank.POLL, Rank.STOP]):
            crowd.join(f"{rank.name} {number}", rank)
        give_back(crowd.turns, turn)
        crowd.leave()
        assert crowd.called == ["STOP 4", "STOP 6", "COMMAND 2", "READ 1", "READ 3", "POLL 0", "POLL 5"]

    def test_nobody_slips_in_between(self):
        """Whoever comes when a turn is over, and the next has not been called yet, waits behind those who wait."""
        crowd = Crowd(PriorityLock())
        turn = take(crowd.turns, Rank.READ)
        crowd.join("waiting", Rank.READ)
        with crowd.turns._guard:
            turn.held.release()
            crowd.threads.append(threading.Thread(target=lambda: crowd.called.append(take(crowd.turns, Rank.READ, 5))))
            crowd.threads[-1].start()
            time.sleep(0.05)
        crowd.leave()
        assert crowd.called[0] == "waiting"
        assert isinstance(crowd.called[1], Turn)

    def test_who_has_waited_long_enough_leaves(self):
        crowd = Crowd(PriorityLock())
        turn = take(crowd.turns, Rank.READ)
        crowd.join("hasty", Rank.STOP, seconds=0.03)
        crowd.join("patient", Rank.POLL)
        wait_for(lambda: crowd.called == ["not hasty"])
        assert not crowd.turns.stop_waits()
        give_back(crowd.turns, turn)
        crowd.leave()
        assert crowd.called == ["not hasty", "patient"]
        assert take(crowd.turns, Rank.POLL)

    def test_many_who_give_up_in_the_moment_in_which_they_are_called(self):
        turns, inside, most, served = PriorityLock(), [], [], Counter()

        def work(name):
            for number in range(150):
                turn = take(turns, Rank.READ, 0.0005 * (number % 3))
                if turn is None:
                    served["gave up"] += 1
                    continue
                inside.append(name)
                most.append(len(inside))
                if number % 5 == 0:
                    time.sleep(0.0005)
                inside.pop()
                served["served"] += 1
                give_back(turns, turn)

        threads = [threading.Thread(target=work, args=(name,)) for name in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(30)
            assert not thread.is_alive()
        assert max(most) == 1
        assert served["gave up"] > 0
        assert served["served"] > 0
        assert take(turns, Rank.READ)

    def test_whoever_is_interrupted_in_the_middle_of_a_turn_is_not_waited_for(self):
        """However a turn ends, it is over, and the others see it though nobody calls them."""
        crowd = Crowd(PriorityLock())
        turn = take(crowd.turns, Rank.READ)
        crowd.join("next", Rank.READ)
        turn.held.release()
        crowd.leave()
        assert crowd.called == ["next"]

    def test_whoever_is_interrupted_while_waiting_is_not_called(self):
        crowd = Crowd(PriorityLock())
        turn, gone = take(crowd.turns, Rank.READ), Turn(Rank.STOP)
        gone.called = Interrupted()
        with pytest.raises(KeyboardInterrupt), gone.held:
            has_turn(crowd.turns, gone, 10.0)
        assert not crowd.turns.stop_waits()
        crowd.join("next", Rank.READ)
        give_back(crowd.turns, turn)
        crowd.leave()
        assert crowd.called == ["next"]

    @pytest.mark.soak
    @pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no timer that sends signals")
    @pytest.mark.timeout(180, method="thread")  # the test itself has the timer
    @extents(INTERRUPTS // 10, INTERRUPTS)
    def test_ctrl_c_at_any_instruction_loses_no_turn(self, extent):
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
                        # Handled where the interrupted call is still known, as a program does that stops its motors.
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
    """Let threads be switched as often as can be."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


class TestBus:
    def crowd(self, work, number=THREADS):
        """Let threads begin together; returns what they raised."""
        raised, gate = [], threading.Barrier(number)

        def run(name):
            gate.wait(10)
            try:
                work(name)
            except BaseException as error:  # noqa: BLE001 - the test asks for it
                raised.append(error)

        threads = [threading.Thread(target=run, args=(name,)) for name in range(number)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
            assert not thread.is_alive()
        return raised

    @pytest.mark.parametrize("protocol", PROTOCOLS)
    def test_twenty_threads_do_not_interleave_and_each_gets_its_own_value(self, protocol):
        line = VirtualLine([Mortal(protocol, address) for address in range(1, 6)])
        recorder, wrong = Recorder(), []
        with drivecomm.open_bus(line.port, trace=recorder) as bus:

            def work(name):
                drive = bus.drive(protocol, 1 + name % 5)
                parameter = READABLE[protocol][name % 2]
                expected = line.drives[name % 5].peek(parameter, 0.0)
                raws = {drive.read(parameter).raw for _ in range(8)}
                if raws != {expected}:
                    wrong.append((drive.name, parameter, raws))

            assert self.crowd(work) == []
        assert wrong == []
        spoken = [event for event in recorder.events if getattr(event.message, "kind", "") != "eot"]
        assert [event.what for event in spoken] == ["sent", "received"] * (THREADS * 8)
        for request, reply in zip(spoken[::2], spoken[1::2], strict=True):
            assert request.drive == reply.drive

    @pytest.mark.soak
    def test_twenty_threads_get_the_line_equally_often(self):
        line = VirtualLine([Mortal("vabus", address) for address in range(1, THREADS + 1)])
        recorder = Recorder()
        stop = threading.Event()
        with drivecomm.open_bus(line.port, trace=recorder) as bus:

            def work(name):
                drive = bus.drive("vabus", name + 1)
                while not stop.is_set():
                    drive.status()
                    if len(recorder.events) > 100 * THREADS:
                        stop.set()

            assert self.crowd(work) == []
        order = [event.drive for event in recorder.of("received")]
        # From when all are there to when the first leaves.
        middle = order[4 * THREADS : -4 * THREADS]
        served = Counter(middle)
        assert len(served) == THREADS
        # On a busy machine a thread that has just been served may be late to ask again; without turns some get none.
        assert 4 * min(served.values()) >= 3 * max(served.values()), served

    def test_stops_overtake_commands_and_they_overtake_readings(self):
        virtual = Mortal("vabus")
        line = VirtualLine([Mortal("vabus", 4), virtual])
        entered, leave = threading.Event(), threading.Event()
        held = []

        def hold(*_):
            if not held:
                held.append(True)
                entered.set()
                assert leave.wait(10)

        done = []
        with drivecomm.open_bus(lambda: Port(line.port(), write=hold)) as bus:
            drive = bus.drive("vabus", 3, model="agile")
            threads = [threading.Thread(target=drive.probe)]
            threads[0].start()
            assert entered.wait(10)
            for name, call in (
                ("poll", lambda: drive.polled("481")),
                ("read", lambda: drive.read("481")),
                ("status", drive.status),
                ("write", lambda: drive.write("481", 1)),
                ("reset", drive.reset),
                ("stop", bus.drive("vabus", 4).stop),
            ):

                def work(name=name, call=call):
                    call()
                    done.append(name)

                waiting = len(bus._lock.waiting)
                threads.append(threading.Thread(target=work))
                threads[-1].start()
                wait_for(lambda waiting=waiting: len(bus._lock.waiting) > waiting)
            queue = sorted(bus._lock.waiting, key=lambda turn: (turn.rank, turn.order))
            leave.set()
            for thread in threads:
                thread.join(10)
        assert [turn.rank for turn in queue] == [Rank.STOP, Rank.COMMAND, Rank.COMMAND, *[Rank.READ] * 2, Rank.POLL]
        assert done[0] == "stop"
        assert sorted(done) == ["poll", "read", "reset", "status", "stop", "write"]
        kinds = [message.kind for _, message in virtual.heard if getattr(message, "parameter", None) == 481]
        assert kinds == ["select", "enquiry", "enquiry"], "the write before anybody's reading of the same parameter"

    def test_a_stop_of_all_overtakes_what_waits(self):
        line, recorder = VirtualLine([Mortal("vabus")]), Recorder()
        entered, leave = threading.Event(), threading.Event()

        def hold(*_):
            if not entered.is_set():
                entered.set()
                assert leave.wait(10)

        with drivecomm.open_bus(lambda: Port(line.port(), write=hold), trace=recorder) as bus:
            drive = bus.drive("vabus", 3)
            threads = [threading.Thread(target=drive.probe)]
            threads[0].start()
            assert entered.wait(10)
            for call in (lambda: drive.read("481"), bus.broadcast("vabus").stop):
                waiting = len(bus._lock.waiting)
                threads.append(threading.Thread(target=call))
                threads[-1].start()
                wait_for(lambda waiting=waiting: len(bus._lock.waiting) > waiting)
            leave.set()
            for thread in threads:
                thread.join(10)
        asked = [event.message.parameter for event in recorder.sent() if event.message.kind in ("select", "enquiry")]
        assert asked[1:] == [410, 481]

    def test_a_bus_is_not_closed_in_the_middle_of_an_exchange(self):
        line, closed = VirtualLine([Mortal("vabus")]), []
        entered, leave = threading.Event(), threading.Event()

        def hold(*_):
            if not entered.is_set():
                entered.set()
                assert leave.wait(10)

        port = Port(line.port(), write=hold, close=lambda: closed.append(leave.is_set()))
        bus = drivecomm.open_bus(lambda: port)
        drive, read = bus.drive("vabus", 3), []
        reading = threading.Thread(target=lambda: read.append(drive.read("481").raw))
        reading.start()
        assert entered.wait(10)
        closing = threading.Thread(target=bus.close)
        closing.start()
        closing.join(0.05)
        leave.set()
        for thread in (reading, closing):
            thread.join(10)
        assert read == ["000003E8"]
        assert closed == [True]

    def test_a_reading_has_the_time_of_its_own_reply(self):
        """However long it takes until its thread goes on, and whoever has the line by then."""
        line = VirtualLine([Mortal("danfoss-fc", address) for address in (1, 2)])
        recorder = Recorder()
        with drivecomm.open_bus(line.port, trace=recorder) as bus:
            first, second = (bus.drive("danfoss-fc", address) for address in (1, 2))
            hand_on, others = bus._lock.hand_on, [True]

            def hand_on_and_be_slow():
                hand_on()
                if others:
                    others.clear()
                    thread = threading.Thread(target=second.status)
                    thread.start()
                    thread.join(10)

            bus._lock.hand_on = hand_on_and_be_slow
            reading = first.read("3-10[3]")
        own, other = recorder.of("received")
        assert (own.drive, other.drive) == (first.name, second.name)
        assert reading.time_s == own.time

    @pytest.mark.usefixtures("_often_interrupted")
    def test_drives_may_be_made_while_others_are_commanded(self):
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

    @pytest.mark.usefixtures("_often_interrupted")
    def test_counters_may_be_read_while_drives_are_added(self):
        line = VirtualLine([])
        with drivecomm.open_bus(line.port, reply_timeout_s=0.01) as bus:
            over = threading.Event()

            def work(name):
                if name:
                    while not over.is_set():
                        assert bus.counters is not None
                        assert bus.health is not None
                        assert bus.statistics is not None
                    return
                try:
                    for address in range(1, 127):
                        drive = bus.drive("danfoss-fc", address, set_up={"3-41": 1} if address % 2 else None)
                        with pytest.raises(DriveCommError):
                            drive.probe()
                finally:
                    over.set()

            assert self.crowd(work, 3) == []

    def test_drives_may_be_added_while_the_counters_are_gone_through(self):
        """Python may collect garbage whenever an object is made, and others go on meanwhile."""
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
                    # Python keeps pairs that were thrown away for use again; what it has to make anew counts.
                    hoard.append([(number, hoard) for number in range(2100)])
                    gc.set_threshold(1)
                    seen.append(len(read()))
                    gc.set_threshold(*before)
            finally:
                gc.callbacks.remove(add_one)
                gc.set_threshold(*before)
            assert seen == sorted(seen)
            assert seen[-1] > seen[0]

    def test_a_trace_function_cannot_wait_for_itself(self):
        line = VirtualLine([Mortal("vabus")])
        said = []

        def trace(_):
            if not said:
                with pytest.raises(UsageError, match="a trace function cannot use the bus that calls it") as caught:
                    drive.probe()
                said.append(caught.value)

        with drivecomm.open_bus(line.port, trace=trace) as bus:
            drive = bus.drive("vabus", 3)
            drive.read("481")
            assert drive.read("481").raw == "000003E8"
        assert len(said) == 1

    def test_an_error_in_a_trace_function_leaves_the_line_to_the_others(self):
        line = VirtualLine([Mortal("vabus")])
        broken = [True]

        def trace(event):
            if broken and event.what == "sent":
                broken.clear()
                raise ZeroDivisionError

        with drivecomm.open_bus(line.port, trace=trace) as bus:
            drive = bus.drive("vabus", 3)
            with pytest.raises(ZeroDivisionError):
                drive.read("481")
            assert drive.read("482", type="long").raw == "000009C4"


async def queued(turns, ranks, called):
    """Let tasks wait for a line that is taken; each notes its number when it is called, and hands the line on."""
    assert await turns.take(Rank.READ, 1.0)

    async def wait(number, rank):
        assert await turns.take(Rank(rank), 10.0)
        called.append(number)
        turns.give_back()

    tasks = [asyncio.create_task(wait(number, rank)) for number, rank in enumerate(ranks)]
    await asyncio.sleep(0)
    return tasks


class TestTasks:
    """The same turns for tasks."""

    def test_the_order_is_by_rank_and_then_by_coming(self):
        async def main():
            turns, called, ranks = AsyncPriorityLock(), [], [3, 2, 2, 0, 1, 3, 0, 1]
            tasks = await queued(turns, ranks, called)
            assert len(turns._waiting) == 8
            turns.give_back()
            await asyncio.gather(*tasks)
            assert [f"{ranks[number]}{number}" for number in called] == [
                "03", "06", "14", "17", "21", "22", "30", "35",
            ]  # fmt: skip

        asyncio.run(main())

    def test_leaving_keeps_the_order_of_the_others(self):
        async def main(gone):
            turns, called = AsyncPriorityLock(), []
            tasks = await queued(turns, [Rank.READ] * 9, called)
            place = turns._waiting[gone]
            assert turns._left(place)
            assert not turns._left(place)
            turns.give_back()
            await asyncio.gather(*tasks[:gone], *tasks[gone + 1 :])
            assert called == [number for number in range(9) if number != gone]
            tasks[gone].cancel()

        for gone in range(9):
            asyncio.run(main(gone))

    def test_those_who_are_equal_are_not_the_same(self):
        async def main():
            turns, called = AsyncPriorityLock(), []
            tasks = await queued(turns, [Rank.READ] * 2, called)
            first, second = turns._waiting
            assert first < second
            assert turns._left(second)
            assert turns._waiting == [first]
            turns.give_back()
            await tasks[0]
            assert called == [0]
            tasks[1].cancel()

        asyncio.run(main())

    def test_the_line_is_not_lost_when_it_is_handed_on_in_the_moment_in_which_the_time_is_over(self):
        async def main():
            turns = AsyncPriorityLock()
            assert await turns.take(Rank.READ, 1.0)
            waiting = asyncio.create_task(turns.take(Rank.READ, 0.01))
            await asyncio.sleep(0)
            # The next round of the loop hands the line on, and sees then that the time is over.
            time.sleep(0.02)  # noqa: ASYNC251 - on purpose
            asyncio.get_running_loop().call_soon(turns.give_back)
            if await waiting:
                turns.give_back()
            assert await turns.take(Rank.READ, 0.0)

        asyncio.run(main())

    def test_ranks_overtake_and_equals_do_not(self):
        async def main():
            turns, called = AsyncPriorityLock(), []
            assert await turns.take(Rank.READ, 1.0)

            async def wait(name, rank):
                assert await turns.take(rank, 10.0)
                called.append(name)
                turns.give_back()

            ranks = [Rank.POLL, Rank.READ, Rank.COMMAND, Rank.READ, Rank.STOP, Rank.POLL, Rank.STOP]
            tasks = [asyncio.create_task(wait(f"{rank.name} {number}", rank)) for number, rank in enumerate(ranks)]
            await asyncio.sleep(0)
            turns.give_back()
            await asyncio.gather(*tasks)
            assert called == ["STOP 4", "STOP 6", "COMMAND 2", "READ 1", "READ 3", "POLL 0", "POLL 5"]
            assert not turns._taken

        asyncio.run(main())

    @pytest.mark.parametrize("seconds", [0.0, 0.01])
    def test_who_has_waited_long_enough_leaves(self, seconds):
        async def main():
            turns = AsyncPriorityLock()
            assert await turns.take(Rank.READ, seconds)
            assert not await turns.take(Rank.STOP, seconds)
            assert len(turns._waiting) == 0
            turns.give_back()
            assert await turns.take(Rank.POLL, seconds)

        asyncio.run(main())

    @pytest.mark.parametrize("called_first", [False, True])
    @pytest.mark.parametrize("times", [1, 2])
    def test_cancelled_while_waiting(self, called_first, times):
        """Also in the moment of being called, and twice."""

        async def main():
            turns = AsyncPriorityLock()
            assert await turns.take(Rank.READ, 1.0)
            waiting = asyncio.create_task(turns.take(Rank.READ, 10.0))
            behind = asyncio.create_task(turns.take(Rank.POLL, 10.0))
            await asyncio.sleep(0)
            if called_first:
                turns.give_back()
            for _ in range(times):
                waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            if not called_first:
                assert not behind.done()
                turns.give_back()
            assert await behind
            turns.give_back()
            assert not turns._taken
            assert await turns.take(Rank.READ, 0.0)

        asyncio.run(main())

    def test_cancelled_before_the_line_is_handed_on_in_the_same_breath(self):
        async def main():
            turns = AsyncPriorityLock()
            assert await turns.take(Rank.READ, 1.0)
            waiting = asyncio.create_task(turns.take(Rank.READ, 10.0))
            behind = asyncio.create_task(turns.take(Rank.READ, 10.0))
            await asyncio.sleep(0)
            waiting.cancel()
            turns.give_back()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            assert await behind
            turns.give_back()
            assert not turns._taken

        asyncio.run(main())
