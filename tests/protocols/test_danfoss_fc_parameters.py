"""Parameter addresses of the FC protocol, and the check of values before a write."""

from decimal import Decimal

import pytest

from drivecomm.errors import ParameterAddressError, UsageError, ValueRefusedError
from drivecomm.models import load_model
from drivecomm.protocol import Model, ParameterInfo, installed, protocol_options
from drivecomm_danfoss_fc.description import conversion
from drivecomm_danfoss_fc.options import DanfossFcOptions
from drivecomm_danfoss_fc.parameters import raw_for, target, text_for

FC300 = load_model("drivecomm_danfoss_fc", "danfoss-fc", "fc300")
VLT5000 = load_model("drivecomm_danfoss_fc", "danfoss-fc", "vlt5000")
OPTIONS = DanfossFcOptions()
OLD = DanfossFcOptions(pnu_bits=11, index_base=1)


class TestAddresses:
    @pytest.mark.parametrize(
        ("text", "model", "options", "pnu", "ind", "address"),
        [
            ("16-14", None, OPTIONS, 1614, 0, "16-14"),
            ("1614", None, OPTIONS, 1614, 0, "1614"),
            ("1614", FC300, OPTIONS, 1614, 0, "16-14"),
            ("motor_current", FC300, OPTIONS, 1614, 0, "16-14"),
            ("3-10[3]", None, OPTIONS, 310, 3, "3-10[3]"),
            ("preset_reference[3]", FC300, OPTIONS, 310, 3, "3-10[3]"),
            ("3-10", FC300, OPTIONS, 310, 0, "3-10[0]"),
            ("0-01", None, OPTIONS, 1, 0, "0-01"),
            ("40-95", None, OPTIONS, 4095, 0, "40-95"),
            ("520", None, OLD, 520, 0, "520"),
            ("001", None, OLD, 1, 0, "1"),
            ("1", VLT5000, OLD, 1, 0, "001"),
            ("615", VLT5000, OLD, 615, 1, "615[1]"),
            ("615[10]", VLT5000, OLD, 615, 10, "615[10]"),
            ("error_log_code", VLT5000, OLD, 615, 1, "615[1]"),
        ],
    )
    def test_address_is_read_in_every_form(self, text, model, options, pnu, ind, address):  # noqa: PLR0917
        wanted = target(text, model, options)
        assert (wanted.pnu, wanted.ind, wanted.address) == (pnu, ind, address)

    @pytest.mark.parametrize(
        "text", ["", "16-1", "16_14", "16-14-1", "16-14[", "16-14[x]", "48x", "-14", "16-14 ", "٣"]
    )
    def test_malformed_address_is_refused(self, text):
        with pytest.raises(ParameterAddressError, match="not an FC parameter address"):
            target(text, None, OPTIONS)

    def test_unknown_name_is_refused_with_the_model(self):
        with pytest.raises(ParameterAddressError, match="name of model fc300"):
            target("speed_of_light", FC300, OPTIONS)

    @pytest.mark.parametrize(("text", "options"), [("40-96", OPTIONS), ("99-99", OPTIONS), ("20-48", OLD)])
    def test_parameter_number_beyond_its_bits_is_refused(self, text, options):
        with pytest.raises(ParameterAddressError, match="cannot be reached"):
            target(text, None, options)

    def test_index_has_eight_bits(self):
        assert target("3-10", None, OPTIONS, index=255).ind == 255
        with pytest.raises(ParameterAddressError, match="low byte of IND"):
            target("3-10[256]", None, OPTIONS)

    def test_contradicting_indices_are_refused(self):
        assert target("3-10[2]", None, OPTIONS, index=2).ind == 2
        with pytest.raises(UsageError, match="another"):
            target("3-10[2]", None, OPTIONS, index=3)

    def test_unknown_type_is_refused(self):
        with pytest.raises(UsageError, match="not a type of the FC protocol"):
            target("3-10", None, OPTIONS, type="long")

    def test_invalid_address_in_the_model_is_reported(self):
        strange = ParameterInfo(address="abc", name="strange", title="strange")
        model = Model(
            protocol="danfoss-fc", name="m", title="m", source="", parameters={"abc": strange}, faults={}, options={}
        )
        with pytest.raises(ParameterAddressError, match="abc"):
            target("16-14", model, OPTIONS)


class TestOptions:
    @pytest.mark.parametrize(
        "given",
        [
            {"address_format": "1-127"},
            {"pnu_bits": 13},
            {"profile": "uss"},
            {"index_base": 2},
            {"actual_scaling": "raw"},
            {"off_bit_when_active": 2},
            {"reference_minimum_hz": "x"},
            {"reference_minimum_hz": 50, "reference_maximum_hz": 50},
            {"output_maximum_hz": 0},
        ],
    )
    def test_impossible_option_is_refused(self, given):
        with pytest.raises(UsageError):
            protocol_options(installed["danfoss-fc"], given)


def raw(parameter, value, model=FC300, **more):
    return raw_for(target(parameter, model, OPTIONS, **more), value)


class TestValues:
    @pytest.mark.parametrize(
        ("parameter", "value", "on_the_wire"),
        [
            ("3-41", 10.0, 1000),
            ("3-41", "0.01", 1),
            ("3-02", Decimal("-50.000"), -50000),
            ("3-10[3]", -12.5, -1250),
            ("8-35", 10, 10),
            ("8-37", "0.01", 1),
            ("1-20", 4, 400),
            ("4-14", 100, 1000),
        ],
    )
    def test_physical_value_is_scaled_by_the_model(self, parameter, value, on_the_wire):
        assert raw(parameter, value) == on_the_wire

    @pytest.mark.parametrize(
        ("parameter", "value"),
        [
            ("3-41", "10.005"),
            ("3-10", 327.68),
            ("3-10", "-327.69"),
            ("3-41", -1),
            ("8-31", 127),
            ("8-31", 0),
            ("3-00", 2),
            ("3-41", "fast"),
            ("3-41", True),
            ("3-41", float("inf")),
            ("4-14", "6553.6"),
        ],
    )
    def test_value_outside_step_limits_or_type_is_refused(self, parameter, value):
        with pytest.raises(ValueRefusedError):
            raw(parameter, value)

    @pytest.mark.parametrize(
        ("type", "lowest", "highest"),
        [
            ("int16", -32768, 32767),
            ("int32", -(2**31), 2**31 - 1),
            ("uint8", 0, 255),
            ("uint16", 0, 65535),
            ("uint32", 0, 2**32 - 1),
        ],
    )
    def test_value_outside_the_range_of_its_type_is_refused(self, type, lowest, highest):
        assert raw("9-99", lowest, None, type=type) == lowest
        assert raw("9-99", highest, None, type=type) == highest
        for beyond in (lowest - 1, highest + 1):
            with pytest.raises(ValueRefusedError, match=type):
                raw("9-99", beyond, None, type=type)

    def test_fraction_without_a_scale_is_refused(self):
        with pytest.raises(ValueRefusedError, match="not rounded"):
            raw("9-99", 1.5, None, type="uint16")

    def test_write_without_a_known_type_is_refused(self):
        with pytest.raises(UsageError, match="type of parameter 3-41 is not known"):
            raw("3-41", 1, None)

    def test_text_that_does_not_fit_its_parameter_is_refused(self):
        display = target("0-37", FC300, OPTIONS)
        assert text_for(display, "Lüfter 3", 245) == "Lüfter 3"
        with pytest.raises(ValueRefusedError, match="longer than 25"):
            text_for(display, "x" * 26, 245)
        with pytest.raises(ValueRefusedError, match="8859"):
            text_for(display, "5 €", 245)
        with pytest.raises(ValueRefusedError, match="not a text"):
            text_for(display, 5, 245)


class TestModels:
    @pytest.mark.parametrize("name", ["fc300", "fc102", "fc101", "vlt5000", "vlt6000"])
    def test_model_has_unique_names_and_sources(self, name):
        model = load_model("drivecomm_danfoss_fc", "danfoss-fc", name)
        names = [info.name for info in model.parameters.values()]
        assert len(set(names)) == len(names)
        assert all(info.source for info in model.parameters.values())
        assert DanfossFcOptions(**model.options)

    def test_ramp_parameters_of_vlt_5000_and_vlt_6000_differ(self):
        vlt6000 = load_model("drivecomm_danfoss_fc", "danfoss-fc", "vlt6000")
        assert VLT5000.find("ramp_1_up_time").address == "207"
        assert vlt6000.find("ramp_up_time").address == "206"
        assert vlt6000.find("208") is None

    def test_conversion_index_is_spelled_out(self):
        assert [conversion(index) for index in (6, 1, 0, -2, -7)] == [
            "factor 1000000",
            "factor 10",
            "factor 1",
            "factor 0.01",
            "factor 0.0000001",
        ]
        assert [conversion(index) for index in (67, 70, 74, 75, 77, 100)] == [
            "rpm",
            "minutes",
            "hours",
            "kWh",
            "days",
            "no conversion",
        ]
        assert conversion(50) == "not listed"
