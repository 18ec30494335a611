"""Registers and coils in telegrams, and values in words, checked against printed and recorded ones."""

from decimal import Decimal

import pytest

from drivecomm.errors import TelegramError, ValueRefusedError
from drivecomm.profiles import Place, blocks_of
from drivecomm.protocol import ParameterInfo, WordFormat
from drivecomm.protocol.schema import bits_as, bits_in, bytes_as, crc16, numbers, words_as, words_in


@pytest.mark.parametrize("telegram", ["01 03 21 00 00 04 4E 35", "01 06 09 1A 00 FA 2B D2", "01 03 00 04 00 02 85 CA"])
def test_crc16_matches_recorded_and_printed_telegrams(telegram):
    data = bytes.fromhex(telegram)
    assert crc16(data[:-2]) == data[-2:]


def test_words_and_bits_convert_to_text_and_back():
    assert words_in("\x01\x02\xff\x00") == (0x0102, 0xFF00)
    assert words_as((0x0102, 0xFF00)) == "\x01\x02\xff\x00"
    assert bits_in("\x05") == (1, 0, 1, 0, 0, 0, 0, 0)
    assert bits_as((1, 0, 1, 0, 0, 0, 0, 0, 1)) == "\x05\x01"


@pytest.mark.parametrize("wrong", [None, [1], (1, True), (0x10000,), (-1,), ("1",)])
def test_invalid_list_of_words_is_refused_with_its_field(wrong):
    with pytest.raises(TelegramError) as caught:
        numbers(wrong, 0xFFFF)
    assert caught.value.field == "values"


@pytest.mark.parametrize("wrong", [None, "0", "xy", "00" * 5])
def test_invalid_hexadecimal_text_is_refused_with_its_field(wrong):
    with pytest.raises(TelegramError, match="data"):
        bytes_as(wrong, "data", 4)


def info(**facts):
    return ParameterInfo(address="1", name="speed", title="speed", **facts)


@pytest.mark.parametrize(
    ("kind", "words", "value"),
    [
        (WordFormat(type="s16"), (0xFFFF,), -1),
        (WordFormat(type="u32", size=2), (1, 2), 0x10002),
        (WordFormat(type="s32", size=2, low_first=True), (0xFFFE, 0xFFFF), -2),
        (WordFormat(type="f32", size=2), (0x4148, 0), Decimal("12.5")),
        (WordFormat(type="string", size=2), (0x4142, 0x4300), "ABC"),
    ],
)
def test_value_converts_to_words_and_back(kind, words, value):
    reading = kind.reading(kind.raw_of(words), "1", info(type=kind.type))
    assert (reading.value, reading.note) == (value, "")
    back = kind.words_of(kind.raw_for(value, "1", info(type=kind.type)))
    assert back == words or value == "ABC"


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (WordFormat(type="u16"), 65536),
        (WordFormat(type="s16"), 32768),
        (WordFormat(type="f32", size=2), "nan"),
        (WordFormat(type="string", size=1), "ABC"),
        (WordFormat(allowed=range(2)), 2),
    ],
)
def test_value_that_does_not_fit_its_type_is_refused(kind, value):
    with pytest.raises(ValueRefusedError):
        kind.raw_for(value, "1", None)


def test_value_outside_the_limits_of_its_parameter_is_refused():
    limited = info(type="u16", minimum=Decimal(2), maximum=Decimal(5))
    kind = WordFormat(type="u16")
    assert kind.raw_for(5, "1", limited) == 5
    for beyond in (1, 6):
        with pytest.raises(ValueRefusedError, match="is outside 2 to 5"):
            kind.raw_for(beyond, "1", limited)


@pytest.mark.parametrize(
    ("part", "word", "value", "with_all"),
    [("low", 0x1234, 0x34, 0x12FF), ("high", 0x1234, 0x12, 0xFF34), ("2", 4, 1, 4)],
)
def test_part_of_a_register_is_read_and_replaced(part, word, value, with_all):
    place = Place("", 7, part)
    assert place.cut(word) == value
    assert place.put(word, 0xFF) == with_all
    assert Place.named(place.name) == Place("", 7)
    assert Place.named("c65") == Place("c", 65)


def test_no_addresses_give_no_blocks():
    assert blocks_of([], most=5, bridged=0) == []
