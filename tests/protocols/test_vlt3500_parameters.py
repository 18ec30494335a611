"""Parameter addresses of VLT 3500 drives, and values in the units of a model."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Any

import pytest

from drivecomm.errors import ParameterAddressError, UsageError, ValueRefusedError
from drivecomm.models import load_model
from drivecomm.protocol import Model, ParameterInfo
from drivecomm_vlt3500.parameters import data_for, reading_of, target

if TYPE_CHECKING:
    from pathlib import Path

MODEL = load_model("drivecomm_vlt3500", "vlt3500", "vlt3500")


def own(**facts: Any) -> Model:
    info = ParameterInfo(**{"address": "516", "name": "speed", "title": "speed", **facts})
    return Model(
        protocol="vlt3500", name="own", title="", source="", parameters={info.address: info}, faults={}, options={}
    )


@pytest.mark.parametrize(
    ("text", "index", "address"),
    [
        ("516", None, "516"),
        ("0516", None, "516"),
        ("3", None, "003"),
        ("9999", None, "9999"),
        ("502[17]", None, "502[17]"),
        ("602[13,5]", None, "602[13,5]"),
        ("602[13, 05]", None, "602[13,5]"),
        ("502", 17, "502[17]"),
        ("602", (13, 5), "602[13,5]"),
        ("602", [13, 5], "602[13,5]"),
        ("602", "13,5", "602[13,5]"),
        ("502[17]", 17, "502[17]"),
        ("502[99999]", None, "502[99999]"),
    ],
)
def test_parameter_address_is_read_in_every_form(text: str, index: Any, address: str) -> None:
    assert target(text, None, index).address == address
    assert target(text, MODEL, index).address == address


def test_parameter_is_found_by_its_name_in_the_model() -> None:
    assert target("bus_reference", MODEL).address == "516"
    assert target("read_out_status_word", MODEL).address == "502[17]"
    assert target("index_602[13,5]", MODEL).address == "602[13,5]"
    assert target("index_602", MODEL, (13, 5)).address == "602[13,5]"
    assert target("502[17]", MODEL).info == MODEL.parameters["502[17]"]
    assert target("502[99]", MODEL).info == MODEL.parameters["502"]
    assert target("1234", MODEL).info is None


def test_addresses_in_a_model_may_have_leading_zeros() -> None:
    for address in ("0003", "003", "3"):
        assert target("003", own(address=address)).info is not None
        assert target("speed", own(address=address)).address == "003"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x",
        "12345",
        "-1",
        "516[",
        "516[]",
        "516[a]",
        "602[1,2,3]",
        "602[1000,1]",
        "602[1,100]",
        "502[100000]",
        "5 16",
    ],
)
def test_malformed_address_is_refused(text: str) -> None:
    for model in (None, MODEL):
        with pytest.raises(ParameterAddressError):
            target(text, model)


@pytest.mark.parametrize("index", ["a", (1, 2, 3), (1000, 1), -1, 1.5, ()])
def test_malformed_index_is_refused(index: Any) -> None:
    with pytest.raises(ParameterAddressError):
        target("602", None, index)


def test_contradicting_indices_are_refused() -> None:
    with pytest.raises(UsageError, match="another"):
        target("502[1]", None, 2)


def test_reading_has_notes_on_unknown_and_derived_facts() -> None:
    bare = reading_of(target("516", None), Decimal("23.750"))
    assert (bare.value, bare.raw, bare.unit, bare.note) == (Decimal("23.75"), "23.750", "", "unit not known")
    known = reading_of(target("516", MODEL), Decimal(80))
    assert (known.value, known.unit, known.name, known.note) == (80, "%", "bus_reference", "")
    assert isinstance(known.value, int)
    guessed = reading_of(target("503", MODEL), Decimal(3), "so it says")
    assert guessed.text == "either (or)"
    assert guessed.note == "so it says; type and unit are derived"


def test_factor_of_a_model_scales_readings_and_writes() -> None:
    wanted = target("516", own(factor=Decimal("0.5"), unit="Hz"))
    assert reading_of(wanted, Decimal(80)).value == Decimal(40)
    assert data_for(wanted, 40, None) == (Decimal(80), 0)
    third = target("516", own(factor=Decimal(3)))
    with pytest.raises(ValueRefusedError, match="multiple"):
        data_for(third, 1, None)


def test_decimals_of_the_model_are_the_default_for_writes() -> None:
    wanted = target("516", own(extra={"decimals": 2}))
    assert str(data_for(wanted, 80, None)[0]) == "80.00"
    assert str(data_for(wanted, 80, 0)[0]) == "80"
    with pytest.raises(ValueRefusedError, match="not exact"):
        data_for(wanted, "23.755", None)


def test_printed_limits_are_enforced_and_assumed_limits_are_not() -> None:
    with pytest.raises(ValueRefusedError, match="1 to 99"):
        data_for(target("500", MODEL), 100, None)
    assert data_for(target("516", MODEL), 400, None) == (Decimal(400), 0)


@pytest.mark.parametrize("value", [100000, "0.000001", "fast", float("nan"), True, "1e99999"])
def test_value_that_no_telegram_holds_is_refused(value: Any) -> None:
    with pytest.raises(ValueRefusedError):
        data_for(target("516", None), value, None)


def test_float_is_written_with_its_shown_digits() -> None:
    assert data_for(target("516", None), 10.1, None) == (Decimal("10.1"), 1)


def test_each_parameter_of_the_packaged_models_has_a_source() -> None:
    for name in ("vlt3500", "vlt3000", "vlt2000"):
        model = load_model("drivecomm_vlt3500", "vlt3500", name)
        assert all(info.source for info in model.parameters.values())
        for address in model.parameters:
            assert target(address, model).address == address


def test_printed_parameters_are_those_of_the_specification() -> None:
    sure = {address for address, info in MODEL.parameters.items() if info.sure == "printed"}
    assert sure == {"215", "216", "218", "309", "500", "501", "516", "601", "602"}


def test_model_file_of_a_user_is_loaded_by_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'format = 1\nprotocol = "vlt3500"\nname = "mine"\n[[parameter]]\naddress = "777"\nname = "belt"\n'
        "[faults]\n12 = 'belt torn'\n",
        encoding="utf-8",
    )
    assert target("belt", load_model("drivecomm_vlt3500", "vlt3500", path)).address == "777"
