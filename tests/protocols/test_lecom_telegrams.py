"""LECOM-A/B telegrams: printed ones, and cases in which manuals or related protocols would mislead a decoder."""

import pytest
from hypothesis import given, strategies as st

import drivecomm
from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, installed

CODEC = installed["lecom"].codec(None)
ENDS = {0x02: "12", 0x03: "13", 0x04: "14", 0x05: "15", 0x06: "16", 0x15: "12.9"}
"""Values of C46, by the control character that is their BCC."""
NUMBERS = st.integers(-(1 << 31), (1 << 31) - 1).map(lambda steps: f"{steps / 10000:.4f}".rstrip("0").rstrip("."))
WORDS = st.sampled_from([2, 4, 8]).flatmap(lambda size: st.text("0123456789ABCDEF", min_size=size, max_size=size))
OCTETS = st.binary(min_size=1, max_size=120).map(lambda octets: "O" + octets.hex().upper())
TEXTS = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1, max_size=240).map("S{}".format)
SENT = NUMBERS | WORDS.map("H{}".format) | OCTETS
CODES = st.builds(lambda code: {"code": code}, st.integers(0, 6229)) | st.builds(
    lambda code, subcode: {"code": code, "subcode": subcode, "extended": True},
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFF),
)


def written(direction, **fields):
    return drivecomm.encode("lecom", fields, direction=direction)


@pytest.mark.parametrize(
    ("code", "characters"),
    [(11, b"11"), (46, b"46"), (68, b"68"), (135, b"=5"), (150, b"?0"), (790, b"0:"), (1103, b"O="), (6229, b"u\x7f")],
)
def test_code_number_is_encoded_by_the_formula_of_the_manual(code, characters):
    assert written("request", kind="receive", address=1, code=code) == b"\x0401" + characters + b"\x05"


@pytest.mark.parametrize("characters", [b"0/", b"/0", b"v\x7f", b"~\x7f", b"u\x80", b"0\xff"])
def test_invalid_code_characters_are_refused(characters):
    with pytest.raises(TelegramError):
        CODEC.decode(b"\x0401" + characters + b"\x05", "request")


def test_each_code_number_is_decoded_as_encoded():
    for code in range(6230):
        data = written("request", kind="receive", address=1, code=code)
        assert data[3] in range(0x30, 0x7F)
        assert CODEC.decode(data, "request").code == code


def test_printed_extended_address_is_encoded():
    data = written("request", kind="receive", address=1, code=1002, extended=True)
    assert data == b"\x0401!03EA00\x05"


@pytest.mark.parametrize(("end", "value"), ENDS.items())
def test_check_byte_equal_to_a_control_character_does_not_end_a_telegram(end, value):
    data = written("reply", kind="value", code=46, data=value)
    assert data[-1] == end
    for size in (1, 2, 3, 100):
        framer, stream, found = Framer(CODEC, "reply"), data + data + b"\x06", []
        for start in range(0, len(stream), size):
            found += framer.feed(stream[start : start + size])
        assert [each.data for each in found if isinstance(each, Framed)] == [data, data, b"\x06"]


def test_check_byte_below_20h_is_not_raised():
    data = written("reply", kind="value", code=46, data="35.4")
    assert data[-1] == 0x1D
    with pytest.raises(TelegramError) as raised:
        CODEC.decode(data[:-1] + b"\x3d", "reply")
    assert raised.value.category == "checksum"


def test_misprinted_eot_does_not_start_a_request():
    assert not CODEC.measure(b"\x0201", "request")


@pytest.mark.parametrize(
    "value",
    [
        "",
        "-",
        "12.",
        ".5",
        "+1",
        "1.23456",
        "1234567",
        "214748.3648",
        "-214748.3649",
        "1,5",
        "1e3",
        "H",
        "H1",
        "H123",
        "Hab",
        "O",
        "O1",
        "Oab",
        "S",
        "S\x03",
        "S" + 241 * "x",
        "O" + 242 * "0",
        "?",
    ],
)
def test_impossible_value_is_refused(value):
    with pytest.raises(TelegramError):
        written("reply", kind="value", code=46, data=value)


def test_text_value_is_encoded_in_a_reply_only():
    assert written("reply", kind="value", code=200, data="S82S8212V")
    with pytest.raises(TelegramError, match="data"):
        written("request", kind="send", address=1, code=200, data="S82S8212V")


@pytest.mark.parametrize("address", range(0, 100, 10))
def test_group_address_is_encoded_in_a_send_request_only(address):
    assert written("request", kind="send", address=address, code=46, data="0")
    with pytest.raises(TelegramError, match="no drive answers"):
        written("request", kind="receive", address=address, code=46)


@pytest.mark.parametrize("fields", [{"subcode": 1}, {"extended": 1}, {"code": 6230}, {"kind": "ack"}, {"data": "1"}])
def test_fields_that_exclude_each_other_are_refused(fields):
    with pytest.raises(TelegramError):
        written("request", **{"kind": "receive", "address": 1, "code": 46, **fields})


@given(st.integers(0, 99), CODES, SENT)
def test_send_request_is_decoded_as_encoded(address, code, value):
    fields = {"kind": "send", "address": address, **code, "data": value}
    read = drivecomm.decode("lecom", written("request", **fields), direction="request").fields
    assert {name: read[name] for name in fields} == fields


@given(CODES, SENT | TEXTS)
def test_value_reply_is_decoded_as_encoded(code, value):
    fields = {"kind": "value", **code, "data": value}
    read = drivecomm.decode("lecom", written("reply", **fields), direction="reply").fields
    assert {name: read[name] for name in fields} == fields
