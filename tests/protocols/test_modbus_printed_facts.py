"""Printed facts of single Modbus series: raw register values and their meaning, with the page of each."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import RefusedError, StateError
from drivecomm.models import load_model
from drivecomm.protocol import DriveState
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def showing():
    """Yield a function that makes a drive of a model show fixed registers.

    The function returns the drive object, the virtual drive and a list of the telegrams sent.
    """
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


def writes(sent):
    """Return register and value of each single-register write."""
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


def test_optidrive_e3_reset_pulses_bit_2_and_checks_the_trip(showing):
    drive, virtual, sent = showing("optidrive-e3", {"6.low": 0x02, "6.high": 3})
    with pytest.raises(StateError, match="still tripped"):
        drive.reset()
    assert writes(sent) == [(0, 0), (0, 4), (0, 0)]
    virtual.poke("6.low", 0x40)
    drive.reset()
    assert writes(sent) == [(0, 0), (0, 4), (0, 0)]


def test_optidrive_e3_start_is_obeyed_and_its_trip_can_be_reset():
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


# ACS550 manual p. 209, ACH550-UH p. 165: bit 10 matters if 5305 = FULL, and does no harm if it is LIM.
@pytest.mark.parametrize("model", ["abb-acs355", "abb-acs580"])
def test_every_abb_control_word_has_bit_10(model):
    control = load_model("drivecomm_modbus", "modbus", model).control
    words = [step[1] for name in ("start", "stop", "coast", "quick", "reset") for step in control[name]]
    assert words
    assert all(word & 0x0400 for word in words)


# ACS355 register map: 0103 is signed; a program that drives an ACS550 found steps of 0.1 Hz.
def test_abb_output_frequency_is_signed():
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
def test_abb_fault_code_has_its_text(showing, code, text):
    drive, _, _ = showing("abb-acs355", {"40004": 0x08, "40401": code})
    assert text in drive.status().fault_text


# Both editions of the Plus guide print it so, and related documents do not; unmapped until a source decides.
def test_optidrive_plus_status_bytes_are_unconfirmed():
    model = load_model("drivecomm_modbus", "modbus", "optidrive-plus")
    assert {model.parameters[each].sure for each in ("6.low", "6.high")} == {"unconfirmed"}
    assert "fault_code" not in model.quantities


# MS300 manual p. 790, GS4 manual p. D-14: bits 4-3 are 0 forwards, 1 backwards to forwards, 2 forwards to backwards,
# 3 backwards.
@pytest.mark.parametrize(("bits", "reverse"), [(0b00, False), (0b01, True), (0b10, False), (0b11, True)])
@pytest.mark.parametrize("model", ["delta", "delta-vfd-b", "delta-vfd-e", "gs2"])
def test_delta_direction_is_that_of_the_turning_motor(showing, model, bits, reverse):
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


# VP3000 manual p. 249 prints other numbers than older series: none is offered without a page of the MS300.
def test_delta_link_loss_action_has_no_option_numbers():
    model = load_model("drivecomm_modbus", "modbus", "delta")
    assert model.watchdog is None
    assert not model.parameters["0x0902"].values
    assert "3 a fault and coasting" in model.link_loss


# VFD-E manual 04EE p. 4-113: 0.0 to 120.0 s; VFD-B manual BE16 p. 5-83: 0.0 to 60.0 s
@pytest.mark.parametrize(("model", "most"), [("delta-vfd-e", 120), ("delta-vfd-b", 60)])
def test_delta_silence_time_has_the_limit_of_its_series(model, most):
    assert load_model("drivecomm_modbus", "modbus", model).parameters["0x0903"].maximum == most


# MS300 manual p. 791: 211BH is not the maximum frequency if 00-26 is set.
def test_delta_maximum_frequency_is_parameter_01_00():
    assert load_model("drivecomm_modbus", "modbus", "delta").quantities["maximum_frequency"] == "0x0100"


# Ms300FaultReader of TaidaFlow, which reads an MS300: low byte 58 is CE10, high byte 5 its warning.
def test_delta_fault_and_warning_have_their_texts(showing):
    drive, virtual, _ = showing("delta", {"0x2100.low": 58})
    virtual.poke("0x2100.high", 5)
    status = drive.status()
    assert (status.fault_code, status.fault_text) == (58, "Modbus silent")
    assert load_model("drivecomm_modbus", "modbus", "delta").warnings[5] == "Modbus silent"


# J1000 manual p. 231, GA800 p. 282: with H5-11 = 0 a parameter takes effect after 0910H (RAM) or 0900H (stored).
@pytest.mark.parametrize(("store", "enter"), [(False, 0x0910), (True, 0x0900)])
def test_yaskawa_write_is_followed_by_enter(store, enter):
    sent = []
    with drivecomm.open_bus(VirtualLine([virtual_drive("modbus", 1, model="yaskawa")]).port, trace=sent.append) as bus:
        drive = bus.drive("modbus", 1, model="yaskawa")
        drive.write("0x0180", 2, store=store)
        drive.set_reference(hz=20)
    told = [event.data for event in sent if event.what == "sent" and event.data[1] == 16]
    places = [int.from_bytes(data[2:4]) for data in told]
    assert [each for number, each in enumerate(places) if number == 0 or each != places[number - 1]] == [
        0x0180,
        enter,
        0x0002,
    ]


# A1000 27C p. 494 and V1000 register map: 0098H in 10 h, 0099H in 1 h; the unit of 0026H depends on the drive.
def test_yaskawa_hours_use_two_registers_and_the_current_has_no_unit(showing):
    drive, _, _ = showing("yaskawa", {"0x0098": 1234, "0x0099": 5, "0x0026": 1000})
    hours = [drive.read(each) for each in ("0x0098", "0x0099")]
    assert [(each.value, each.unit) for each in hours] == [(Decimal(12340), "h"), (Decimal(5), "h")]
    assert drive.read("motor_current").unit == ""
    assert "output_current" not in load_model("drivecomm_modbus", "modbus", "yaskawa").quantities


# A1000 27G p. 561 prints bit 6 of 002AH as overheat, but with the symbol of overvoltage.
def test_yaskawa_alarm_bit_6_has_no_text():
    warnings = load_model("drivecomm_modbus", "modbus", "yaskawa").warnings
    assert 6 not in warnings
    assert warnings[9] == "Modbus silent"


# SYSDRIVE MX2 manual p. 6-18: 23H read-only, 22H not while the motor runs
def test_hitachi_read_only_register_is_refused_with_35():
    with drivecomm.open_bus(VirtualLine([virtual_drive("modbus", 1, model="hitachi-wj200")]).port) as bus:
        with pytest.raises(RefusedError, match="read-only") as refused:
            bus.drive("modbus", 1, model="hitachi-wj200").write("0x0012", 1)
        assert refused.value.code == 35


# Published map of E6581913: a VF-S15 stores what function 06 writes; no source says so for an ATV212.
def test_altivar_212_does_not_inherit_volatile_writes_from_toshiba():
    assert load_model("drivecomm_modbus", "modbus", "toshiba-vfs11").control["plain_write"] == "volatile"
    assert not load_model("drivecomm_modbus", "modbus", "schneider-atv212").control["plain_write"]


# BBV51917 rows 37, 39, 139, 211, 221, 224
def test_altivar_faults_and_watchdog_follow_its_parameter_list():
    model = load_model("drivecomm_modbus", "modbus", "schneider-atv")
    assert model.quantities["fault_code"] == "7121"
    assert (model.parameters["7121"].name, model.fault_log[0]) == ("present_fault", "7200")
    assert {model.parameters[each].access for each in ("6005", "7010", "8413")} == {"rw*"}
    assert (model.watchdog.time, model.watchdog.action, dict(model.watchdog.actions)) == (
        "6005",
        "7010",
        {"trip": 1, "hold": 0},
    )
    assert "highest_address" not in model.options
    assert model.faults[5] == "SLF1 Modbus silent"


# Goodrive10 manual p. 87
@pytest.mark.parametrize(
    ("word", "state"), [(1, DriveState.RUNNING), (2, DriveState.RUNNING), (3, DriveState.READY), (4, DriveState.FAULT)]
)
def test_invt_status_is_the_number_in_register_2100h(showing, word, state):
    drive, _, _ = showing("invt", {"0x2100": word, "0x5000": 18 if word == 4 else 0})
    status = drive.status()
    assert (status.state, status.fault_text) == (state, "CE" if word == 4 else "")
