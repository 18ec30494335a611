"""A plant in virtual time: drives, motors, speed, and the scripted faults at their times."""

from contextlib import contextmanager

import pytest
from benches import COMMANDED

import drivecomm
from drivecomm.errors import NoReplyError, UsageError
from drivecomm.plant import (
    Condition,
    Fault,
    InjectStep,
    Noise,
    Plant,
    PlantLine,
    PowerCutStep,
    StuckStep,
    TelegramFault,
    TripStep,
    Window,
)
from drivecomm.protocol import DriveConfig, installed
from drivecomm.virtual import VirtualPlant

# No manual page says which parameter of these drives holds a measured value.
MEASURED_BY = [name for name in COMMANDED if name not in ("ct-ansi", "movilink")]
ADDRESS = 5
# A parameter that can be read and written, and one that the drive measures (its output frequency).
STORED = {
    "vabus": "480",
    "danfoss-fc": "3-41",
    "vlt3500": "215",
    "fuji": "F07",
    "modbus": "3110",
    "uss": "1082",
    "huanyang": "CFG0",
    "hitachi": "F002",
    "ls-bus": "0x0007",
    "toshiba": "0012",
    "mitsubishi": "72",
}
MEASURED = {
    "vabus": "210",
    "danfoss-fc": "16-13",
    "vlt3500": "502[1]",
    "fuji": "M09",
    "modbus": "16130",
    "uss": "21",
    "huanyang": "CFG1",
    "hitachi": "03-1",
    "ls-bus": "0x000A",
    "toshiba": "FD00",
    "mitsubishi": "H6F",
}
# Parameters that one telegram writes.
WRITTEN = {**STORED, "mitsubishi": "H7B", "modbus": "50010"}
protocol = pytest.mark.parametrize("name", MEASURED_BY)
# A value that a reply holds as digits cannot be stuck.
with_numbers = pytest.mark.parametrize("name", [name for name in MEASURED_BY if name not in ("hitachi", "mitsubishi")])


def planted(*script, name="vabus", line=None, speed=1.0, **drive):
    """Return a plant with one line, hall, and one drive, pump."""
    hall = line or PlantLine(name="hall")
    pump = DriveConfig(protocol=name, address=ADDRESS, line="hall", name="pump", **drive)
    return VirtualPlant(Plant(lines=(hall,), drives=(pump,), script=script), speed=speed)


@contextmanager
def master(plant, name="vabus", **options):
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        model = installed[name].default_model
        yield bus.drive(name, ADDRESS, model=model, **{"attempts": 1, **options})


def answers(drive, tries, call):
    """Return for each try whether there was a reply."""
    told = []
    for _ in range(tries):
        try:
            call(drive)
            told.append(True)
        except NoReplyError:
            told.append(False)
    return told


def patient(plant, drive, call, tries):
    """Return for each try whether there was a reply; wait until a given-up drive is probed again."""
    told = []
    for _ in range(tries):
        told += answers(drive, 1, call)
        if not told[-1]:
            plant.line("hall").advance(60)
            answers(drive, 1, lambda each: each.probe())
    return told


# Contents of a plant


def test_plant_puts_every_drive_on_its_line_with_values_and_motor():
    plant = VirtualPlant(
        Plant(
            lines=(PlantLine(name="hall", settings={"baudrate": 9600}), PlantLine(name="yard", echo=True, paced=False)),
            drives=(
                DriveConfig(
                    protocol="vabus", address=1, line="hall", name="pump", values={"480": 1234}, motor={"rated_kw": 7.5}
                ),
                DriveConfig(protocol="vabus", address=2, line="hall", options={"baudrate": 4800, "model": "act"}),
                DriveConfig(protocol="fuji", address=7, line="yard"),
            ),
        )
    )
    assert [drive.name for drive in plant.line("hall").drives] == ["pump", "vabus:2"]
    assert plant.drive("pump").settings.baudrate == 9600
    assert plant.drive("vabus:2").settings.baudrate == 4800
    assert plant.drive("pump").motor.rated_kw == 7.5
    assert plant.get("pump", "480") == "000004D2"
    assert plant.line("yard").echo
    assert not plant.line("yard").paced
    with drivecomm.open_bus(plant.line("hall").port, baudrate=9600) as bus:
        assert bus.drive("vabus", 1, model="agile").read("480").raw == "000004D2"
    assert [state.name for state in plant.states()] == ["pump", "vabus:2", "fuji:7"]
    assert plant.line_of("fuji:7") is plant.line("yard")


@pytest.mark.parametrize(
    ("drive", "sentence"),
    [
        ({"protocol": "profibus"}, "drive pump: .*profibus"),
        ({"address": 99}, "drive pump: vabus has no drive at address 99"),
        ({"options": {"model": "x"}}, "drive pump: vabus has no model 'x'"),
        ({"options": {"colour": 1}}, "drive pump: vabus drives have no option 'colour'"),
        ({"values": {"999": 1}}, "drive pump: .*999"),
        ({"values": {"480": 2**40}}, "drive pump: parameter 480 cannot hold 1099511627776"),
        ({"values": {"480": "zero"}}, "drive pump: parameter 480 cannot hold 'zero'"),
    ],
)
def test_impossible_drive_of_a_plant_is_refused(drive, sentence):
    planned = DriveConfig(**{"protocol": "vabus", "address": 1, "line": "hall", "name": "pump", **drive})
    with pytest.raises(UsageError, match=sentence):
        VirtualPlant(Plant(lines=(PlantLine(name="hall"),), drives=(planned,)))


def test_unknown_names_are_refused_by_a_plant():
    plant = planted()
    for use in (
        lambda: plant.line("yard"),
        lambda: plant.drive("fan"),
        lambda: plant.trip("fan", 5),
        lambda: plant.power_off("fan"),
        lambda: plant.inject("yard", b"x"),
        lambda: plant.get("pump", "none"),
    ):
        with pytest.raises(UsageError, match=r"yard|fan|none"):
            use()
    with pytest.raises(UsageError, match="fault code 0"):
        plant.trip("pump", 0)
    with pytest.raises(UsageError, match="a speed of 0"):
        planted(speed=0)


@protocol
def test_every_protocol_is_driven_through_a_plant(name):
    plant = planted(name=name)
    with master(plant, name) as pump:
        assert pump.read(STORED[name]).raw == plant.get("pump", STORED[name])
        plant.trip("pump", 5)
        assert pump.status().fault == pump.capabilities.faults
        assert plant.states()[0].fault == 5
        # A VABus drive acknowledges no fault for 15 s.
        plant.line("hall").advance(16)
        if not pump.capabilities.faults:
            return
        pump.reset()
        assert not pump.status().fault


def test_noise_is_repeatable():
    def course(seed):
        noise = Noise(rate=0.3, seed=seed, kinds=(Fault.DROP,), requests=False)
        plant = planted(line=PlantLine(name="hall", noise=noise))
        with master(plant) as pump:
            return patient(plant, pump, lambda drive: drive.read("480"), 40)

    assert course(1) == course(1)
    assert 0 < sum(course(1)) < 40


@protocol
@pytest.mark.parametrize("raw", [2**40, -(2**40), -1, 70000, 10**9, "", "x", "FFFF"])
def test_drive_set_to_an_odd_value_still_answers(name, raw):
    plant = planted(name=name)
    try:
        plant.set("pump", STORED[name], raw)
    except UsageError as error:
        assert f"parameter {STORED[name]} cannot hold {raw!r}" in str(error)  # noqa: PT017 - the write may also succeed
    with master(plant, name) as pump:
        assert pump.read(STORED[name]).raw == plant.get("pump", STORED[name])
        pump.status()


# Faults of telegrams


# A write to an LS drive is two telegrams.
@pytest.mark.parametrize("name", [name for name in MEASURED_BY if name != "ls-bus"])
def test_every_third_reply_to_a_write_is_lost(name):
    plant = planted(TelegramFault(line="hall", kind=Fault.DROP, of="reply to a write", every=3), name=name)
    with master(plant, name) as pump:
        value = pump.read(WRITTEN[name]).value
        told = []
        for _ in range(9):
            told += answers(pump, 1, lambda drive: drive.write(WRITTEN[name], value, store=name == "fuji"))
            # Reads are not counted; the first read after a lost reply finds the line drained.
            pump.read(STORED[name])
        assert told == [True, True, False] * 3
    assert plant.disturbances[0].happened == 3


def test_fault_applies_only_to_requests_with_these_fields():
    to = {"kind": "enquiry", "parameter": 480}
    plant = planted(TelegramFault(drive="pump", kind=Fault.DROP, of="reply", to=to))
    with master(plant) as pump:
        assert answers(pump, 3, lambda drive: drive.read("481")) == [True] * 3
        assert answers(pump, 1, lambda drive: drive.read("480")) == [False]


def test_fault_applies_only_within_its_window():
    plant = planted(TelegramFault(line="hall", kind=Fault.DROP, window=Window(from_s=10, until_s=20)))
    with master(plant) as pump:
        assert answers(pump, 1, lambda drive: drive.read("480")) == [True]
        plant.line("hall").pass_time(10)
        assert answers(pump, 1, lambda drive: drive.read("480")) == [False]
        plant.line("hall").pass_time(20)
        assert answers(pump, 1, lambda drive: drive.read("480")) == [True]


def test_fault_applies_to_a_random_share():
    plant = planted(TelegramFault(line="hall", kind=Fault.DROP, of="reply to a read", rate=0.25, seed=4))
    port = plant.line("hall").port()
    port.configure(plant.drive("pump").settings)
    request = drivecomm.encode("vabus", {"kind": "enquiry", "address": ADDRESS, "parameter": 480}, direction="request")
    replies = []
    for _ in range(200):
        port.write(request)
        replies.append(port.read(port.now() + 0.1, 100))
    assert 30 <= replies.count(b"") == plant.disturbances[0].happened <= 70


def test_replies_are_delayed_and_requests_duplicated():
    plant = planted(
        TelegramFault(line="hall", kind=Fault.DELAY, of="reply", every=2, delay_s=0.2),
        TelegramFault(line="hall", kind=Fault.DUPLICATE, of="request", window=Window(from_s=50)),
    )
    line = plant.line("hall")
    with master(plant, reply_timeout_s=0.15) as pump:
        assert answers(pump, 2, lambda drive: drive.read("480")) == [True, False]
    line.pass_time(50)
    assert plant.disturbances[1].happened == 0
    with master(plant) as pump:
        pump.read("480")
    assert plant.disturbances[1].happened > 0


def test_fault_of_one_drive_spares_the_others():
    plant = VirtualPlant(
        Plant(
            lines=(PlantLine(name="hall"),),
            drives=tuple(DriveConfig(protocol="vabus", address=number, line="hall") for number in (1, 2)),
            script=(TelegramFault(drive="vabus:2", kind=Fault.DROP),),
        )
    )
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        assert answers(bus.drive("vabus", 1), 3, lambda drive: drive.read("480")) == [True] * 3
        assert answers(bus.drive("vabus", 2, attempts=1), 1, lambda drive: drive.read("480")) == [False]


def test_fault_of_writes_needs_a_protocol_that_separates_reads_and_writes(monkeypatch):
    monkeypatch.setattr(type(installed["vabus"]), "__setattr__", object.__setattr__)
    monkeypatch.setattr(installed["vabus"], "intent", None)
    with pytest.raises(UsageError, match="fault 1: the package of vabus does not distinguish reading from writing"):
        planted(TelegramFault(line="hall", kind=Fault.DROP, of="reply to a write"))


# Power


def test_power_cut_ends_and_resumes_at_its_times():
    cut = PowerCutStep(drive="pump", off_at_s=20, back_at_s=35)
    plant = planted(cut, name="danfoss-fc", values={"3-41": 1234})
    line = plant.line("hall")
    with master(plant, "danfoss-fc") as pump:
        pump.set_reference(percent=40)
        pump.start()
        line.pass_time(19.8)
        assert pump.status().running
        line.pass_time(20)
        assert answers(pump, 1, lambda drive: drive.read("3-41")) == [False]
        assert not plant.states()[0].powered
        line.pass_time(34.9)
        assert not plant.states()[0].powered
    line.pass_time(35)
    with master(plant, "danfoss-fc") as pump:
        assert plant.states()[0].powered
        assert pump.read("3-41").raw == 1234
        assert not pump.status().running


@protocol
def test_power_cut_with_factory_resets_all_settings(name):
    settings = {"baudrate": 2400}
    plant = planted(
        PowerCutStep(drive="pump", off_at_s=1, back_at_s=2, factory=True),
        name=name,
        line=PlantLine(name="hall", settings=settings),
        motor={"rated_kw": 9},
    )
    before = plant.get("pump", STORED[name])
    with master(plant, name, baudrate=2400) as pump:
        pump.write(STORED[name], 7, store=name not in ("huanyang", "vlt3500") and pump.capabilities.stored_writes)
        assert plant.get("pump", STORED[name]) != before
    plant.line("hall").pass_time(2)
    assert plant.get("pump", STORED[name]) == before
    assert plant.drive("pump").motor.rated_kw == 9
    with master(plant, name, baudrate=2400) as pump:
        assert answers(pump, 1, lambda drive: drive.read(STORED[name])) == [False]
    with master(plant, name) as pump:
        assert pump.read(STORED[name]).raw == before


def test_switching_twice_equals_switching_once():
    plant = planted()
    plant.power_on("pump")
    plant.power_off("pump")
    plant.power_off("pump")
    assert not plant.states()[0].powered
    plant.power_on_as_new("pump")
    plant.power_on("pump")
    assert plant.states()[0].powered


# Trips


def test_trip_occurs_at_its_time():
    plant = planted(TripStep(drive="pump", code=0x103, at_s=5))
    plant.line("hall").pass_time(4.99)
    assert plant.states()[0].fault == 0
    plant.line("hall").pass_time(5)
    assert plant.states()[0].fault == 0x103


@protocol
def test_trip_occurs_when_a_value_was_too_high_for_some_time(name):
    condition = Condition(parameter=MEASURED[name], above=30, for_s=2)
    plant = planted(TripStep(drive="pump", code=5, when=condition), name=name)
    line = plant.line("hall")
    with master(plant, name) as pump:
        run_at(pump, 60)
        at = time_of_trip(plant)
        motor = plant.drive("pump").motor
        ramp_s = motor.ramp_up_s * 30 / motor.rated_hz
        assert ramp_s + 2 <= at <= ramp_s + 2 + 1.0
        # No second trip before the condition was false.
        line.advance(16)
        if not pump.capabilities.faults:
            return
        pump.reset()
        run_at(pump, 60)
        assert time_of_trip(plant) > at + 2


def run_at(pump, percent):
    if pump.capabilities.reference_percent:
        pump.set_reference(percent=percent * 1.2)
    else:
        pump.set_reference(hz=percent * 0.6)
    pump.start()
    if pump.capabilities.reference_percent:
        pump.set_reference(percent=percent * 1.2)


def time_of_trip(plant):
    line = plant.line("hall")
    for _ in range(1000):
        if plant.states()[0].fault:
            return line.time
        line.advance(0.05)
    raise AssertionError("no trip")


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_condition_must_hold_for_its_process_time_without_a_break(speed):
    condition = Condition(parameter="480", above=20, for_s=2)
    plant = planted(TripStep(drive="pump", code=5, when=condition), speed=speed, options={"model": "agile"})

    def fault_after(raw, seconds):
        plant.set("pump", "480", raw)
        plant.line("hall").advance(seconds / speed)
        return plant.states()[0].fault

    assert fault_after(1000, 5) == 0
    assert fault_after(3000, 1.5) == 0
    assert fault_after(1000, 1) == 0
    assert fault_after(3000, 1.5) == 0
    assert fault_after(3000, 1) == 5


def test_impossible_condition_is_refused():
    for parameter, sentence in (("none", "none"), ("12345", "12345"), ("1", "is not a number|1")):
        with pytest.raises(UsageError, match=sentence):
            planted(TripStep(drive="pump", code=5, when=Condition(parameter=parameter, above=1)))


def test_drive_without_power_meets_no_condition():
    plant = planted(TripStep(drive="pump", code=5, when=Condition(parameter="480", above=1, for_s=1)))
    plant.power_off("pump")
    plant.line("hall").advance(10)
    assert plant.states()[0].fault == 0
    plant.power_on("pump")
    plant.line("hall").advance(2)
    assert plant.states()[0].fault == 5


# Stuck values


@with_numbers
@pytest.mark.parametrize("parameters", [STORED, MEASURED], ids=["stored", "measured"])
def test_stuck_value_is_read_until_it_is_released(name, parameters):
    parameter = parameters[name]
    step = StuckStep(drive="pump", parameter=parameter, value=12, window=Window(from_s=5, until_s=50))
    plant = planted(step, name=name)
    line = plant.line("hall")
    with master(plant, name) as pump:
        free = pump.read(parameter).value
        assert free != 12
        line.pass_time(5)
        assert pump.read(parameter).value == 12
        # All other values are unchanged.
        other = (STORED if parameters is MEASURED else MEASURED)[name]
        assert pump.read(other).raw == plant.get("pump", other)
        line.pass_time(50)
        assert pump.read(parameter).value == free


@with_numbers
def test_stuck_value_takes_the_usual_reply_time(name):
    step = StuckStep(drive="pump", parameter=STORED[name], value=12, window=Window(from_s=5))
    plant = planted(step, name=name, reply_delay_s=0.04)
    line = plant.line("hall")

    def seconds(pump):
        began = line.time
        pump.read(STORED[name])
        return line.time - began

    with master(plant, name) as pump:
        # The link waits longer for the first replies.
        seconds(pump)
        line.pass_time(3)
        free = seconds(pump)
        assert free > 0.04
        line.pass_time(5)
        assert seconds(pump) == pytest.approx(free, rel=0.1)


@with_numbers
def test_raw_text_can_be_stuck(name):
    free = str(planted(name=name).get("pump", MEASURED[name]))
    raw = free[:-1] + "3"
    plant = planted(StuckStep(drive="pump", parameter=MEASURED[name], value=raw), name=name)
    plant.line("hall").advance(0)
    with master(plant, name) as pump:
        assert str(pump.read(MEASURED[name]).raw) == raw != free


@pytest.mark.parametrize(("parameter", "value"), [("none", 1), ("999", 1), ("480", "12"), ("480", 1e12)])
def test_impossible_stuck_value_is_refused(parameter, value):
    with pytest.raises(UsageError, match=f"fault 1: .*{parameter}"):
        planted(StuckStep(drive="pump", parameter=parameter, value=value))


def test_refusal_is_not_changed_by_a_stuck_value():
    plant = planted(StuckStep(drive="pump", parameter="480", value=12))
    with master(plant) as pump, pytest.raises(drivecomm.RefusedError):
        pump.read("999", type="uint")


# Injected bytes, and the speed of the process


def test_injected_bytes_arrive_at_their_time():
    plant = planted(InjectStep(line="hall", data=b"hello", at_s=3))
    port = plant.line("hall").port()
    assert port.read(10.0, 5) == b"hello"
    assert port.now() == pytest.approx(3 + 5 * 10 / 9600)


def test_faster_process_keeps_the_speed_of_the_wire():
    def course(speed):
        plant = planted(TripStep(drive="pump", code=5, at_s=200), speed=speed)
        line = plant.line("hall")
        with master(plant) as pump:
            pump.set_reference(hz=40)
            pump.start()
            began = line.time
            pump.read("480")
            took = line.time - began
        line.advance(1)
        return took, plant.states()[0].output_hz, plant

    slow, fast = course(1), course(100)
    assert slow[0] == pytest.approx(fast[0]), "the wire keeps its pace"
    assert 5 < slow[1] < 15
    assert fast[1] == 40
    fast[2].line("hall").pass_time(1.99)
    assert fast[2].states()[0].fault == 0
    fast[2].line("hall").pass_time(2.0)
    assert fast[2].states()[0].fault == 5


def test_drive_answers_at_an_address_set_by_its_parameter():
    plant = planted(name="vlt3500")
    plant.set("pump", "500", 9)
    with drivecomm.open_bus(plant.line("hall").port) as bus:
        assert bus.drive("vlt3500", 9).read("215")
    assert plant.states()[0].drive == "vlt3500:9"
