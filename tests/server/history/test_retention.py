"""Removal of old values by age and by file size; a clock that is wrong for a while deletes nothing too early."""

import time
from types import SimpleNamespace

import pytest
from past_values import NOON, event, value

from drivecomm.server.history import History, HistoryWriter, age, journal as journals, store

DAY = 86400


@pytest.fixture
def file(tmp_path):
    return tmp_path / "history.sqlite"


@pytest.fixture
def small_segments(monkeypatch):
    monkeypatch.setattr(store, "ROWS_A_SEGMENT", 1000)


def filled(file, count, *, apart_s=1.0, text=""):
    one = store.HistoryFile(file)
    for first in range(0, count, 1000):
        one.add([value(n, time_s=NOON + n * apart_s, text=text) for n in range(first, first + 1000)], [])
        one.sort()
    return one


@pytest.mark.usefixtures("small_segments")
def test_values_and_events_beyond_the_age_limit_are_dropped_in_steps(file):
    one = filled(file, 5000)
    one.add([], [event(n) for n in range(5000)])
    dropped = 0
    while one.drop_oldest(before_s=NOON + 2500, megabytes=1000):
        dropped += 1
    one.close()
    with History(file) as history:
        assert history.values().__next__().time_s == NOON + 2000
        assert history.events()[0].event.number == 2500
    assert dropped == 2


@pytest.mark.soak
@pytest.mark.usefixtures("small_segments")
def test_oldest_rows_are_dropped_beyond_the_size_limit(file):
    filled(file, 30_000).close()
    full = file.stat().st_size
    one = store.HistoryFile(file)
    while one.drop_oldest(before_s=0, megabytes=full / 2e6):
        pass
    one.close()
    assert file.stat().st_size <= full / 2
    with History(file) as history:
        rows = [each.row for each in history.values()]
    assert rows[-1] == 30_000
    assert 8_000 < len(rows) < 16_000
    assert rows == list(range(rows[0], 30_001))


@pytest.mark.usefixtures("small_segments")
def test_row_numbers_continue_after_all_rows_were_dropped(file):
    one = filled(file, 3000)
    while one.drop_oldest(before_s=NOON * 2, megabytes=1000):
        pass
    one.close()
    again = store.HistoryFile(file)
    again.add([value(1)], [])
    again.close()
    with History(file) as history:
        assert list(history.values())[-1].row == 3001


@pytest.mark.soak
def test_oldest_events_are_dropped_beyond_the_size_limit(file):
    one = store.HistoryFile(file)
    for _ in range(4):
        one.add([], [event(n, "x" * 500) for n in range(10_000)])
    one.drop_oldest(before_s=0, megabytes=10)
    one.close()
    with History(file) as history:
        assert len(history.events()) == 30_000


def test_age_limit_applies_after_an_hour_and_lags_by_one():
    limit = age.AgeLimit(30)
    assert limit.before_s(NOON, 5.0) == 0
    assert limit.before_s(NOON + 3599, 3604.0) == 0
    assert limit.before_s(NOON + 3600, 3605.0) == NOON - 30 * DAY
    assert limit.before_s(NOON + 7200, 7205.0) == NOON + 3600 - 30 * DAY


@pytest.mark.parametrize("wrong_s", [365 * DAY, -365 * DAY])
def test_clock_wrong_for_half_an_hour_deletes_nothing_too_early(wrong_s):
    limit = age.AgeLimit(30)
    for steady_s in range(0, 5 * 3600, 60):
        wrong = 7000 <= steady_s < 8800
        now_s = NOON + steady_s
        assert limit.before_s(now_s + wrong * wrong_s, steady_s) <= now_s - 30 * DAY


@pytest.mark.soak
@pytest.mark.usefixtures("small_segments")
def test_journal_drops_old_values_after_an_hour(file, monkeypatch):
    monkeypatch.setattr(journals, "COMMITTED_EVERY_S", 0.001)
    filled(file, 5000).close()
    steady_s, wall_s = [0.0], NOON + 4200 + 30 * DAY
    clock = SimpleNamespace(time=lambda: wall_s, monotonic=lambda: steady_s[0])
    monkeypatch.setattr(journals, "time", clock)
    journal = HistoryWriter(file, days=30)

    def kept():
        with History(file) as history:
            return sum(each.quality == "good" for each in history.values())

    for wanted, now_s in ((5000, 3500.0), (1000, 8000.0)):
        steady_s[0] = now_s
        for _ in range(200):
            if kept() == wanted:
                break
            time.sleep(0.01)
        assert kept() == wanted
    journal.close()
