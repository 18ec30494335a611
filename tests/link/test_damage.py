"""Telegrams among noise, and typical damage of a telegram."""

import pytest

from drivecomm.link import likely_damage, telegrams_among_noise
from drivecomm.protocol import Framed, Noise, installed

# Modbus over serial line V1.02, and the forum threads that field case 09 quotes.
REPLY = bytes.fromhex("01 03 02 6D 60 94 FC")
ENQUIRY = bytes.fromhex("04 41 30 30 34 38 31 05")


def codec_of(name):
    plugin = installed[name]
    return plugin.codec(plugin.options())


@pytest.mark.parametrize(
    ("data", "before", "telegram", "behind"),
    [
        ("00 01 03 02 6D 60 94 FC", "00", "01 03 02 6D 60 94 FC", ""),
        ("00 04 83 02 D0 F0 00", "00", "04 83 02 D0 F0", "00"),
        ("00 2e 03 02 04 80 6e e2 00", "00", "2e 03 02 04 80 6e e2", "00"),
    ],
)
def test_telegram_is_found_between_noise_bytes(data, before, telegram, behind):
    finds = telegrams_among_noise(bytes.fromhex(data), codec_of("modbus"), "reply")
    sound = [each.data for each in finds if isinstance(each, Framed)]
    noise = [each.data for each in finds if isinstance(each, Noise)]
    assert sound == [bytes.fromhex(telegram)]
    assert noise == [bytes.fromhex(each) for each in (before, behind) if each]


def test_short_telegram_that_fits_by_chance_is_rejected():
    assert telegrams_among_noise(bytes.fromhex("00 2e 03 02 04 80 6e"), codec_of("vabus"), "request") == ()


@pytest.mark.parametrize(
    ("protocol", "direction", "data", "cause"),
    [
        ("modbus", "reply", REPLY[:-2] + REPLY[:-3:-1], "wrong order"),
        ("modbus", "reply", REPLY[1:], "first byte"),
        ("modbus", "reply", REPLY[:-1], "last byte"),
        ("vabus", "request", bytes(byte | 0x80 for byte in ENQUIRY), "bit 7"),
    ],
)
def test_typical_damage_is_named(protocol, direction, data, cause):
    damage = likely_damage(data, codec_of(protocol), direction)
    assert damage is not None
    assert cause in damage.cause
    assert damage.remedy


def test_untypical_damage_is_not_named():
    changed = REPLY[:3] + bytes([REPLY[3] ^ 0x24]) + REPLY[4:]
    assert likely_damage(changed, codec_of("modbus"), "reply") is None
