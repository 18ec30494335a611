"""Machine units: exact conversion in both directions, refusal of impossible ones and of foreign units."""

from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import UsageError, ValueRefusedError
from drivecomm.protocol import MachineUnit

BELT = MachineUnit(unit="m/min", per_hz="1.25")

ABOVE_ZERO = st.decimals(min_value="0.0001", max_value="100000", places=4)
MACHINES = st.one_of(
    st.builds(MachineUnit, unit=st.sampled_from(["m/min", "m/s", "bar"]), per_hz=ABOVE_ZERO),
    st.builds(
        MachineUnit,
        unit=st.just("m/min"),
        poles=st.sampled_from([2, 4, 6, 12]),
        gear=st.none() | ABOVE_ZERO,
        per_turn=ABOVE_ZERO,
    ),
    st.builds(MachineUnit, unit=st.just("rpm"), poles=st.sampled_from([2, 4, 6, 12]), gear=st.none() | ABOVE_ZERO),
)


@given(machine=MACHINES, hz=st.decimals(min_value=-600, max_value=600, places=3))
def test_conversion_to_the_machine_unit_and_back_is_exact(machine, hz):
    assert machine.to_hz(machine.from_hz(hz)) == Fraction(hz)
    assert machine.from_hz(machine.to_hz(hz)) == Fraction(hz)


@given(machine=MACHINES, hz=st.decimals(min_value=-600, max_value=600, places=2))
def test_reference_is_the_frequency_of_the_given_speed(machine, hz):
    exactly = machine.from_hz(hz)
    # A decimal number with enough digits to distinguish two steps of 0.01 Hz.
    value = Decimal(round(exactly * 10**15)).scaleb(-15)
    assert machine.reference_hz(value) == machine.reference_hz(f"{value} {machine.unit}") == hz


@given(machine=MACHINES, hz=st.decimals(min_value=-600, max_value=600, places=2))
def test_displayed_speed_as_reference_sets_the_same_frequency(machine, hz):
    assert machine.reference_hz(machine.shown(hz).value) == hz


@given(machine=MACHINES)
def test_machine_unit_can_be_rebuilt_from_its_content(machine):
    assert MachineUnit(**machine.content) == machine


@pytest.mark.parametrize(
    ("said", "hz", "shown"),
    [
        ({"unit": "m/min", "per_hz": "1.25"}, "10.00", "12.50 m/min"),
        ({"unit": "m/min", "per_hz": 1.25}, "-0.01", "-0.01 m/min"),
        ({"unit": "rpm", "poles": 4}, "50.0", "1500 rpm"),
        ({"unit": "rpm", "poles": 4, "gear": "5.2"}, "50.00", "288.46 rpm"),
        ({"unit": "m/min", "poles": 4, "gear": "5.2", "per_turn": "0.314"}, "50.00", "90.58 m/min"),
        ({"unit": "t/h", "per_hz": 3}, "0.00", "0.00 t/h"),
        ({"unit": "t/h", "per_hz": 3}, 50, "150 t/h"),
        ({"unit": "t/h", "per_hz": 3}, "20.001220703125", "60.00 t/h"),
        ({"unit": "1/h", "per_hz": 100}, "1E+1", "1000 1/h"),
    ],
)
def test_speed_is_shown_with_as_many_decimals_as_its_frequency(said, hz, shown):
    assert str(MachineUnit(**said).shown(Decimal(hz))) == shown


def test_numbers_of_a_machine_unit_become_exact_decimals():
    assert MachineUnit(unit="m/min", per_hz=0.1).per_hz == Decimal("0.1")
    assert MachineUnit(unit="rpm", poles=4, gear="5.20").gear == Decimal("5.2")


@pytest.mark.parametrize(
    ("value", "hz"),
    [
        (12.5, "10.00"),
        ("12.5", "10.00"),
        ("12.5 m/min", "10.00"),
        ("12.5m/min", "10.00"),
        (" -12.5 m/min ", "-10.00"),
        (0, "0.00"),
        (Decimal("-0.02"), "-0.02"),
        ("1e1", "8.00"),
    ],
)
def test_reference_is_a_number_or_a_text_with_the_unit(value, hz):
    found = BELT.reference_hz(value)
    assert str(found) == hz


@pytest.mark.parametrize(
    "value",
    [
        "12.5 m/s",
        "12.5 M/min",
        "12.5 Hz",
        "50%",
        "m/min",
        "fast",
        "",
        "nan",
        "1_0 m/min",
        True,
        float("inf"),
    ],
)
def test_reference_in_another_unit_is_refused(value):
    with pytest.raises(ValueRefusedError):
        BELT.reference_hz(value)


@pytest.mark.parametrize("value", [0.001, "-0.006 m/min"])
def test_speed_that_would_be_rounded_to_a_standstill_is_refused(value):
    with pytest.raises(ValueRefusedError, match="is nearest to 0 Hz"):
        BELT.reference_hz(value)


def test_number_that_is_ambiguous_with_the_unit_is_refused():
    shaft = MachineUnit(unit="1/min", poles=4)
    assert shaft.reference_hz("30 1/min") == 1
    with pytest.raises(ValueRefusedError, match="write 10 1/min"):
        shaft.reference_hz("301/min")


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ({"unit": ""}, "invalid unit = ''; write the unit of the machine"),
        ({"unit": " m"}, "invalid unit = ' m'"),
        ({"unit": "m\n"}, "invalid unit = "),
        ({"unit": 3}, "invalid unit = 3"),
        ({"unit": "x" * 21}, "write up to 20 characters"),
        ({"unit": "HZ", "per_hz": 1}, "invalid unit = HZ, which every reference supports"),
        ({"unit": "%", "per_hz": 1}, "invalid unit = %"),
        ({"unit": "m/min"}, "either per_hz or poles"),
        ({"unit": "m/min", "per_hz": 1, "poles": 4}, "either per_hz or poles"),
        ({"unit": "m/min", "per_hz": 1, "gear": 4}, "gear belongs to poles"),
        ({"unit": "m/min", "per_hz": 1, "per_turn": 4}, "per_turn belongs to poles"),
        ({"unit": "m/min", "per_hz": 0}, "invalid per_hz = 0; write a number above 0"),
        ({"unit": "m/min", "per_hz": "-1"}, "invalid per_hz = '-1'"),
        ({"unit": "m/min", "per_hz": "nan"}, "invalid per_hz = 'nan'"),
        ({"unit": "m/min", "per_hz": float("inf")}, "invalid per_hz = inf"),
        ({"unit": "m/min", "per_hz": True}, "invalid per_hz = True"),
        ({"unit": "m/min", "per_hz": "1,25"}, "invalid per_hz = '1,25'"),
        ({"unit": "rpm", "poles": 3}, "invalid poles = 3"),
        ({"unit": "rpm", "poles": 0}, "invalid poles = 0"),
        ({"unit": "rpm", "poles": True}, "invalid poles = True"),
        ({"unit": "rpm", "poles": 4, "gear": 0}, "invalid gear = 0"),
        ({"unit": "rpm", "poles": 4, "per_turn": 1}, "rpm already counts turns; leave per_turn out"),
        ({"unit": "m/min", "poles": 4}, "write per_turn"),
        (
            {"unit": "m/s", "poles": 4, "per_turn": 1},
            "poles give a speed per minute, and m/s is not one",
        ),
    ],
)
def test_invalid_machine_unit_is_refused(said, sentence):
    with pytest.raises(UsageError) as caught:
        MachineUnit(**said)
    assert sentence in str(caught.value)
