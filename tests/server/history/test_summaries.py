"""Summaries of a quantity over time intervals, compared with values calculated by hand."""

from decimal import Decimal

import pytest
from hypothesis import given, strategies as st

from drivecomm.server.history import CoursePoint, summarized


def course(*points):
    return [CoursePoint(time_s, value, "bad" if value is None else "good") for time_s, value in points]


def test_summary_interpolates_linearly_between_values():
    first, second, third = summarized(
        course((-5, 10), (5, Decimal("20.0")), (10, 30), (20, 30), (25, 0), (30, 5)), [(0, 10), (10, 20), (20, 30)]
    )
    assert (first.at_begin, first.number, first.mean, first.mean_over_time) == (15, 1, 20, 21.25)
    assert (second.at_begin, second.number, second.mean, second.mean_over_time) == (30, 1, 30, 30)
    assert (third.number, third.mean, third.lowest, third.highest) == (2, 15, 0, 30)
    assert third.mean_over_time == pytest.approx((75 + 12.5) / 10)
    assert not any(each.is_held or each.has_gap for each in (first, second, third))


def test_summary_before_the_first_value_is_empty():
    first, second, third = summarized(course((15, 4), (40, 4)), [(0, 10), (10, 20), (20, 30)])
    assert (first.number, first.mean, first.mean_over_time, first.at_begin) == (0, None, None, None)
    assert (second.mean_over_time, second.known_s, second.at_begin) == (4, 5, None)
    assert (third.mean, third.mean_over_time, third.at_begin) == (None, 4, 4)


def test_summary_holds_the_last_value():
    first, second = summarized(course((0, 2), (5, 6)), [(0, 10), (10, 20)])
    assert (first.mean_over_time, first.is_held) == (5, True)
    assert (second.at_begin, second.mean_over_time, second.number, second.is_held) == (6, 6, 0, True)


def test_intervals_with_missing_values_are_marked():
    points = course((1, 2), (12, None), (15, None), (21, 2), (25, 2), (31, 2))
    assert [each.has_gap for each in summarized(points, [(0, 10), (10, 20), (20, 30), (30, 40)])] == [
        False, True, True, False,
    ]  # fmt: skip
    (alone,) = summarized(course((1, 2), (5, None)), [(0, 10)])
    assert alone.has_gap


def test_summary_ignores_texts_and_values_from_a_clock_set_back():
    (found,) = summarized(
        [CoursePoint(1, 2, "good"), CoursePoint(0, 9, "good"), CoursePoint(3, "on", "good"), CoursePoint(4, 4, "good")],
        [(0, 5)],
    )
    assert (found.number, found.mean, found.has_gap) == (2, 3, True)


@given(
    values=st.dictionaries(st.integers(0, 100), st.integers(-50, 50), min_size=1, max_size=20),
    width=st.integers(1, 40),
)
def test_summaries_of_intervals_add_up_to_the_summary_of_the_whole(values, width):
    points = course(*sorted(values.items()))
    (whole,) = summarized(points, [(0, 120)])
    parts = summarized(points, [(at, min(at + width, 120)) for at in range(0, 120, width)])
    assert sum(each.number for each in parts) == whole.number
    assert sum(each.area for each in parts) == pytest.approx(whole.area)
    assert sum(each.known_s for each in parts) == pytest.approx(whole.known_s)
    assert min(each.lowest for each in parts if each.number) == whole.lowest
    assert max(each.highest for each in parts if each.number) == whole.highest
