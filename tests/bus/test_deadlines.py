"""The deadline of a call, and the pauses that a drive or a line requires."""

from itertools import pairwise

import pytest
from benches import ADDRESS, PROTOCOLS, Mortal, Recorder
from two_faces import FACES, open_on

import drivecomm
from drivecomm.errors import DeadlineError, NoReplyError, ReplyError
from drivecomm.line import Job
from drivecomm.protocol import Ask, Pause
from drivecomm.virtual import VirtualLine
from drivecomm_vabus.telegrams import Enquiry

ENQUIRY = Enquiry(address=ADDRESS, parameter=481)


@pytest.fixture
def virtual():
    return Mortal("vabus")


@pytest.fixture
def line(virtual):
    return VirtualLine([virtual])


@pytest.fixture
def recorder():
    return Recorder()


@pytest.fixture(params=FACES)
def bus(line, recorder, request):
    with open_on(request.param, line.port, trace=recorder) as opened:
        yield opened


def sent_at(recorder):
    return [event.time for event in recorder.sent() if event.message.kind != "eot"]


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("deadline_s", [0.3, 1.0, 4.0])
def test_call_ends_by_its_deadline_for_any_number_of_attempts(protocol, deadline_s, recorder):
    line = VirtualLine([])
    with drivecomm.open_bus(line.port, trace=recorder) as bus:
        drive = bus.drive(protocol, ADDRESS, attempts=100, deadline_s=deadline_s)
        with pytest.raises((DeadlineError, NoReplyError)):
            drive.status()
        # A request that was begun in time is sent completely.
        assert deadline_s - 0.26 <= line.time <= deadline_s + 0.03
        assert all(event.time < deadline_s for event in recorder.sent())


@pytest.mark.parametrize("call", [lambda drive: drive.read("481"), lambda drive: drive.stop()], ids=["read", "stop"])
def test_deadline_ends_a_call_between_attempts(line, virtual, bus, recorder, call):
    virtual.alive = False
    drive = bus.drive("vabus", ADDRESS, attempts=100, reply_timeout_s=0.1, deadline_s=1.0)
    with pytest.raises((DeadlineError, NoReplyError)):
        call(drive)
    assert line.time <= 1.05
    assert 8 <= len(sent_at(recorder)) <= 10


def test_deadline_during_a_reply_wait_is_not_counted_as_silence(line, virtual, bus):
    """The reply timeout of 500 ms was not waited for, so the drive may be there."""
    virtual.alive = False
    drive = bus.drive("vabus", ADDRESS, deadline_s=0.05)
    with pytest.raises(DeadlineError, match=r"vabus:3 did not answer before the call's deadline \(0\.05 s\)"):
        drive.read("481")
    assert line.time == pytest.approx(0.05, abs=0.001)
    assert not bus.health[drive.name].given_up


def test_deadline_ends_a_pause_of_an_exchange(line, bus):
    drive = bus.drive("vabus", ADDRESS, deadline_s=2.0)
    reached = []

    def exchange():
        yield Ask(message=ENQUIRY)
        try:
            yield Pause(seconds=60)
        except ReplyError as error:
            reached.append((line.time, error))
            raise

    with pytest.raises(DeadlineError, match="the call's deadline"):
        bus.run(Job(drive.peer, exchange()))
    ((when, error),) = reached
    assert when == line.time == pytest.approx(2.0, abs=0.001)
    assert isinstance(error, TimeoutError)


def test_exchange_that_ignores_its_deadline_sends_nothing(line, bus, recorder):
    drive = bus.drive("vabus", ADDRESS, deadline_s=2.0)

    def stubborn():
        for _ in range(5):
            try:
                yield Pause(seconds=60)
            except ReplyError:
                continue
        return (yield Ask(message=ENQUIRY))

    with pytest.raises(DeadlineError):
        bus.run(Job(drive.peer, stubborn()))
    assert line.time == pytest.approx(2.0, abs=0.001)
    assert sent_at(recorder) == []


def test_exchange_of_many_telegrams_has_one_deadline(line, bus, recorder):
    drive = bus.drive("vabus", ADDRESS, deadline_s=0.1)

    def many():
        for _ in range(100):
            yield Ask(message=ENQUIRY)

    with pytest.raises((DeadlineError, NoReplyError)):
        bus.run(Job(drive.peer, many()))
    # The gap of the drive is added, in which the interrupted reply may end.
    assert line.time <= 0.1 + drive.facts.gap_s + 0.003
    assert 3 <= len(sent_at(recorder)) <= 5
    # The next call has its own deadline.
    assert drive.read("481").raw == "000003E8"


def test_request_interval_beyond_the_deadline_raises_deadline_error(line, bus, recorder):
    drive = bus.drive("vabus", ADDRESS, request_interval_s=5.0, deadline_s=1.0)
    drive.read("481")
    before, sent = line.time, len(sent_at(recorder))
    with pytest.raises(DeadlineError):
        drive.read("481")
    assert line.time - before <= 1.001
    assert len(sent_at(recorder)) == sent


def test_wait_for_a_late_reply_ends_at_the_deadline(line, virtual, bus, recorder):
    drive = bus.drive("vabus", ADDRESS, model="agile", late_s=5.0, deadline_s=1.0, attempts=1)
    drive.read("481")
    virtual.alive = False
    with pytest.raises(NoReplyError):
        drive.write("481", 1)
    virtual.alive = True
    before, sent = line.time, len(sent_at(recorder))
    with pytest.raises(DeadlineError):
        drive.write("481", 2)
    assert line.time - before <= 1.001
    assert len(sent_at(recorder)) == sent
    # The possible late reply is still waited for.
    began = line.time
    while True:
        try:
            drive.write("481", 3)
        except DeadlineError:
            continue
        break
    assert line.time - began >= 5.0 - 1.001 - 0.6 - 0.1


def test_each_drive_has_its_own_deadline(line, virtual, bus):
    virtual.alive = False
    for deadline_s in (0.4, 1.2):
        drive = bus.drive("vabus", ADDRESS, deadline_s=deadline_s, attempts=100, reply_timeout_s=0.05)
        before = line.time
        with pytest.raises(ReplyError):
            drive.probe()
        bus.drive("vabus", 5)
        assert line.time - before <= deadline_s + 0.001


def test_default_deadline_is_30_s(bus):
    assert bus.drive("vabus", ADDRESS).facts.timing.deadline_s == 30.0
    with pytest.raises(drivecomm.UsageError, match="deadline_s of -1 is negative"):
        bus.drive("vabus", ADDRESS, deadline_s=-1)


def test_time_in_the_line_queue_counts_towards_the_deadline(line, recorder):
    """A call that gets the line after its deadline sends nothing, and does not count as a failure of the drive."""
    with drivecomm.open_bus(line.port, trace=recorder) as bus:
        drive = bus.drive("vabus", ADDRESS, deadline_s=1.0)
        drive.read("481")
        before = len(sent_at(recorder))
        ask = bus.line.turns.ask

        def ask_slowly(turn):
            line.advance(1.5)
            return ask(turn)

        bus.line.turns.ask = ask_slowly
        for _ in range(5):
            with pytest.raises(DeadlineError, match="the call's deadline"):
                drive.read("481")
        bus.line.turns.ask = ask
        assert len(sent_at(recorder)) == before
        assert not bus.health[drive.name].given_up
        assert bus.health[drive.name].failed_calls == 0


# Pauses


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_request_interval_separates_the_starts_of_requests(protocol, recorder):
    """A telegram that only ends an exchange is not a request."""
    line = VirtualLine([Mortal(protocol)])
    with drivecomm.open_bus(line.port, trace=recorder) as bus:
        drive = bus.drive(protocol, ADDRESS, request_interval_s=1.0)
        for _ in range(5):
            drive.status()
    times = sent_at(recorder)
    assert [later - earlier for earlier, later in pairwise(times)] == pytest.approx([1.0] * 4)


def test_request_interval_includes_retries_and_other_objects_of_a_drive(virtual, bus, recorder):
    virtual.alive = False
    first = bus.drive("vabus", ADDRESS, request_interval_s=0.3, reply_timeout_s=0.05)
    second = bus.drive("vabus", ADDRESS, request_interval_s=0.3, reply_timeout_s=0.05)
    with pytest.raises(NoReplyError):
        first.probe()
    with pytest.raises(NoReplyError):
        second.status()
    times = sent_at(recorder)
    assert len(times) >= 3
    assert min(later - earlier for earlier, later in pairwise(times)) >= 0.3 - 1e-9


def test_request_interval_of_one_drive_does_not_delay_others(recorder):
    line = VirtualLine([Mortal("vabus", address) for address in (3, 4)])
    with drivecomm.open_bus(line.port, trace=recorder) as bus:
        slow = bus.drive("vabus", 3, request_interval_s=2.0)
        quick = bus.drive("vabus", 4)
        slow.read("481")
        before = line.time
        for _ in range(10):
            quick.read("481")
        assert line.time - before < 0.4
        slow.read("481")
        assert line.time >= 2.0


def test_line_is_silent_in_the_pause_after_a_broadcast(line, recorder):
    with drivecomm.open_bus(line.port, trace=recorder, broadcast_pause_s=0.7) as bus:
        drive = bus.drive("vabus", ADDRESS)
        everybody = bus.broadcast("vabus", model="agile")
        drive.read("481")
        everybody.write("481", 1)
        returned = line.time
        drive.read("481")
        broadcast, after = sent_at(recorder)[-2:]
        (told,) = recorder.sent("vabus:*")
        assert after - broadcast >= 0.7 + drive.facts.settings.wire_s(len(told.data)) - 1e-9
        # Only the next request waits for the pause.
        assert returned - broadcast < 0.1
        assert drive.read("481").raw == "00000064"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_reply_that_begins_in_time_is_received_completely(protocol):
    """The reply timeout covers the first character; after it, only the gap between two characters counts."""
    line = VirtualLine([Mortal(protocol)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, ADDRESS)
        drive.probe()
        quickest = bus.statistics[drive.name].reply_times.shortest_s
        # From a timeout too short for any reply to one that suffices, in steps of a tenth of a character.
        step = drive.facts.settings.character_s / 10
        outcomes = []
        for number in range(1, 1 + int(quickest / step) + 20):
            hasty = bus.drive(protocol, ADDRESS, attempts=1, reply_timeout_s=number * step)
            try:
                hasty.probe()
            except ReplyError:
                outcomes.append(False)
            else:
                outcomes.append(True)
            line.advance(3.0)
    first = outcomes.index(True)
    assert all(outcomes[first:])
    # Only the first character has to be in time, though the last one arrives long after.
    assert first * step < quickest - 4 * drive.facts.settings.character_s
