"""References in hertz to USS drives, which accept per cent: scaled by the frequency that the drive holds as 100 %."""

import struct

import pytest

import drivecomm
from drivecomm.errors import NotSupported, StateError, ValueRefusedError
from drivecomm.virtual import VirtualLine, virtual_drive

FULL_SCALE = {"micromaster4": "2000", "v20": "2000", "g110": "310"}


@pytest.fixture
def drive_of():
    """Yield a function that returns a virtual drive holding a frequency as 100 %, its line and the drive object."""
    buses = []

    def make(model, held=50.0, **options):
        virtual = virtual_drive("uss", 1, model=model)
        if model in FULL_SCALE:
            virtual.poke(FULL_SCALE[model], struct.unpack(">I", struct.pack(">f", held))[0])
        line = VirtualLine([virtual])
        buses.append(drivecomm.open_bus(line.port))
        return virtual, line, buses[-1].drive("uss", 1, model=model, confirmed=model, **options)

    yield make
    for bus in buses:
        bus.close()


@pytest.mark.parametrize("model", FULL_SCALE)
@pytest.mark.parametrize(("held", "hz"), [(50.0, 20), (40.0, 30), (50.0, -20)])
def test_hertz_are_scaled_by_the_full_scale_of_the_drive(drive_of, model, held, hz):
    virtual, line, drive = drive_of(model, held)
    assert drive.capabilities.reference_hz
    drive.set_reference(hz=hz)
    drive.start()
    line.advance(60)
    drive.status()
    assert virtual.motor.output_hz == pytest.approx(hz, abs=0.01)


def test_hertz_above_the_full_scale_are_refused_and_the_speed_is_kept(drive_of):
    virtual, line, drive = drive_of("micromaster4", 40.0)
    drive.set_reference(hz=20)
    drive.start()
    line.advance(60)
    with pytest.raises(ValueRefusedError, match=r"41 Hz is above 100 % of 40.* \(parameter 2000"):
        drive.set_reference(hz=41)
    line.advance(60)
    drive.status()
    assert virtual.motor.output_hz == pytest.approx(20, abs=0.01)


def test_reference_limit_of_the_options_applies_to_hertz(drive_of):
    _, _, drive = drive_of("micromaster4", 40.0, reference_limit=120)
    drive.set_reference(hz=48)
    with pytest.raises(ValueRefusedError, match="above 120 %"):
        drive.set_reference(hz=49)


def test_hertz_are_refused_if_the_full_scale_is_zero(drive_of):
    _, _, drive = drive_of("micromaster4", 0.0)
    with pytest.raises(StateError, match="parameter 2000"):
        drive.set_reference(hz=20)


def test_option_overrides_the_full_scale_of_the_drive(drive_of):
    virtual, line, drive = drive_of("micromaster4", 50.0, reference_frequency_hz=100)
    drive.set_reference(hz=50)
    drive.start()
    line.advance(60)
    drive.status()
    assert virtual.motor.output_hz == pytest.approx(25, abs=0.01)


@pytest.mark.parametrize("model", ["g120", "s110", "masterdrives", "nord"])
def test_hertz_without_a_full_scale_parameter_are_refused_with_the_option(drive_of, model):
    _, _, drive = drive_of(model)
    assert not drive.capabilities.reference_hz
    with pytest.raises(NotSupported, match="reference_frequency_hz=50"):
        drive.set_reference(hz=20)


def test_hertz_without_a_parameter_area_are_refused_with_the_option(drive_of):
    _, _, drive = drive_of("micromaster4", pkw_words=0)
    with pytest.raises(NotSupported, match="reference_frequency_hz=50"):
        drive.set_reference(hz=20)
