"""The Fuji codec beyond the vectors: profiles, streams and correlation."""

from __future__ import annotations

from itertools import product

import pytest

import drivecomm
from drivecomm import TelegramError
from drivecomm.protocol import Damaged, Framed, Framer, Noise
from drivecomm_fuji import protocol
from drivecomm_fuji.codec import FujiCodec
from drivecomm_fuji.generations import PROFILES
from drivecomm_fuji.options import FujiOptions
from drivecomm_fuji.telegrams import (
    COMMAND_REFUSED,
    Poll,
    Select,
    Standard,
    message_from,
    mismatch,
    titled_forms,
)


def frame(text: bytes) -> bytes:
    """Append the checksum to a frame that is given from SOH to ETX."""
    total = sum(text[1:]) % 256
    return text + f"{total:02X}".encode()


UNKNOWN = frame(b"\x0101\x15QS05   4B\x03")


def codec(**options):
    return protocol.codec(FujiOptions(**options))


def test_nak_of_an_unknown_command_is_accepted_in_a_stream_only():
    with pytest.raises(TelegramError) as caught:
        codec().decode(UNKNOWN, "reply")
    assert (caught.value.category, caught.value.field) == ("field", "command")
    listening = codec()
    found = Framer(listening, "reply").feed(UNKNOWN)
    assert found == [Framed(UNKNOWN, Standard(kind="nak", address=1, command="Q", error_code=75))]
    with pytest.raises(TelegramError):
        listening.decode(frame(b"\x0101\x15ZS05   4B\x03"), "reply")
    with pytest.raises(TelegramError):
        listening.decode(UNKNOWN, "request")
    with pytest.raises(TelegramError):
        listening.decode(UNKNOWN[:-1], "reply")
    with pytest.raises(TelegramError, match="only read"):
        COMMAND_REFUSED.build(found[0].message)


def test_soh_starts_a_new_frame():
    good = frame(b"\x0101\x06f\x03")
    found = Framer(codec(), "reply").feed(b"\x0101\x06RM09 1" + good)
    assert [type(find) for find in found] == [Noise, Framed]
    assert codec().measure(b"\x01\x01", "reply") == 0
    assert codec().measure(b"\x0101", "reply") == 5
    assert codec().measure(b"0", "reply") == 0


def test_frame_with_a_wrong_checksum_is_damaged():
    found = Framer(codec(), "reply").feed(b"\x0101\x06f\x0300")
    assert isinstance(found[0], Damaged)
    assert found[0].error.category == "checksum"


@pytest.mark.parametrize("name", PROFILES)
def test_encoder_refuses_requests_outside_its_generation(name):
    profile = PROFILES[name]
    own, union = FujiCodec(profile), FujiCodec()
    requests = [
        *(Standard(kind="request", address=1, command=c, function="S05", data=0) for c in "WA"),
        *(
            Standard(kind="request", address=1, command="R", function=f"{t}{n:02d}")
            for t, n in product("SoyL", (46, 49, 99))
        ),
        *(Select(kind="request", address=1, command=c, data=0) for c in "abcdefm"),
        *(Poll(kind="request", address=1, command=c) for c in "ghijk"),
    ]
    for request in requests:
        letter = request.command
        allowed = letter in profile.commands | set(profile.select) | set(profile.poll)
        if isinstance(request, Standard) and letter == "R":
            allowed = request.function[0] in profile.types and int(request.function[1:]) <= profile.highest_number
        data = union.encode(request)
        assert own.decode(data, "request") == request
        if allowed:
            assert own.encode(request) == data
        else:
            with pytest.raises(TelegramError) as caught:
                own.encode(request)
            assert caught.value.category == "field"


def test_option_allows_higher_function_numbers():
    request = Standard(kind="request", address=1, command="R", function="F99")
    with pytest.raises(TelegramError, match="number 46"):
        codec(profile="e11s").encode(request)
    assert codec(profile="e11s", number_check=False).encode(request)


def test_refusal_code_of_the_first_generation_is_padded_with_zeros():
    refusal = Standard(kind="nak", address=1, command="R", function="M99", error_code=78)
    assert codec(profile="e11s").encode(refusal)[9:13] == b"004E"
    assert codec().encode(refusal)[9:13] == b"  4E"
    reset = Standard(kind="nak", address=1, command="E", error_code=76)
    assert codec(profile="e11s").encode(reset)[9:13] == b"004C"


def test_broadcast_functions_depend_on_the_generation():
    request = Standard(kind="request", address=99, command="W", function="S08", data=1)
    assert codec().encode(request)
    assert codec(profile="vg").encode(request)
    for name in ("e11s", "g11s", "frenic"):
        with pytest.raises(TelegramError, match="all stations"):
            codec(profile=name).encode(request)


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"kind": "request"},
        {"kind": ["request"], "command": "R"},
        {"kind": "request", "command": ["R"]},
        {"kind": "request", "command": "R"},
        {"kind": "request", "command": "R", "address": 1, "parameter": "S05"},
        {"kind": "request", "command": "k", "address": 1, "frame": "select"},
    ],
)
def test_incomplete_fields_are_refused(fields):
    with pytest.raises(TelegramError) as caught:
        message_from(fields, "request")
    assert caught.value.category == "field"


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "request", "command": "R", "address": "1", "function": "M09"},
        {"kind": "request", "command": "R", "address": 1, "function": 9},
        {"kind": "request", "command": "W", "address": 1, "function": "S05", "data": "2EE0"},
        {"kind": "request", "command": "W", "address": 1, "function": "S05", "data": 1, "negative": 2},
    ],
)
def test_field_of_the_wrong_type_is_refused(fields):
    with pytest.raises(TelegramError):
        drivecomm.encode("fuji", fields, direction="request")


def test_frame_and_data_of_command_m_are_implied():
    fields = {"kind": "request", "command": "m", "address": 1}
    assert drivecomm.encode("fuji", fields, direction="request") == frame(b"\x0101\x05m0000\x03")


def test_encode_refuses_foreign_and_unknown_messages():
    with pytest.raises(TelegramError, match="not a telegram"):
        codec().encode(object())
    with pytest.raises(TelegramError, match="is none of"):
        codec().encode(Select(kind="request", address=1, command="R"))
    with pytest.raises(TelegramError, match="is none of"):
        codec().encode(Standard(kind="request", address=1, command="Q"))


ASKED = Standard(kind="request", address=1, command="R", function="M09")
SHORT = Select(kind="request", address=1, command="f", data=1)


@pytest.mark.parametrize(
    ("request_", "reply", "differs"),
    [
        (ASKED, Standard(kind="ack", address=1, command="R", function="M09", data=0), ""),
        (ASKED, Standard(kind="ack", address=2, command="R", function="M09", data=0), "address"),
        (ASKED, Standard(kind="ack", address=1, command="R", function="M05", data=0), "function"),
        (ASKED, Standard(kind="ack", address=1, command="W", function="M09", data=0), "command"),
        (ASKED, Poll(kind="ack", address=1, command="j", data=0), "frame"),
        (ASKED, ASKED, "kind"),
        (ASKED, object(), "kind"),
        (object(), ASKED, "kind"),
        (Standard(kind="ack", address=1, command="R", function="M09", data=0), ASKED, "kind"),
        (ASKED, Standard(kind="nak", address=1, command="W", function="S05", error_code=74), ""),
        (ASKED, Standard(kind="nak", address=2, command="R", function="M09", error_code=74), "address"),
        (ASKED, Standard(kind="nak", address=1, command="R", function="M09", error_code=78), ""),
        (ASKED, Standard(kind="nak", address=1, command="R", function="M09"), ""),
        (ASKED, Standard(kind="nak", address=1, command="R", function="M05", error_code=78), "function"),
        (ASKED, Standard(kind="nak", address=1, command="Q", error_code=75), ""),
        (ASKED, Standard(kind="nak", address=1, command="Q"), ""),
        (ASKED, Standard(kind="nak", address=1, command="Q", error_code=78), "command"),
        (SHORT, Select(kind="ack", address=1, command="f"), ""),
        (SHORT, Select(kind="nak", address=1, command="f"), ""),
        (SHORT, Select(kind="ack", address=1, command="e"), "command"),
        (SHORT, Standard(kind="nak", address=1, command="W", function="S06", error_code=75), ""),
        (SHORT, Standard(kind="nak", address=1, command="W", function="S06", error_code=76), "frame"),
        (
            Standard(kind="request", address=1, command="E"),
            Standard(kind="ack", address=1, command="E"),
            "",
        ),
    ],
)
def test_reply_matches_only_its_own_request(request_, reply, differs):
    assert mismatch(request_, reply) == differs


def test_refusal_must_repeat_its_function():
    with pytest.raises(TelegramError) as caught:
        codec().decode(frame(b"\x0101\x15RQ05   50\x03"), "reply")
    assert caught.value.category == "field"
    assert codec().decode(frame(b"\x0101\x15RQ05   4E\x03"), "reply").function is None


def test_refusal_with_some_codes_may_omit_its_function():
    for code in (74, 75, 78):
        refusal = Standard(kind="nak", address=1, command="W", error_code=code)
        assert codec().decode(codec().encode(refusal), "reply") == refusal
    for code in (None, 80):
        with pytest.raises(TelegramError) as caught:
            codec().encode(Standard(kind="nak", address=1, command="W", error_code=code))
        assert caught.value.field == "function"


@pytest.mark.parametrize(
    "request_",
    [
        Select(kind="request", address=1, command="m", data=1),
        Standard(kind="request", address=99, command="A", function="S05", data=1),
        Standard(kind="request", address=99, command="R", function="S05"),
        Poll(kind="request", address=99, command="k"),
        Standard(kind="request", address=99, command="W", function="F15", data=1),
        Standard(kind="request", address=1, command="R", function="M09", data=0),
    ],
)
def test_request_that_must_not_be_sent_is_refused(request_):
    with pytest.raises(TelegramError) as caught:
        codec().encode(request_)
    assert caught.value.category == "field"


def test_reset_of_all_stations_is_encoded():
    assert codec().encode(Standard(kind="request", address=99, command="E"))
    assert codec(profile="frenic").encode(Select(kind="request", address=99, command="m", data=0))
    with pytest.raises(TelegramError) as caught:
        codec().decode(b"\x0201", "request")
    assert caught.value.category == "framing"


def test_titled_forms_have_the_length_of_a_frame():
    for title, form in titled_forms().items():
        assert sum(int(size) for _, size, _ in form.describe()) in (8, 12, 16), title
    assert protocol.blind_spots(UNKNOWN, "reply") == frozenset()
