"""Fuji and VLT 3500 models: the parameters printed in the tables of their specifications, and their common names.

The addresses of the tables are listed here by hand: section 5.1, 6.1, 10 and 11 of the one specification, section 14 of
the other, without those that have no page and that nothing relies on.
"""

from __future__ import annotations

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.models import load_model, parameter_at, quantities
from drivecomm.virtual import VirtualLine, virtual_drive

FUJI = {
    "e11s": "S01 S05 S06 S08-S11 M01 M05-M21 M23-M27 M31-M37"
    " F03 F07 F08 F11 F15 F17 F18 E01-E05 C05 C31 P01 P04 A13 H03 H28 H30 H34",
    "g11s": "S01 S05-S11 M01 M05-M21 M23-M27 M31-M37"
    " F03 F07 F08 F11 F15 F17 F18 E01-E05 C05 C31 P01 P02 P04 A13 H03 H28 H30 H31 H34-H37 o05",
    "vg": "S01-S11 M01 M05-M21 M23-M27 M31-M37"
    " F03 F07 F08 F11 F15 F17 F18 E01-E05 C05 C31 P01 P02 P04 A13 H03 H28 H30-H40 o05",
    "frenic": "S01 S05-S11 M01-M21 M23-M27 M31-M37"
    " F03 F05 F07 F08 F11 F15 F17 F18 E01-E05 C05 C31 P01 P02 P04 A13 H03 H28 H30 o05"
    " y01-y04 y06-y09 y12 y13 y16-y19 y98 y99",
}

# From the list of a public program for VLT 2000.
VLT_2000_PARAMETERS = (
    "000-010 013 101-105 107-112 114 119-122 125 200-211 213 215 216 218 224 230 300 306-310 315 402-405 408 409"
    " 411-413 500-511 514 516 517 606-610"
)
READ_OUTS = [*range(6), *range(8, 20)]
CONFIRMED = ("215", "216", "218", "309", "500", "501", "503", "516", "601", "602")
# Found on no VLT 3500 or 3000 page: the virtual drive shows and obeys these as VLT 2000 does.
UNCONFIRMED = "001 003 101 104 105 110 112 120 200 205-207 209-211 502 514 606"


def expanded(ranges):
    """Yield the addresses of a list with ranges: `S05-S07 M09` gives S05, S06, S07, M09."""
    for each in ranges.split():
        first, dash, last = each.partition("-")
        if not dash:
            yield first
            continue
        letter = first.rstrip("0123456789")
        digits = len(first) - len(letter)
        for number in range(int(first[len(letter) :]), int(last[len(letter) :]) + 1):
            yield f"{letter}{number:0{digits}d}"


@pytest.mark.parametrize("name", FUJI)
def test_fuji_model_has_exactly_the_functions_of_the_tables(name):
    model = load_model("drivecomm_fuji", "fuji", name)
    assert set(expanded(FUJI[name])) == set(model.parameters)


@pytest.mark.parametrize("name", ["vlt3500", "vlt3000", "vlt2000"])
def test_vlt_model_has_exactly_the_parameters_of_the_tables(name):
    model = load_model("drivecomm_vlt3500", "vlt3500", name)
    read_outs = {f"502[{index}]" for index in READ_OUTS}
    wanted = {
        "vlt3500": {*CONFIRMED, *expanded(UNCONFIRMED), *read_outs},
        "vlt3000": {*CONFIRMED, "502", "502[1]"},
        "vlt2000": {*expanded(VLT_2000_PARAMETERS), *read_outs},
    }
    assert wanted[name] == set(model.parameters)


def test_vlt_2000_facts_come_from_the_program_except_one_from_a_page():
    model = load_model("drivecomm_vlt3500", "vlt3500", "vlt2000")
    assert {address for address, info in model.parameters.items() if info.sure != "field"} == {"500"}


def test_vlt_2000_motor_data_are_option_numbers_without_a_unit():
    """The program shows the meaning of each number of 103, 104 and 105: 104 = 2 is a motor of 220 V, not of 2 V."""
    model = load_model("drivecomm_vlt3500", "vlt3500", "vlt2000")
    volts, hertz = model.parameters["104"], model.parameters["105"]
    assert dict(volts.values) == {0: "200 V", 1: "208 V", 2: "220 V", 3: "230 V", 4: "240 V"}
    assert dict(hertz.values) == {0: "50 Hz", 1: "60 Hz", 2: "87 Hz", 3: "100 Hz"}
    assert (volts.unit, hertz.unit, model.parameters["103"].unit) == ("", "", "")
    assert not {"103", "104", "105"} & set(model.quantities.values())
    assert dict(model.parameters["001"].values) == {1: "set-up 1", 2: "set-up 2", 5: "multi-set-up"}


@pytest.mark.parametrize(("option", "volts"), [(0, 400), (3, 200)])
def test_virtual_vlt_2000_uses_the_rated_frequency_of_its_option(option, volts):
    """At 50 Hz a motor rated for 50 Hz has its rated voltage, and one rated for 100 Hz half of it."""
    drive = virtual_drive("vlt3500", 1, model="vlt2000")
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        master = bus.drive("vlt3500", 1, model="vlt2000")
        master.write("105", option)
        master.set_reference(percent=100)
        master.start()
        line.advance(20)
        assert master.read("output_voltage").value == pytest.approx(volts, rel=0.05)


@pytest.mark.parametrize("name", ["vlt3500", "vlt3000"])
def test_confirmed_vlt_parameters_are_printed_or_derived(name):
    model = load_model("drivecomm_vlt3500", "vlt3500", name)
    sure = {address: model.parameters[address].sure for address in CONFIRMED}
    assert {address for address, mark in sure.items() if mark != "printed"} == {"503"}
    assert sure["503"] == "derived", "the page names it; its options are the public program's"
    others = {info.sure for address, info in model.parameters.items() if address not in CONFIRMED}
    assert others == {"unconfirmed"}


EVERYWHERE = {
    "output_frequency",
    "output_voltage",
    "dc_link_voltage",
    "operating_hours",
    "status_word",
    "control_word",
    "software_version",
    "acceleration_time",
    "deceleration_time",
}
VLT_2000 = EVERYWHERE | {
    "maximum_frequency",
    "output_current",
    "motor_thermal_load",
    "drive_thermal_load",
    "warning_word",
    "alarm_word",
    "reference_percent",
    "running_hours",
    "power_ups",
    "quick_stop_time",
    "minimum_frequency",
    "jog_frequency",
    "motor_rated_current",
    "switching_frequency",
    "bus_address",
}
# Names that its pages give; the rest is known of VLT 2000 only, and has no common name on another series.
VLT_3500 = {"acceleration_time", "deceleration_time", "quick_stop_time", "reference_percent", "bus_address"}
FUJI_NAMES = EVERYWHERE | {"torque_percent", "reference_frequency", "fault_code"}
HAS = {
    "fuji/e11s": FUJI_NAMES,
    "fuji/g11s": FUJI_NAMES | {"bus_address"},
    "fuji/vg": FUJI_NAMES | {"bus_address", "link_timeout"},
    "fuji/frenic": FUJI_NAMES | {"maximum_frequency", "motor_rated_voltage", "link_timeout"},
    "vlt3500/vlt3500": VLT_3500,
    "vlt3500/vlt3000": VLT_3500,
    "vlt3500/vlt2000": VLT_2000,
}
MEASURING = [name for name, has in HAS.items() if "output_frequency" in has]


def loaded(name):
    protocol, _, model = name.partition("/")
    return protocol, load_model(f"drivecomm_{protocol}", protocol, model)


@pytest.mark.parametrize("name", HAS)
def test_model_has_exactly_its_expected_common_names(name):
    _, model = loaded(name)
    assert set(model.quantities) == HAS[name]


@pytest.mark.parametrize("name", HAS)
def test_common_names_are_read_at_rest_with_unit_and_start_value(name):
    """At rest each drive holds the start values of its model, and its motor stands."""
    protocol, model = loaded(name)
    drive = virtual_drive(protocol, 1, model=model)
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        master = bus.drive(protocol, 1, model=model)
        for common, address in model.quantities.items():
            reading = master.read(common)
            assert (reading.name, reading.unit) == (common, quantities()[common].unit)
            assert reading.raw == drive.peek(address, line.time)
            start = parameter_at(address, model).start
            if common not in ("status_word", "dc_link_voltage", "motor_thermal_load", "drive_thermal_load"):
                assert reading.value == start, common
        if "dc_link_voltage" in model.quantities:
            assert 500 < master.read("dc_link_voltage").value < 600


@pytest.mark.parametrize("name", MEASURING)
def test_common_names_show_a_running_and_a_tripped_motor(name):
    protocol, model = loaded(name)
    options = {"maximum_hz": 50} if protocol == "vlt3500" else {}
    line = VirtualLine([virtual_drive(protocol, 1, model=model)])
    with drivecomm.open_bus(line.port) as bus:
        master = bus.drive(protocol, 1, model=model, **options)
        master.set_reference(percent=30)
        master.start()
        line.advance(20)
        assert master.read("output_frequency").value == Decimal(15)
        assert master.read("output_voltage").value > 50
        if "torque_percent" in model.quantities:
            assert master.read("torque_percent").value > 10
            assert master.read("reference_frequency").value == Decimal(15)
        line.drives[0].trip(7, line.time)
        if "fault_code" in model.quantities:
            fault = master.read("fault_code")
            assert (fault.value, fault.text) == (7, model.faults[7])
        if "alarm_word" in model.quantities:
            assert master.read("alarm_word").value == 7


@pytest.mark.parametrize("name", HAS)
def test_ramp_written_by_its_common_name_acts_on_the_motor(name):
    protocol, model = loaded(name)
    line = VirtualLine([virtual_drive(protocol, 1, model=model)])
    stored = protocol == "fuji" and model.quantities["acceleration_time"] == "F07"
    with drivecomm.open_bus(line.port) as bus:
        master = bus.drive(protocol, 1, model=model)
        master.write("acceleration_time", 10, **({"store": True} if stored else {}))
        assert master.read("acceleration_time").value == 10
        master.set_reference(percent=100)
        master.start()
        line.advance(5)
        shown = "output_frequency" if name in MEASURING else "502[1]"
        assert float(master.read(shown).value) == pytest.approx(25, abs=1)


@pytest.mark.parametrize("name", ["fuji/vg", "fuji/frenic"])
def test_watchdog_holds_or_trips(name):
    _, model = loaded(name)
    watchdog = model.watchdog
    assert watchdog.actions == {"trip": 0, "hold": 3}
    assert model.find(watchdog.action).values[3] == "go on"
    assert model.find(watchdog.time).unit == "s"
    assert watchdog.time == model.quantities["link_timeout"]
    assert watchdog.off == 0


@pytest.mark.parametrize("name", ["fuji/e11s", "fuji/g11s", "vlt3500/vlt3500", "vlt3500/vlt3000", "vlt3500/vlt2000"])
def test_series_without_a_documented_watchdog_have_none(name):
    assert loaded(name)[1].watchdog is None


@pytest.mark.parametrize("name", [name for name in HAS if name.startswith("fuji")])
def test_storage_of_fuji_functions_follows_their_type(name):
    _, model = loaded(name)
    by_type = {}
    for info in model.parameters.values():
        by_type.setdefault(info.address[0], set()).add(info.storage)
    assert by_type["S"] == {"volatile"}
    assert "stored" not in by_type["M"]
    unknown = {address for address, info in model.parameters.items() if info.storage == ""}
    memory = set(expanded("M16-M20 M23-M27 M31-M37"))
    commands = {"H03", "P04", "A13"}
    assert unknown == memory | commands
    assert by_type["F"] == by_type["C"] == by_type["E"] == {"stored"}
    assert {letter for letter, storages in by_type.items() if "volatile" in storages} == {"S", "M"}


def test_storage_of_vlt_3500_parameters_is_mostly_unknown():
    _, model = loaded("vlt3500/vlt3500")
    kept = {info.address for info in model.parameters.values() if info.storage}
    assert kept == {"516", *(f"502[{index}]" for index in READ_OUTS if index != 19)}
    assert {model.parameters[address].storage for address in kept} == {"volatile"}
