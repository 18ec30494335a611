"""Floats of 32 bits: the number that people see is the one that the drive holds."""

from decimal import Decimal
from struct import pack

import pytest
from hypothesis import given, strategies as st

from drivecomm.protocol import WordFormat, float_bits, float_of


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_the_number_gives_the_same_bits(number):
    bits = int.from_bytes(pack(">f", number), "big")
    found = float_of(bits)
    assert float_bits(float(found)) == bits


@pytest.mark.parametrize("text", ["0.1", "16777216", "123456.79", "1000000", "-2.5", "1.5E-12", "0"])
def test_the_shortest_is_told(text):
    assert float_of(float_bits(float(text))) == Decimal(text)


@pytest.mark.parametrize("bits", [0x7F800000, 0xFF800000, 0x7FC00000])
def test_no_number(bits):
    assert float_of(bits) is None


def test_beyond_a_float():
    assert float_bits(1e39) is None


def test_registers_tell_it_in_full():
    registers = WordFormat(type="f32", size=2)
    reading = registers.reading(float_bits(16777216), "1", None)
    assert str(reading.value) == "16777216"
