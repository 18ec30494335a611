"""Drives without replies: given up by two criteria, refused immediately, probed now and then, and taken back."""

from contextlib import suppress
from itertools import pairwise

import pytest
from benches import ADDRESS, PROTOCOLS, READABLE, Mortal, Port, Recorder, running, set_reference

import drivecomm
from drivecomm.errors import DamagedReplyError, NoReplyError, NotAnsweringError
from drivecomm.link import FIRST_PAUSE_S, LONGEST_PAUSE_S, PROBING_SHARE, Backoff, Health, ProbingTime, UsualDelays
from drivecomm.plant import FaultPlan
from drivecomm.protocol import MotorCommand
from drivecomm.virtual import VirtualLine, virtual_drive

EACH_PROTOCOL = pytest.mark.parametrize("protocol", PROTOCOLS)


@pytest.fixture
def recorder():
    return Recorder()


@pytest.fixture
def virtual():
    return Mortal("vabus")


@pytest.fixture
def line(virtual):
    return VirtualLine([virtual, virtual_drive("vabus", 4)])


@pytest.fixture
def bus(line, recorder):
    with drivecomm.open_bus(line.port, trace=recorder) as opened:
        yield opened


@pytest.fixture
def drive(bus):
    return bus.drive("vabus", ADDRESS)


def give_up(drive):
    """Read the drive until it is refused without a request."""
    for _ in range(100):
        try:
            drive.read("481")
        except NotAnsweringError:
            return
        except NoReplyError:
            continue
    raise AssertionError("the drive is asked again and again")


def until_given_up(bus, *drives):
    """Request the status of drives in turn until all of them are given up."""
    while not all(drive.name in bus.health and bus.health[drive.name].given_up for drive in drives):
        for drive in drives:
            with pytest.raises(NoReplyError):
                drive.status()


def refused(drive, line, recorder):
    """Return whether the drive is refused immediately: no time passes and nothing is sent."""
    before, sent = line.time, len(recorder.events)
    with pytest.raises(NoReplyError) as caught:
        drive.read("481")
    if not isinstance(caught.value, NotAnsweringError):
        return False
    return (line.time, len(recorder.events)) == (before, sent)


class TestHealth:
    """`Health` alone, with times set by hand."""

    def test_never_heard_drive_is_given_up_after_one_call_and_a_second(self):
        health = Health()
        assert not health.fell_silent(10.0, 10.9)
        assert not health.given_up
        assert health.fell_silent(10.9, 11.1)
        assert (health.given_up, health.away) == (True, True)
        assert health.silent_since == 10.0
        assert health.probe_at == pytest.approx(11.1 + FIRST_PAUSE_S)

    def test_three_failed_calls_within_two_seconds_do_not_give_a_drive_up(self):
        health = Health()
        health.answered()
        for call in range(20):
            assert not health.fell_silent(call * 0.1, call * 0.1 + 0.09)
        assert health.fell_silent(1.95, 2.05)

    def test_two_failed_calls_do_not_give_a_drive_up_after_any_time(self):
        health = Health()
        health.answered()
        assert not health.fell_silent(0.0, 5.0)
        assert not health.fell_silent(50.0, 55.0)
        assert health.fell_silent(60.0, 65.0)

    def test_reply_restarts_the_count_of_failed_calls(self):
        health = Health()
        health.answered()
        for began in (0.0, 5.0):
            assert not health.fell_silent(began, began + 1)
        health.answered()
        for began in (10.0, 15.0):
            assert not health.fell_silent(began, began + 1)
        assert health.fell_silent(20.0, 21.0)
        assert health.silent_since == 10.0

    def test_fell_silent_is_true_only_once(self):
        health = Health()
        assert [health.fell_silent(time, time + 1) for time in (0.0, 2.0, 9.0)] == [True, False, False]

    def test_reply_takes_a_drive_back_and_leaves_its_set_up_pending(self):
        health = Health()
        health.fell_silent(0.0, 1.0)
        health.answered()
        assert (health.given_up, health.away, health.failed_calls) == (False, True, 0)
        assert health.probe_at == float("-inf")

    def test_probing_pause_grows_up_to_its_limit(self):
        pause, times = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S), []
        for _ in range(7):
            pause.failed(100.0)
            times.append(pause.over_at - 100.0)
        assert times == pytest.approx([0.5, 1, 2, 4, 8, 9, 9])
        pause.succeeded()
        pause.failed(100.0)
        assert pause.over_at == pytest.approx(100.5)

    def test_minimum_pause_may_exceed_the_longest_pause(self):
        pause = Backoff(0.5, 9.0)
        pause.failed(0.0, 30.0)
        assert pause.over_at == 30.0
        pause.failed(0.0)
        assert pause.over_at == 1.0

    @pytest.mark.parametrize("number", [1, 3, 28, 120])
    def test_all_silent_drives_share_one_part_of_the_line(self, number):
        drives = [Health() for _ in range(number + 2)]
        for health in drives[:number]:
            health.fell_silent(0.0, 1.0)
        time = ProbingTime(drives)
        assert time.number == number
        assert time.each_s * number == pytest.approx(LONGEST_PAUSE_S * PROBING_SHARE)
        # If each probe takes longer than its part, its pause grows to keep the part.
        assert number * 0.2 / time.least_pause_s(0.2) == pytest.approx(PROBING_SHARE)

    def test_drives_that_answer_again_take_no_part_of_the_probing_time(self):
        back, silent = Health(), Health()
        for health in (back, silent):
            health.fell_silent(0.0, 1.0)
        back.answered()
        assert back.away, "it is still to be set up"
        assert ProbingTime([back, silent]).number == 1

    def test_one_quick_reply_does_not_shorten_the_probes_of_slow_drives(self):
        delays = UsualDelays()
        for delay_s in (0.02, 0.001):
            delays.answered("vabus", delay_s)
        assert 0.019 < delays.minimum_listen_s("vabus") < 0.022
        assert delays.minimum_listen_s("fuji") == pytest.approx(0.012), "of which nothing is known"
        for _ in range(200):
            delays.answered("vabus", 0.001)
        assert delays.minimum_listen_s("vabus") < 0.002
        delays.answered("vabus", 5.0)
        assert delays.minimum_listen_s("vabus") == pytest.approx(0.03), "no longer than this"


def test_never_heard_drive_is_refused_after_its_first_call(line, recorder, virtual, drive):
    virtual.alive = False
    with pytest.raises(NoReplyError) as caught:
        drive.read("481")
    assert not isinstance(caught.value, NotAnsweringError)
    assert refused(drive, line, recorder)


def test_known_drive_is_given_up_after_three_calls_and_two_seconds(line, recorder, virtual, bus):
    drive = bus.drive("vabus", ADDRESS, reply_timeout_s=0.1)
    drive.read("481")
    virtual.alive = False
    began, calls = line.time, 0
    while not bus.health[drive.name].given_up:
        with pytest.raises(NoReplyError) as caught:
            drive.read("481")
        assert not isinstance(caught.value, NotAnsweringError)
        calls += 1
    assert calls > 3
    assert 2.0 <= line.time - began < 2.3
    assert refused(drive, line, recorder)


def test_known_drive_is_not_given_up_before_its_third_failed_call(line, virtual, drive, bus):
    drive.read("481")
    virtual.alive = False
    for _ in range(2):
        with pytest.raises(NoReplyError):
            drive.read("481")
        line.advance(60)
    assert not bus.health[drive.name].given_up
    with pytest.raises(NoReplyError):
        drive.read("481")
    assert bus.health[drive.name].given_up


@EACH_PROTOCOL
def test_refused_call_takes_no_time_on_the_line(protocol, recorder):
    line = VirtualLine([Mortal(protocol)])
    line.drives[0].alive = False
    with drivecomm.open_bus(line.port, trace=recorder) as bus:
        drive = bus.drive(protocol, ADDRESS)
        until_given_up(bus, drive)
        before, events, counters = line.time, len(recorder.events), dict(bus.counters[drive.name])
        for verb in (drive.status, drive.start, drive.reset, lambda: drive.read(READABLE[protocol][0])):
            for _ in range(50):
                with pytest.raises(NotAnsweringError, match=r"has not answered for .* s; it is probed again in .* s"):
                    verb()
        assert line.time == before
        assert len(recorder.events) == events
        assert bus.counters[drive.name] == counters


def test_refusal_states_the_silence_and_the_time_of_the_next_probe(line, virtual, drive):
    virtual.alive = False
    with pytest.raises(NoReplyError):
        drive.read("481")
    silent = line.time
    line.advance(0.1)
    with pytest.raises(NotAnsweringError) as caught:
        drive.read("481")
    assert str(caught.value) == f"vabus:3 has not answered for {silent + 0.1:.1f} s; it is probed again in 0.4 s"
    line.advance(0.4)
    with pytest.raises(NotAnsweringError, match="it was probed just now"):
        drive.read("481")


def probe_times(line, drive, bus, until):
    """Read the drive until this time; return the times when each probe began and ended."""
    times = []
    while line.time < until:
        began, before = line.time, bus.counters[drive.name]["probes"]
        with pytest.raises(NotAnsweringError):
            drive.read("481")
        if bus.counters[drive.name]["probes"] > before:
            times.append((began, line.time))
        line.advance(0.01)
    return times


def between(times):
    return [later[0] - earlier[1] for earlier, later in pairwise(times)]


def test_probes_come_with_a_growing_pause(line, virtual, bus):
    drive = bus.drive("vabus", ADDRESS, reply_timeout_s=0.005)
    virtual.alive = False
    until_given_up(bus, drive)
    pauses = between([(0.0, line.time), *probe_times(line, drive, bus, 60)])
    assert pauses == pytest.approx([0.5, 1, 2, 4, 8, *[9] * (len(pauses) - 5)], abs=0.05)
    assert len(pauses) >= 8


def test_drive_with_a_long_reply_timeout_is_probed_less_often(line, virtual, drive, bus):
    """The share of the line for probes also limits a single drive; its probe waits for 0.4 s of its 0.5 s."""
    virtual.alive = False
    with pytest.raises(NoReplyError):
        drive.read("481")
    times = probe_times(line, drive, bus, 60)
    assert between(times) == pytest.approx([9] * (len(times) - 1), abs=0.1)
    assert sum(ended - began for began, ended in times) < 0.05 * 60


def test_probe_moves_nothing_and_is_sent_once(line, recorder, virtual, drive):
    virtual.alive = False
    give_up(drive)
    line.advance(5)
    before = len(recorder.sent())
    with pytest.raises(NotAnsweringError):
        drive.start()
    (probe,) = recorder.sent()[before:]
    assert probe.message.kind == "enquiry"


def test_first_good_reply_takes_a_drive_back(line, virtual, drive, bus):
    virtual.alive = False
    give_up(drive)
    virtual.alive = True
    line.advance(1)
    assert drive.read("481").raw == "000003E8"
    health = bus.health[drive.name]
    assert (health.given_up, health.failed_calls) == (False, 0)
    before = bus.counters[drive.name].copy()
    drive.read("482")
    assert bus.counters[drive.name] - before == {"requests": 1, "replies": 1}


@pytest.mark.parametrize("verb", ["stop", "probe"])
@EACH_PROTOCOL
def test_stop_and_probe_are_sent_to_a_given_up_drive(protocol, verb, recorder):
    line = VirtualLine([Mortal(protocol)])
    (virtual,) = line.drives
    virtual.alive = False
    with drivecomm.open_bus(line.port, trace=recorder) as bus:
        drive = bus.drive(protocol, ADDRESS)
        with pytest.raises(NoReplyError):
            drive.status()
        for _ in range(5):
            before = len(recorder.sent())
            with pytest.raises(NoReplyError) as caught:
                getattr(drive, verb)()
            assert not isinstance(caught.value, NotAnsweringError)
            assert len(recorder.sent()) > before
        virtual.alive = True
        # Its reply takes the drive back during any pause.
        getattr(drive, verb)()
        assert not bus.health[drive.name].given_up


def test_reply_to_a_stop_takes_a_drive_back(virtual, drive, bus):
    virtual.alive = False
    give_up(drive)
    virtual.alive = True
    drive.stop()
    assert not bus.health[drive.name].given_up
    assert drive.read("481").raw


def test_health_is_separate_for_other_line_settings(bus, virtual):
    drive = bus.drive("vabus", ADDRESS)
    virtual.alive = False
    give_up(drive)
    other = bus.drive("vabus", ADDRESS, baudrate=9600)
    with pytest.raises(NoReplyError) as caught:
        other.read("481")
    assert not isinstance(caught.value, NotAnsweringError)
    with pytest.raises(NotAnsweringError):
        other.read("481")
    virtual.alive = True
    # Silence at 9600 baud says nothing about 19200.
    assert drive.read("481").raw


def test_objects_with_the_same_line_settings_share_their_health(line, recorder, virtual, bus, drive):
    virtual.alive = False
    give_up(drive)
    assert refused(bus.drive("vabus", ADDRESS), line, recorder)
    assert refused(bus.drive("vabus", ADDRESS, attempts=5, reply_timeout_s=1.0), line, recorder)


def test_silent_drive_does_not_affect_the_health_of_others(virtual, bus, drive):
    virtual.alive = False
    other = bus.drive("vabus", 4)
    give_up(drive)
    assert other.read("481").raw
    assert not bus.health[other.name].given_up


class DamagedReplies(FaultPlan):
    """Faults that give every reply a wrong check."""

    def reply(self, data):
        return [(0.0, data[:-1] + bytes([data[-1] ^ 1]))]


def test_damaged_replies_alone_do_not_give_a_drive_up(line, drive, bus):
    """Something answers, so the drive is there."""
    line.faults = DamagedReplies(rate=0.0)
    for _ in range(5):
        with pytest.raises(DamagedReplyError):
            drive.read("481")
        line.advance(1)
    assert not bus.health[drive.name].given_up


def test_silent_drive_does_not_close_the_port(line, virtual):
    closed, opened = [], []

    def port():
        opened.append(True)
        return Port(line.port(), close=lambda: closed.append(True))

    with drivecomm.open_bus(port) as bus:
        drive = bus.drive("vabus", ADDRESS)
        virtual.alive = False
        for _ in range(50):
            with pytest.raises(NoReplyError):
                drive.read("481")
            line.advance(1)
        assert (opened, closed) == ([True], [])


def test_constant_noise_does_not_lengthen_every_probe():
    """With constant noise on the line, one probe in nine seconds is long and the others are short."""
    dead = [Mortal("danfoss-fc", address) for address in range(1, 21)]
    for each in dead:
        each.alive = False
    line = VirtualLine([*dead, virtual_drive("danfoss-fc", 25)])
    lengths = []
    with drivecomm.open_bus(line.port) as bus:
        live = bus.drive("danfoss-fc", 25)
        drives = [bus.drive("danfoss-fc", each.address, reply_timeout_s=1.0) for each in dead]
        until_given_up(bus, *drives)
        while line.time < 100:
            for drive in drives:
                before, probes = line.time, bus.counters[drive.name]["probes"]
                with pytest.raises(NotAnsweringError):
                    drive.status()
                if bus.counters[drive.name]["probes"] > probes:
                    lengths.append((before, line.time - before))
                    line.inject(b"\xaa\x55")
                    line.advance(0.01)
            with suppress(drivecomm.ReplyError):
                # The noise may damage this reply.
                live.status()
            line.advance(0.05)
    long = [began for began, length in lengths if length > 0.5]
    assert len(lengths) >= 20
    assert 1 <= len(long) <= 100 / 9 + 1


def test_drive_slower_than_its_short_probe_is_found():
    """Among many silent drives a probe is short; a drive that answers it too late gets one with the full timeout."""
    dead = [Mortal("danfoss-fc", address) for address in range(1, 21)]
    line = VirtualLine([*dead, virtual_drive("danfoss-fc", 25)])
    for each in dead:
        each.alive = False
    with drivecomm.open_bus(line.port) as bus:
        live = bus.drive("danfoss-fc", 25)
        drives = [bus.drive("danfoss-fc", each.address) for each in dead]
        until_given_up(bus, *drives)
        dead[7].alive = True
        began = line.time
        while line.time < began + 10:
            live.status()
            for drive in drives[:7] + drives[8:]:
                with pytest.raises(NotAnsweringError):
                    drive.status()
            try:
                drives[7].status()
            except NotAnsweringError:
                continue
            break
        assert line.time - began < 10


# Commands are forgotten: a command from before an absence must not return by itself


def valid_words(virtual):
    """Return the control words with their valid bit that a Danfoss FC drive received."""
    return [message.control_word for _, message in virtual.heard if message.control_word & 0x0400]


def silence(drive, virtual, line):
    virtual.alive = False
    for _ in range(20):
        with pytest.raises(NoReplyError):
            drive.status()
        line.advance(0.5)


@pytest.mark.parametrize("runs_on", [False, True])
@pytest.mark.parametrize("objects", [1, 2])
def test_run_command_is_never_repeated_to_a_drive_after_its_absence(objects, runs_on):
    virtual = Mortal("danfoss-fc")
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drives = [bus.drive("danfoss-fc", ADDRESS) for _ in range(objects)]
        drives[0].set_reference(percent=50)
        drives[0].watched(3600)
        drives[0].start()
        line.advance(5)
        virtual.heard.clear()
        drives[0].status()
        assert running(line, virtual)
        assert valid_words(virtual), "what the drive obeys is repeated for its watchdog"
        # The first object commanded; the last one detects the silence.
        silence(drives[-1], virtual, line)
        assert bus.health[drives[0].name].given_up
        virtual.heard.clear()
        if not runs_on:
            virtual.motor.stop(MotorCommand.OFF, line.time)
        virtual.alive = True
        line.advance(10)
        for drive in drives:
            drive.status()
            drive.read("3-10[3]")
            drive.polled("3-10[3]")
            drive.identify()
        assert len(virtual.heard) >= 4 * objects
        assert valid_words(virtual) == []
        line.advance(5)
        assert running(line, virtual) is runs_on


def test_run_command_is_not_repeated_after_the_port_was_lost():
    virtual = Mortal("danfoss-fc")
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        first, second = (bus.drive("danfoss-fc", ADDRESS) for _ in range(2))
        for drive in (first, second):
            drive.set_reference(percent=50)
            drive.watched(3600)
            drive.start()
        first.status()
        virtual.heard.clear()
        first.status()
        assert valid_words(virtual)
        line.broken = True
        with pytest.raises(drivecomm.LinkDownError):
            first.status()
        line.broken = False
        virtual.heard.clear()
        line.advance(1)
        for drive in (first, second):
            drive.status()
            drive.read("3-10[3]")
        assert virtual.heard
        assert valid_words(virtual) == []


def test_unanswered_start_is_not_repeated_later():
    virtual = Mortal("danfoss-fc")
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("danfoss-fc", ADDRESS)
        drive.set_reference(percent=50)
        virtual.alive = False
        for _ in range(20):
            with pytest.raises(NoReplyError):
                drive.start()
            line.advance(0.3)
        virtual.alive = True
        virtual.heard.clear()
        line.advance(10)
        drive.status()
        drive.read("3-10[3]")
        assert valid_words(virtual) == []


@EACH_PROTOCOL
def test_no_motor_starts_when_its_drive_returns(protocol):
    virtual = Mortal(protocol)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, ADDRESS)
        set_reference(protocol, drive)
        drive.start()
        silence(drive, virtual, line)
        assert bus.health[drive.name].given_up
        virtual.revive()
        line.advance(10)
        drive.status()
        drive.read(READABLE[protocol][0])
        line.advance(10)
        drive.status()
        assert not running(line, virtual)


@EACH_PROTOCOL
def test_new_command_is_carried_out_by_a_drive_after_its_absence(protocol):
    virtual = Mortal(protocol)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, ADDRESS)
        virtual.alive = False
        with pytest.raises(NoReplyError):
            drive.status()
        virtual.alive = True
        line.advance(10)
        set_reference(protocol, drive)
        drive.start()
        line.advance(5)
        assert running(line, virtual)


def test_counters_separate_probes_from_requests(line, virtual, drive, bus):
    virtual.alive = False
    give_up(drive)
    counters = bus.counters[drive.name]
    before = counters["probes"]
    line.advance(10)
    with pytest.raises(NotAnsweringError):
        drive.read("481")
    assert counters["probes"] == before + 1


def test_damaged_reply_to_a_probe_is_reported_as_damage(line, virtual, drive):
    virtual.alive = False
    give_up(drive)
    virtual.alive = True
    line.advance(10)
    line.faults = DamagedReplies(rate=0.0)
    with pytest.raises(DamagedReplyError):
        drive.read("481")
    line.faults = FaultPlan(rate=0.0)
    line.advance(10)
    assert drive.read("481").raw


def test_given_up_drive_with_damaged_replies_gets_little_of_the_line(line, virtual, drive):
    """Its probes have the same growing pause as unanswered ones."""
    virtual.alive = False
    give_up(drive)
    virtual.alive = True
    line.faults = DamagedReplies(rate=0.0)
    line.advance(10)
    began, busy = line.time, 0.0
    while line.time < began + 30:
        before = line.time
        with pytest.raises(drivecomm.ReplyError):
            drive.read("481")
        busy += line.time - before
        line.advance(0.01)
    assert busy < 0.1 * 30
