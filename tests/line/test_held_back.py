"""A lost reply: other requests to its drive wait for a late reply; the other drives of the line do not wait."""

import threading
from contextlib import contextmanager
from itertools import pairwise

import pytest
from two_faces import each_face, open_on

import drivecomm
from drivecomm.errors import HeldBackError, NoReplyError
from drivecomm.virtual import VirtualLine, virtual_drive

LATE_S = 2.5
ADDRESSES = (1, 2)
READS = ("0x2103", "0x2105")


class LosesOne:
    """A disturbance that loses reply number `number` of the first drive."""

    def __init__(self, number):
        self.left = number

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        if data[0] != ADDRESSES[0]:
            return [(0.0, data)]
        self.left -= 1
        return [] if self.left == 0 else [(0.0, data)]


def drives():
    return [virtual_drive("modbus", address, model="delta") for address in ADDRESSES]


def line_that_loses(number):
    line = VirtualLine(drives(), paced=False)
    line.disturbances.append(LosesOne(number))
    return line


@contextmanager
def served_line_that_loses(serving, number):
    with serving(drives(), "tcp") as server:
        server.line.disturbances.append(LosesOne(number))
        with drivecomm.open_bus(server.address) as bus:
            yield bus


def items_on(bus):
    both = [bus.drive("modbus", address, model="delta", late_s=LATE_S, attempts=1) for address in ADDRESSES]
    return [drivecomm.PollItem(drive=drive, parameter=name, period_s=0.1) for drive in both for name in READS]


def longest_gap(results, drive):
    """Return the longest time between two values of a drive, and the number of failed reads."""
    own = [each for each in results if each.drive == drive]
    times = [each.time_s for each in own if each.error is None]
    return max(later - earlier for earlier, later in pairwise(times)), sum(each.error is not None for each in own)


def judge(results):
    gap_s, failed = longest_gap(results, "modbus:1")
    assert failed == 1, "what was not asked yet has not failed"
    assert gap_s < 0.6, "the question that was lost is asked again at once"
    other = [each for each in results if each.drive == "modbus:1" and each.error is None]
    late = {name: longest_gap([each for each in other if each.parameter == name], "modbus:1")[0] for name in READS}
    assert max(late.values()) > LATE_S - 0.2, "the other question waits for the late reply"
    gap_s, failed = longest_gap(results, "modbus:2")
    assert gap_s < 0.6, "it waits for the reply that is lost, and no longer"
    assert failed == 0


@each_face
def test_poll_plan_continues_with_other_drives_after_a_lost_reply(face):
    with open_on(face, line_that_loses(20).port) as bus:
        judge(list(bus.poll(items_on(bus), duration_s=6)))


@pytest.mark.soak
def test_poll_plan_of_many_lines_continues_after_a_lost_reply(serving):
    with served_line_that_loses(serving, 20) as bus:
        judge(list(drivecomm.poll(items_on(bus), duration_s=6)))


class TestCalls:
    """Calls of a program: a thread that reads the drive with the lost reply waits; other threads do not."""

    @pytest.fixture
    def bus(self, serving):
        with served_line_that_loses(serving, 2) as bus:
            yield bus

    def test_read_of_another_drive_does_not_wait_for_a_late_reply(self, bus):
        lost, other = (bus.drive("modbus", each, model="delta", late_s=5.0, attempts=1) for each in ADDRESSES)
        other.read(READS[1])
        lost.read(READS[0])
        with pytest.raises(NoReplyError):
            lost.read(READS[0])
        ended = []
        waiting = threading.Thread(target=lambda: ended.append((lost.read(READS[1]).parameter, bus.now())))
        waiting.start()
        began = bus.now()
        while not bus.counters["modbus:1"]["timeouts"] or waiting.is_alive():
            other.read(READS[1])
            ended.append(("other", bus.now()))
            if len(ended) == 20:
                break
        took = bus.now() - began
        assert ended[0][0] == "other", "the one that waits comes last"
        assert took < 3, "it would be five seconds"
        waiting.join(20)
        assert ended[-1][0] == READS[1]

    def test_poll_job_gets_the_time_when_its_drive_can_be_read_again(self, bus):
        drive = bus.drive("modbus", 1, model="delta", late_s=1.0, attempts=1)
        drive.read(READS[0])
        with pytest.raises(NoReplyError):
            drive.read(READS[0])
        with pytest.raises(HeldBackError, match="modbus:1 was not asked: a late reply") as held:
            drive.polled(READS[1])
        assert 0 < held.value.until - bus.now() < 1.0
        bus.sleep_until(held.value.until)
        assert drive.polled(READS[1]).parameter == READS[1]
