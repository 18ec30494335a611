"""Watchdogs of virtual drives: each series reacts to a silent master as documented, in virtual time."""

import pytest

import drivecomm
from drivecomm.plant import Plant, PlantLine
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualLine, VirtualPlant, virtual_drive

WATCHDOG_S = 4


class Bench:
    """A motor at half speed with its watchdog set, on a line whose master then falls silent."""

    def __init__(self, protocol, model, values, *others):
        self.virtual = virtual_drive(protocol, 2, model=model)
        for parameter, raw in values.items():
            self.virtual.poke(parameter, raw)
        self.line = VirtualLine([self.virtual, *others])
        self.bus = drivecomm.open_bus(self.line.port)
        self.drive = self.bus.drive(protocol, 2, model=model)
        self.drive.watched(WATCHDOG_S)
        self.drive.set_reference(percent=50)
        self.drive.start()
        self.keep_speaking(10)

    def keep_speaking(self, seconds):
        for _ in range(seconds):
            self.drive.status()
            self.line.advance(1)
        self.drive.status()

    def after(self, seconds):
        """Pass seconds in silence; return whether the motor runs, its frequency in Hz, and the fault."""
        self.line.advance(seconds)
        self.virtual.follow(self.line.time)
        motor = self.virtual.motor
        motor.advance(self.line.time)
        return motor.running, round(motor.output_hz, 2), motor.fault


CASES = {
    "vabus trip": ("vabus", "agile", {"413": WATCHDOG_S}),
    "vabus off": ("vabus", "agile", {"413": 0}),
    "fc off": ("danfoss-fc", "fc300", {"8-03": 40, "8-04": 0}),
    "fc freeze": ("danfoss-fc", "fc300", {"8-03": 40, "8-04": 1}),
    "fc stop": ("danfoss-fc", "fc300", {"8-03": 40, "8-04": 2}),
    "fc maximum": ("danfoss-fc", "fc300", {"8-03": 40, "8-04": 4}),
    "fc stop and trip": ("danfoss-fc", "fc300", {"8-03": 40, "8-04": 5}),
    "vlt5000 stop": ("danfoss-fc", "vlt5000", {"513": 4, "514": 2}),
    "frenic off": ("fuji", "frenic", {"y08": 0, "y02": 0}),
    "frenic trip": ("fuji", "frenic", {"y08": 4, "y02": 0}),
    "frenic run, then trip": ("fuji", "frenic", {"y08": 4, "y02": 1, "y03": 30}),
    "frenic trip if it lasts": ("fuji", "frenic", {"y08": 4, "y02": 2, "y03": 30}),
    "frenic go on": ("fuji", "frenic", {"y08": 4, "y02": 3}),
    "vg trip": ("fuji", "vg", {"H38": 40, "H32": 0}),
    "vg run, then trip": ("fuji", "vg", {"H38": 40, "H32": 1, "H33": 300}),
}


def bench_for(case, *others):
    return Bench(*CASES[case], *others)


@pytest.mark.parametrize("case", CASES)
def test_watchdog_does_not_act_before_its_time(case):
    bench = bench_for(case)
    running, hz, fault = bench.after(WATCHDOG_S - 0.5)
    assert running
    assert hz > 20
    assert not fault
    assert bench.drive.status().running


@pytest.mark.parametrize(("case", "code"), [("vabus trip", 0x2010), ("frenic trip", 38), ("vg trip", 38)], ids=str)
def test_watchdog_trips_in_time_even_if_the_drive_is_read_late(case, code):
    bench = bench_for(case)
    assert bench.after(WATCHDOG_S + 0.5) == (False, 0, code)
    assert bench.drive.status().fault_code == code
    late = bench_for(case)
    late.line.advance(100)
    assert late.drive.status().fault
    shaft = late.virtual.motor.shaft_hz
    assert shaft == 0, "it tripped long ago, so that the motor has run out"


@pytest.mark.parametrize("case", ["vabus off", "fc off", "frenic off", "frenic go on"])
def test_motor_runs_on_without_a_watchdog(case):
    running, hz, fault = bench_for(case).after(1000)
    assert (running, fault) == (True, 0)
    assert hz > 20


def test_fc_timeout_functions_act_as_documented():
    assert bench_for("fc freeze").after(60)[:2] == (True, 25)
    assert bench_for("fc maximum").after(60)[:2] == (True, 65), "its output frequency high limit"
    assert bench_for("fc stop").after(60) == (False, 0, 0)
    assert bench_for("vlt5000 stop").after(60) == (False, 0, 0)
    stopping = bench_for("fc stop and trip")
    running, hz, fault = stopping.after(WATCHDOG_S + 1)
    assert running
    assert 0 < hz < 25
    assert not fault
    assert stopping.after(60) == (False, 0, 17)


@pytest.mark.parametrize("case", ["frenic run, then trip", "frenic trip if it lasts", "vg run, then trip"])
def test_fuji_runs_until_its_timer_expires_and_then_trips(case):
    bench = bench_for(case)
    assert bench.after(WATCHDOG_S + 2)[0]
    assert bench.after(1.5) == (False, 0, 38)


def test_fuji_trips_after_a_short_silence_by_action_1_only():
    lasting, ended = bench_for("frenic run, then trip"), bench_for("frenic trip if it lasts")
    for bench in (lasting, ended):
        assert bench.after(WATCHDOG_S + 1)[0]
        bench.keep_speaking(5)
    assert lasting.after(0) == (False, 0, 38)
    assert ended.after(0)[0]


def test_fuji_watchdog_is_fed_by_foreign_frames_on_frenic_but_not_on_vg():
    for case, goes_on in (("frenic trip", True), ("vg trip", False)):
        bench = bench_for(case, virtual_drive("fuji", 7))
        other = bench.bus.drive("fuji", 7)
        for _ in range(10):
            other.status()
            bench.line.advance(1)
        assert bench.after(0)[0] is goes_on


def test_fuji_watchdog_is_inactive_while_the_link_has_no_control():
    bench = bench_for("frenic trip")
    bench.virtual.poke("H30", 0)
    assert bench.after(WATCHDOG_S + 10)[2] == 0


def test_vabus_watchdog_is_not_fed_by_broadcasts_or_foreign_telegrams():
    bench = bench_for("vabus trip", virtual_drive("vabus", 7))
    other, everybody = bench.bus.drive("vabus", 7), bench.bus.broadcast("vabus")
    for _ in range(WATCHDOG_S + 1):
        other.read("411")
        everybody.write("481", 10, type="long")
        bench.line.advance(1)
    assert bench.after(0) == (False, 0, 0x2010)


def test_vabus_watchdog_is_fed_by_refused_reads_and_keeps_an_earlier_fault():
    bench = bench_for("vabus trip")
    for _ in range(WATCHDOG_S + 4):
        with pytest.raises(drivecomm.RefusedError):
            bench.drive.read("999")
        bench.line.advance(1)
    assert bench.after(0)[0]
    bench.virtual.trip(0x0300, bench.line.time)
    assert bench.after(60) == (False, 0, 0x0300)


def test_fc_watchdog_is_not_fed_by_telegrams_without_a_valid_control_word():
    bench = bench_for("fc stop")
    reader = bench.bus.drive("danfoss-fc", 2, model="fc300")
    for _ in range(20):
        reader.read("16-13")
        bench.line.advance(1)
    assert bench.after(0) == (False, 0, 0)


@pytest.mark.parametrize("case", ["vabus trip", "fc stop", "frenic trip", "vg trip"])
def test_watchdog_is_inactive_before_the_first_request_and_after_power_up(case):
    protocol, model, values = CASES[case]
    fresh = virtual_drive(protocol, 2, model=model)
    for parameter, raw in values.items():
        fresh.poke(parameter, raw)
    fresh.follow(1000.0)
    assert not fresh.motor.fault
    bench = bench_for(case)
    bench.virtual.power_cycle(bench.line.time)
    for parameter, raw in values.items():
        bench.virtual.poke(parameter, raw)
    assert bench.after(1000) == (False, 0, 0)


def test_virtual_plant_shows_watchdog_trips_and_passes_on_foreign_frames():
    plant = VirtualPlant(
        Plant(
            lines=(PlantLine(name="hall"),),
            drives=(
                DriveConfig(protocol="fuji", address=1, line="hall", values={"y08": 4}),
                DriveConfig(protocol="fuji", address=2, line="hall"),
                DriveConfig(protocol="vabus", address=1, line="hall", values={"413": "0003"}),
            ),
        )
    )
    line = plant.line("hall")
    with drivecomm.open_bus(line.port) as bus:
        other = bus.drive("fuji", 2)
        for protocol in ("fuji", "vabus"):
            bus.drive(protocol, 1).start()
        for _ in range(6):
            line.advance(1)
            other.status()
        mill, _, pump = plant.states()
        assert (mill.fault, pump.fault) == (0, 0x2010)
        line.advance(5)
        assert plant.states()[0].fault == 38
