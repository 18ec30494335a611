"""Printed raw values of single Modbus series, read in their units; and the sources of common names."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.models import load_model
from drivecomm.virtual import VirtualLine, virtual_drive

NO_GUESSES = [
    "abb-acs355", "abb-acs580", "delta", "delta-vfd-b", "delta-vfd-e", "gs2", "hitachi-wj200", "invt", "optidrive-e3",
    "optidrive-plus", "schneider-atv", "schneider-atv212", "toshiba-vfs11", "vacon10", "yaskawa",
]  # fmt: skip


@pytest.mark.parametrize("name", NO_GUESSES)
def test_common_names_and_control_of_a_model_have_sources(name):
    model = load_model("drivecomm_modbus", "modbus", name)
    weak = [common for common, at in model.quantities.items() if model.parameters[at].sure == "unconfirmed"]
    assert weak == []
    assert model.sources["commands"]
    assert model.sources["status"]


READINGS = {
    # ACS580 Modbus Parameter Engine: 32 bits, the low word first, all but the torque in hundredths
    ("abb-acs580", "output_frequency"): (0xFFFFEC78, "-50.00"),
    ("abb-acs580", "output_current"): (1234, "12.34"),
    ("abb-acs580", "torque_percent"): (505, "50.5"),
    # MX2 I570 p. 287: 1010H in 1 %, 1028H in 0.1 %
    ("hitachi-wj200", "torque_percent"): (0xFF9C, "-100"),
    ("hitachi-wj200", "motor_thermal_load"): (875, "87.5"),
    # Goodrive300 fieldbus monitors: torque x 10
    ("invt", "torque_percent"): (1005, "100.5"),
    # BBV51917 rows 105, 107, 145
    ("schneider-atv", "motor_rated_voltage"): (230, "230"),
    ("schneider-atv", "motor_rated_frequency"): (500, "50.0"),
    ("schneider-atv", "acceleration_time"): (30, "3.0"),
    # wb-mqtt-serial, config-vacon10.json
    ("vacon10", "maximum_frequency"): (5000, "50.00"),
    ("vacon10", "motor_rated_current"): (420, "4.20"),
    # vfs11_vfd.c of LinuxCNC, lines 669 to 679
    ("toshiba-vfs11", "drive_current"): (42, "4.2"),
    # gs2_vfd.c of LinuxCNC, line 490: * 0.1
    ("gs2", "load"): (1000, "100.0"),
    # MS300 manual p. 791: X.XXX kW; p. A-12: XXX.X %
    ("delta", "output_power"): (1500, "1.500"),
    ("delta", "output_torque"): (985, "98.5"),
    # ACS550 and ACH550, by programs that read them: 0104 in 0.1 A, 0106 in 0.1 kW
    ("abb-acs355", "output_current"): (75, "7.5"),
    ("abb-acs355", "output_power"): (31, "3.1"),
    ("abb-acs355", "output_frequency"): (0xFF9C, "-10.0"),
    # Optidrive E3 Advanced Technical Manual iss. 05 p. 31; Fieldbus Guide 1.02 p. 56
    ("optidrive-e3", "output_power"): (100, "1.00"),
    ("optidrive-e3", "output_voltage"): (200, "200"),
    ("optidrive-e3", "acceleration_time"): (500, "5.00"),
    # PowerFlex 40 manual 22B-UM001J p. 53, 76; raw values that CIPDeviceBackup reads
    ("powerflex-40", "motor_rated_voltage"): (460, "460"),
    ("powerflex-40", "motor_rated_frequency"): (60, "60"),
    ("powerflex-40", "link_timeout"): (50, "5.0"),
    # PowerFlex 520 manual 520-UM001O p. 65, 102
    ("powerflex-520", "motor_rated_voltage"): (460, "460"),
    ("powerflex-520", "motor_rated_frequency"): (60, "60"),
    ("powerflex-520", "motor_rated_current"): (25, "2.5"),
    ("powerflex-520", "motor_rated_speed"): (1750, "1750"),
    ("powerflex-520", "motor_rated_power"): (37, "0.37"),
    ("powerflex-520", "link_timeout"): (50, "5.0"),
    # INVT e-manual group P14; CFW-08 manual p. 100
    ("invt", "link_timeout"): (50, "5.0"),
    ("weg-cfw08", "link_timeout"): (50, "5.0"),
    # gs2_vfd.c of LinuxCNC
    ("gs2", "motor_rated_voltage"): (230, "230"),
    ("gs2", "motor_rated_speed"): (1730, "1730"),
    # snapshot of 25 August 2026 of windtunnel-control: 3019, 9905 to 9908 of an ACS550-U1-046A-2 with a 60 Hz motor
    ("abb-acs550", "link_timeout"): (30, "3.0"),
    ("abb-acs550", "motor_rated_voltage"): (230, "230"),
    ("abb-acs550", "motor_rated_current"): (250, "25.0"),
    ("abb-acs550", "motor_rated_frequency"): (600, "60.0"),
    ("abb-acs550", "motor_rated_speed"): (1770, "1770"),
    # as on the ACS550
    ("abb-acs355", "motor_rated_voltage"): (230, "230"),
    ("abb-acs355", "motor_rated_current"): (250, "25.0"),
    ("abb-acs355", "motor_rated_frequency"): (600, "60.0"),
    ("abb-acs355", "motor_rated_speed"): (1770, "1770"),
    # MIRA's guide of the GS10, P05.03 as delivered
    ("delta", "motor_rated_speed"): (1710, "1710"),
}


@pytest.mark.parametrize(("model", "name"), READINGS, ids=["-".join(each) for each in READINGS])
def test_printed_example_of_a_register_is_read_in_its_unit(model, name):
    raw, value = READINGS[model, name]
    known = load_model("drivecomm_modbus", "modbus", model)
    virtual = virtual_drive("modbus", 1, model=model)
    virtual._machine.live = lambda _: None
    virtual.poke(known.quantities.get(name) or known.find(name).address, raw)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        assert bus.drive("modbus", 1, model=model).read(name).value == Decimal(value)
