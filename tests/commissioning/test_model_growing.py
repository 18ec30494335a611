"""Parameters named by words, and models merged from a drive's descriptions and a known model."""

from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given, strategies as st

import drivecomm
from drivecomm.bus import carry_out
from drivecomm.commissioning import addresses_in, asking, descriptions, grown, parameters_of, unasked, way_to_grow
from drivecomm.commissioning.exploring import Answer, Forgetful, exploring
from drivecomm.commissioning.parameter_sets import back_up_everything
from drivecomm.errors import NotSupported, UsageError
from drivecomm.models import check_model, load_model, model_text
from drivecomm.protocol import Model, ParameterInfo, Reading, Watchdog, installed
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
def test_words_name_parameters_and_ranges(words, addresses):
    assert addresses_in(words) == addresses


@pytest.mark.parametrize("word", ["16-10..17-10", "10..9", "..5", "5..", "a..b", "1..100000", "1..x2"])
def test_invalid_range_is_refused(word):
    with pytest.raises(UsageError, match="range"):
        addresses_in([word])


@given(first=st.integers(0, 999), length=st.integers(1, 300))
def test_range_holds_each_number_between_its_ends_once(first, length):
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


def test_description_of_the_drive_overrides_the_known_model():
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


def test_common_names_and_watchdog_stay_only_with_their_parameters():
    model = make(told("1", "RAMP"), base=BASE)
    assert model.quantities == {"acceleration_time": "1", "fault_code": "1[1]"}
    assert model.watchdog is None
    assert model.identified_by == {}
    assert make(told("2", "SILENCE"), base=BASE).watchdog == BASE.watchdog
    acting = replace(BASE, watchdog=Watchdog(time="2", action="3"))
    assert make(told("2", "SILENCE"), base=acting).watchdog is None


@pytest.mark.parametrize("protocol", [plugin.name for plugin in installed.working() if plugin.name != "danfoss-fc"])
def test_protocol_without_descriptions_cannot_grow_a_model(protocol):
    virtual = virtual_drive(protocol, installed[protocol].addresses[0])
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, virtual.address)
        with pytest.raises(NotSupported, match="no model can be grown") as caught:
            list(descriptions(drive, ["1"]))
    assert caught.value.exit_code == 2
    assert line.time == 0, "nothing was sent"


@pytest.mark.soak
@pytest.mark.parametrize(
    ("protocol", "real", "base", "unknown"),
    [
        ("vabus", "guesses", "agile", "29"),
        ("vlt3500", "vlt3500", "vlt2000", "601[0,1]"),
        ("fuji", "frenic", "g11s", "M02"),
        ("vabus", "guesses", None, "29"),
        ("fuji", "frenic", None, "F11"),
        ("danfoss-fc", "fc302", "fc101", "3-41"),
    ],
)
def test_model_grown_from_all_answers_is_valid(tmp_path, protocol, real, base, unknown):
    plugin, path = installed[protocol], tmp_path / "own.toml"
    line = VirtualLine([virtual_drive(protocol, 1, model=real)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, 1, model=base)
        way = way_to_grow(plugin, drive.model, None)
        asks = asking(plugin, drive.model, {})
        answers = carry_out(drive, exploring(way, asks, Forgetful(), lambda _step: None))
    told = parameters_of(answers, plugin, drive.model, "vabus:1")
    model = grown(told, protocol=protocol, name="own", title="own", source="answers", base=drive.model)
    path.write_text(model_text(model), encoding="utf-8")
    assert check_model(path) == []
    info = model.parameters[unknown]
    if protocol == "danfoss-fc":
        assert (info.sure, info.source) == ("field", "read from the drive, AK 4")
    else:
        assert (info.type, info.access, info.sure) == ("", "r", "unconfirmed")
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, 1, model=path)
        assert drive.read(unknown).raw is not None
        if protocol != "danfoss-fc":
            with pytest.raises(UsageError):
                drive.check_write(unknown, 1, store=True)
        assert back_up_everything(drive, within=[]).of(["unknown"]) == []


def test_unreadable_parameters_and_commands_stay_in_the_model():
    base = load_model(installed["vabus"].package, "vabus", "agile")
    assert [info.address for info in unasked(installed["vabus"], base)] == [
        info.address for info in base.parameters.values() if "r" not in info.access or info.kind == "command"
    ]
    assert unasked(installed["vabus"], None) == []
    fan = installed["danfoss-fc"]
    assert unasked(fan, load_model(fan.package, "danfoss-fc", "fc300")) == []


def test_data_sets_become_one_parameter():
    answers = [
        Answer(address=f"900[{dataset}]", told=Reading(parameter="900", value="0001", raw="0001"))
        for dataset in (1, 2, 3, 4)
    ]
    (info,) = parameters_of(answers, installed["vabus"], None, "x")
    assert (info.address, info.name, info.extra) == ("900", "parameter_900", {"datasets": 4})


def test_description_options_are_refused_without_descriptions():
    with pytest.raises(UsageError, match="vabus drives do not describe their parameters"):
        asking(installed["vabus"], None, {"option_texts": 3})
