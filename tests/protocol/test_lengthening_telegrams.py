"""Telegrams that begin like others and are told from them by their length alone."""

from dataclasses import dataclass

import pytest

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer
from drivecomm.protocol.schema import Check, Form, LengtheningTelegrams, Telegrams, constant, hex_sum, hex_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    kind = "value"
    data: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    kind = "done"


def form(digits):
    return Form(Value, constant(b"!"), "data" / hex_text(digits, "digits"), Check(2, 1, hex_sum))


DONE = {"Done": Form(Done, constant(b"."))}
CODEC = LengtheningTelegrams(
    {"Four": form(4)}, DONE, further=Telegrams({"Six": form(6)}, {"Done, long": Form(Done, constant(b"+"))}), alike="it"
)
FOUR, SIX = b"!1234CA", b"!12345633"
AMBIGUOUS = b"!1234CA4E"


@pytest.mark.parametrize(("data", "digits"), [(FOUR, "1234"), (SIX[:7] + hex_sum(SIX[1:7]), "123456")])
def test_both_lengths_are_read_and_written(data, digits):
    assert CODEC.decode(data, "request") == Value(data=digits)
    assert CODEC.encode(Value(data=digits)) == data
    assert CODEC.measure(data, "request") == len(data)


def test_shorter_one_is_found_without_waiting_for_more():
    assert CODEC.measure(FOUR, "request") == len(FOUR)
    (found,) = Framer(CODEC, "request").feed(FOUR)
    assert isinstance(found, Framed)


@pytest.mark.parametrize("size", [1, 3, 100])
def test_stream_holds_both(size):
    six = CODEC.encode(Value(data="123456"))
    stream, framer = FOUR + six + FOUR, Framer(CODEC, "request")
    found = [find for place in range(0, len(stream), size) for find in framer.feed(stream[place : place + size])]
    assert [each.data for each in found] == [FOUR, six, FOUR]


def test_longer_one_that_begins_with_a_whole_telegram_is_refused():
    data = AMBIGUOUS[:7] + hex_sum(AMBIGUOUS[1:7])
    with pytest.raises(TelegramError):
        CODEC.decode(data, "request")
    with pytest.raises(TelegramError, match="whole by itself"):
        CODEC.encode(Value(data="1234CA"))
    assert CODEC.measure(data, "request") == len(FOUR)


@pytest.mark.parametrize("digits", ["12345", "12ab", "", 1234, None, ["1", "2"]])
def test_what_fits_neither_is_refused(digits):
    with pytest.raises(TelegramError):
        CODEC.encode(Value(data=digits))


def test_damage_is_named_as_in_the_telegram_of_that_length():
    for data in (FOUR[:-1] + b"0", SIX[:-1] + b"0"):
        with pytest.raises(TelegramError) as raised:
            CODEC.decode(data, "request")
        assert raised.value.category == "checksum"


def test_forms_and_kinds_are_those_of_both():
    assert CODEC.forms.keys() == {"Four", "Done", "Six", "Done, long"}
    assert CODEC.message({"kind": "done"}, "reply") == Done()
