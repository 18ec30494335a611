"""VLT 3500 telegrams beyond the vectors: messages, options of the codec, and requests refused before they are sent."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import Any

import pytest

import drivecomm
from drivecomm.protocol import installed, protocol_options
from drivecomm_vlt3500.codec import blind_spots, message_from, mismatch
from drivecomm_vlt3500.messages import Control, ControlReply, Read, ReadIndex, Reply, Update
from drivecomm_vlt3500.parameters import number, packed, unpacked
from drivecomm_vlt3500.telegrams import telegrams

CODEC = telegrams()


def test_every_telegram_form_is_compiled() -> None:
    for form in (*CODEC.forms.values(), *telegrams(lenient=True).forms.values()):
        assert form.parse_compiled != form.parse_declared
        assert form.build_compiled != form.build_declared


def test_every_telegram_form_has_22_characters() -> None:
    assert {sum(int(size) for _, size, _ in form.describe()) for form in CODEC.forms.values()} == {22}


@pytest.mark.parametrize(
    ("value", "decimals", "expected"),
    [
        ("23.75", None, (2375, 2)),
        ("23.750", None, (2375, 2)),
        ("23.75", 3, (23750, 3)),
        ("-0.5", 1, (5, 1)),
        ("1e3", None, (1000, 0)),
        ("0", 5, (0, 5)),
        ("0e-30", None, (0, 0)),
        ("99999", 0, (99999, 0)),
    ],
)
def test_value_is_packed_into_digits_and_decimals(value: str, decimals: int | None, expected: tuple[int, int]) -> None:
    assert packed(Decimal(value), decimals) == expected


@pytest.mark.parametrize("value", ["100000", "1e40000", "-123456", "0.000001", "1.23456", "12345.6"])
def test_value_with_too_many_digits_is_refused(value: str) -> None:
    with pytest.raises(ValueError, match=r"digits|decimals"):
        packed(Decimal(value), None)


@pytest.mark.parametrize("value", [True, 1.5, None, "x", "inf", "nan", b"1"])
def test_inexact_or_invalid_number_is_refused(value: Any) -> None:
    with pytest.raises(ValueError, match="number"):
        number(value)


def test_minus_zero_is_read_as_zero() -> None:
    assert str(unpacked(negative=True, digits="00000", decimals=2)) == "0.00"


def test_digits_of_other_scripts_are_refused() -> None:
    with pytest.raises(ValueError, match="digits"):
        unpacked(negative=False, digits="1234\u0665", decimals=0)


def test_update_accepts_integers_texts_and_decimals() -> None:
    sent = {
        CODEC.encode(Update(address=1, parameter=516, value=value, decimals=1))  # type: ignore[arg-type]
        for value in (80, "80", Decimal("80.0"))
    }
    assert sent == {b"<01U@@@@0516+00800182>"}


def test_other_sign_character_is_kept_by_decode_and_encode() -> None:
    data = b"<01U@@@@0516 00080070>"
    message = CODEC.decode(data, "request")
    assert message == Update(address=1, parameter=516, value=Decimal(80), decimals=0, sign=" ")
    assert CODEC.encode(message) == data


@pytest.mark.parametrize(("value", "sign"), [("-1", "<"), ("1", "-"), ("1", "ab"), ("1", 5), ("1", "\u20ac")])
def test_contradicting_or_invalid_sign_is_refused(value: str, sign: Any) -> None:
    with pytest.raises(drivecomm.TelegramError) as caught:
        CODEC.encode(Update(address=1, parameter=516, value=Decimal(value), sign=sign))
    assert caught.value.category == "field"


def test_unchecked_telegram_is_built_on_request() -> None:
    assert CODEC.encode(Read(address=1, parameter=516, unchecked=True)) == b"<01R@@@@0516+000000??>"


@pytest.mark.parametrize(
    "message",
    [
        Control(address=1, control_word=0, parameter=None),
        Control(address=1, control_word=0, parameter=516, filler="0516 abcdef"),
        Control(address=1, control_word=0, parameter=None, filler="a.b?\x91xyz..."),
        ControlReply(address=1, status_word=7, parameter=516, filler="0516+000800"),
    ],
)
def test_unused_characters_of_a_control_telegram_are_kept(message: Any) -> None:
    direction: Any = "request" if isinstance(message, Control) else "reply"
    assert CODEC.encode(CODEC.decode(CODEC.encode(message), direction)) == CODEC.encode(message)


@pytest.mark.parametrize(
    "fields",
    [
        {"parameter": 10_000},
        {"parameter": "516"},
        {"filler": "short"},
        {"filler": "0516+\x910000"},
        {"filler": "0000\u20ac000000"},
        {"filler": "0517+000000", "parameter": 516},
        {"filler": "0517+000000"},
        {"filler": 5},
        {"colour": "red"},
        {"control_mask": "FFFF"},
    ],
)
def test_invalid_fields_of_a_control_telegram_are_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(drivecomm.TelegramError) as caught:
        CODEC.encode(message_from({"kind": "control", "address": 1, "control_word": 0, **fields}, "request"))
    assert caught.value.category == "field"


@pytest.mark.parametrize(
    ("word", "mask"),
    [(0x10000, None), ("0", None), (0, 0x10000), (0x0400, 0x0F01), (0x007F, 0xF0FF), (0x847F, 0x0FFF)],
)
def test_invalid_control_word_or_mask_is_refused(word: Any, mask: Any) -> None:
    with pytest.raises(drivecomm.TelegramError) as caught:
        CODEC.encode(Control(address=1, control_word=word, control_mask=mask))
    assert caught.value.field == "control_word"


def test_messages_are_built_from_fields() -> None:
    message = message_from({"kind": "read_index", "address": 1, "parameter": 602, "index": [13, 5]}, "request")
    assert message == ReadIndex(address=1, parameter=602, index=(13, 5))
    assert CODEC.encode(message) == b"<01I@@@@0602+01305268>"
    message = message_from(
        {"kind": "read", "address": 1, "status_word": 0x607, "parameter": 9, "value": "-0.5"}, "reply"
    )
    assert message == Reply(kind="read", address=1, status_word=0x607, parameter=9, value=Decimal("-0.5"))
    for fields in ({"kind": "select"}, {}, {"kind": "update", "address": 1, "parameter": 1, "value": 1.5}):
        with pytest.raises(drivecomm.TelegramError):
            message_from(fields, "request")


def test_message_that_no_drive_sends_or_answers_is_refused() -> None:
    for message in (
        Read(address=0, parameter=516),
        ReadIndex(address=0, parameter=502, index=(1,)),
        ReadIndex(address=1, parameter=602, index=(10, 3), decimals=1),
        Reply(kind="read", address=1, status_word=7, parameter=1, value=Decimal(1), fault_code=6),
        Reply(kind="read", address=1, status_word=7, parameter=1),
        Reply(kind="read", address=0, status_word=7, parameter=1, value=Decimal(1)),
    ):
        with pytest.raises(drivecomm.TelegramError):
            CODEC.encode(message)


def test_letter_in_an_index_is_refused_with_its_field() -> None:
    with pytest.raises(drivecomm.TelegramError) as caught:
        CODEC.decode(b"<01I@@@@0602+01a052??>", "request")
    assert caught.value.field == "index"


def test_reply_must_match_address_kind_parameter_and_checksum() -> None:
    request = Read(address=1, parameter=516)
    reply = Reply(kind="read", address=1, status_word=7, parameter=516, value=Decimal(1), decimals=0)
    assert mismatch(request, reply) == ""
    assert mismatch(request, replace(reply, address=2)) == "address"
    assert mismatch(request, replace(reply, kind="update")) == "kind"
    assert mismatch(request, replace(reply, parameter=561)) == "parameter"
    assert mismatch(request, replace(reply, unchecked=True)) == "checksum"
    assert mismatch(replace(request, unchecked=True), replace(reply, unchecked=True)) == ""


@pytest.mark.parametrize("index", [None, "13,5", (1.0,), (), [True]])
def test_invalid_index_is_refused(index: Any) -> None:
    with pytest.raises(drivecomm.TelegramError):
        CODEC.encode(ReadIndex(address=1, parameter=602, index=index))


@pytest.mark.parametrize("status", [0x10000, -1, "7", None])
def test_invalid_status_word_is_refused(status: Any) -> None:
    with pytest.raises(drivecomm.TelegramError):
        CODEC.encode(ControlReply(address=1, status_word=status))


def test_decoding_garbage_raises_only_telegram_errors() -> None:
    for data in (b"", b"<", b"x" * 22, b"<" * 22, b"<" + bytes(20) + b">", b"<" + b"\xff" * 20 + b">"):
        for direction in ("request", "reply"):
            with pytest.raises(drivecomm.TelegramError):
                CODEC.decode(data, direction)  # type: ignore[arg-type]


def test_error_names_the_first_faulty_field_in_telegram_order() -> None:
    def field(data: bytes) -> str:
        with pytest.raises(drivecomm.TelegramError) as caught:
            CODEC.decode(data, "request")
        return caught.value.field

    assert field(b"<A1XOGD@05x6+0x0806??>") == "address"
    assert field(b"<01XOGD@05x6+0x0806??>") == "kind"
    assert field(b"<01UO\xc7D@05x6+0x0806??>") == "control_word"
    assert field(b"<01UOGD@05x6+0x0806??>") == "parameter"
    assert field(b"<01UOGD@0516+0x0806??>") == "decimals"
    assert field(b"<01UOGD@0516+0x0800??>") == "value"


def test_lenient_codec_uses_the_low_four_bits_of_status_characters() -> None:
    lenient = telegrams(lenient=True)
    for data in (b"<01Rw0v`0516+000800??>", b"<01Rw0v`0516+000069??>", b"<01Cw0v`0516+000069??>"):
        message = lenient.decode(data, "reply")
        assert message.status_word == 0x0607  # type: ignore[attr-defined]
        with pytest.raises(drivecomm.TelegramError):
            CODEC.decode(data, "reply")
    with pytest.raises(drivecomm.TelegramError):
        lenient.decode(b"<01Rw0v\xe00516+000800??>", "reply")


def test_reply_with_a_damaged_sign_does_not_match() -> None:
    request = Read(address=1, parameter=516)
    minus = b"<01RG@F@0516-00080093>"
    assert mismatch(request, CODEC.decode(minus, "reply")) == ""
    for code in (0x91, 0xF5):
        damaged = minus[:12] + bytes([code]) + minus[13:]
        message = CODEC.decode(damaged, "reply")
        assert message.value == 80  # type: ignore[attr-defined]
        assert mismatch(request, message) == "sign"


def test_idle_word_000f_distinguishes_a_reply_from_an_echo() -> None:
    # Ready and tripped exclude each other, so bits 0 to 3 of a status word are never all 1.
    request = Read(address=1, control_word=0x000F, parameter=516)
    reply = Reply(kind="read", address=1, status_word=0, parameter=516, value=Decimal(0), decimals=0)
    assert mismatch(request, reply) == ""
    assert mismatch(Read(address=1, parameter=516), reply) == "echo"


def test_request_does_not_match_as_a_reply() -> None:
    request = Read(address=1, parameter=516)
    assert mismatch(request, request) == "kind"
    assert mismatch(ControlReply(address=1, status_word=0), ControlReply(address=1, status_word=0)) == "kind"


def test_single_bit_error_is_noticed_outside_the_blind_spots() -> None:
    for data in (b"<01R@@@@0516+00000070>", b"<01R@@@@0516+000000??>"):
        unnoticed = set()
        for place in range(22):
            for bit in range(8):
                wrong = data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]
                try:
                    CODEC.decode(wrong, "request")
                except drivecomm.TelegramError:
                    continue
                unnoticed.add(place)
        assert unnoticed == blind_spots(data, "request")


@pytest.mark.parametrize(
    "options",
    [
        {"idle_word": 0x0400},
        {"idle_word": 0x10000},
        {"idle_word": "0"},
        {"setups": 3},
        {"reference_span": "all"},
        {"reference_decimals": 6},
        {"reference_limit": 0},
        {"reference_limit": "much"},
        {"maximum_hz": 0},
        {"maximum_hz": 50, "minimum_hz": 50},
        {"maximum_hz": 50, "minimum_hz": -1},
    ],
)
def test_impossible_option_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(drivecomm.UsageError):
        protocol_options(installed["vlt3500"], options)
