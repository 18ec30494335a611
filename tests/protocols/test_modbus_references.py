"""References in per cent to drives that take hertz only: a share of the maximum frequency that they hold."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import NotSupported, StateError
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def drive_of():
    """Return a function that gives a virtual drive of a model, and its master."""
    buses = []

    def make(model):
        virtual = virtual_drive("modbus", 1, model=model)
        buses.append(drivecomm.open_bus(VirtualLine([virtual]).port))
        return virtual, buses[-1].drive("modbus", 1, model=model)

    yield make
    for bus in buses:
        bus.close()


@pytest.mark.parametrize(
    ("model", "maximum", "raw", "reference"),
    [
        ("delta", "0x0100", 5000, "0x2001"),
        ("schneider-atv", "3104", 500, "8502"),
        ("toshiba-vfs11", "0x0012", 5000, "0xFA01"),
    ],
)
def test_percent_is_a_share_of_the_maximum_frequency(drive_of, model, maximum, raw, reference):
    virtual, drive = drive_of(model)
    virtual.poke(maximum, raw)
    assert drive.capabilities.reference_percent
    drive.set_reference(percent=Decimal("50.005"))
    # 25.0025 Hz, to the nearest step
    assert drive.read(reference).value == Decimal(25)


def test_percent_is_refused_where_the_maximum_frequency_is_zero(drive_of):
    virtual, drive = drive_of("delta")
    virtual.poke("0x0100", 0)
    with pytest.raises(StateError, match="maximum frequency is 0"):
        drive.set_reference(percent=50)
    assert drive.read("0x2001").raw == 0


def test_percent_is_refused_where_no_maximum_frequency_is_known(drive_of):
    _, drive = drive_of("yaskawa")
    assert not drive.capabilities.reference_percent
    with pytest.raises(NotSupported):
        drive.set_reference(percent=50)
