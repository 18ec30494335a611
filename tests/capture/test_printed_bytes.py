"""Bytes in the notations in which people paste them."""

import pytest

from drivecomm.capture import bytes_of
from drivecomm.errors import UsageError

REPLY = bytes.fromhex("01 03 02 6D 60 94 FC")


@pytest.mark.parametrize(
    "text",
    [
        "0103026D6094FC",
        "01 03 02 6d 60 94 fc",
        "0103 026d 6094 fc",
        "01-03-02-6D-60-94-FC",
        "01:03:02:6d:60:94:fc",
        "0x01,0x03,0x02,0x6d,0x60,0x94,0xfc",
        "0x1 0x3 0x2 0x6d 0x60 0x94 0xfc",
        r"\x01\x03\x02\x6d\x60\x94\xfc",
        r"b'\x01\x03\x02\x6d\x60\x94\xfc'",
        "[01][03][02][6D][60][94][FC]",
        "<01><03><02><6D><60><94><FC>",
        "01h 03h 02h 6Dh 60h 94h FCh",
        "$01 $03 $02 $6D $60 $94 $FC",
        "16#01 16#03 16#02 16#6D 16#60 16#94 16#FC",
        "&H01 &H03 &H02 &H6D &H60 &H94 &HFC",
        "{0x01, 0x03, 0x02, 0x6D, 0x60, 0x94, 0xFC}",
        r"bytearray(b'\x01\x03\x02m`\x94\xfc')",
        r'"\1\3\2m`\224\374"',
        "bytes([1, 3, 2, 109, 96, 148, 252])",
        "[1, 3, 2, 109, 96, 148, 252]",
        "1-3-2-109-96-148-252",
        "001 003 002 109 096 148 252",
        "static const uint8_t frame[7] = {0x01, 0x03, 0x02, 0x6D, 0x60, 0x94, 0xFC};",
        "unsigned char frame[] = {\n  0x01, 0x03, 0x02, // address, function, count\n  0x6d, 0x60, 0x94, 0xfc\n};",
        "byte[] frame = { 1, 3, 2, 109, 96, 148, 252 };",
        "bytes.fromhex('01 03 02 6d 60 94 fc')",
        "<Buffer 01 03 02 6d 60 94 fc>",
        "0000   01 03 02 6d 60 94 fc                              ...m`..",
        "00000000: 0103 026d 6094 fc                        ...m`..",
    ],
)
def test_bytes_are_read_as_other_programs_print_them(text):
    assert bytes_of(text) == REPLY


@pytest.mark.parametrize(
    "text",
    [
        "00000000  01 03 02 6d 60 94 fc 00  01 02 03                 |..m`.......|",
        "0000  01 03 02 6d 60 94 fc 00  01 02 03",
        "00000000: 0103 026d 6094 fc00 0102 03              ...m`......",
    ],
)
def test_dump_line_keeps_every_byte(text):
    assert bytes_of(text) == bytes.fromhex("01 03 02 6D 60 94 FC 00 01 02 03")


def test_python_literal_keeps_the_characters_after_an_escape():
    assert bytes_of(r"b'\x03AB'") == b"\x03AB"
    assert bytes_of(r"b'\n\\'") == b"\n\\"


@pytest.mark.parametrize("text", ["[1, 3, 16, 0]", "[1, 3, 300, 0]"])
def test_ambiguous_or_too_large_numbers_are_refused(text):
    with pytest.raises(UsageError, match="not hexadecimal"):
        bytes_of(text)


def test_pairs_of_digits_are_hexadecimal():
    assert bytes_of("10 20 30 40") == bytes.fromhex("10 20 30 40")


@pytest.mark.parametrize("text", ["01 0", "hello", "0x", "01 03 zz", "", "   "])
def test_text_that_is_not_hexadecimal_is_refused(text):
    with pytest.raises(UsageError, match="not hexadecimal"):
        bytes_of(text)
