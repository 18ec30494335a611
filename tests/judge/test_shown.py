from decimal import Decimal

import pytest

from drivecomm.judge.process import OutputLine, Run
from drivecomm.judge.shown_values import Display, Shown, displays_of, learned_display, number_in


def run(*texts, code=0, is_error=False):
    return Run(code=code, lines=[OutputLine(0.0, text, is_error) for text in texts])


@pytest.mark.parametrize(
    ("text", "held", "same"),
    [
        ("12.34", "12.34", True),
        ("12.3", "12.34", True),
        ("12.4", "12.34", True),
        ("12.2", "12.34", False),
        ("12", "12.34", True),
        ("13", "12", False),
        ("12,5", "12.5", True),
        ("-3", "-3", True),
    ],
)
def test_value_is_compared_to_the_precision_of_its_digits(text, held, same):
    shown = Shown(0.0, text, number_in(text))
    assert Display("(.*)").shows(shown, Decimal(held)) is same


def test_display_is_learned_from_a_number_that_changes_with_the_drive():
    runs = [run("drive 1: 12.34 Hz of 50"), run("drive 1: 23.45 Hz of 50")]
    display = learned_display(runs, [Decimal("12.34"), Decimal("23.45")], [1234, 2345], None)
    assert not display.is_raw
    assert [each.text for each in display.all_in(run("drive 1: 99.9 Hz of 50"))] == ["99.9"]
    assert display.all_in(run("done 12.34")) == []


def test_display_of_a_raw_number_is_learned():
    runs = [run("value 1234"), run("value 2345")]
    assert learned_display(runs, [Decimal("12.34"), Decimal("23.45")], [1234, 2345], None).is_raw


def test_display_with_another_scale_needs_the_scale_of_the_task():
    runs = [run("value 123.4"), run("value 234.5")]
    held = [Decimal("12.34"), Decimal("23.45")], [1234, 2345]
    assert learned_display(runs, *held, None) is None
    assert learned_display(runs, *held, Decimal(10)).scale == 10


def test_error_output_contains_no_value():
    (display, _) = displays_of("([0-9.]+)", None)
    assert display.all_in(run("timeout after 3 attempts")) == []
    assert display.all_in(run("12.5", is_error=True)) == []
    assert display.all_in(run("12.5", code=1)) == []
    assert [each.text for each in display.all_in(run("12.5"))] == ["12.5"]
