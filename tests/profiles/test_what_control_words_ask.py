"""Control words that request several kinds of stop, and the reaction of the drives of each profile."""

import pytest

from drivecomm.profiles import control_profile

FC = {
    0x0474: "off",
    0x0460: "off",
    0x046C: "quick",
    0x0468: "quick",
    0x0478: "dc_brake",
    0x0438: "dc_brake",
    0x043C: "ramp",
    0x041C: "ramp",
    0x053C: "ramp",
    0x045C: "hold",
    0x047C: "run",
    0x857C: "run",
}
PROFIDRIVE = {
    0x0477: "off",
    0x047D: "off",
    0x0473: "off",
    0x0475: "off",
    0x046F: "quick",
    0x047B: "quick",
    0x046A: "quick",
    0x043F: "ramp",
    0x047E: "ramp",
    0x045E: "ramp",
    0x045F: "hold",
    0x047F: "run",
    0x067F: "run",
}
VLT_3500 = {
    0x0477: "off",
    0x047D: "off",
    0x0473: "off",
    0x047B: "quick",
    0x046B: "quick",
    0x046F: "dc_brake",
    0x042F: "dc_brake",
    0x043F: "ramp",
    0x047E: "ramp",
    0x045F: "hold",
    0x047F: "run",
}
PROFILES = {"danfoss-fc": FC, "danfoss-profidrive": PROFIDRIVE, "vlt3500": VLT_3500}
CASES = [(name, *each) for name, words in PROFILES.items() for each in words.items()]


@pytest.mark.parametrize(("name", "word", "asks"), CASES, ids=lambda each: f"{each:04X}" if type(each) is int else each)
def test_control_word_acts_on_a_running_motor_as_listed(name, word, asks):
    known = control_profile(name)
    assert known.asks(word) == asks
    assert known.lets_run(word) is (asks in ("run", "hold"))


@pytest.mark.parametrize("name", PROFILES)
def test_acknowledgement_word_is_a_ramp_stop(name):
    known = control_profile(name)
    edge = known.reset[1].word
    assert edge & 0x80
    assert not known.lets_run(edge)
    assert known.asks(edge) == "ramp"
