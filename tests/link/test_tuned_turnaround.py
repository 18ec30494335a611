"""A tuned turnaround, which is abandoned when errors rise."""

import pytest

import drivecomm
from drivecomm.errors import ReplyError
from drivecomm.link import TuningWatch
from drivecomm.link.other_masters import CAREFUL_S
from drivecomm.plant import Fault, FaultPlan, Plant, PlantLine
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualPlant


class Bench:
    """Drives on a virtual line; the pauses after replies and the notes of the trace are recorded."""

    def __init__(self, *drives, faults=None):
        self.plant = VirtualPlant(Plant(lines=(PlantLine(name="line"),), drives=drives))
        self.line = self.plant.line("line")
        self.line.faults = faults or self.line.faults
        self.line.monitors.append(self._heard)
        self.pauses, self.notes = [], []
        self._ended = None
        self.bus = drivecomm.open_bus(self.line.port, trace=self._traced)
        self.drives = [drive.build(self.bus.drive) for drive in drives]

    def wait_until_careless(self):
        """Pass the time of longer waits for replies; the first reply shows the reply time of the drive."""
        self.ask(len(self.drives))
        self.line.advance(CAREFUL_S)
        self.pauses.clear()
        self._ended = None

    def ask(self, times):
        for number in range(times):
            try:
                self.drives[number % len(self.drives)].probe()
            except ReplyError:
                continue

    def count(self, counter="tunings given up"):
        return sum(counted[counter] for counted in self.bus.counters.values())

    def _traced(self, event):
        if event.what == "note":
            self.notes.append((event.drive, event.detail))

    def _heard(self, sent):
        if sent.source == "drive":
            self._ended = sent.ended
        elif self._ended is not None:
            self.pauses.append(round(sent.began - self._ended, 6))
            self._ended = None


def drive(address=1, *, needs_s=0.0, **options):
    return DriveConfig(protocol="vlt3500", address=address, line="line", options=options, needs_pause_s=needs_s)


def test_tuned_turnaround_is_used():
    bench = Bench(drive(needs_s=0.001, tuned_turnaround_s=0.002))
    bench.wait_until_careless()
    bench.ask(200)
    assert set(bench.pauses) == {0.002}
    assert bench.count("timeouts") == 0


def test_tuned_turnaround_is_abandoned_permanently_when_errors_rise():
    bench = Bench(drive(needs_s=0.003, tuned_turnaround_s=0.002))
    bench.wait_until_careless()
    bench.ask(300)
    assert bench.count("timeouts") == 3
    assert bench.pauses[:3] == [0.002] * 3
    assert set(bench.pauses[3:]) == {0.010}
    assert bench.count() == 1
    assert bench.notes == [("vlt3500:1", "errors rose; the usual turnaround is used again for all drives of the line")]


def test_damaged_replies_count_as_errors_of_the_tuned_turnaround():
    bench = Bench(drive(tuned_turnaround_s=0.002), faults=FaultPlan(rate=0.2, kinds=[Fault.CORRUPT], requests=False))
    bench.ask(100)
    assert bench.count() == 1
    assert bench.pauses[-1] >= 0.010


def test_rare_errors_do_not_abandon_the_tuned_turnaround():
    bench = Bench(drive(tuned_turnaround_s=0.002))
    for _ in range(10):
        bench.line.faults = FaultPlan(rate=1, kinds=[Fault.DROP])
        bench.ask(1)
        bench.line.faults = FaultPlan(rate=0)
        bench.ask(49)
    assert bench.count("timeouts") == 10
    assert bench.count() == 0
    assert bench.pauses[-1] == 0.002


def test_silent_drive_does_not_abandon_the_tuned_turnaround():
    bench = Bench(drive(tuned_turnaround_s=0.002))
    bench.ask(10)
    bench.plant.power_off("vlt3500:1")
    bench.ask(20)
    bench.plant.power_on("vlt3500:1")
    bench.ask(10)
    assert bench.count("timeouts") >= 3
    assert bench.count() == 0
    assert bench.pauses[-1] == 0.002


def test_drive_that_was_never_there_does_not_abandon_the_tuned_turnaround():
    bench = Bench(drive(tuned_turnaround_s=0.002), drive(2))
    bench.plant.power_off("vlt3500:2")
    bench.ask(40)
    assert bench.count("timeouts") == 20
    assert bench.count() == 0


def test_errors_of_an_untuned_drive_count_for_the_tuned_turnaround():
    """The drive misses a request that comes too soon after another drive's reply."""
    bench = Bench(drive(1, tuned_turnaround_s=0.002), drive(2, tuned_turnaround_s=0.002), drive(3))
    bench.ask(30)
    assert bench.pauses[-3:] == [0.010, 0.002, 0.002]
    for _ in range(3):
        bench.ask(2)
        bench.line.faults = FaultPlan(rate=1, kinds=[Fault.DROP])
        bench.drives = bench.drives[2:] + bench.drives[:2]
        bench.ask(1)
        bench.line.faults = FaultPlan(rate=0)
        bench.drives = bench.drives[1:] + bench.drives[:1]
        bench.ask(3)
    assert [name for name, _ in bench.notes] == ["vlt3500:3"]
    bench.pauses.clear()
    bench.ask(12)
    assert set(bench.pauses) == {0.010}


def test_line_without_tuned_drives_reports_no_abandoned_turnaround():
    bench = Bench(drive(needs_s=0.012))
    bench.ask(100)
    assert bench.count("timeouts") > 10
    assert bench.count() == 0
    assert bench.notes[:1] != [
        ("vlt3500:1", "errors rose; the usual turnaround is used again for all drives of the line")
    ]


@pytest.mark.parametrize(("last", "given_up"), [(100, True), (101, False)])
def test_three_errors_in_a_hundred_requests_abandon_the_turnaround(last, given_up):
    watch = TuningWatch()
    assert watch.holds()
    assert not watch.failed("a", 1, 1)
    assert not watch.failed("a", 50, 40)
    assert watch.failed("a", last, 90) is given_up
    assert watch.holds() is not given_up


def test_errors_of_different_drives_are_not_added():
    watch = TuningWatch()
    watch.holds()
    assert not any(watch.failed(name, 10, replies) for replies in (1, 2) for name in ("a", "b", "c"))
    assert watch.holds()
