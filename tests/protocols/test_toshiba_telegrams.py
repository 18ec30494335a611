"""Telegrams of Toshiba's inverter protocol: printed ones, and pitfalls of its manuals."""

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import TelegramError
from drivecomm.protocol import Damaged, Framed, Framer, installed

TOSHIBA = installed["toshiba"]
CODEC = TOSHIBA.codec(TOSHIBA.options())
UNSUMMED = TOSHIBA.codec(TOSHIBA.options(sum=False))
WILD = ["**", *(f"*{digit}" for digit in range(10)), *(f"{digit}*" for digit in range(10))]
WORDS = st.integers(0, 0xFFFF)


def request(**fields):
    return TOSHIBA.message(fields, "request")


def reply(**fields):
    return TOSHIBA.message(fields, "reply")


@pytest.mark.parametrize(
    ("codec", "printed", "fields"),
    [
        # VF-AS1 manual E6581315 p. 7.
        (CODEC, b"(R0000&60)\r", {"number": None, "command": "R", "communication_number": 0}),
        # VF-S15 manual E6581913 p. 8.
        (UNSUMMED, b"(*2R0000)\r", {"number": "*2", "command": "R", "communication_number": 0}),
    ],
)
def test_printed_request_is_read_and_written(codec, printed, fields):
    message = codec.decode(printed, "request")
    assert {name: getattr(message, name) for name in fields} == fields
    assert codec.encode(request(**fields)) == printed


def test_printed_refusal_of_a_wrong_sum_is_read():
    """VF-AS1 manual E6581315 p. 16: the block whose sum should be D9, and the reply of a drive to it."""
    with pytest.raises(TelegramError) as found:
        CODEC.decode(bytes.fromhex("2F 58 02 05 C4 00 17 70 D8"), "request")
    assert found.value.category == "checksum"
    told = CODEC.decode(bytes.fromhex("2F 4E 00 04 81"), "reply")
    assert (told.error_code, told.tripped, told.number) == (4, False, None)


def test_sum_covers_everything_from_the_bracket_to_the_ampersand():
    assert (
        CODEC.encode(request(number=1, command="P", communication_number=0xFA00, data=0xC000)) == b"(01PFA00C000&B9)\r"
    )


@pytest.mark.parametrize("data", [b"(01RFD00)\r", b"(01PFA00C400)\r"])
def test_telegram_without_its_sum_needs_the_option_sum_off(data):
    with pytest.raises(TelegramError):
        CODEC.decode(data, "request")
    assert UNSUMMED.decode(data, "request").number == 1


@pytest.mark.parametrize(
    "data", [b"(1RFD00&BB)\r", b"(01R11\r&94)\r", b"(01RFD00&EB]\r", b"(01rFD00&0B)\r", b"(01RFD0G&02)\r"]
)
def test_malformed_request_that_no_drive_answers_is_refused(data):
    """VF-AS1 manual E6581315 p. 20: one digit of a number, CR among the digits, another stop code."""
    with pytest.raises(TelegramError):
        CODEC.decode(data, "request")


@pytest.mark.parametrize("told", ["R", "W", "P", "N"])
def test_lower_case_reply_shows_a_tripped_drive(told):
    fields = {"error_code": 2} if told == "N" else {"communication_number": 0xFD00, "data": 5}
    for tripped in (False, True):
        data = CODEC.encode(reply(number=1, command=told, tripped=tripped, **fields))
        assert data[3:4].decode() == (told.lower() if tripped else told)
        assert CODEC.decode(data, "reply").tripped is tripped


@pytest.mark.parametrize(("number", "address"), [("**", 255), ("*2", 202), ("1*", 211), (7, 7), (None, None)])
def test_wild_card_has_its_own_address(number, address):
    message = request(number=number, command="R", communication_number=0)
    assert message.address == address
    assert CODEC.decode(CODEC.encode(message), "request").number == number
    if address is not None:
        assert CODEC.encode(request(address=address, command="R", communication_number=0)) == CODEC.encode(message)


@pytest.mark.parametrize(("number", "answers"), [("*2", 2), ("1*", 10), ("**", 0)])
def test_only_a_reply_of_the_smallest_number_matches_a_wild_card(number, answers):
    asked = request(number=number, command="R", communication_number=0)
    for drive in (0, 2, 10, 12, 22):
        told = reply(number=drive, command="R", communication_number=0, data=0)
        assert TOSHIBA.mismatch(asked, told) == ("" if drive == answers else "number")


def test_refusal_matches_every_request_to_its_drive():
    refused = reply(number=1, command="N", error_code=2)
    for communication_number in (0, 0xFD00):
        asked = request(number=1, command="R", communication_number=communication_number)
        assert not TOSHIBA.mismatch(asked, refused)
    assert TOSHIBA.mismatch(request(number=2, command="R", communication_number=0), refused) == "number"


def test_message_of_another_protocol_does_not_match_as_a_reply():
    """A link compares replies of other protocols of its line as well, whose messages have other fields."""
    foreign = installed["weg"].message({"kind": "ack", "address": 1}, "reply")
    assert TOSHIBA.mismatch(request(number=1, command="R", communication_number=0), foreign) == "mode"


def test_binary_reads_with_and_without_a_number_are_distinguished():
    short, long = bytes.fromhex("2F 52 FD 00 7E"), bytes.fromhex("2F 01 52 FD 00 7F")
    assert CODEC.decode(short, "request").number is None
    assert CODEC.decode(long, "request").number == 1
    found = Framer(CODEC, "request").feed(short + long)
    assert [each.data for each in found if isinstance(each, Framed)] == [short, long]


@pytest.mark.parametrize("number", [64, 99, "*2"])
def test_number_that_binary_telegrams_cannot_hold_is_refused(number):
    with pytest.raises(TelegramError, match="number"):
        CODEC.encode(request(mode="binary", number=number, command="R", communication_number=0))


def test_block_is_decoded_and_never_encoded():
    message = CODEC.decode(bytes.fromhex("2F 58 02 05 C4 00 17 70 D9"), "request")
    assert (message.written, message.answers) == ((0xC400, 6000), 5)
    assert not TOSHIBA.intent(message).moves_nothing
    with pytest.raises(TelegramError, match="blocks are not sent"):
        CODEC.encode(message)


@pytest.mark.parametrize("digits", range(5))
def test_data_may_have_fewer_digits(digits):
    message = request(number=1, command="W", communication_number=9, data=(1 if digits else None), digits=digits)
    data = CODEC.encode(message)
    assert data[8:].startswith(b"0001"[4 - digits :] + b"&")
    assert CODEC.decode(data, "request") == message


@pytest.mark.parametrize(
    "fields",
    [{"data": 0x10000}, {"data": -1}, {"data": None}, {"data": True}, {"data": 16, "digits": 1}, {"digits": 5}],
)
def test_data_that_do_not_fit_are_refused(fields):
    with pytest.raises(TelegramError, match="data"):
        CODEC.encode(request(**{"number": 1, "command": "P", "communication_number": 9, "data": 1, **fields}))


def test_overheard_reply_does_not_hide_the_next_request():
    found = Framer(CODEC, "request").feed(b"(02RFD001770&94)\r(01RFD00&EB)\r")
    assert [each.data for each in found if isinstance(each, Framed)] == [b"(01RFD00&EB)\r"]
    assert not any(isinstance(each, Damaged) and each.error.category == "checksum" for each in found)


@given(st.sampled_from([*range(100), *WILD, None]), st.sampled_from("WP"), WORDS, WORDS)
def test_write_is_decoded_as_encoded(number, command, place, data):
    for codec in (CODEC, UNSUMMED):
        message = request(number=number, command=command, communication_number=place, data=data)
        assert codec.decode(codec.encode(message), "request") == message


@given(st.sampled_from([*range(64), None]), st.sampled_from("RGWP"), WORDS, WORDS, st.booleans())
def test_binary_reply_is_decoded_as_encoded(number, command, place, data, tripped):
    message = reply(
        mode="binary", number=number, command=command, communication_number=place, data=data, tripped=tripped
    )
    assert CODEC.decode(CODEC.encode(message), "reply") == message
