"""The memory of a virtual drive of each protocol without power."""

import pytest

import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

# A parameter that is written with store=True if the protocol has that, and one that is not.
STORED = {
    "vabus": ("481", 12, {"store": True}),
    "danfoss-fc": ("3-41", 7, {"store": True}),
    "fuji": ("F07", 9, {"store": True}),
}
VOLATILE = {"vabus": ("481", 12), "danfoss-fc": ("3-41", 7), "fuji": ("S08", 9)}
MODELS = {"vabus": "agile", "danfoss-fc": "fc300", "fuji": None, "vlt3500": None}
EACH = pytest.mark.parametrize("protocol", list(MODELS))


def at_work(protocol):
    virtual = virtual_drive(protocol, 3, model=MODELS[protocol])
    line = VirtualLine([virtual])
    bus = drivecomm.open_bus(line.port)
    return virtual, line, bus, bus.drive(protocol, 3, model=MODELS[protocol])


def switched_off_and_on(line, virtual):
    line.power_off(virtual)
    line.advance(5.0)
    line.power_on(virtual)
    line.advance(1.0)


@EACH
def test_motor_stays_stopped_after_a_power_cycle(protocol):
    virtual, line, bus, drive = at_work(protocol)
    with bus:
        drive.set_reference(percent=50)
        drive.start()
        line.advance(10.0)
        assert drive.status().running
        switched_off_and_on(line, virtual)
        assert not bus.drive(protocol, 3, model=MODELS[protocol]).status().running
        line.advance(10.0)
        assert virtual.motor.output_hz == 0
        assert not virtual.motor.running


@EACH
def test_trip_is_cleared_by_a_power_cycle(protocol):
    virtual, line, bus, drive = at_work(protocol)
    with bus:
        virtual.trip(4, line.time)
        assert drive.status().fault
        switched_off_and_on(line, virtual)
        assert not drive.status().fault


@pytest.mark.parametrize("protocol", list(STORED))
def test_stored_value_survives_a_power_cycle(protocol):
    virtual, line, bus, drive = at_work(protocol)
    parameter, value, how = STORED[protocol]
    with bus:
        drive.write(parameter, value, **how)
        switched_off_and_on(line, virtual)
        assert drive.read(parameter).value == value


@pytest.mark.parametrize("protocol", list(VOLATILE))
def test_volatile_value_is_lost_by_a_power_cycle(protocol):
    virtual, line, bus, drive = at_work(protocol)
    parameter, value = VOLATILE[protocol]
    with bus:
        before = drive.read(parameter).value
        drive.write(parameter, value)
        assert drive.read(parameter).value == value != before
        switched_off_and_on(line, virtual)
        assert drive.read(parameter).value == before


@EACH
def test_address_and_keypad_settings_survive_a_power_cycle(protocol):
    virtual, line, bus, drive = at_work(protocol)
    parameter = {"vabus": "480", "danfoss-fc": "3-41", "fuji": "F07", "vlt3500": "215"}[protocol]
    with bus:
        before = virtual.peek(parameter, line.time)
        virtual.poke(parameter, 6)
        set_to = virtual.peek(parameter, line.time)
        assert set_to != before
        switched_off_and_on(line, virtual)
        assert drive.read(parameter).raw == set_to
