"""Which parameters words name, and what a drive's word and a known model make together."""

from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given, strategies as st

import drivecomm
from drivecomm.commissioning import addresses_in, descriptions, grown
from drivecomm.errors import NotSupported, UsageError
from drivecomm.protocol import Model, ParameterInfo, Watchdog, installed
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.mark.parametrize(
    ("words", "addresses"),
    [
        (["16-14"], ["16-14"]),
        (["16-09..16-11"], ["16-09", "16-10", "16-11"]),
        (["001..003", "002"], ["001", "002", "003"]),
        (["98..101"], ["98", "99", "100", "101"]),
        (["S05..S06", "ramp_up_time"], ["S05", "S06", "ramp_up_time"]),
        ([], []),
    ],
)
def test_words_and_the_parameters_that_they_name(words, addresses):
    assert addresses_in(words) == addresses


@pytest.mark.parametrize("word", ["16-10..17-10", "10..9", "..5", "5..", "a..b", "1..100000", "1..x2"])
def test_what_is_no_range(word):
    with pytest.raises(UsageError, match="range"):
        addresses_in([word])


@given(first=st.integers(0, 999), length=st.integers(1, 300))
def test_a_range_has_all_between_its_ends_once(first, length):
    last = first + length - 1
    assert [int(each) for each in addresses_in([f"{first}..{last}"])] == list(range(first, last + 1))


def told(address, title, **more):
    return ParameterInfo(address=address, name=title.lower(), title=title, source="told", sure="field", **more)


BASE = Model(
    protocol="toy",
    name="base",
    title="base",
    source="a manual",
    parameters={
        "1": ParameterInfo(
            address="1",
            name="ramp",
            title="ramp time",
            factor=Decimal("0.1"),
            access="rw*",
            storage="stored",
            values={0: "none"},
            start=Decimal(5),
            extra={"role": "ramp", "elements": 4},
        ),
        "2": ParameterInfo(address="2", name="silence", title="silence"),
    },
    faults={5: "overload"},
    options={"bits": 12},
    quantities={"acceleration_time": "1", "link_timeout": "2", "fault_code": "1[1]"},
    watchdog=Watchdog(time="2", actions={"trip": 0}),
    identified_by={"type": "B.*"},
)


def make(*infos, base=None):
    return grown(infos, protocol="toy", name="own", title="own", source="told", base=base)


def test_two_parameters_with_one_title_have_two_names():
    model = make(told("1", "Speed"), told("16-02", "Speed"))
    assert [info.name for info in model.parameters.values()] == ["speed", "speed_16_02"]


def test_the_drives_word_goes_before_what_was_known_and_the_rest_stays():
    model = make(told("1", "RAMP", factor=Decimal("0.01"), extra={"elements": 8}), base=BASE)
    info = model.parameters["1"]
    assert (info.name, info.title, info.factor, info.source, info.sure) == (
        "ramp",
        "RAMP",
        Decimal("0.01"),
        "told",
        "field",
    )
    assert (info.access, info.storage, info.values, info.start) == ("rw*", "stored", {0: "none"}, 5)
    assert info.extra == {"role": "ramp", "elements": 8}
    assert make(told("1", "RAMP", access="r"), base=BASE).parameters["1"].access == "r"
    assert (model.options, model.faults) == ({"bits": 12}, {5: "overload"})


def test_common_names_and_watchdog_stay_where_their_parameters_are():
    model = make(told("1", "RAMP"), base=BASE)
    assert model.quantities == {"acceleration_time": "1", "fault_code": "1[1]"}
    assert model.watchdog is None
    assert model.identified_by == {}
    assert make(told("2", "SILENCE"), base=BASE).watchdog == BASE.watchdog
    acting = replace(BASE, watchdog=Watchdog(time="2", action="3"))
    assert make(told("2", "SILENCE"), base=acting).watchdog is None


@pytest.mark.parametrize("protocol", [plugin.name for plugin in installed.working() if plugin.name != "danfoss-fc"])
def test_a_protocol_whose_drives_do_not_tell(protocol):
    virtual = virtual_drive(protocol, installed[protocol].addresses[0])
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, virtual.address)
        with pytest.raises(NotSupported, match="no model can be grown") as caught:
            list(descriptions(drive, ["1"]))
    assert caught.value.exit_code == 2
    assert line.time == 0, "nothing was sent"
