"""Line settings, timing, and overriding the facts of a line."""

import pytest

from drivecomm.errors import UsageError
from drivecomm.protocol import LINE_FACT_NAMES, LineFacts, LineSettings, Timing

TIMING = Timing(reply_timeout_s=0.5, gap_s=0.05, turnaround_s=0.0, broadcast_pause_s=0.0)


@pytest.mark.parametrize(
    ("settings", "bits", "text"),
    [
        ({}, 10, "9600 8N1"),
        ({"bytesize": 7, "parity": "E"}, 10, "9600 7E1"),
        ({"parity": "E"}, 11, "9600 8E1"),
        ({"parity": "O", "stopbits": 2}, 12, "9600 8O2"),
        ({"stopbits": 1.5}, 10.5, "9600 8N1.5"),
    ],
)
def test_character_time_follows_the_line_settings(settings, bits, text):
    line = LineSettings(**settings)
    assert line.character_s == pytest.approx(bits / 9600)
    assert line.wire_s(10) == pytest.approx(bits / 960)
    assert str(line) == text


@pytest.mark.parametrize(
    "settings",
    [
        {"baudrate": 0},
        {"baudrate": -9600},
        {"baudrate": 10_000_000},
        {"bytesize": 6},
        {"bytesize": 9},
        {"parity": "X"},
        {"parity": "even"},
        {"stopbits": 0},
        {"stopbits": 3},
    ],
)
def test_impossible_line_settings_are_refused(settings):
    with pytest.raises(UsageError):
        LineSettings(**settings)


@pytest.mark.parametrize("settings", [{"baudrate": "fast"}, {"baudrate": None}, {"parity": 3}, {"parity": []}])
def test_line_settings_of_the_wrong_type_raise_usage_error(settings):
    with pytest.raises(UsageError):
        LineSettings(**settings)


@pytest.mark.parametrize("timing", [{"reply_timeout_s": -1}, {"gap_s": -0.1}, {"late_s": -1}, {"attempts": 0}])
def test_impossible_timing_is_refused(timing):
    with pytest.raises(UsageError):
        Timing(**{"reply_timeout_s": 0.5, "gap_s": 0.05, "turnaround_s": 0.0, "broadcast_pause_s": 0.0, **timing})


def test_line_facts_are_overridden_by_name():
    facts = LineFacts(settings=LineSettings(), timing=TIMING)
    changed = facts.override({"baudrate": 19200, "attempts": 1, "parity": None})
    assert changed.settings == LineSettings(baudrate=19200)
    assert changed.timing.attempts == 1
    assert changed.timing.gap_s == 0.05
    assert facts.override({}) == facts
    assert {"baudrate", "bytesize", "parity", "stopbits", "reply_timeout_s", "gap_s", "attempts"} <= LINE_FACT_NAMES
    with pytest.raises(UsageError):
        facts.override({"baudrate": 1})


def test_longer_of_the_pause_in_seconds_and_in_characters_applies():
    def pauses(baudrate, seconds):
        timing = Timing(
            reply_timeout_s=0.5,
            gap_s=seconds,
            turnaround_s=seconds,
            broadcast_pause_s=seconds,
            gap_characters=4,
            turnaround_characters=6,
        )
        facts = LineFacts(settings=LineSettings(baudrate=baudrate), timing=timing)
        return facts.gap_s, facts.turnaround_s, facts.broadcast_pause_s

    assert pauses(1000, 0.01) == pytest.approx((0.04, 0.06, 0.06))
    assert pauses(1000, 0.1) == pytest.approx((0.1, 0.1, 0.1))
