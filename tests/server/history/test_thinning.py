"""Thinning of a curve for a plot: its ends, extremes and gaps remain, and no other value appears."""

from itertools import pairwise

from hypothesis import given, strategies as st

from drivecomm.plant import SpanOutline
from drivecomm.server.history.thinning import CoursePoint, thinned

numbers = st.one_of(st.none(), st.integers(-50, 50))
courses = st.lists(numbers, min_size=1, max_size=300)


def points_of(values):
    return [
        CoursePoint(float(second), value, "bad" if value is None else "good") for second, value in enumerate(values)
    ]


def runs(values):
    """Return the curve as alternating runs: True for values, False for a gap."""
    told = [value is not None for value in values]
    return told[:1] + [after for before, after in pairwise(told) if after != before]


def edges(points):
    """Return the times at which gaps begin, and those of the first value after each gap."""
    return [after.time_s for before, after in pairwise(points) if (before.value is None) != (after.value is None)]


def test_thinned_curve_continues_after_a_gap():
    course = [CoursePoint(second, 120.0 + second, "good") for second in range(20)]
    course += [CoursePoint(20, None, "bad")]
    course += [CoursePoint(second, 130.0, "good") for second in range(21, 39)]
    assert [(point.time_s, point.value) for point in thinned(course, 0, 86400, 500)] == [
        (0, 120.0), (19, 139.0), (20, None), (21, 130.0), (38, 130.0),
    ]  # fmt: skip


@given(courses, st.integers(4, 200))
def test_thinned_curve_keeps_order_ends_and_extremes(values, most):
    points = points_of(values)
    found = list(thinned(points, 0, len(values), most))
    assert [point for point in points if point in set(found)] == found
    assert (found[0], found[-1]) == (points[0], points[-1])
    known = [value for value in values if value is not None]
    if known:
        kept = [point.value for point in found if point.value is not None]
        assert (min(kept), max(kept)) == (min(known), max(known))
    stretches = max(1, most // SpanOutline.POINTS)
    assert len(found) <= (stretches + 1) * (SpanOutline.POINTS + 3 * (SpanOutline.MOST_GAPS + 1))


@given(courses, st.integers(4, 200))
def test_thinned_curve_keeps_begin_and_end_of_its_gaps(values, most):
    points = points_of(values)
    found = list(thinned(points, 0, len(values), most))
    width = len(values) / max(1, most // SpanOutline.POINTS)
    by_stretch = {}
    for point in points:
        by_stretch.setdefault(int(point.time_s / width), []).append(point)
    if all(runs([point.value for point in each]).count(False) <= SpanOutline.MOST_GAPS for each in by_stretch.values()):
        assert runs([point.value for point in found]) == runs(values)
        assert edges(found) == edges(points)


@given(st.lists(numbers, min_size=40, max_size=300))
def test_outline_with_too_many_gaps_keeps_the_first_and_the_last(values):
    outline = SpanOutline()
    for place, value in enumerate(values):
        outline.add(place, value)
    kept = outline.kept()
    assert len(kept) <= SpanOutline.POINTS + 3 * (SpanOutline.MOST_GAPS + 1)
    gaps = [place for place, value in enumerate(values) if value is None]
    if gaps:
        assert gaps[0] in kept
        begin_of_last = max(place for place in gaps if place == 0 or values[place - 1] is not None)
        assert begin_of_last in kept


@given(st.lists(st.sampled_from(["ready", "running", None]), min_size=1, max_size=100))
def test_thinned_texts_keep_only_their_changes(values):
    points = points_of(values)
    found = list(thinned(points, 0, len(values), 10_000))
    changes = [points[0], *(after for before, after in pairwise(points) if after.value != before.value)]
    assert [point for point in found if point.value] == [point for point in changes if point.value]
    assert runs([point.value for point in found]) == runs(values)
