"""A foreign USS drive: the virtual vacuum pump of `turboctl`, a Leybold TURBOVAC.

The pump accepts telegrams of 4 PKW and 6 PZD words, replies as address 0, and has no mirror telegram. Its package is
not among those that the tests install: `pip install turboctl`.
"""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import NoReplyError, RefusedError, ValueRefusedError

virtualpump = pytest.importorskip(
    "turboctl.virtualpump.virtualpump", reason="turboctl is not installed; pip install turboctl"
)

PUMP = {"pkw_words": 4, "pzd_words": 6, "ind": "plain", "mirror": False, "eeprom_tasks": "none"}
ON, OFF = 0x0401, 0x0400
"""Control words of TURBOVAC pumps: bit 0 starts, bit 10 is control by the master."""


@pytest.fixture
def pump():
    with virtualpump.VirtualPump() as pump, drivecomm.open_bus(pump.connection.port) as bus:
        yield bus.drive("uss", 0, **PUMP)


def test_probe_finds_the_pump(pump):
    pump.probe()


def test_parameters_of_the_pump_are_read(pump):
    assert pump.read("18", type="U16").value == 1000
    assert pump.read("2", type="U16").raw == 10000
    assert pump.read("7", type="I16").raw == 0


def test_word_is_written_and_read_back(pump):
    assert pump.write("16", 75, type="I16").value == 75
    assert pump.read("16", type="I16").value == 75


def test_refusal_of_the_pump_has_its_reason(pump):
    with pytest.raises(RefusedError, match="cannot be changed"):
        pump.write("3", 1, type="U16")
    with pytest.raises(RefusedError, match="limit"):
        pump.write("16", 151, type="I16")


def test_value_that_does_not_fit_is_refused(pump):
    with pytest.raises(ValueRefusedError):
        pump.write("16", Decimal("1.5"), type="I16")


def test_status_commands_nothing_and_a_control_word_with_bit_10_starts(pump):
    before = pump.status().word
    assert pump.status().word == before
    pump.call("control_word", word=ON)
    started = pump.status().word
    assert started != before
    pump.call("control_word", word=OFF)
    assert pump.status().word != started


def test_telegram_of_another_length_is_not_answered():
    with virtualpump.VirtualPump() as pump, drivecomm.open_bus(pump.connection.port) as bus:
        drive = bus.drive("uss", 0, **PUMP | {"pzd_words": 2}, attempts=1)
        with pytest.raises(NoReplyError):
            drive.probe()
