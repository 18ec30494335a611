"""Comparison of parameter sets: equal, different and incomparable values."""

from dataclasses import replace
from decimal import Decimal

import pytest

import drivecomm
from drivecomm.commissioning.parameter_sets import Entry, ParameterSet, back_up, compare, same
from drivecomm.errors import UsageError
from drivecomm.models import load_model
from drivecomm.virtual import VirtualLine, virtual_drive


def a_set(*entries, **facts):
    known = {"protocol": "vabus", "drive": "vabus:1", "model": "agile", **facts}
    return ParameterSet(entries={entry.address: entry for entry in entries}, **known)


def the_one(left, right):
    found = compare(left, right)
    (difference,) = (*found.differences, *found.missing)
    return difference.kind, difference.address, difference.reason


@pytest.mark.parametrize(
    ("left", "right", "equal"),
    [
        (10, Decimal("10.00"), True),
        ("10.00", 10, True),
        ("ten", 10, False),
        ("10", "10.0", False),
        (Decimal("0.1"), Decimal("0.10"), True),
        (-1, 1, False),
    ],
)
def test_same_compares_numbers_by_value_and_texts_literally(left, right, equal):
    assert same(left, right) is same(right, left) is equal


def test_units_are_converted_if_the_result_is_exact():
    ours = a_set(Entry(address="480", value=Decimal("0.5"), unit="kHz"))
    assert compare(ours, a_set(Entry(address="480", value=500, unit="Hz"))).same
    theirs = a_set(Entry(address="480", value=500, unit="%"))
    assert the_one(ours, theirs) == ("not comparable", "480", "kHz cannot be given in %")
    theirs = a_set(Entry(address="480", value="slow", unit="Hz"))
    assert the_one(theirs, ours) == (
        "not comparable",
        "480",
        "'slow' is not a number, so it cannot be converted to kHz",
    )


def test_value_missing_on_one_side_is_not_a_difference():
    ours, nothing = a_set(Entry(address="480", value=1)), a_set()
    assert the_one(ours, nothing) == ("missing", "480", "")
    assert the_one(nothing, ours) == ("missing", "480", "")
    unread = a_set(not_read={"480": "the drive refused it", "481": "it can only be written"})
    assert the_one(ours, unread) == ("not comparable", "480", "the drive refused it")
    assert (compare(ours, nothing).same, compare(nothing, ours).same) == (True, True), "it is lacking, not different"
    assert not compare(ours, unread).same


def test_remarks_name_models_identity_firmware_and_unread_values():
    ours = a_set(not_read={"481": "no"}, firmware="1", identity={"serial number": "1", "software version": "1"})
    theirs = a_set(not_read={"481": "no"}, model="acu", identity={"serial number": "2", "software version": "2"})
    found = compare(ours, theirs)
    assert found.same
    assert found.remarks == (
        "models differ: agile here, acu there",
        "its serial number is '1', and '2' there",
        "firmware is 1 here and not known there",
        "read on neither side: 481",
    )


def test_communication_and_measured_values_are_compared_only_on_request():
    ours = a_set(Entry(address="10", value=1, part="communication"), Entry(address="210", value=1, part="measured"))
    theirs = a_set(Entry(address="10", value=2, part="communication"), Entry(address="210", value=2, part="measured"))
    assert compare(ours, theirs).same
    assert [each.address for each in compare(ours, theirs, ["measured"]).differences] == ["210"]


def test_sets_of_two_makers_are_compared_only_by_common_names():
    ours = a_set(Entry(address="419", value=50, unit="Hz", common="maximum_frequency"))
    theirs = a_set(Entry(address="F07", value=6, unit="s"), protocol="fuji", drive="fuji:3", model="frenic")
    with pytest.raises(UsageError, match="share only parameters with common names"):
        compare(ours, theirs)
    theirs = a_set(
        Entry(address="F03", value=60, unit="Hz", common="maximum_frequency"),
        Entry(address="F15", value="x", unit="kHz", common="minimum_frequency"),
        protocol="fuji",
        drive="fuji:3",
        model="frenic",
    )
    (difference,) = compare(ours, theirs).differences
    assert (difference.address, difference.name) == ("maximum_frequency", "419")


def test_firmware_is_read_by_its_common_name():
    model = load_model("drivecomm_danfoss_fc", "danfoss-fc", "fc102")
    mapped = replace(model, quantities={"software_version": "15-43"})
    with drivecomm.open_bus(VirtualLine([virtual_drive("danfoss-fc", 3, model="fc102")]).port) as bus:
        assert back_up(bus.drive("danfoss-fc", 3, model=mapped)).firmware == "5.11"
        broken = replace(model, quantities={"software_version": "1-99"})
        assert back_up(bus.drive("danfoss-fc", 3, model=broken), []).firmware == "5.11", "as its name plate says"
