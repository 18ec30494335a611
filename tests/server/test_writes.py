"""Parameters written through a server, as recorded in events."""

import pytest

from drivecomm.server import CommandRequest
from drivecomm.server.writes import Write, Writes

NOON_S = 1_795_780_800.0


@pytest.fixture
def writes():
    known = Writes()
    for number, parameter in enumerate(("420", "ramp_down_time"), 1):
        write = Write("eva (http)", number, NOON_S + 60 * number)
        known.note(
            "pump", CommandRequest(drive="pump", verb="write", arguments={"parameter": parameter}), write, now_s=1.0
        )
    return known


def test_write_of_a_parameter_is_found_for_each_of_its_data_sets(writes):
    text = " (eva (http), 2026-11-27 12:01 UTC, audit record 1)"
    assert writes.words_for("pump", "420[2]") == writes.words_for("pump", "420") == text


def test_write_by_common_name_is_found_by_the_address(writes):
    assert "audit record 2" in writes.words_for("pump", "421", "ramp_down_time")


def test_write_before_the_last_comparison_is_not_the_author_of_a_change(writes):
    assert writes.words_for("pump", "420", after_s=NOON_S)
    assert writes.words_for("pump", "420", after_s=NOON_S + 61) == ""


def test_parameter_without_a_write_has_no_author(writes):
    assert writes.words_for("pump", "430") == writes.words_for("fan", "420") == ""
