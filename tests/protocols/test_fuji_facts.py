"""Facts of Fuji inverters over both protocols, with the page of each."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.models import load_model
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

BOTH = [("fuji", "frenic", "F03"), ("modbus", "fuji-frenic", "0x0003")]


def model_of(protocol, name):
    return load_model(installed[protocol].package, protocol, name)


@pytest.mark.parametrize(("protocol", "name", "address"), BOTH)
def test_maximum_frequency_of_a_frenic_counts_tenths(protocol, name, address):
    # Omron M1 user manual I669 p. 8-37, with the function codes and formats of FRENIC: 70.0 Hz is 700
    virtual = virtual_drive(protocol, 1, model=name)
    virtual.poke(address, 700)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        assert bus.drive(protocol, 1, model=name).read("maximum_frequency").value == Decimal("70.0")


@pytest.mark.parametrize(("protocol", "name", "address"), [(*BOTH[0][:2], "F05"), (*BOTH[1][:2], "0x0005")])
def test_rated_voltage_of_a_frenic_counts_volts(protocol, name, address):
    # Omron M1 user manual I669 p. 8-36: F05 = 200 V is 00C8 hex, format [1]
    virtual = virtual_drive(protocol, 1, model=name)
    virtual.poke(address, 0x00C8)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        assert bus.drive(protocol, 1, model=name).read("motor_rated_voltage").value == 200


@pytest.mark.parametrize("name", ["family", "g11s", "e11s", "vg"])
def test_maximum_frequency_is_unmapped_if_no_page_gives_its_format(name):
    assert "maximum_frequency" not in model_of("fuji", name).quantities


def test_h32_of_vg_makes_a_forced_stop_with_0():
    # FRENIC-VG option manual p. 5-11
    assert model_of("fuji", "vg").parameters["H32"].values[0] == "forced stop"


@pytest.mark.parametrize(("protocol", "name"), [(protocol, name) for protocol, name, _ in BOTH])
@pytest.mark.parametrize(
    ("code", "sign"), [(42, "Erd"), (47, "ErE"), (53, "ErP"), (57, "ECF"), (59, "dbA"), (17, "OH1")]
)
def test_alarm_code_has_its_text(protocol, name, code, sign):
    # Omron M1 user manual I669 p. 8-37
    assert model_of(protocol, name).faults[code].startswith(sign)


def test_link_loss_of_a_frenic_over_modbus_trips_with_er8():
    line = VirtualLine([virtual_drive("modbus", 1, model="fuji-frenic")])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model="fuji-frenic")
        drive.write("0x0E02", 0, store=True)
        drive.write("link_timeout", 2, store=True)
        drive.set_reference(hz=20)
        drive.start()
        line.advance(10)
        assert drive.status().fault_text.startswith("Er8")
