"""Telegrams of WEG's serial protocol: printed ones, and pitfalls of its manuals."""

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, installed

WEG = installed["weg"]
CODEC = WEG.codec(WEG.options())
CODES = st.builds(lambda s, e, n: f"0{s}{e}{n:02d}", st.integers(0, 7), st.integers(7, 9), st.integers(0, 99))


def request(**fields):
    return WEG.message(fields, "request")


def reply(**fields):
    return WEG.message(fields, "reply")


def framed(stream, direction):
    return [each.data for each in Framer(CODEC, direction).feed(stream) if isinstance(each, Framed)]


@pytest.mark.parametrize(("letter", "code"), [(b"J", "01703"), (b"J", "01803"), (b"G", "02733"), (b"A", "00702")])
def test_read_request_is_the_printed_one(letter, code):
    """CFW-08 manual p. 181, CFW-09 manual p. 307: J is drive 10."""
    data = CODEC.encode(request(kind="read", address=letter[0] - 0x40, code=code))
    assert data == b"\x04" + letter + code.encode() + b"\x05"


def test_check_byte_covers_the_bytes_after_stx_up_to_and_with_etx():
    data = CODEC.encode(request(kind="write", address=7, code="02733", value=600))
    assert data == b"\x04G\x0202733=0258\x03\x04"
    assert CODEC.encode(request(kind="write", address=8, code="02733", value=600))[-1:] == data[-1:]


@pytest.mark.parametrize("end", [0x02, 0x03, 0x04, 0x05, 0x06])
def test_check_byte_equal_to_a_control_character_does_not_end_a_telegram(end):
    telegrams = (
        CODEC.encode(request(kind="write", address=7, code=f"027{number}", value=value))
        for number in (33, 34)
        for value in range(0x10000)
    )
    data = next(each for each in telegrams if each[-1] == end)
    stream = data + b"\x04" + data + b"\x04J01703\x05"
    for size in (1, 3, 100):
        framer, found = Framer(CODEC, "request"), []
        for start in range(0, len(stream), size):
            found += framer.feed(stream[start : start + size])
        assert [each.data for each in found if isinstance(each, Framed)] == [data, b"\x04", data, b"\x04J01703\x05"]


@pytest.mark.parametrize(
    ("data", "category"),
    [
        (b"\x04J\x0201703:030C\x03\x7c", "field"),
        (b"\x04J0170A\x05", "field"),
        (b"\x04J01403\x05", "field"),
        (b"\x04J11703\x05", "field"),
        (b"\x04J01703\x06", "framing"),
    ],
)
def test_malformed_request_that_no_drive_answers_is_refused(data, category):
    """CFW-08 manual p. 144: a letter in a code, a separator other than `=`, wrong control characters."""
    with pytest.raises(TelegramError) as found:
        CODEC.decode(data, "request")
    assert found.value.category == category


@pytest.mark.parametrize("value", ["030c", "03:<", "0 0C"])
def test_invalid_hexadecimal_digit_in_a_value_is_refused(value):
    """It is not known whether a drive could send letters as 3AH to 3FH (MVW3000 manual p. 9-15)."""
    covered = f"01703={value}\x03".encode()
    check = 0
    for byte in covered:
        check ^= byte
    with pytest.raises(TelegramError, match="value"):
        CODEC.decode(b"J\x02" + covered + bytes([check]), "reply")


@pytest.mark.parametrize("kind", ["read", "write"])
def test_request_to_address_0_is_decoded_and_never_encoded(kind):
    value = {"value": 1} if kind == "write" else {}
    with pytest.raises(TelegramError, match="address"):
        CODEC.encode(request(kind=kind, address=0, code="00702", **value))
    assert CODEC.decode(b"\x04@00702\x05", "request").address == 0


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "end", "address": 1},
        {"kind": "read", "address": 31, "code": "00702"},
        {"kind": "read", "address": 1, "code": 702},
        {"kind": "read", "address": 1, "code": "00702", "value": 1},
        {"kind": "write", "address": 1, "code": "00702", "value": 0x10000},
        {"kind": "ack", "address": 1},
    ],
)
def test_fields_that_exclude_each_other_are_refused(fields):
    with pytest.raises(TelegramError):
        CODEC.encode(request(**fields))


def test_reply_starts_with_the_address():
    data = CODEC.encode(reply(kind="data", address=10, code="01703", value=780))
    assert data == b"J\x0201703=030C\x03{"
    assert framed(b"G\x06" + data + b"J\x15", "reply") == [b"G\x06", data, b"J\x15"]


def test_only_a_data_reply_must_match_the_code():
    asked = request(kind="read", address=10, code="01703")
    assert WEG.mismatch(asked, reply(kind="data", address=10, code="01705", value=780)) == "code"
    assert WEG.mismatch(asked, reply(kind="data", address=10, code="01803", value=780)) == "code"
    assert WEG.mismatch(asked, reply(kind="ack", address=10)) == "kind"
    assert not WEG.mismatch(asked, reply(kind="nak", address=10))
    assert not WEG.mismatch(request(kind="write", address=10, code="02733", value=1), reply(kind="nak", address=10))


@given(st.integers(1, 30), CODES, st.integers(0, 0xFFFF))
def test_telegram_is_decoded_as_encoded(address, code, value):
    for message, direction in (
        (request(kind="write", address=address, code=code, value=value), "request"),
        (reply(kind="data", address=address, code=code, value=value), "reply"),
        (request(kind="read", address=address, code=code), "request"),
    ):
        assert CODEC.decode(CODEC.encode(message), direction) == message
