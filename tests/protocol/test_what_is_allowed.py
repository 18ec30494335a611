"""Limits of a parameter, as far as they are known, and refusals when looking into a virtual drive."""

from decimal import Decimal

import pytest

from drivecomm.errors import ParameterAddressError, ValueRefusedError
from drivecomm.protocol import ParameterInfo, Refusal, looked_into


def limited(minimum=None, maximum=None, unit="Hz"):
    given = {name: Decimal(each) for name, each in (("minimum", minimum), ("maximum", maximum)) if each is not None}
    return ParameterInfo(address="419", name="maximum_frequency", title="maximum frequency", unit=unit, **given)


@pytest.mark.parametrize("value", ["0", "0.1", "50"])
def test_value_at_a_limit_is_allowed(value):
    assert limited("0", "50").allows(Decimal(value))
    limited("0", "50").check(Decimal(value))


@pytest.mark.parametrize(
    ("info", "value", "said"),
    [
        (limited("0", "50"), "50.01", "50.01 for parameter 419 is outside 0 to 50 Hz"),
        (limited("0", "50", unit=""), "-1", "-1 for parameter 419 is outside 0 to 50"),
        (limited(maximum="50"), "51", "51 for parameter 419 is above 50 Hz"),
        (limited("1"), "0", "0 for parameter 419 is below 1 Hz"),
    ],
)
def test_value_outside_its_limits_is_refused_with_the_known_limits(info, value, said):
    assert not info.allows(Decimal(value))
    with pytest.raises(ValueRefusedError) as caught:
        info.check(Decimal(value))
    assert str(caught.value) == said


def test_parameter_without_limits_allows_every_value():
    limited().check(Decimal(-(10**9)))


def test_refusal_when_looking_into_a_drive_reports_an_unknown_parameter():
    with pytest.raises(ParameterAddressError, match="the virtual drive holds no parameter '481'"), looked_into("481"):
        raise Refusal(3)
    with pytest.raises(ValueError, match="other"), looked_into("481"):
        raise ValueError("other")
