"""Exact numbers: conversion between physical and raw values without rounding."""

from decimal import Decimal

import pytest

from drivecomm.errors import UsageError, ValueRefusedError
from drivecomm.protocol import ParameterInfo, exact, must_know_type, scaled, unscaled, whole_number


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (1, "1"),
        (10.1, "10.1"),
        ("10.10", "10.10"),
        (Decimal("0.3"), "0.3"),
        (-0.5, "-0.5"),
        ("1e2", "1E+2"),
        (0.1, "0.1"),
    ],
)
def test_exact_returns_the_decimal_of_the_given_number(given, meant):
    assert exact(given, "1") == Decimal(meant)


@pytest.mark.parametrize(
    "given",
    [
        "",
        "ten",
        "0x10",
        "1_0",
        "\N{ARABIC-INDIC DIGIT ONE}",
        "\N{FULLWIDTH DIGIT ONE}",
        None,
        [],
        float("nan"),
        float("inf"),
        "nan",
        "-inf",
        Decimal("NaN"),
        True,
        False,
        b"1",
        [1, [1, 0], 0],
        (1, (1, 0), 0),
    ],
)
def test_exact_refuses_a_value_that_is_not_a_number(given):
    with pytest.raises(ValueRefusedError, match="for parameter 481 is not a number"):
        exact(given, "481")


def test_physical_value_converts_to_the_raw_number():
    assert unscaled(Decimal("10.00"), Decimal("0.01"), "481", "Hz") == 1000
    assert unscaled(Decimal(-3), Decimal(1), "481") == -3
    assert unscaled(Decimal(20), Decimal(10), "481") == 2


@pytest.mark.parametrize(("physical", "factor"), [("10.001", "0.01"), ("0.5", "1"), ("5", "10"), ("1", "3")])
def test_value_between_two_steps_is_refused(physical, factor):
    with pytest.raises(ValueRefusedError, match=f"is not a multiple of {factor} Hz; it is not rounded"):
        unscaled(Decimal(physical), Decimal(factor), "481", "Hz")


def test_value_with_more_digits_than_the_decimal_context_is_refused():
    with pytest.raises(ValueRefusedError):
        unscaled(Decimal("1." + "0" * 40 + "1"), Decimal("0.01"), "481")


def test_number_too_long_to_divide_is_refused():
    with pytest.raises(ValueRefusedError):
        unscaled(Decimal("1e999999"), Decimal("0.01"), "481")


def test_raw_number_converts_to_the_physical_value():
    assert scaled(1000, Decimal("0.01")) == Decimal("10.00")
    assert str(scaled(1000, Decimal("0.01"))) == "10.00"
    assert scaled(7, Decimal(1)) == 7
    assert type(scaled(7, Decimal(1))) is int


TENTHS = ParameterInfo(address="12", name="", title="", unit="Hz", factor=Decimal("0.1"), maximum=Decimal(400))


def test_value_converts_to_the_whole_number_of_its_type():
    assert whole_number(12.5, "12", TENTHS, "uint8", range(256)) == 125
    assert whole_number("-3", "12", None, "int8", range(-128, 128)) == -3


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (400.1, "400.1 for parameter 12 is above 400 Hz"),
        (12.55, "12.55 for parameter 12 is not a multiple of 0.1 Hz; it is not rounded"),
        (25.6, "25.6 for parameter 12 is above 25.5 Hz, the highest value that uint8 holds"),
    ],
)
def test_value_outside_limits_steps_or_type_is_refused(value, says):
    with pytest.raises(ValueRefusedError) as refused:
        whole_number(value, "12", TENTHS, "uint8", range(256))
    assert str(refused.value).startswith(says)


def test_write_without_a_known_type_is_refused():
    must_know_type("int", ("int", "long"), "12")
    with pytest.raises(UsageError, match=r"the type of parameter 12 is not known.*give type= \(int, long\)"):
        must_know_type("", ("int", "long"), "12")
