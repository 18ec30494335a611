"""32-bit floats: the displayed number converts back to the bits that the drive holds."""

from decimal import Decimal
from struct import pack

import pytest
from hypothesis import given, strategies as st

from drivecomm.protocol import WordFormat, float_bits, float_of


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_displayed_float_converts_back_to_the_same_bits(number):
    bits = int.from_bytes(pack(">f", number), "big")
    found = float_of(bits)
    assert float_bits(float(found)) == bits


@pytest.mark.parametrize("text", ["0.1", "16777216", "123456.79", "1000000", "-2.5", "1.5E-12", "0"])
def test_float_is_shown_with_the_shortest_digits(text):
    assert float_of(float_bits(float(text))) == Decimal(text)


@pytest.mark.parametrize("bits", [0x7F800000, 0xFF800000, 0x7FC00000])
def test_infinity_and_nan_have_no_number(bits):
    assert float_of(bits) is None


def test_number_beyond_the_float_range_has_no_bits():
    assert float_bits(1e39) is None


def test_reading_of_a_float_register_has_no_exponent():
    registers = WordFormat(type="f32", size=2)
    reading = registers.reading(float_bits(16777216), "1", None)
    assert str(reading.value) == "16777216"
