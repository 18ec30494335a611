"""A scan that is told drive options finds drives that the usual ones do not reach, and says by which it did."""

import pytest
from acme import MODEL, on_a_line

from drivecomm.bus import LineChoices
from drivecomm.commissioning import forecast_scan
from drivecomm.errors import UnknownProtocolError, UsageError


def test_a_drive_with_other_options_is_found_by_them_and_used_as_it_was_found():
    with on_a_line(3, end=1) as (_, bus, _, _):
        assert not [each for each in bus.scan(["acme"], [3]) if each.sound]
        (found,) = bus.scan(["acme,end=1"], [3])
        assert (found.name, dict(found.options), found.identity) == ("acme:3", {"end": 1}, {"software": "7"})
        assert found.drive.with_options(model=MODEL).build(bus.drive).read("software").raw == 7


def test_several_options_of_one_protocol_are_tried_until_a_drive_is_known():
    with on_a_line(3, end=1) as (_, bus, sent, _):
        (found,) = [each for each in bus.scan(["acme,end=2", "acme,end=1", "acme"], [3]) if each.sound]
        assert found.options["end"] == 1
        assert all(each.endswith(b"\r") for each in sent())


def test_a_wide_scan_tries_options_at_each_of_its_settings():
    with on_a_line(3, end=1, baudrate=4800) as (_, bus, _, _):
        choices = LineChoices(baudrates=(9600, 4800), parities=("N",), bytesizes=(8,), stopbits=(1,))
        (found,) = [each for each in bus.scan(["acme", "acme,end=1"], [3], choices=choices) if each.sound]
        assert (found.options["end"], found.settings.baudrate) == (1, 4800)
        assert forecast_scan(["acme", "acme,end=1"], [3], choices).questions == 4


def test_what_is_no_option_is_refused():
    with on_a_line(3) as (_, bus, _, _):
        for text in ("acme,end", "acme,no_such=1"):
            with pytest.raises(UsageError):
                list(bus.scan([text], [3]))
        with pytest.raises(UnknownProtocolError):
            list(bus.scan(["acne,end=1"], [3]))
