"""Common verbs of all protocols, waiting for a state, reading back, and the guard of stored writes."""

from decimal import Decimal

import pytest
from two_faces import FACES, open_on

import drivecomm
from drivecomm.bus import Drive, GoalWait, is_stored, reaching
from drivecomm.errors import NotSupported, OvertakenError, StateError, UsageError, ValueRefusedError
from drivecomm.models import load_model
from drivecomm.protocol import DriveState, DriveStatus, installed
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_vabus.options import VabusOptions

DRIVES = {
    "vabus": {"model": "agile"},
    "danfoss-fc": {"model": "fc300"},
    "vlt3500": {"model": "vlt3500"},
    "fuji": {"model": "frenic"},
}


@pytest.fixture(params=DRIVES)
def virtual(request):
    return virtual_drive(request.param, 1, **DRIVES[request.param])


@pytest.fixture(params=FACES)
def drive(virtual, request):
    protocol = request.node.callspec.params["virtual"]
    with open_on(request.param, VirtualLine([virtual]).port) as bus:
        yield bus.drive(protocol, 1, **DRIVES[protocol])


def test_drive_starts_reverses_and_stops(drive, virtual):
    virtual.motor.ramp_up_s = virtual.motor.ramp_down_s = 2
    drive.set_reference(percent=30)
    drive.start()
    status = drive.wait_for("at_reference")
    assert status.running
    assert virtual.motor.output_hz > 0
    drive.reverse()
    drive.wait_for("at_reference")
    assert virtual.motor.output_hz < 0
    drive.start()
    drive.wait_for("at_reference")
    assert virtual.motor.output_hz > 0
    drive.stop()
    assert not drive.wait_for(DriveState.READY).running
    assert virtual.motor.target_hz == 0


@pytest.mark.parametrize("protocol", ["danfoss-fc", "fuji"])
def test_zero_is_a_valid_reference(protocol):
    virtual, bus = drive_and_bus(protocol, **DRIVES[protocol])
    with bus:
        drive = bus.drive(protocol, 1, **DRIVES[protocol])
        drive.set_reference(percent=30)
        drive.start()
        drive.set_reference(percent=0)
        drive.wait_for("at_reference")
        assert virtual.motor.output_hz == 0


def test_wait_for_leaves_the_line_free_between_requests(drive, virtual):
    virtual.motor.ramp_up_s = 4
    drive.set_reference(percent=50)
    drive.start()
    before = drive.bus.counters[drive.name]["requests"]
    began = drive.bus.now()
    drive.wait_for("at_reference")
    asked = drive.bus.counters[drive.name]["requests"] - before
    assert asked <= (drive.bus.now() - began) / 0.1 + 2


def test_wait_for_raises_at_its_timeout_and_at_a_fault(drive, virtual):
    began = drive.bus.now()
    with pytest.raises(StateError, match=r"did not reach 'running' within 1 s; it is (not_)?ready"):
        drive.wait_for(DriveState.RUNNING, timeout_s=1)
    assert drive.bus.now() - began < 1.5
    virtual.trip(4, drive.bus.now())
    with pytest.raises(StateError, match=r"has a fault( 4.*)? and will not reach 'running'; reset it first"):
        drive.wait_for(DriveState.RUNNING, timeout_s=100)
    assert drive.wait_for(DriveState.FAULT).fault


def drive_status(**facts):
    return DriveStatus(**{"word": 0, "state": DriveState.READY, "running": False, "fault": False, **facts})


def test_standing_motor_is_not_at_its_reference():
    waiting = GoalWait("fan", "at_reference", 10.0, now=0.0)
    assert not waiting.over(drive_status(at_reference=True), 1.0)
    assert waiting.over(drive_status(at_reference=True, running=True), 1.0)


def test_wait_for_at_reference_needs_a_status_that_shows_it():
    waiting = GoalWait("fan", "at_reference", 10.0, now=0.0)
    assert not waiting.over(drive_status(at_reference=None), 1.0)
    with pytest.raises(NotSupported, match="does not report whether the reference is reached"):
        waiting.over(drive_status(at_reference=None, running=True), 1.0)


def test_overtaking_stop_does_not_end_a_wait_before_its_timeout():
    now, overtaken = [0.0], OvertakenError("a stop went first")
    waiting = reaching("fan", DriveState.READY, 10.0, lambda: now[0])
    next(waiting)
    waiting.throw(overtaken)
    next(waiting)
    waiting.send(drive_status(state=DriveState.RUNNING, running=True))
    next(waiting)
    with pytest.raises(StopIteration) as ended:
        waiting.send(drive_status())
    assert ended.value.value == drive_status()
    waiting = reaching("fan", DriveState.READY, 10.0, lambda: now[0])
    next(waiting)
    now[0] = 10.0
    with pytest.raises(OvertakenError):
        waiting.throw(overtaken)


@pytest.mark.parametrize(("goal", "seconds"), [("somewhere", 1), (DriveState.READY, -1), ("at_reference", "soon")])
def test_wait_for_refuses_unknown_goals_and_invalid_times(drive, goal, seconds):
    with pytest.raises((UsageError, TypeError)):
        drive.wait_for(goal, timeout_s=seconds)


def test_verbs_missing_from_the_capabilities_are_refused(drive):
    for verb, arguments in {
        "jog": {},
        "hold": {},
        "select_setup": {"number": 1},
        "set_relay": {"number": 1, "on": True},
    }.items():
        if verb not in drive.capabilities.verbs:
            with pytest.raises(NotSupported, match=f"does not support {verb}; supported common verbs: "):
                getattr(drive, verb)(**arguments)


def drive_and_bus(protocol, **options):
    virtual = virtual_drive(protocol, 1, **options)
    return virtual, drivecomm.open_bus(VirtualLine([virtual]).port)


def test_danfoss_drive_jogs_holds_and_selects_setups_and_relays():
    virtual, bus = drive_and_bus("danfoss-fc", model="fc300")
    with bus:
        drive = bus.drive("danfoss-fc", 1, model="fc300")
        drive.set_reference(percent=50)
        drive.start()
        drive.wait_for("at_reference", timeout_s=20)
        drive.hold()
        assert virtual.motor.command.value == "hold"
        drive.jog()
        drive.select_preset(1)
        drive.select_setup(2)
        drive.set_relay(2, on=True)
        with pytest.raises(ValueRefusedError, match="relay 3 does not exist"):
            drive.set_relay(3, on=True)


def test_value_is_written_by_its_text_and_read_back():
    _, bus = drive_and_bus("vabus", model="agile")
    with bus:
        drive = bus.drive("vabus", 1, model="agile")
        held = drive.write_and_read("10", "9600 baud")
        assert (held.value, held.text) == (3, "9600 baud")
        assert drive.write_and_read("481", 12.5).value == Decimal("12.50")
        with pytest.raises(ValueRefusedError, match="is not a number"):
            drive.write("10", "9601 baud")


def test_option_text_ignores_case_and_must_be_unambiguous(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(
        'format = 1\nprotocol = "vabus"\nname = "own"\nextends = "agile"\n'
        '[[parameter]]\naddress = "11"\nname = "twofold"\ntype = "uint"\nvalues = { 1 = "on", 2 = "on" }\n',
        encoding="utf-8",
    )
    _, bus = drive_and_bus("vabus", model="agile")
    with bus:
        drive = bus.drive("vabus", 1, model=str(own))
        assert drive.write_and_read("baud_rate", "9600 BAUD").value == 3
        with pytest.raises(ValueRefusedError, match="is not a number"):
            drive.check_write("twofold", "on")


class IgnoredWrites:
    """Operations of a drive whose writes are confirmed and not carried out."""

    def __init__(self, inner):
        self._inner = inner

    def __getattr__(self, name):
        return getattr(self._inner, name)

    def write(self, _parameter, _value, **_options):
        yield from ()


def test_write_and_read_detects_a_drive_that_holds_another_value():
    model = load_model("drivecomm_vabus", "vabus", "agile")
    virtual, bus = drive_and_bus("vabus", model="agile")
    with bus:
        drive = bus.drive("vabus", 1, model=model)
        deaf = Drive(bus, drive.peer, IgnoredWrites(installed["vabus"].operations(1, VabusOptions(), model)), model)
        with pytest.raises(StateError, match=r"481 was written as 17\.5 and holds .* Hz; see the limits"):
            deaf.write_and_read("481", 17.5)
        assert virtual.peek("481", 0)


def test_eleventh_stored_write_within_an_hour_is_refused_unsent():
    _, bus = drive_and_bus("vabus", model="agile")
    with bus:
        drive = bus.drive("vabus", 1, model="agile")
        began = bus.now()
        for value in range(10):
            drive.write("481", value, store=True)
            drive.write("481", value)
        sent = bus.counters["vabus:1"]["requests"]
        with pytest.raises(UsageError, match="481 of vabus:1 was stored 10 times within an hour"):
            drive.write("fixed_frequency_2", 3, store=True)
        assert bus.counters["vabus:1"]["requests"] == sent
        drive.write("482", 3, store=True)
        bus.sleep_until(began + 3599)
        with pytest.raises(UsageError, match="within an hour"):
            drive.write("481", 3, store=True)
        bus.sleep_until(bus.now() + 3600)
        drive.write("481", 3, store=True)


def test_parameters_that_a_drive_always_stores_are_counted(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(
        'format = 1\nprotocol = "vlt3500"\nname = "own"\n'
        '[[parameter]]\naddress = "215"\nname = "ramp_up_time"\nstorage = "stored"\n'
        '[[parameter]]\naddress = "216"\nname = "ramp_down_time"\n',
        encoding="utf-8",
    )
    _, bus = drive_and_bus("vlt3500", model="vlt3500")
    with bus:
        drive = bus.drive("vlt3500", 1, model=str(own))
        for _ in range(10):
            drive.write("215", 5)
            drive.write("216", 5)
        drive.write("216", 5)
        with pytest.raises(UsageError, match="215 of vlt3500:1 was stored"):
            drive.write("215", 5)
        assert is_stored(drive.capabilities, drive.model, "215[2]", store=False), "an element of it is, too"
        assert not is_stored(drive.capabilities, drive.model, "216[2]", store=False)


def test_reference_in_rpm_is_converted_by_the_name_plate(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(
        'format = 1\nprotocol = "vabus"\nname = "own"\nextends = "agile"\n[quantities]\n'
        'motor_rated_frequency = "375"\nmotor_rated_speed = "372"\n',
        encoding="utf-8",
    )
    virtual, bus = drive_and_bus("vabus", model="agile")
    with bus:
        drive = bus.drive("vabus", 1, model=str(own))
        drive.write("375", 50)
        drive.write("372", 1460)
        drive.set_reference(rpm=1200)
        assert virtual.peek("480", 0) == f"{4000:08X}"
        with pytest.raises(
            NotSupported, match="no motor_rated_frequency in its model, so rpm cannot be converted; use hz"
        ):
            bus.drive("vabus", 1).set_reference(rpm=1200)
        with pytest.raises(UsageError, match="give the reference as one of percent, hz, rpm and machine"):
            drive.set_reference(rpm=1200, hz=40)
        drive.write("372", 0)
        with pytest.raises(UsageError, match="no name plate"):
            drive.set_reference(rpm=1200)
        drive.write("372", 3600)
        with pytest.raises(UsageError, match="has no pole pairs; correct its name plate"):
            drive.set_reference(rpm=1200)
