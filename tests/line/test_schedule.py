"""Schedules of poll plans, without a line: the next item, and the fields of its result."""

import math
from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given, settings, strategies as st

from drivecomm.errors import NoReplyError, RefusedError, UsageError
from drivecomm.line import PRIORITY_STEP_S, PollItem, Schedule, poll
from drivecomm.protocol import Reading


@dataclass(eq=False)
class Pump:
    name: str = "pump"


PUMP = Pump()


def item(parameter="1", **facts):
    return PollItem(drive=PUMP, parameter=parameter, **facts)


def reading(time_s=0.0, value=5):
    return Reading(parameter="1", value=value, raw=value, time_s=time_s)


def carried_out(items, until, takes, *, fails=(), start=0.0):
    """Carry out a schedule with reads of known length; return each item, the time of its request, and its result."""
    schedule = Schedule(items, start_s=start)
    now, done = start, []
    while True:
        now = max(now, schedule.next_due())
        if now >= start + until:
            return done
        one = schedule.due(now)
        asked = now
        now += takes[items.index(one)]
        outcome = NoReplyError("nothing came") if items.index(one) in fails else reading(now)
        done.append((one, asked, schedule.finished(one, now, outcome, time_s=now)))


# The schedule


def test_every_item_has_its_period():
    items = [item("1", period_s=1.0), item("2", period_s=0.25)]
    done = carried_out(items, 10.0, [0.01, 0.01])
    assert sum(one is items[0] for one, _, _ in done) == 10
    assert sum(one is items[1] for one, _, _ in done) == 40
    assert all(not result.missed and result.late_s < 0.011 for _, _, result in done)


def test_items_with_the_same_period_are_spread_over_it():
    items = [item(str(number), period_s=0.4) for number in range(4)]
    done = carried_out(items, 4.0, [0.001] * 4)
    assert [round(asked, 3) for _, asked, _ in done[:6]] == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert all(result.late_s == 0 for _, _, result in done)


def test_long_period_does_not_delay_the_first_value():
    items = [item(str(number), period_s=60.0) for number in range(10)]
    done = carried_out(items, 200.0, [0.001] * 10)
    asked = {one.parameter: [] for one in items}
    for one, at, _ in done:
        asked[one.parameter].append(at)
    assert max(times[0] for times in asked.values()) < 1.0
    for number, times in enumerate(asked.values()):
        assert times[1:] == pytest.approx([60.0 + 6 * number, 120.0 + 6 * number, 180.0 + 6 * number][: len(times) - 1])


def test_item_that_misses_its_periods_does_not_catch_up():
    slow, quick = item("slow", period_s=10.0), item("quick", period_s=0.1)
    done = carried_out([slow, quick], 3.0, [0.55, 0.01])
    asked = [(round(asked, 6), result.missed) for one, asked, result in done if one is quick]
    # The slow item takes from 0 to 0.55; then the quick one is read once, and resumes its own rhythm.
    assert asked[:4] == [(0.55, 0), (0.6, 5), (0.7, 0), (0.8, 0)]


def test_earliest_due_item_goes_first_and_priority_moves_ahead():
    schedule = Schedule([item("a", period_s=5.0), item("b", period_s=5.0, priority=1)], start_s=0.0)
    # a is due at 0, b at 0.5; at 0.4 b is not due yet, at 0.6 its priority counts for a second.
    assert schedule.due(0.4).parameter == "a"
    again = Schedule([item("a", period_s=5.0), item("b", period_s=5.0, priority=1)], start_s=0.0)
    assert again.due(0.6).parameter == "b"


def test_priority_counts_one_second_per_step():
    wanted, other = item("wanted", period_s=0.1, priority=3), item("other", period_s=0.1)
    done = carried_out([wanted, other], 60.0, [0.2, 0.2])
    times = [asked for one, asked, _ in done if one is other]
    assert len(times) >= 60 / (3 * PRIORITY_STEP_S + 1)
    assert sum(one is wanted for one, _, _ in done) > 2 * len(times)


def test_item_without_a_period_is_read_whenever_the_line_is_free():
    greedy, calm = item("greedy", period_s=0), item("calm", period_s=0.5)
    done = carried_out([greedy, calm], 10.0, [0.1, 0.1])
    assert sum(one is calm for one, _, _ in done) == 20
    assert sum(one is greedy for one, _, _ in done) in {80, 81}
    assert all(result.late_s <= 0.1 + 1e-9 for one, _, result in done if one is calm)


def test_item_without_a_period_yields_to_an_item_due_slightly_later():
    greedy, calm = item("greedy", period_s=0), item("calm", period_s=0.5)
    schedule = Schedule([greedy, calm], start_s=0.0)
    for one in (schedule.due(0.0), schedule.due(0.0)):
        schedule.finished(one, 0.1, reading(), time_s=0.1)
    # The item without a period is due since 0.1, the other one since 0.5.
    assert [schedule.due(0.6) for _ in range(2)] == [calm, greedy]


def test_failed_item_without_a_period_rests_before_its_next_read():
    done = carried_out([item("1", period_s=0)], 0.95, [0.0], fails={0})
    assert len(done) == 10


def test_cycles_limit_the_reads_of_each_item():
    items = [item("1", period_s=0.1), item("2", period_s=1.0)]
    schedule, now, seen = Schedule(items, start_s=5.0, cycles=3), 5.0, []
    while (now := max(now, schedule.next_due())) < math.inf:
        one = schedule.due(now)
        seen.append(one.parameter)
        schedule.finished(one, now, reading(), time_s=now)
    assert sorted(seen) == ["1"] * 3 + ["2"] * 3
    assert schedule.due(1e9) is None


def test_item_is_not_due_before_its_time():
    schedule = Schedule([item("1", period_s=1.0)], start_s=100.0)
    assert schedule.due(99.9) is None
    assert schedule.next_due() == 100.0
    one = schedule.due(100.0)
    assert schedule.next_due() == math.inf
    schedule.finished(one, 100.1, reading(), time_s=100.1)
    assert schedule.next_due() == 101.0


plans = st.lists(
    st.tuples(
        st.sampled_from([0.05, 0.1, 0.25, 1.0, 3.0]),  # period
        st.integers(-2, 3),  # priority
        st.floats(0.001, 0.6),  # duration of a read
        st.booleans(),  # whether the read fails
    ),
    min_size=1,
    max_size=8,
)


@pytest.mark.soak
@given(plans)
@settings(max_examples=60, deadline=None)
def test_every_item_gets_its_turn_and_at_most_one_per_period(plan):
    items = [item(str(n), period_s=period, priority=priority) for n, (period, priority, _, _) in enumerate(plan)]
    takes = [seconds for _, _, seconds, _ in plan]
    round_s = sum(takes)
    done = carried_out(items, 40.0, takes, fails={n for n, row in enumerate(plan) if row[3]})
    for number, one in enumerate(items):
        mine = [(asked, result) for who, asked, result in done if who is one]
        # At most once in each of its periods, and every period is either read or counted as missed.
        dues = [result.due_s for _, result in mine]
        assert all(later - earlier >= one.period_s - 1e-6 for earlier, later in pairwise(dues))
        assert all(asked >= result.due_s - 1e-9 for asked, result in mine)
        for (_, before), (_, after) in pairwise(mine[1:]):
            periods = (after.due_s - before.due_s) / one.period_s
            assert periods == pytest.approx(after.missed + 1, abs=1e-6)
        # A due item waits at most for the items before it, and for items that their priority moves ahead.
        ahead = (max(each.priority for each in items) - one.priority) * PRIORITY_STEP_S
        longest = 2 * one.period_s + ahead + 2 * round_s + max(takes)
        times = [0.0, *(asked for asked, _ in mine), 40.0]
        assert max(later - earlier for earlier, later in pairwise(times)) <= longest, number


@given(plans)
@settings(max_examples=60, deadline=None)
def test_overdue_item_with_the_earliest_deadline_goes_first(plan):
    items = [item(str(n), period_s=period) for n, (period, _, _, _) in enumerate(plan)]
    takes = [seconds for _, _, seconds, _ in plan]
    done = carried_out(items, 20.0, takes)
    ended, open_due = {}, {}
    for one, asked, result in done:
        for other in items:
            if other is not one and other in open_due and open_due[other] <= asked:
                assert result.due_s <= open_due[other] + 1e-9
        ended[one] = asked + takes[items.index(one)]
        following = [later for who, _, later in done if who is one and later.due_s > result.due_s]
        open_due[one] = following[0].due_s if following else math.inf


@given(st.lists(st.floats(0.001, 0.05), min_size=2, max_size=8), st.integers(0, 7))
@settings(max_examples=60, deadline=None)
def test_bad_parameter_delays_the_others_by_its_own_exchange_only(takes, bad):
    bad %= len(takes)
    items = [item(str(n), period_s=2.0) for n in range(len(takes))]
    sound = carried_out(items, 20.0, takes)
    disturbed = carried_out(items, 20.0, [0.7 if n == bad else s for n, s in enumerate(takes)], fails={bad})
    late = {(r.parameter, round(r.due_s, 6)): r.late_s for _, _, r in disturbed}
    for _, _, result in sound:
        if result.due_s >= 18.0:
            # Near the end, the disturbed plan has not reached this item yet.
            continue
        assert late[result.parameter, round(result.due_s, 6)] <= result.late_s + 0.7 + sum(takes)


# Results


def test_failure_is_stale_while_the_last_value_is_young_then_bad():
    one = item("1", period_s=1.0)
    schedule = Schedule([one], start_s=0.0)
    error = RefusedError("1", 3, "no")
    qualities = []
    for turn in range(7):
        schedule.due(float(turn))
        outcome = reading(1000.0 + turn) if turn == 1 else error
        qualities.append(schedule.finished(one, turn + 0.1, outcome, time_s=1000.0 + turn))
    assert [result.quality for result in qualities] == ["bad", "good", "stale", "stale", "stale", "bad", "bad"]
    first, good, stale, last = qualities[0], qualities[1], qualities[3], qualities[6]
    assert (first.reading, first.time_s, first.error) == (None, 1000.0, error)
    assert (good.cause, good.error, good.time_s) == ("", None, 1001.0)
    assert (stale.reading, stale.reading.time_s, stale.time_s) == (good.reading, 1001.0, 1003.0)
    assert stale.cause == "the drive refused parameter 1 with code 3: no"
    assert (last.reading, last.time_s) == (None, 1006.0)


@pytest.mark.parametrize(("facts", "keeps_s"), [({"stale_after_s": 0}, 0), ({"period_s": 0}, 1.0), ({}, 3.0)])
def test_value_is_kept_for_three_periods_or_stale_after_s(facts, keeps_s):
    assert item("1", **facts).keeps_s == keeps_s


def test_results_have_the_drive_name_of_the_plan():
    one = item("1", name="well 3")
    schedule = Schedule([one], start_s=0.0)
    schedule.due(0.0)
    result = schedule.finished(one, 0.25, reading(), time_s=0.0)
    assert (result.drive, result.parameter, result.item) == ("well 3", "1", one)
    assert (result.due_s, result.late_s, result.took_s) == (0.0, 0.0, 0.25)


def test_impossible_plans_are_refused():
    with pytest.raises(UsageError, match="at least one item"):
        poll([])
    with pytest.raises(UsageError, match="pump 1 twice"):
        Schedule([item("1"), item("1")], start_s=0.0)
    with pytest.raises(UsageError, match="invalid cycles = 0; use 1 or more"):
        Schedule([item("1")], start_s=0.0, cycles=0)
    for wrong in (-1.0, math.inf, math.nan):
        with pytest.raises(UsageError, match="period_s of 1 is"):
            item("1", period_s=wrong)
        with pytest.raises(UsageError, match="stale_after_s of 1 is"):
            item("1", stale_after_s=wrong)
    # The same parameter with other options or periods is another item.
    Schedule([item("1"), item("1", options={"dataset": 2}), item("1", period_s=5)], start_s=0.0)
