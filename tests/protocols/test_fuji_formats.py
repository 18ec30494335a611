"""Function codes, data formats and words: addresses, values that fit and values that are refused."""

from __future__ import annotations

from decimal import Decimal

import pytest

from drivecomm import ParameterAddressError, UnexpectedReplyError, UsageError, ValueRefusedError
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed, protocol_options, resolve_options
from drivecomm_fuji.generations import PROFILES, slow_write
from drivecomm_fuji.options import FujiOptions
from drivecomm_fuji.parameters import reading_of, target, word_for
from drivecomm_fuji.store import Store
from drivecomm_fuji.words import FORMATS, command_flags, current_format, flags_of, format_named, word_text

FRENIC = load_model("drivecomm_fuji", "fuji", "frenic")

# Examples printed in the manuals (section 4.3 of the specification).
PRINTED = [
    ("0", "60", 0x003C),
    ("1", "-20", 0xFFEC),
    ("2", "100.0", 0x03E8),
    ("3", "-5.0", 0xFFCE),
    ("4", "50.25", 0x13A1),
    ("[1]", "60", 0x003C),
    ("[2]", "-20", 0xFFEC),
    ("[3]", "100.0", 0x03E8),
    ("[4]", "-5.0", 0xFFCE),
    ("[5]", "50.25", 0x13A1),
    ("[6]", "-85.38", 0xDEA6),
    ("[7]", "0.105", 0x0069),
    ("[8]", "-1.234", 0xFB2E),
    ("[9]", "2", 0x0002),
    ("[12]", "20.0", 0x04C8),
    ("[14]", "69", 0x0045),
    ("[15]", "17", 0x0011),
    ("[21]", "257", 0x0101),
    ("[22]", "50.25", 0x13A1),
]


@pytest.mark.parametrize(("name", "value", "word"), PRINTED)
def test_printed_examples_convert_both_ways(name, value, word):
    known = FORMATS[name]
    assert known.value(word) == Decimal(value)
    assert known.raw(Decimal(value), "F00") == word


def test_sign_character_makes_a_magnitude_negative_in_every_format():
    assert FORMATS["11"].value(0x1770, negative=True) == Decimal("-60.00")
    assert FORMATS["[5]"].value(0x9C40, negative=True) == Decimal("-400.00")
    assert FORMATS["[2]"].value(0x8001, negative=True) == -0x8001
    assert FORMATS["[12]"].value(0x04C8, negative=True) == Decimal("-20.0")


def test_current_format_depends_on_the_rating():
    assert current_format(40).value(0x042E) == Decimal("107.0")
    assert current_format(30).value(0x0168) == Decimal("3.60")
    assert not current_format(None).known


@pytest.mark.parametrize(
    ("value", "word"),
    [
        ("0.01", 0x0001),
        ("9.99", 0x03E7),
        ("10.0", 0x0464),
        ("99.9", 0x07E7),
        ("100", 0x0864),
        ("999", 0x0BE7),
        ("1000", 0x0C64),
        ("9990", 0x0FE7),
        ("-20.0", 0x84C8),
    ],
)
def test_ramp_time_is_encoded_with_the_smallest_exponent(value, word):
    known = FORMATS["[12]"]
    assert known.raw(Decimal(value), "F07") == word
    assert known.value(word) == Decimal(value)


@pytest.mark.parametrize("value", ["0", "10.05", "0.001", "9991", "10000", "1e999999", "-0.005"])
def test_ramp_time_that_would_be_rounded_is_refused(value):
    with pytest.raises(ValueRefusedError, match="not rounded"):
        FORMATS["[12]"].raw(Decimal(value), "F07")


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [
        ("[45]", "0", 0),
        ("[45]", "9.999", 0x270F),
        ("[45]", "10", 0x43E8),
        ("[45]", "16.39", 0x4667),
        ("[45]", "163.9", 0x8667),
        ("[45]", "9999", 0xE70F),
        ("[24]", "0.01", 1),
        ("[24]", "99.99", 0x270F),
        ("[24]", "100", 0x43E8),
        ("[24]", "99990", 0xE70F),
    ],
)
def test_floating_formats_convert_both_ways(name, value, word):
    known = FORMATS[name]
    assert known.raw(Decimal(value), "M00") == word
    assert known.value(word) == Decimal(value)


@pytest.mark.soak
def test_each_word_of_the_floating_formats_keeps_its_value():
    for floating in (FORMATS["[24]"], FORMATS["[45]"]):
        for word in range(0x10000):
            value = Decimal(floating.value(word))
            if word & 0x3FFF < 10_000:
                assert floating.value(floating.raw(value, "M00")) == value
            elif word >= 0xC000:
                with pytest.raises(ValueRefusedError, match="four digits"):
                    floating.raw(value, "M00")
    times = FORMATS["[12]"]
    for word in range(0x1000):
        if word & 0x3FF in range(100, 1000):
            assert times.raw(Decimal(times.value(word)), "F07") == word


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("[45]", "16.383"),
        ("[45]", "10000"),
        ("[45]", "-1"),
        ("[24]", "0.001"),
        ("[24]", "99991"),
        ("[9]", "3"),
        ("[21]", "768"),
        ("12", "769"),
        ("[14]", "65536"),
        ("[14]", "1.5"),
        ("[5]", "655.36"),
        ("[5]", "-0.01"),
        ("[5]", "0.005"),
        ("[6]", "327.68"),
        ("[1]", "1e999999"),
    ],
)
def test_value_that_does_not_fit_its_format_is_refused(name, value):
    with pytest.raises(ValueRefusedError):
        FORMATS[name].raw(Decimal(value), "F00")


def test_format_number_depends_on_the_generation():
    assert format_named(5, e11s=False).name == "[5]"
    assert format_named("4", e11s=True).name == "4"
    assert format_named("[5]", e11s=True).name == "[5]"
    for wrong in ("[13]", "zz"):
        with pytest.raises(UsageError, match="not a data format"):
            format_named(wrong, e11s=False)


@pytest.mark.parametrize("wrong", ["", "S5", "s05", "S005", "Q01", "S0x", "frequenzy", "S05 ", "٣"])
def test_malformed_address_is_refused(wrong):
    for model in (None, FRENIC):
        with pytest.raises(ParameterAddressError):
            target(wrong, model, FujiOptions())


def test_function_outside_the_generation_is_refused():
    e11s = FujiOptions(profile="e11s")
    with pytest.raises(ParameterAddressError, match="types are S M F E C P H A"):
        target("o05", None, e11s)
    with pytest.raises(ParameterAddressError, match="number 46"):
        target("F47", None, e11s)
    assert target("F47", None, FujiOptions(profile="e11s", number_check=False)).function == "F47"
    assert target("y99", None, FujiOptions()).function == "y99"


def test_parameter_name_of_the_model_is_an_address():
    assert target("acceleration_time_1", FRENIC, FujiOptions()).function == "F07"


def test_reading_without_a_format_is_the_plain_number():
    found = reading_of(target("M09", None, FujiOptions()), 6000, FujiOptions(), None, negative=True)
    assert (found.value, found.raw, found.unit) == (-6000, -6000, "")
    assert "format not known" in found.note


def test_reading_in_an_unknown_format_has_a_note():
    found = reading_of(target("M24", FRENIC, FujiOptions()), 18, FujiOptions(), FRENIC)
    assert (found.value, found.type) == (18, "[11]")
    assert "format [11] not known" in found.note
    found = reading_of(target("F11", FRENIC, FujiOptions()), 800, FujiOptions(), FRENIC)
    assert found.value == 800
    assert "40 HP" in found.note
    known = FujiOptions(rating_hp=10)
    assert reading_of(target("F11", FRENIC, known), 800, known, FRENIC).value == Decimal("8.00")


def test_word_outside_its_format_is_an_unexpected_reply():
    with pytest.raises(UnexpectedReplyError, match="F07"):
        reading_of(target("F07", FRENIC, FujiOptions()), 0x7000, FujiOptions(), FRENIC)


def test_reading_of_a_derived_fact_has_a_note():
    found = reading_of(target("M20", FRENIC, FujiOptions()), 7, FujiOptions(), FRENIC)
    assert (found.value, found.unit, found.name) == (7, "h", "operating_time")
    assert "derived" in found.note
    assert reading_of(target("H30", FRENIC, FujiOptions()), 3, FujiOptions(), FRENIC).text == "link gives both"


def test_scale_of_m12_is_an_option():
    for options, value in ((FujiOptions(), "400.0"), (FujiOptions(m12_factor="1"), "4000")):
        assert reading_of(target("M12", FRENIC, options), 4000, options, FRENIC).value == Decimal(value)


@pytest.mark.parametrize(
    ("parameter", "model", "value"),
    [
        ("S05", FRENIC, "400.01"),
        ("S05", FRENIC, "0.005"),
        ("S05", FRENIC, -1),
        ("S05", None, 40001),
        ("S05", None, 50.5),
        ("S01", None, 20001),
        ("S01", None, -20001),
        ("S06", None, 3),
        ("S06", None, 0x0800),
        ("S06", FRENIC, 0x1000),
        ("F15", None, 65536),
        ("F15", None, -32769),
        ("F15", None, "nan"),
        ("F15", None, "fast"),
        ("F15", None, True),
        ("F11", FRENIC, "8.00"),
        ("M24", FRENIC, 1),
        ("C05", FRENIC, "400.01"),
    ],
)
def test_value_outside_its_function_is_refused(parameter, model, value):
    with pytest.raises(ValueRefusedError):
        word_for(target(parameter, model, FujiOptions()), value, FujiOptions())


@pytest.mark.parametrize(
    ("parameter", "model", "value", "word"),
    [
        ("S05", FRENIC, "50.25", 0x13A1),
        ("S05", FRENIC, 50.25, 0x13A1),
        ("S05", None, 5025, 0x13A1),
        ("S01", None, -770, 0xFCFE),
        ("S01", FRENIC, -20000, 0xB1E0),
        ("F18", FRENIC, -20, 0xFFEC),
        ("F18", None, -20, 0xFFEC),
        ("F07", FRENIC, "20.0", 0x04C8),
        ("S06", None, 0x6001, 0x6001),
    ],
)
def test_value_is_encoded_as_its_word(parameter, model, value, word):
    assert word_for(target(parameter, model, FujiOptions()), value, FujiOptions()) == word


def test_allowed_bits_of_s06_are_an_option():
    options = FujiOptions(s06_mask=0x8803)
    assert word_for(target("S06", None, options), 0x0801, options) == 0x0801
    with pytest.raises(ValueRefusedError, match="8803"):
        word_for(target("S06", None, options), 0x0004, options)


def test_operation_command_bits_depend_on_the_generation():
    assert command_flags(0x0045, PROFILES["g11s"]) == ("FWD", "X1", "X5")
    assert command_flags(0xE800, PROFILES["frenic"]) == ("EN", "XF", "XR", "RST")
    assert command_flags(0x7800, PROFILES["vg"]) == ("X11", "X12", "X13", "X14")
    assert command_flags(0x0080, PROFILES["e11s"]) == ("bit 7",)
    assert [hex(PROFILES[name].command_mask) for name in PROFILES] == ["0x807f", "0x87ff", "0xffff", "0xe7ff"]


def test_operation_status_bits_depend_on_the_generation():
    assert flags_of(0x1221, PROFILES["frenic"]) == ("FWD", "NUV", "ACC", "RL")
    assert flags_of(0x3021, PROFILES["g11s"]) == ("FWD", "NUV", "RL", "WR RS-485")
    assert flags_of(0x6000, PROFILES["g11s"]) == ("WR 3",)
    assert flags_of(0x2000, PROFILES["frenic"]) == ("WR 1",)


@pytest.mark.parametrize(
    ("name", "word", "text"),
    [
        ("[10]", 0, "no alarm"),
        ("[10]", 10, "LU undervoltage"),
        ("[10]", 99, ""),
        ("[14]", 0, "none"),
        ("[14]", 0x0045, "FWD, X1, X5"),
        ("[15]", 0x0011, "Y1, Y5"),
        ("[15]", 0, "none"),
        ("[16]", 0x0021, "FWD, NUV"),
        ("[16]", 0, "none"),
        ("[17]", 0x1234, "type 1, generation 2, series 3, voltage 4"),
        ("[18]", 0x4321, "data 4: 4, data 3: 3, data 2: 2, data 1: 1"),
        ("[20]", 0, "no error"),
        ("[20]", 80, "data out of range"),
        ("[20]", 2, "unlisted error 2"),
        ("[21]", 0x0101, "data 1, forward"),
        ("12", 0x0202, "data 2, reverse"),
        ("[67]", 20, "RS-485 channel 1"),
        ("[67]", 6, ""),
        ("[1]", 6, ""),
    ],
)
def test_word_has_the_text_of_its_format(name, word, text):
    assert word_text(name, word, PROFILES["frenic"], FRENIC.faults) == text


def test_slow_writes_extend_the_reply_timeout():
    options = FujiOptions(response_interval_s=0.5)
    assert [slow_write("S05", 1), FujiOptions().reply_timeout()] == [None, None]
    assert options.reply_timeout() == pytest.approx(0.6)
    for function, data, timeout in (
        ("F07", 1, 1.0),
        ("H03", 2, 1.5),
        ("P02", 400, 1.5),
        ("H03", 1, 10.5),
        ("P04", 0x0101, 300.5),
        ("P04", 0, 1.0),
        ("H03", 0, 1.0),
    ):
        assert options.reply_timeout(slow_write(function, data)) == pytest.approx(timeout)


@pytest.mark.parametrize(
    "wrong",
    [
        {"profile": "g9"},
        {"coast_terminal": "X10"},
        {"coast_terminal": "X6", "profile": "e11s"},
        {"m12_factor": "0"},
        {"maximum_frequency_hz": -1},
        {"write_timeout_s": -1.0},
        {"busy_repeats": -1},
        {"s06_mask": -1},
    ],
)
def test_impossible_option_is_refused(wrong):
    with pytest.raises(UsageError):
        protocol_options(installed["fuji"], wrong)


@pytest.mark.parametrize("name", model_names("drivecomm_fuji", "fuji"))
def test_model_agrees_with_its_formats(name):
    model = load_model("drivecomm_fuji", "fuji", name)
    _, options = resolve_options(installed["fuji"], model, {})
    names = [info.name for info in model.parameters.values()]
    assert len(names) == len(set(names))
    for info in model.parameters.values():
        wanted = target(info.address, model, options)
        assert info.source
        if not wanted.format.special and wanted.format.name and wanted.format.name != "[19]":
            assert wanted.format.factor == info.factor, info.address
    store = Store(model, options)
    for info in model.parameters.values():
        if "w" in info.access:
            store.check(info.address, store.word(info.address), running=False)


def test_baud_rates_of_a_model_belong_to_its_generation():
    for name, parameter in (("vg", "H34"), ("e11s", "H34"), ("g11s", "H34"), ("frenic", "y04")):
        model = load_model("drivecomm_fuji", "fuji", name)
        named = {int(text.split()[0]) for text in model.parameters[parameter].values.values()}
        assert named <= set(PROFILES[name].baud_rates)


def test_error_codes_depend_on_the_generation():
    assert PROFILES["e11s"].error_codes == {71, 72, 73, 74, 75, 78, 79, 80}
    assert PROFILES["vg"].error_codes.isdisjoint({77, 81})
    assert PROFILES["frenic"].error_codes == set(range(71, 82))
