"""Telegrams that start alike and differ in length only."""

from dataclasses import dataclass

import pytest

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer
from drivecomm.protocol.schema import CheckCharacters, Form, Telegrams, TelegramsByLength, constant, hex_sum, hex_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    kind = "value"
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    kind = "done"


def form(digits):
    return Form(Value, constant(b"!"), "data" / hex_text(digits, "digits"), CheckCharacters(2, 1, hex_sum))


DONE = {"Done": Form(Done, constant(b"."))}
CODEC = TelegramsByLength(
    {"Four": form(4)}, DONE, further=Telegrams({"Six": form(6)}, {"Done, long": Form(Done, constant(b"+"))}), alike="it"
)
FOUR, SIX = b"!1234CA", b"!12345633"
AMBIGUOUS = b"!1234CA4E"


@pytest.mark.parametrize(("data", "digits"), [(FOUR, "1234"), (SIX[:7] + hex_sum(SIX[1:7]), "123456")])
def test_telegrams_of_both_lengths_are_read_and_written(data, digits):
    assert CODEC.decode(data, "request") == Value(data=digits)
    assert CODEC.encode(Value(data=digits)) == data
    assert CODEC.measure(data, "request") == len(data)


def test_shorter_telegram_is_framed_without_waiting_for_more_bytes():
    assert CODEC.measure(FOUR, "request") == len(FOUR)
    (found,) = Framer(CODEC, "request").feed(FOUR)
    assert isinstance(found, Framed)


@pytest.mark.parametrize("size", [1, 3, 100])
def test_telegrams_of_both_lengths_are_found_in_a_stream(size):
    six = CODEC.encode(Value(data="123456"))
    stream, framer = FOUR + six + FOUR, Framer(CODEC, "request")
    found = [find for place in range(0, len(stream), size) for find in framer.feed(stream[place : place + size])]
    assert [each.data for each in found] == [FOUR, six, FOUR]


def test_long_telegram_that_starts_with_a_whole_short_one_is_refused():
    data = AMBIGUOUS[:7] + hex_sum(AMBIGUOUS[1:7])
    with pytest.raises(TelegramError):
        CODEC.decode(data, "request")
    with pytest.raises(TelegramError, match="complete shorter one"):
        CODEC.encode(Value(data="1234CA"))
    assert CODEC.measure(data, "request") == len(FOUR)


@pytest.mark.parametrize("digits", ["12345", "12ab", "", 1234, None, ["1", "2"]])
def test_encode_refuses_a_value_that_fits_neither_length(digits):
    with pytest.raises(TelegramError):
        CODEC.encode(Value(data=digits))


def test_wrong_checksum_is_reported_for_both_lengths():
    for data in (FOUR[:-1] + b"0", SIX[:-1] + b"0"):
        with pytest.raises(TelegramError) as raised:
            CODEC.decode(data, "request")
        assert raised.value.category == "checksum"


def test_codec_has_the_forms_and_kinds_of_both_lengths():
    assert CODEC.forms.keys() == {"Four", "Done", "Six", "Done, long"}
    assert CODEC.message({"kind": "done"}, "reply") == Done()
