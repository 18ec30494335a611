"""Descriptions that a drive gives of its own parameters, and a model grown from them."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.commissioning import descriptions, grown_model
from drivecomm.errors import NotSupported, ParameterAddressError, RefusedError, UsageError
from drivecomm.models import factor_between, load_model, model_names, model_text, read_model
from drivecomm.testing import play
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_danfoss_fc.description_elements import unit_and_factor
from drivecomm_danfoss_fc.exchanges import DanfossFcOperations
from drivecomm_danfoss_fc.messages import ParameterReply, ParameterRequest, TextReply
from drivecomm_danfoss_fc.options import DanfossFcOptions

PACKAGED = model_names("drivecomm_danfoss_fc", "danfoss-fc")
AT_3 = {"address_format": "1-126", "address": 3}


def element(pnu, number, pwe):
    """Return a request for a description element, and the reply of the drive."""
    request = ParameterRequest(**AT_3, ak=4, pnu=pnu, ind=number, pwe=0, control_word=0, reference=0)
    ak = 7 if pwe is None else 3
    reply = {"pnu": pnu, "ind": number, "status_word": 0x0607, "main_actual": 0}
    if isinstance(pwe, str):
        return request, TextReply(**AT_3, ak=ak, text=pwe, **reply)
    return request, ParameterReply(**AT_3, ak=ak, pwe=9 if pwe is None else pwe, **reply)


def option_text(pnu, option, text):
    request = ParameterRequest(**AT_3, ak=15, pnu=pnu, ind=option + 1, pwe=0, control_word=0, reference=0)
    reply = {"pnu": pnu, "ind": option + 1, "status_word": 0x0607, "main_actual": 0}
    if text is None:
        return request, ParameterReply(**AT_3, ak=7, pwe=15, **reply)
    return request, TextReply(**AT_3, ak=15, text=text, **reply)


def described(script, parameter, **options):
    return play(DanfossFcOperations(3, DanfossFcOptions(), None).describe(parameter, **options), script)


def test_printed_description_telegrams_give_the_parameter():
    # VLT 5000 Design Guide p. 95-98: 520 is of type 7, read only, with conversion index -2 and unit index 22.
    info = described(
        [
            element(520, 1, 0x0207),
            element(520, 6, "MOTOR CURRENT  "),
            element(520, 4, 0xFE16),
            element(520, 7, 0),
            element(520, 8, 99999),
            element(520, 20, 0),
        ],
        "520",
    )
    assert (info.address, info.name, info.title) == ("520", "motor_current", "MOTOR CURRENT")
    assert (info.type, info.unit, info.factor, info.access) == ("uint32", "A", Decimal("0.01"), "r")
    assert (info.minimum, info.maximum, info.start) == (0, Decimal("999.99"), 0)
    assert (info.sure, info.source) == ("field", "read from the drive, AK 4")
    assert info.extra == {"conversion_index": -2}


def test_negative_limits_of_a_word_are_signed():
    info = described(
        [
            element(215, 1, 0x0003),
            element(215, 6, "PRESET REF. 1"),
            element(215, 4, 0xFE18),
            element(215, 7, 0xD8F0),
            element(215, 8, 10000),
            element(215, 20, 0),
        ],
        "215",
    )
    assert (info.minimum, info.maximum, info.unit) == (Decimal("-100.00"), Decimal("100.00"), "%")


def test_option_parameter_may_have_gaps_between_its_options():
    info = described(
        [
            element(804, 1, 0x0405),
            element(804, 6, "Control Timeout Function"),
            element(804, 4, 0x0000),
            element(804, 7, 0),
            element(804, 8, 2),
            element(804, 20, None),
            option_text(804, 0, "Off"),
            option_text(804, 1, None),
            option_text(804, 2, "Stop"),
        ],
        "8-04",
    )
    assert info.values == {0: "Off", 2: "Stop"}
    assert info.start is None
    assert info.access == "rw"


def test_number_of_option_texts_is_limited_on_request():
    script = [element(801, 1, 0x0505), element(801, 6, "Control Site")]
    assert described([*script, element(801, 4, None)], "8-01", option_texts=0).values == {}
    only = described([*script, element(801, 4, None), option_text(801, 0, "Both")], "8-01", option_texts=1)
    assert only.values == {0: "Both"}
    for bad in (-1, 255, 1.5, True):
        with pytest.raises(UsageError, match="option texts cannot be read"):
            described([], "8-01", option_texts=bad)


def test_data_type_that_the_protocol_cannot_carry_is_left_empty():
    info = described([element(1599, 1, 0x020A), element(1599, 6, None)], "15-99")
    assert (info.type, info.title, info.name) == ("", "parameter 15-99", "parameter_15_99")
    assert info.extra == {"data_type": 10}


def test_description_of_an_unknown_parameter_is_refused():
    request, refusal = element(1999, 1, None)
    refusal = ParameterReply(**AT_3, ak=7, pnu=1999, ind=1, pwe=0, status_word=0x0607, main_actual=0)
    with pytest.raises(RefusedError, match="does not exist"):
        described([(request, refusal)], "19-99")
    with pytest.raises(ParameterAddressError):
        described([], "nonsense")


def test_describe_is_refused_as_broadcast():
    with pytest.raises(NotSupported, match="no drive answers"):
        DanfossFcOperations(0, DanfossFcOptions(), None).describe("8-04")


@pytest.mark.parametrize(
    ("index", "unit_index", "unit", "factor"),
    [
        (-2, 22, "A", "0.01"),
        (1, 9, "kW", "0.01"),
        (0, 9, "kW", "0.001"),
        (-1, 28, "Hz", "0.1"),
        (67, 11, "rpm", "1"),
        (0, 4, "s", "1"),
        (-2, 4, "s", "0.01"),
        (-3, 4, "ms", "1"),
        (-5, 4, "ms", "0.01"),
        (70, 4, "min", "1"),
        (74, 4, "h", "1"),
        (75, 8, "kWh", "1"),
        (100, 17, "degC", "1"),
        (2, 21, "V", "100"),
        (-3, 0, "", "0.001"),
        (55, 28, "", "1"),
        (-2, 200, "", "1"),
    ],
)
def test_unit_and_factor_follow_conversion_and_unit_index(index, unit_index, unit, factor):
    assert unit_and_factor(index, unit_index) == (unit, Decimal(factor))


@pytest.mark.soak
@pytest.mark.parametrize("name", PACKAGED)
def test_grown_model_reads_the_same_values_as_the_packaged_one(name, tmp_path):
    packaged = load_model("drivecomm_danfoss_fc", "danfoss-fc", name)
    virtual = virtual_drive("danfoss-fc", 3, model=name)
    line = VirtualLine([virtual])
    path = tmp_path / "grown.toml"
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("danfoss-fc", 3, model=name)
        told = [info for _, info in descriptions(drive, packaged.parameters, {"option_texts": 11})]
        made = grown_model(told, protocol="danfoss-fc", name="grown", title="grown", source="told", base=packaged)
        path.write_text(model_text(made), encoding="utf-8")
    read = read_model(path, "danfoss-fc")
    assert read == made
    assert list(read.parameters) == list(packaged.parameters)
    assert (read.options, read.faults, read.quantities) == (packaged.options, packaged.faults, packaged.quantities)
    virtual.motor.run(25.0, line.time)
    line.advance(100)
    with drivecomm.open_bus(line.port) as bus:
        by_packaged = bus.drive("danfoss-fc", 3, model=packaged)
        by_grown = bus.drive("danfoss-fc", 3, model=read)
        for address, info in packaged.parameters.items():
            # Both models must convert the same raw number to the same value.
            one, other = by_packaged.read(address), by_grown.read(address)
            assert other.name == one.name
            if isinstance(one.value, str):
                assert other.value == one.value
                continue
            # A parameter in a unit of the application, such as the reference, is described without a unit.
            factor = factor_between(other.unit, one.unit) if other.unit else 1
            assert factor is not None
            assert other.raw * read.parameters[address].factor * factor == other.raw * info.factor, address
            assert other.type == one.type
            assert (info.minimum, info.maximum) in (
                (None, None),
                (read.parameters[address].minimum, read.parameters[address].maximum),
            )
        for common in packaged.quantities:
            assert by_grown.read(common).unit == by_packaged.read(common).unit


def test_grown_model_without_a_base_has_only_its_parameters():
    line = VirtualLine([virtual_drive("danfoss-fc", 3)])
    with drivecomm.open_bus(line.port) as bus:
        told = dict(descriptions(bus.drive("danfoss-fc", 3), ["16-14", "19-99", "3-41"]))
    assert isinstance(told.pop("19-99"), RefusedError)
    made = grown_model(told.values(), protocol="danfoss-fc", name="own", title="own", source="told")
    assert made.find("motor_current").unit == "A"
    assert (made.quantities, made.options, made.watchdog) == ({}, {}, None)
    with drivecomm.open_bus(line.port) as bus:
        reading = bus.drive("danfoss-fc", 3, model=made).read("ramp_1_ramp_up_time")
    assert (reading.value, reading.unit, reading.note) == (3, "s", "type and unit are as seen on a drive")
