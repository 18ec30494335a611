"""Scans with drive options: they find drives that default options do not reach, and report the options used."""

import pytest
from acme import MODEL, on_a_line

from drivecomm.bus import LineChoices
from drivecomm.commissioning import forecast_scan
from drivecomm.errors import UnknownProtocolError, UsageError


def test_scan_with_options_finds_a_drive_and_keeps_its_options():
    with on_a_line(3, end=1) as (_, bus, _, _):
        assert not [each for each in bus.scan(["acme"], [3]) if each.sound]
        (found,) = bus.scan(["acme,end=1"], [3])
        assert (found.name, dict(found.options), found.identity) == ("acme:3", {"end": 1}, {"software": "7"})
        assert found.drive.with_options(model=MODEL).build(bus.drive).read("software").raw == 7


def test_scan_tries_option_sets_until_a_drive_answers():
    with on_a_line(3, end=1) as (_, bus, sent, _):
        (found,) = [each for each in bus.scan(["acme,end=2", "acme,end=1", "acme"], [3]) if each.sound]
        assert found.options["end"] == 1
        assert all(each.endswith(b"\r") for each in sent())


def test_wide_scan_tries_options_at_each_line_setting():
    with on_a_line(3, end=1, baudrate=4800) as (_, bus, _, _):
        choices = LineChoices(baudrates=(9600, 4800), parities=("N",), bytesizes=(8,), stopbits=(1,))
        (found,) = [each for each in bus.scan(["acme", "acme,end=1"], [3], choices=choices) if each.sound]
        assert (found.options["end"], found.settings.baudrate) == (1, 4800)
        assert forecast_scan(["acme", "acme,end=1"], [3], choices).questions == 4


def test_scan_refuses_invalid_options_and_unknown_protocols():
    with on_a_line(3) as (_, bus, _, _):
        for text in ("acme,end", "acme,no_such=1"):
            with pytest.raises(UsageError):
                list(bus.scan([text], [3]))
        with pytest.raises(UnknownProtocolError):
            list(bus.scan(["acne,end=1"], [3]))
