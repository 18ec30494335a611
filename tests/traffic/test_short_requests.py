"""Requests of one character, which repeat or continue the previous read: recognised only after such a read."""

import pytest
from traffic import sniffed, telegrams

from drivecomm.capture import Piece
from drivecomm.protocol import encode
from drivecomm.traffic.sniffer import HeardTelegram

READ = encode("ct-ansi", {"kind": "read", "group": 1, "unit": 1, "menu": 10, "parameter": 40}, direction="request")
VALUES = [
    encode("ct-ansi", {"kind": "value", "menu": 10, "parameter": 40, "data": f"+{number}"}, direction="reply")
    for number in range(9)
]
OTHER = encode("vabus", {"kind": "enquiry", "address": 1, "parameter": 481}, direction="request")


def conversation(*parts):
    """Return the findings for these bytes, a tenth of a second apart, after a few ordinary reads."""
    before = [each for value in VALUES[:4] for each in (READ, value)]
    pieces = [Piece(time_s=0.1 * number, data=data) for number, data in enumerate([*before, *parts])]
    found = sniffed(pieces)
    assert [each.data for each in telegrams(found)][:8] == before
    return found[8:]


@pytest.mark.parametrize(("character", "kind"), [(b"\x15", "repeat"), (b"\x06", "next"), (b"\x08", "previous")])
def test_single_character_after_a_reply_is_a_request(character, kind):
    found = conversation(character, VALUES[5], character, VALUES[6])
    assert [(each.direction, each.data) for each in found] == [
        ("request", character),
        ("reply", VALUES[5]),
        ("request", character),
        ("reply", VALUES[6]),
    ]
    assert found[0].message.kind == kind


def test_single_character_after_another_protocol_is_not_a_request():
    found = conversation(OTHER, b"\x15", READ, VALUES[5])
    assert [each.data for each in found if isinstance(each, HeardTelegram)] == [OTHER, READ, VALUES[5]]


def test_single_character_without_an_earlier_read_is_not_a_telegram():
    found = sniffed([Piece(time_s=0.1 * number, data=b"\x15") for number in range(5)])
    assert not telegrams(found)


@pytest.mark.parametrize("character", [b"\x06", b"\x15"])
def test_single_character_after_a_write_is_its_reply(character):
    write = encode(
        "ct-ansi",
        {"kind": "write", "group": 1, "unit": 1, "menu": 1, "parameter": 21, "data": "+1.0"},
        direction="request",
    )
    found = conversation(write, character, READ, VALUES[5])
    assert [each.direction for each in found] == ["request", "reply", "request", "reply"]
