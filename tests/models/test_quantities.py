"""Common names: their registry, their mapping by models, and readings made by them."""

from dataclasses import replace
from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import ParameterAddressError, UsageError
from drivecomm.models import converted, factor_between, load_model, quantities, read_model
from drivecomm.protocol import Reading
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def line():
    return VirtualLine([virtual_drive("vabus", 1, model="agile")])


def test_each_common_name_has_a_valid_name_a_meaning_and_a_unit():
    known = quantities()
    assert len(known) >= 30
    for name, quantity in known.items():
        assert name.isidentifier()
        assert name == name.lower()
        assert quantity.meaning
        assert quantity.unit == quantity.unit.strip()


def test_read_by_common_name_returns_name_address_and_unit(line):
    with drivecomm.open_bus(line.port) as bus:
        reading = bus.drive("vabus", 1, model="agile").read("output_frequency")
    assert (reading.parameter, reading.name, reading.unit, reading.value) == ("210", "output_frequency", "Hz", 0)
    assert reading.quality == "good"
    assert reading.note == "type and unit are derived"


def test_value_by_common_name_is_converted_to_the_common_unit(line, tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(
        'format = 1\nprotocol = "vabus"\nname = "own"\nextends = "agile"\n'
        '[quantities]\nacceleration_time = "481"\n'
        '[[parameter]]\naddress = "481"\nname = "ramp"\ntype = "long"\nunit = "ms"\nfactor = "10"\n',
        encoding="utf-8",
    )
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1, model=str(own))
        drive.write("acceleration_time", 1.5)
        assert drive.read("ramp").value == 1500
        told = drive.read("acceleration_time")
        assert (told.value, told.unit, told.raw) == (Decimal("1.5"), "s", "00000096")
        plain = drive.read("ramp")
        same = replace(plain, name="acceleration_time", value=Decimal("1.5"), unit="s", time_s=told.time_s)
        assert told == same
        with pytest.raises(drivecomm.ValueRefusedError, match="not a multiple of 10 ms"):
            drive.write("acceleration_time", "0.001")


def test_common_name_that_the_model_does_not_map_is_refused(line):
    with drivecomm.open_bus(line.port) as bus:
        with pytest.raises(ParameterAddressError, match="model agile does not say which parameter is the energy"):
            bus.drive("vabus", 1, model="agile").read("energy")
        with pytest.raises(ParameterAddressError, match="a drive without a model does not say"):
            bus.drive("vabus", 1).write("energy", 1)


def test_empty_mapping_removes_an_inherited_common_name(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(
        'format = 1\nprotocol = "vabus"\nname = "own"\nextends = "agile"\n[quantities]\noutput_power = ""\n',
        encoding="utf-8",
    )
    model = read_model(own, "vabus", "drivecomm_vabus")
    assert "output_power" not in model.quantities
    assert model.quantities["output_current"] == "211"


def test_misspelt_common_name_in_a_model_leaves_the_others_usable(line, tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(
        'format = 1\nprotocol = "vabus"\nname = "own"\nextends = "agile"\n[quantities]\noutput_freqency = "210"\n',
        encoding="utf-8",
    )
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1, model=str(own))
        assert drive.read("output_frequency").unit == "Hz"
        with pytest.raises(ParameterAddressError, match="'output_freqency' is not a VABus parameter address"):
            drive.read("output_freqency")


def test_model_of_the_users_folder_may_extend_the_packaged_model_it_replaces(tmp_path, monkeypatch):
    monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path))
    (tmp_path / "vabus").mkdir()
    (tmp_path / "vabus" / "act.toml").write_text(
        'format = 1\nprotocol = "vabus"\nname = "act"\ntitle = "ours"\nextends = "act"\n', encoding="utf-8"
    )
    model = load_model("drivecomm_vabus", "vabus", "act")
    assert model.title == "ours"
    assert model.find("481").unit == "Hz"


@pytest.mark.parametrize(
    ("given", "wanted", "factor"),
    [("Hz", "Hz", 1), ("W", "kW", Decimal("0.001")), ("kHz", "Hz", 1000), ("min", "s", 60), ("", "Hz", None)],
)
def test_units_are_converted_exactly_or_not_at_all(given, wanted, factor):
    assert factor_between(given, wanted) == factor


def test_conversion_between_unrelated_units_is_refused():
    assert converted(Decimal("1.50"), "Hz", "Hz") == Decimal("1.50")
    with pytest.raises(UsageError, match="A cannot be given in Hz"):
        converted(Decimal(1), "A", "Hz")


def test_numeric_reading_converts_to_a_pint_quantity():
    pint = pytest.importorskip("pint")
    reading = Reading(parameter="481", value=Decimal("10.00"), raw="000003E8", unit="Hz", time_s=1.5)
    assert reading.to_pint() == pint.get_application_registry().Quantity(Decimal(10), "Hz")
    assert reading.time.isoformat() == "1970-01-01T00:00:01.500000+00:00"
    assert reading.quality == "good"
    with pytest.raises(UsageError, match="only numbers have a unit"):
        Reading(parameter="1", value="text", raw="text").to_pint()
    with pytest.raises(UsageError, match="not a physical unit"):
        Reading(parameter="1", value=1, raw=1, unit="reference unit").to_pint()


def test_pint_knows_every_unit_of_the_registry():
    for quantity in quantities().values():
        Reading(parameter="1", value=1, raw=1, unit=quantity.unit).to_pint()
