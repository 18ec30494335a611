"""Control profiles as TOML: their contents, and the errors of an invalid one."""

import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.profiles import BitCondition, control_profile, control_profile_from
from drivecomm.protocol import Stop
from drivecomm.tomlfile import TomlTable

STATE = {"name": "on", "mask": 1, "value": 1, "means": "running"}


def read(**content):
    return control_profile_from(TomlTable({"name": "test", **content}, "test.toml"))


def test_conditions_are_read_in_every_form():
    bits = {
        "running": "on",
        "fault": [3, {"bit": 4, "active": 0}],
        "warning": {"mask": 0x30, "value": 0x10},
        "remote": {"mask": 3, "values": [1, 2], "place": "0x2101"},
    }
    known = read(state=[STATE], bits=bits)
    assert known.bits == {
        "running": (BitCondition(mask=1, values=(1,)),),
        "fault": (BitCondition(mask=8, values=(8,)), BitCondition(mask=16, values=(0,))),
        "warning": (BitCondition(mask=0x30, values=(0x10,)),),
        "remote": (BitCondition(mask=3, values=(1, 2), place="0x2101"),),
    }


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"starts": []}, "starts"),
        ({"start": [{"wrod": 1}]}, "wrod"),
        ({"start": [{"place": "x"}]}, "'word' is missing"),
        ({"start": [{"word": 1, "until": "off"}], "state": [STATE]}, "there is no state 'off'"),
        ({"start": [{"word": 1, "until": {"mask": 1}}]}, "write mask and value"),
        ({"start": [{"word": 1, "until": [1.5]}]}, "= 1.5"),
        ({"state": [{**STATE, "means": "on"}]}, "write not_ready or ready"),
        ({"state": [{**STATE, "motor": "on"}]}, "write off or run"),
        ({"state": [STATE], "transition": [{"from": ["off"], "to": "on"}]}, "there is no state 'off'"),
        ({"stop": {"softly": []}}, "softly"),
        ({"flags": {"40": "x"}}, "40"),
        ({"bits": {"on": 1}}, "on"),
        ({"valid": "yes"}, "invalid valid = "),
    ],
)
def test_invalid_profile_is_refused(content, said):
    with pytest.raises(FileFormatError, match=said):
        read(**content)


def test_unknown_profile_name_is_refused():
    with pytest.raises(UsageError, match="'drivekom'"):
        control_profile("drivekom")


PRINTED = {
    "drivecom": (
        [0x0006, 0x0007, 0x000F],
        {"ramp": 0x0007, "coast": 0x0000, "quick": 0x0002},
        [0x0000, 0x0080, 0x0000],
    ),
    "profidrive": ([0x047E, 0x047F], {"ramp": 0x047E, "coast": 0x047C, "quick": 0x047A}, [0x047E, 0x04FE, 0x047E]),
    "danfoss-fc": (
        [0x047C],
        {"ramp": 0x043C, "coast": 0x0474, "quick": 0x046C, "dc_brake": 0x0478},
        [0x043C, 0x04BC, 0x043C],
    ),
}


@pytest.mark.parametrize("name", PRINTED)
def test_control_words_of_a_profile_are_those_of_the_manuals(name):
    known = control_profile(name)
    start, stops, reset = PRINTED[name]
    assert [step.word for step in known.start] == start
    assert {how.value: steps[0].word for how, steps in known.stops.items()} == stops
    assert [step.word for step in known.reset] == reset
    assert known.take_back == known.stops[Stop.RAMP]


def test_status_conditions_depend_on_the_expected_bits():
    drivecom, fc = control_profile("drivecom"), control_profile("danfoss-fc")
    assert [bit for bit in range(16) if drivecom.says("warning", {"": 1 << bit})] == [7, 15]
    assert [bit for bit in range(16) if fc.says("fault", {"": 1 << bit})] == [3, 6]
    assert [bit for bit in range(16) if fc.says("running", {"": 1 << bit})] == [11]
