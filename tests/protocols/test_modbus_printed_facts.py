"""What makers print of single Modbus series: raw register values and what they mean, with the page of each."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import StateError
from drivecomm.models import load_model
from drivecomm.protocol import DriveState
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def showing():
    """Return a function that makes a drive of a model show fixed registers, with its bus and what was sent."""
    buses = []

    def make(model, registers):
        virtual = virtual_drive("modbus", 1, model=model)
        virtual._machine.live = lambda _: None
        for address, raw in registers.items():
            virtual.poke(address, raw)
        sent = []
        bus = drivecomm.open_bus(VirtualLine([virtual]).port, trace=sent.append)
        buses.append(bus)
        return bus.drive("modbus", 1, model=model), virtual, sent

    yield make
    for bus in buses:
        bus.close()


def address_of(name, called):
    """Return the address of a common name or of a parameter's name."""
    model = load_model("drivecomm_modbus", "modbus", name)
    return model.quantities.get(called) or model.find(called).address


def writes(sent):
    """Return function, register and value of each single-register write."""
    told = [event.data for event in sent if event.what == "sent" and event.data[1] == 6]
    return [(int.from_bytes(data[2:4]), int.from_bytes(data[4:6])) for data in told]


# E3 Advanced Technical Manual iss. 05 p. 35: low byte bits 0 running, 1 tripped, 6 ready; high byte the fault code.
@pytest.mark.parametrize(
    ("low", "high", "state", "code"),
    [
        (0x41, 0, DriveState.RUNNING, None),
        (0x40, 0, DriveState.READY, None),
        (0x00, 0, DriveState.NOT_READY, None),
        (0x02, 1, DriveState.FAULT, 1),
        (0x02, 3, DriveState.FAULT, 3),
    ],
)
def test_optidrive_e3_status_comes_from_the_low_byte(showing, low, high, state, code):
    drive, _, _ = showing("optidrive-e3", {"6.low": low, "6.high": high})
    status = drive.status()
    assert (status.state, status.fault_code) == (state, code)
    assert drive.read("fault_code").value == high


def test_optidrive_e3_reset_sets_bit_2_and_looks_whether_the_trip_went(showing):
    drive, virtual, sent = showing("optidrive-e3", {"6.low": 0x02, "6.high": 3})
    with pytest.raises(StateError, match="still tripped"):
        drive.reset()
    assert writes(sent) == [(0, 0), (0, 4), (0, 0)]
    virtual.poke("6.low", 0x40)
    drive.reset()
    assert writes(sent) == [(0, 0), (0, 4), (0, 0)]


def test_optidrive_e3_start_is_kept_while_the_drive_shows_running():
    virtual = virtual_drive("modbus", 1, model="optidrive-e3")
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        drive = bus.drive("modbus", 1, model="optidrive-e3")
        drive.set_reference(hz=20)
        drive.start()
        assert virtual.peek("6.low", 0.0) == 0x41
        virtual.trip(3, 0.0)
        assert drive.status().fault_text == "overcurrent"
        drive.reset()
        assert drive.status().state is DriveState.READY


# ACS550 manual p. 209, ACH550-UH p. 165: bit 10 counts where 5305 = FULL, and costs nothing where it is LIM.
@pytest.mark.parametrize("model", ["abb-acs355", "abb-acs580"])
def test_abb_control_words_all_have_bit_10(model):
    control = load_model("drivecomm_modbus", "modbus", model).control
    words = [step[1] for name in ("start", "stop", "coast", "quick", "reset") for step in control[name]]
    assert words
    assert all(word & 0x0400 for word in words)


# ACS355 register map: 0103 is signed; a program that drives an ACS550 found steps of 0.1 Hz.
def test_abb_output_frequency_has_its_sign():
    virtual = virtual_drive("modbus", 1, model="abb-acs355")
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model="abb-acs355")
        drive.set_reference(percent=-40)
        drive.start()
        line.advance(30)
        assert drive.read("output_frequency").value == Decimal("-20.0")


# ACS550-02 manual p. 259; Carrier 48HC service manual p. 127
@pytest.mark.parametrize(
    ("code", "text"), [(19, "internal link"), (26, "identity"), (31, "fieldbus"), (105, "internal")]
)
def test_abb_fault_is_named(showing, code, text):
    drive, _, _ = showing("abb-acs355", {"40004": 0x08, "40401": code})
    assert text in drive.status().fault_text


# Both editions of the Plus guide print it so, and related documents do not: no common name until one decides.
def test_optidrive_plus_status_bytes_are_not_sure():
    model = load_model("drivecomm_modbus", "modbus", "optidrive-plus")
    assert {model.parameters[each].sure for each in ("6.low", "6.high")} == {"unconfirmed"}
    assert "fault_code" not in model.quantities


# MS300 manual p. 790, GS4 manual p. D-14: bits 4-3 are 0 forward, 1 backwards and to go forward, 2 forward and to go
# backwards, 3 backwards.
@pytest.mark.parametrize(("bits", "reverse"), [(0b00, False), (0b01, True), (0b10, False), (0b11, True)])
@pytest.mark.parametrize("model", ["delta", "delta-vfd-b", "delta-vfd-e", "gs2"])
def test_delta_direction_is_the_way_in_which_the_motor_turns(showing, model, bits, reverse):
    status = "0x2119" if model == "delta" else "0x2101"
    drive, _, _ = showing(model, {status: bits << 3 | 3})
    assert drive.status().reverse is reverse


@pytest.mark.parametrize("model", ["delta", "delta-vfd-b", "delta-vfd-e", "gs2"])
def test_delta_drive_that_turns_backwards_shows_both_direction_bits(model):
    virtual = virtual_drive("modbus", 1, model=model)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model=model)
        drive.set_reference(hz=20)
        drive.start(reverse=True)
        line.advance(30)
        assert drive.read("0x2119" if model == "delta" else "0x2101").raw & 0x1B == 0x1B


# VP3000 manual p. 249 prints other numbers than older series: none is offered before a page of the MS300 is seen.
def test_delta_link_loss_action_has_no_numbers_of_another_series():
    model = load_model("drivecomm_modbus", "modbus", "delta")
    assert model.watchdog is None
    assert not model.parameters["0x0902"].values
    assert "3 a fault and coasting" in model.link_loss


# VFD-E manual 04EE p. 4-113: 0.0 to 120.0 s; VFD-B manual BE16 p. 5-83: 0.0 to 60.0 s
@pytest.mark.parametrize(("model", "most"), [("delta-vfd-e", 120), ("delta-vfd-b", 60)])
def test_delta_silence_time_has_the_limit_of_its_own_series(model, most):
    assert load_model("drivecomm_modbus", "modbus", model).parameters["0x0903"].maximum == most


# MS300 manual p. 791: 211BH is not the maximum frequency where 00-26 is set.
def test_delta_maximum_frequency_is_parameter_01_00():
    assert load_model("drivecomm_modbus", "modbus", "delta").quantities["maximum_frequency"] == "0x0100"


# Ms300FaultReader of TaidaFlow, which reads an MS300: low byte 58 is CE10, high byte 5 the warning of it.
def test_delta_fault_and_warning_are_named(showing):
    drive, virtual, _ = showing("delta", {"0x2100.low": 58})
    virtual.poke("0x2100.high", 5)
    status = drive.status()
    assert (status.fault_code, status.fault_text) == (58, "Modbus silent")
    assert load_model("drivecomm_modbus", "modbus", "delta").warnings[5] == "Modbus silent"


READINGS = {
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
}


@pytest.mark.parametrize(("model", "name"), READINGS, ids=["-".join(each) for each in READINGS])
def test_printed_example_of_a_register_is_read_in_its_unit(showing, model, name):
    raw, value = READINGS[model, name]
    drive, virtual, _ = showing(model, {})
    virtual.poke(address_of(model, name), raw)
    assert drive.read(name).value == Decimal(value)
