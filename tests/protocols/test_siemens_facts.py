"""Facts of Siemens drives over USS and Modbus, with the page of each."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import RefusedError
from drivecomm.models import load_model
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive


def model_of(protocol, name):
    return load_model(installed[protocol].package, protocol, name)


def line_of(protocol, model):
    virtual = virtual_drive(protocol, 1, model=model)
    return virtual, VirtualLine([virtual])


def test_micromaster_refuses_a_new_maximum_frequency_while_running():
    # MICROMASTER 420 Reference Manual p. 50: reply 743A 0000 0011, error 17
    _, line = line_of("uss", "micromaster4")
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("uss", 1, model="micromaster4")
        drive.write("1082", 60)
        drive.set_reference(percent=50)
        drive.start()
        line.advance(20)
        with pytest.raises(RefusedError) as caught:
            drive.write("1082", 50)
        assert caught.value.code == 17


@pytest.mark.parametrize(
    ("address", "raw", "value", "unit"),
    [
        # G120 Function Manual 04/2018 p. 134
        ("40345", 1234, "12.34", "A"),
        ("40346", -500, "-5.00", "Nm"),
        ("40347", 150, "1.50", "kW"),
        ("40348", 42, "42", "kWh"),
        # G120X operating instructions 06/2019 p. 250
        ("40320", 150, "1.50", "kW"),
        ("40321", 100, "10.0", "A"),
        ("40342", 5000, "50.00", "Hz"),
    ],
)
def test_g120_register_has_its_printed_scale(address, raw, value, unit):
    info = model_of("modbus", "siemens-g120").parameters[address]
    assert (raw * info.factor, info.unit) == (Decimal(value), unit)


def test_g120_fault_has_its_text():
    # 40400 is r0947[0] (G120 Function Manual 04/2018 p. 134); F01910: G120XA operating instructions p. 174
    virtual, line = line_of("modbus", "siemens-g120")
    virtual.trip(1910, 0.0)
    with drivecomm.open_bus(line.port) as bus:
        status = bus.drive("modbus", 1, model="siemens-g120").status()
    assert (status.fault_code, status.fault_text) == (1910, "F01910 fieldbus interface: setpoint timeout")


def test_g120_power_unit_rating_is_not_mapped_as_the_motor_rating():
    # 40320 is r0206, of the power unit (G150 operating instructions 07/2016 p. 401); the motor's is p0307.
    assert "motor_rated_power" not in model_of("modbus", "siemens-g120").quantities


@pytest.mark.parametrize("protocol", ["modbus", "uss"])
def test_v20_link_loss_is_that_of_its_own_manual(protocol):
    # V20 operating instructions 07/2012 p. 111, 115: P2014, and fault F72
    model = model_of(protocol, {"modbus": "siemens-v20", "uss": "v20"}[protocol])
    assert "F72" in model.faults[72]
    said = model.link_loss or f"{model.watchdog.source} {model.watchdog.note}"
    assert "F72" in said
    assert "1910" not in said


# G110.h of RPI_SINAMICS_G110; RootCNC wiki, Inverters (V20); G120C List Manual 04/2014 p. 53 to 55; SINAMICS S200 Basic
# parameter list (p0305, p0311: FloatingPoint32). Raw values: a double word holds an IEEE 754 float.
PLATE = {
    "motor_rated_voltage": ("304", "V", 230, 0x43660000),
    "motor_rated_current": ("305", "A", Decimal("7.5"), 0x40F00000),
    "motor_rated_frequency": ("310", "Hz", 400, 0x43C80000),
    "motor_rated_speed": ("311", "rpm", 24000, 0x46BB8000),
}
WORDS = {"motor_rated_voltage": 230, "motor_rated_speed": 24000}


@pytest.mark.parametrize("name", PLATE)
@pytest.mark.parametrize("series", ["g110", "v20", "micromaster4", "g120", "s110"])
def test_siemens_motor_rating_is_read_from_its_parameter(series, name):
    address, unit, value, as_float = PLATE[name]
    model = model_of("uss", series)
    assert model.quantities[name] == address
    virtual = virtual_drive("uss", 0, model=series)
    virtual.poke(address, as_float if series in ("g120", "s110") else WORDS.get(name, as_float))
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        reading = bus.drive("uss", 0, model=series).read(name)
    assert (reading.value, reading.unit) == (value, unit)
