"""A late reply that names no drive never counts as the reply of another drive of its protocol, however late."""

import pytest

import drivecomm
from drivecomm.errors import DriveCommError, NoReplyError
from drivecomm.plant import Fault, FaultPlan
from drivecomm.virtual import VirtualLine, virtual_drive

LATE_S, SLOW_S = 0.15, 0.09
"""Delays in seconds: of a reply that misses its own request, and of the next reply, which arrives after it."""


class Late:
    """A disturbance that delays the next replies."""

    def __init__(self):
        self.delays_s = []

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        return [(self.delays_s.pop(0) if self.delays_s else 0.0, data)]


@pytest.fixture
def line():
    """Return a line with three drives, each with another maximum frequency."""
    drives = [virtual_drive("lecom", address) for address in (1, 2, 3)]
    for drive in drives:
        drive.poke("C0011", 100 * drive.address)
    line = VirtualLine(drives)
    line.late = Late()
    line.disturbances.append(line.late)
    return line


def ask_in_vain(line, bus):
    line.late.delays_s = [LATE_S, SLOW_S]
    with pytest.raises(NoReplyError):
        bus.drive("lecom", 1, attempts=1).read("C0011")


def test_late_reply_is_not_accepted_from_a_known_drive(line):
    with drivecomm.open_bus(line.port) as bus:
        second = bus.drive("lecom", 2)
        assert second.read("C0011").value == 20
        ask_in_vain(line, bus)
        assert second.read("C0011").value == 20


def test_late_reply_is_not_accepted_from_a_new_drive(line):
    with drivecomm.open_bus(line.port) as bus:
        ask_in_vain(line, bus)
        assert bus.drive("lecom", 3).read("C0011").value == 30


def test_late_acknowledgement_confirms_no_write_to_another_drive(line):
    with drivecomm.open_bus(line.port) as bus:
        line.late.delays_s = [LATE_S]
        with pytest.raises(NoReplyError, match="whether the drive acted"):
            bus.drive("lecom", 1, attempts=1).write("C0011", 40)
        line.drives[1].hear = lambda *_: None
        with pytest.raises(NoReplyError):
            bus.drive("lecom", 2, attempts=1).write("C0011", 40)


def test_late_reply_is_waited_out_once_for_all_drives(line):
    with drivecomm.open_bus(line.port) as bus:
        others = [bus.drive("lecom", address) for address in (2, 3)]
        ask_in_vain(line, bus)
        others[0].read("C0011")
        began = line.time
        others[1].read("C0011")
        assert line.time - began < 0.1


def test_late_reply_does_not_delay_drives_whose_replies_name_them(line):
    line = VirtualLine([*line.drives, virtual_drive("vabus", 9)])
    with drivecomm.open_bus(line.port) as bus:
        other = bus.drive("vabus", 9)
        other.read("481")
        with pytest.raises(NoReplyError):
            bus.drive("lecom", 44, attempts=1).read("C0011")
        began = line.time
        other.read("481")
        assert line.time - began < 0.2


@pytest.mark.parametrize("delay_s", [0.4, 2.0])
def test_many_late_replies_never_give_the_value_of_another_drive(line, delay_s):
    wrong = good = 0
    line = VirtualLine(line.drives, faults=FaultPlan(rate=0.2, kinds=[Fault.DELAY], delay_s=delay_s, seed=5))
    with drivecomm.open_bus(line.port) as bus:
        drives = {address: bus.drive("lecom", address, attempts=1) for address in (1, 2, 3)}
        for _ in range(300):
            for address, drive in drives.items():
                try:
                    value = drive.read("C0011").value
                except DriveCommError:
                    continue
                finally:
                    line.advance(0.5)
                good += 1
                wrong += value != 10 * address
    assert not wrong
    assert good > 50


def test_scan_finds_no_drive_by_the_late_reply_of_another(line):
    class AlwaysLate(Late):
        def reply(self, data, drive, now):  # noqa: ARG002
            return [(0.12, data)]

    line.disturbances[:] = [AlwaysLate()]
    with drivecomm.open_bus(line.port) as bus:
        found = {each.address for each in bus.scan(["lecom"], addresses=[1, 4, 5])}
    assert found <= {1}
