"""A reply that names nothing and arrives after its wait must not answer any other request."""

from contextlib import suppress
from functools import partial

import pytest
from extents import every_choice

import drivecomm
from drivecomm.errors import (
    DeadlineError,
    DoubtfulReplyError,
    DriveCommError,
    LinkDownError,
    NoReplyError,
    OvertakenError,
)
from drivecomm.line import run_steps
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import Ask, installed
from drivecomm.virtual import VirtualLine, virtual_drive

FREQUENCY, VOLTAGE = "0x2103", "0x2105"


class HeldReplies:
    """A disturbance that holds replies back on demand, and inserts one of them before a later reply."""

    def __init__(self):
        self.kept = []
        self.keeps = False
        self.in_front = b""

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        if self.keeps:
            self.kept.append(data)
            return []
        before, self.in_front = self.in_front, b""
        # The held reply comes alone, and the reply of the drive is late in turn.
        return [(0.0, before), (0.6, data)] if before else [(0.0, data)]


class Changing:
    """A disturbance that puts another value into each reply."""

    def __init__(self):
        self.values = iter(range(1, 100))

    def request(self, data, now):  # noqa: ARG002
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        fields = {"address": 1, "function": 3, "values": [next(self.values)]}
        return [(0.0, drivecomm.encode("modbus", fields, direction="reply"))]


class Bench:
    def __init__(self, *, trace=None):
        self.virtual = virtual_drive("modbus", 1, model="delta")
        self.line = VirtualLine([self.virtual])
        self.replies = HeldReplies()
        self.line.disturbances.append(self.replies)
        self.bus = drivecomm.open_bus(self.line.port, trace=trace)
        self.drive = self.bus.drive("modbus", 1, model="delta")
        self.drive.set_reference(hz=20)
        self.drive.start()
        self.line.advance(30)
        # The first requests of a line have a longer wait, so they are made here.
        self.right = {name: self.drive.read(name).raw for name in (FREQUENCY, VOLTAGE)}
        assert len(set(self.right.values())) == 2

    def late_reply_comes(self):
        """Deliver the late reply to the first request right after the next request, long after `late_s`."""
        self.replies.keeps = False
        self.line.advance(3)
        assert self.replies.kept, "the drive has answered"
        self.replies.in_front = self.replies.kept[0]


def timed_out(bench):
    with pytest.raises(NoReplyError):
        bench.bus.drive("modbus", 1, model="delta", attempts=1).read(FREQUENCY)


def deadline_over(bench):
    with pytest.raises(DeadlineError):
        bench.bus.drive("modbus", 1, model="delta", deadline_s=0.1).read(FREQUENCY)


def overtaken_by_a_stop(bench):
    link, never = bench.bus._roster.link, bench.bus.line.turns.stop_waits
    from_s = bench.line.time + 0.01
    bench.bus.line.turns.stop_waits = link.stop_waits = lambda: bench.line.time > from_s
    with pytest.raises(OvertakenError):
        bench.bus.drive("modbus", 1, model="delta", attempts=1).read(FREQUENCY)
    bench.bus.line.turns.stop_waits = link.stop_waits = never


def interrupted_by_ctrl_c(bench):
    def interrupt():
        raise KeyboardInterrupt

    bench.line.call_at(bench.line.time + 0.05, interrupt)
    with pytest.raises(KeyboardInterrupt):
        bench.drive.read(FREQUENCY)


def cancelled(bench):
    """Close the steps in the middle, as the cancellation of a task does."""
    port, link = bench.line.port(), bench.bus._roster.link
    operations = bench.drive._exchanges.operations
    steps = link.run(bench.drive.peer, operations.read(FREQUENCY), port.now())
    talk = next(steps)
    talk.begun = port.now()
    port.write(talk.data)
    bench.line.advance(0.05)
    steps.close()


def port_lost_and_opened_again(bench):
    bench.line.call_at(bench.line.time + 0.05, partial(setattr, bench.line, "broken", True))
    with pytest.raises(LinkDownError):
        bench.drive.read(FREQUENCY)
    bench.line.broken = False
    bench.line.advance(2)


EVENTS = [timed_out, deadline_over, overtaken_by_a_stop, interrupted_by_ctrl_c, port_lost_and_opened_again]


@pytest.mark.parametrize("event", EVENTS, ids=lambda each: each.__name__)
@pytest.mark.parametrize("trace", [None, lambda _: None], ids=["short way", "long way"])
def test_reply_later_than_late_s_answers_no_other_request(event, trace):
    bench = Bench(trace=trace)
    bench.replies.keeps = True
    event(bench)
    bench.late_reply_comes()
    assert bench.drive.read(VOLTAGE).raw == bench.right[VOLTAGE]
    assert bench.drive.read(FREQUENCY).raw == bench.right[FREQUENCY]


@pytest.mark.parametrize(("event", "counter"), [(timed_out, "timeouts"), (overtaken_by_a_stop, "overtaken")])
def test_read_overtaken_by_a_stop_is_not_counted_as_a_timeout(event, counter):
    bench = Bench()
    bench.replies.keeps = True
    event(bench)
    counters = bench.bus.counters["modbus:1"]
    assert {name: counters[name] for name in ("timeouts", "overtaken") if counters[name]} == {counter: 1}


def test_reply_to_a_cancelled_read_answers_no_other_request():
    bench = Bench()
    bench.replies.keeps = True
    cancelled(bench)
    bench.late_reply_comes()
    assert bench.drive.read(VOLTAGE).raw == bench.right[VOLTAGE]


def test_request_after_a_timeout_is_repeated_until_two_replies_agree():
    bench = Bench()
    bench.replies.keeps = True
    timed_out(bench)
    bench.replies.keeps = False
    bench.line.advance(3)
    before = bench.bus.counters["modbus:1"].copy()
    assert bench.drive.read(VOLTAGE).raw == bench.right[VOLTAGE]
    asked = bench.bus.counters["modbus:1"] - before
    assert (asked["requests"], asked["retries"], asked["replies"], asked["doubtful"]) == (1, 1, 1, 1)


def test_request_long_after_a_timeout_is_sent_once():
    bench = Bench()
    bench.replies.keeps = True
    timed_out(bench)
    bench.replies.keeps = False
    bench.line.advance(20)
    before = bench.bus.counters["modbus:1"].copy()
    bench.drive.read(VOLTAGE)
    asked = bench.bus.counters["modbus:1"] - before
    assert (asked["requests"], asked["retries"]) == (1, 0)


def test_value_that_differs_in_each_reply_after_a_timeout_is_uncertain():
    bench = Bench()
    bench.replies.keeps = True
    timed_out(bench)
    bench.replies.keeps = False
    bench.line.advance(3)
    bench.line.disturbances.append(Changing())
    reading = bench.drive.read(VOLTAGE)
    assert reading.doubt == "modbus:1 answered late before, and does not repeat the same reply"
    assert reading.quality == "uncertain"


@pytest.mark.parametrize("seed", range(8))
def test_late_replies_never_give_a_wrong_value(seed):
    bench = Bench()
    names = ("output_frequency", "dc_bus", "output_current")
    right = {name: bench.drive.read(name).value for name in names}
    bench.line.faults = FaultPlan(rate=0.1, seed=seed, kinds=[LineFault.DELAY], delay_s=2)
    wrong = []
    for name in names * 50:
        try:
            found = bench.drive.read(name).value
        except DriveCommError:
            continue
        wrong += [(name, found)] if abs(found - right[name]) > right[name] / 10 else []
    assert wrong == []


def test_surplus_reply_is_waited_out_after_a_distinct_request():
    """A request that no nameless reply can answer leaves the wait in force; the next nameless request waits."""
    bench = Bench()
    peer, link = bench.drive.peer, bench.bus._roster.link
    nameless = bench.drive._exchanges.operations.read(FREQUENCY).send(None)
    record = link._records[peer.name]
    record.unanswered, record.surplus, record.nameless = peer.telegram(nameless.message), True, True
    record.late_until = bench.line.time + 2.5
    waits_until = record.late_until

    def asking():
        yield Ask(message=nameless.message, distinct=True)
        yield Ask(message=nameless.message, nameless=True)

    port = bench.bus.line.port
    run_steps(link.run(peer, asking(), port.now()), port, lambda: False)
    assert bench.line.time > waits_until


class ReplacedReplies:
    """A disturbance that replaces the drive's replies by these in turn; None leaves the reply of the drive.

    own: the replies that the drive itself sent, in order.
    """

    def __init__(self, *replies):
        self.replies = list(replies)
        self.own = []

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        self.own.append(data)
        said = self.replies.pop(0) if self.replies else None
        return [(0.0, data if said is None else said)]


def test_reply_displaced_by_a_late_one_is_late_in_turn():
    """After the late reply, the one that is still missing is unknown, and it may fit the next request."""
    bench = Bench()
    bench.replies.keeps = True
    timed_out(bench)
    bench.replies.keeps = False
    bench.line.advance(3)
    late = ReplacedReplies(bench.replies.kept[0])
    bench.line.disturbances.append(late)
    assert bench.drive.read(VOLTAGE).raw == bench.right[VOLTAGE]
    late.replies = [late.own[0]]
    assert bench.drive.read(FREQUENCY).raw == bench.right[FREQUENCY]


def test_unrequested_reply_does_not_settle_which_request_it_answers():
    """Of two unanswered requests, the reply to the second comes first and unrequested, that to the first later."""
    bench = Bench()
    bench.replies.keeps = True
    timed_out(bench)
    bench.line.advance(2)
    with pytest.raises(NoReplyError):
        bench.bus.drive("modbus", 1, model="delta", attempts=1).read(VOLTAGE)
    bench.replies.keeps = False
    first, second = bench.replies.kept
    bench.line.advance(1.5)
    bench.line.inject(second)
    bench.line.advance(0.1)
    bench.line.disturbances.append(ReplacedReplies(None, None, first))
    assert bench.drive.read(VOLTAGE).raw == bench.right[VOLTAGE]
    bench.line.disturbances[-1].replies = [first]
    assert bench.drive.read(VOLTAGE).raw == bench.right[VOLTAGE]


def test_many_equal_late_replies_are_outvoted():
    """After several unanswered calls, the same number of late replies with one value proves nothing."""
    bench = Bench()
    bench.replies.keeps = True
    for _ in range(4):
        timed_out(bench)
    bench.replies.keeps = False
    bench.line.disturbances.append(ReplacedReplies(*bench.replies.kept))
    assert len(bench.replies.kept) == 4
    assert bench.drive.read(VOLTAGE).raw == bench.right[VOLTAGE]


@pytest.mark.parametrize(("plugin", "attempts"), every_choice(5, list(installed.working()), [1, 3]))
def test_replies_later_than_late_s_give_no_wrong_value(plugin, attempts):
    """Ten percent of all requests and replies come up to twice as late as the wait for late replies."""
    wrong, delay_s = [], 2 * plugin.facts.timing.late_s
    for seed in range(6):
        virtual = virtual_drive(plugin.name, plugin.addresses[0])
        line = VirtualLine([virtual], faults=FaultPlan(rate=0.1, kinds=[LineFault.DELAY], delay_s=delay_s, seed=seed))
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive(plugin.name, plugin.addresses[0], model=plugin.default_model, attempts=attempts)
            names = [info.address for info in drive.model.parameters.values() if info.access == "rw"][:10]
            for name in names * 12:
                with suppress(DriveCommError):
                    reading = drive.read(name)
                    held = virtual.peek(name, line.time)
                    wrong += [(seed, name, reading.raw, held)] if reading.raw != held else []
    assert wrong == []


class ReplacedRequest:
    """A disturbance that loses request number `number` that begins with `begins`, and injects `said` as its reply.

    The replies to earlier such requests come twice.
    """

    def __init__(self, line, begins, said, number):
        self.line, self.begins, self.said, self.number = line, begins, said, number
        self.asked = 0

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        self.asked += data.startswith(self.begins)
        if self.asked != self.number or not data.startswith(self.begins):
            return [(0.0, data)]
        self.line.call_at(self.line.time + 0.02, lambda: self.line.inject(self.said))
        return []

    def reply(self, data, drive, now):  # noqa: ARG002
        return [(0.0, data), (0.0, data)] if 0 < self.asked < self.number else [(0.0, data)]


@pytest.fixture
def owing():
    """Yield a drive with nameless replies that left a write and a read unanswered longer ago than late_s.

    The yielded function delivers a late reply, the confirmation or the value, in place of the reply to a request that
    begins with these bytes.
    """
    virtual = virtual_drive("mitsubishi", 1)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("mitsubishi", 1, model="fr700", attempts=1)
        drive.read("1")
        replies = HeldReplies()
        line.disturbances.append(replies)
        replies.keeps = True
        with pytest.raises(NoReplyError):
            drive.write("240", 0, store=True)
        with pytest.raises(NoReplyError):
            drive.read("H6F")
        replies.keeps = False
        line.advance(3)

        def late(what, begins, number=1):
            said = replies.kept[0 if what == "confirmation" else -1]
            instead = ReplacedRequest(line, b"\x0501" + begins, said, number)
            line.disturbances.append(instead)
            return instead

        yield drive, virtual, late


def test_late_confirmation_confirms_no_other_write(owing):
    drive, virtual, late = owing
    instead = late("confirmation", b"C8")
    drive.write("72", 5, store=True)
    assert virtual.peek("72", 0) == 5
    assert instead.asked > 1


def test_late_confirmation_confirms_no_write_without_retries(owing):
    drive, _, late = owing
    instead = late("confirmation", b"FB")
    with pytest.raises(DoubtfulReplyError, match="whether the drive acted on it is not known"):
        drive.write("H7B", 1)
    assert instead.asked == 1


def test_write_without_retries_is_confirmed_by_reading_the_drive(owing):
    drive, virtual, _ = owing
    drive.write("H7B", 1)
    assert virtual.peek("H7B", 0) == 1


def test_late_confirmation_confirms_no_stop(owing):
    drive, virtual, late = owing
    drive.start()
    instead = late("confirmation", b"FA")
    drive.stop()
    assert not virtual.motor.running
    assert instead.asked > 1


def test_late_value_answers_no_prepared_request(owing):
    drive, virtual, late = owing
    virtual.poke("240", 7)
    instead = late("value", b"30")
    assert drive.read("240").raw == 7
    assert instead.asked > 1


def test_late_value_is_still_expected_when_a_reply_comes_twice(owing):
    drive, virtual, late = owing
    virtual.poke("72", 7)
    instead = late("value", b"48", number=2)
    assert drive.read("72").raw == 7
    assert instead.asked > 2


def test_exchange_long_after_a_timeout_takes_the_short_path():
    """A late reply is expected equally long from a drive whose replies name their requests as from any other."""
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1, attempts=1)
        replies = HeldReplies()
        line.disturbances.append(replies)
        replies.keeps = True
        with pytest.raises(NoReplyError):
            drive.read("481")
        replies.keeps = False
        line.advance(20)
        drive.read("481")
        assert not bus._roster.link._records["vabus:1"].owed
