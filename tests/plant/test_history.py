"""Trends: samples of a value in cells of equal time."""

from hypothesis import given, strategies as st

from drivecomm.plant.watching import Trend


def trend_of(*samples, keeps_s=3.0):
    trend = Trend(keeps_s=keeps_s)
    for time_s, value in samples:
        trend.add(time_s, value)
    return trend


def test_cells_hold_the_latest_value_before_their_end():
    trend = trend_of((0.0, 1.0), (1.0, 2.0), (2.0, 3.0))
    assert trend.cells(4, until_s=2.0, each_s=1.0) == [None, 1.0, 2.0, 3.0]
    assert trend.cells(2, until_s=2.9, each_s=1.0) == [2.0, 3.0]


def test_failure_and_long_silence_are_gaps():
    trend = trend_of((0.0, 1.0), (1.0, None), (2.0, 3.0))
    assert trend.cells(3, until_s=2.0, each_s=1.0) == [1.0, None, 3.0]
    assert trend.cells(2, until_s=6.0, each_s=1.0) == [3.0, None]


def test_oldest_samples_are_dropped_from_a_full_trend():
    trend = Trend(keeps_s=1, room=2)
    for time_s in range(5):
        trend.add(time_s, float(time_s))
    assert [sample.time_s for sample in trend.samples] == [3, 4]


@given(
    st.lists(st.one_of(st.none(), st.floats(-1e6, 1e6)), max_size=50),
    st.integers(1, 80),
    st.floats(0.01, 10),
    st.floats(0, 100),
)
def test_cells_hold_only_sampled_values(values, number, each_s, until_s):
    trend = trend_of(*enumerate(values))
    cells = trend.cells(number, until_s=until_s, each_s=each_s)
    assert len(cells) == number
    assert {cell for cell in cells if cell is not None} <= {value for value in values if value is not None}
