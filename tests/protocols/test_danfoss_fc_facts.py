"""Facts of Danfoss FC drives that were once wrong or missing, over both of their protocols."""

import pytest

import drivecomm
from drivecomm.models import load_model
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

BOTH = [("danfoss-fc", "fc302"), ("modbus", "danfoss-fc")]


def model_of(protocol, name):
    return load_model(installed[protocol].package, protocol, name)


def address_of(protocol, parameter):
    group, number = parameter.split("-")
    return parameter if protocol == "danfoss-fc" else f"{int(group) * 1000 + int(number) * 10}"


@pytest.mark.parametrize(("protocol", "name"), BOTH)
@pytest.mark.parametrize(
    ("parameter", "raw", "value"),
    [
        # FC 301/302 Programming Guide M0013101, parameter list: 16-12 Uint16 with index -1, 16-16 Int16 with -1, 16-17
        # Int32 with 67, 16-10 Int32 with 1 (10 W); a program that runs FC 302 drives has the same factors
        # (STM32_Main, vsd_danfoss_init_parameters.cpp), and the map of a pump maker has 0.1 V for register 16119.
        ("16-12", 4000, "400.0"),
        ("16-16", 263, "26.3"),
        ("16-17", 1450, "1450"),
        ("16-10", 550, "5.50"),
        # from the program named above
        ("1-20", 400, "4.00"),
        ("1-24", 820, "8.20"),
        ("3-11", 50, "5.0"),
        ("3-42", 300, "3.00"),
        ("4-18", 1600, "160.0"),
    ],
)
def test_value_has_the_scale_of_the_parameter_list(protocol, name, parameter, raw, value):
    info = model_of(protocol, name).parameters[address_of(protocol, parameter)]
    assert str(raw * info.factor) == value


@pytest.mark.parametrize(("protocol", "name"), BOTH)
def test_output_voltage_stays_below_the_supply(protocol, name):
    line = VirtualLine([virtual_drive(protocol, 1, model=name)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, 1, model=name)
        drive.set_reference(percent=100)
        drive.start()
        line.advance(60)
        assert 100 < drive.read("output_voltage").value < 500


def test_present_alarm_is_in_the_high_byte_of_16_87():
    # A program that runs FC 302 drives reads 4E00H as alarm 78 (vsd_danfoss.cpp).
    virtual = virtual_drive("danfoss-fc", 1, model="fc302")
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("danfoss-fc", 1, model="fc302")
        virtual.trip(78, 0.0)
        assert drive.read("16-87").value == 0x4E00
        status = drive.status()
        assert (status.fault_code, status.fault_text) == (78, "tracking error")
        drive.reset()
        # 15-30 is the alarm log (MG.33.B4.02 p. 240): its entry remains, and the status no longer reports it.
        assert (drive.read("16-87").value, drive.read("fault_code").value) == (0, 78)
        assert drive.status().fault_code is None


@pytest.mark.parametrize(("protocol", "name"), BOTH)
def test_every_alarm_of_the_operating_guide_has_a_text(protocol, name):
    # FC 301/302 Operating Guide, section 7.4.2 to 7.4.91
    printed = [
        2,
        3,
        4,
        *range(7, 18),
        20,
        21,
        22,
        *range(26, 40),
        43,
        45,
        46,
        *range(50, 59),
        61,
        63,
        65,
        *range(67, 73),
    ]
    printed += [74, 75, *range(78, 85), 88, 90, 91, 99, 104, 122, 164, 166]
    assert not set(printed) - set(model_of(protocol, name).faults)
    # 7.4.1, 7.4.5, 7.4.6: the drive continues to run
    assert {1, 5, 6} <= set(model_of(protocol, name).warnings)
    assert not {1, 5, 6} & set(model_of(protocol, name).faults)


def test_energy_is_unmapped_because_its_length_differs_between_drives():
    # A program for the FC 101 reads 15-02 as one register; the FC 302 has two.
    model = model_of("modbus", "danfoss-fc")
    assert "energy" not in model.quantities
    assert model.parameters["15020"].type == "u32"
