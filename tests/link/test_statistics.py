"""Names of counters, and statistics of reply times."""

import re
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import get_args

import pytest

import drivecomm
from drivecomm.errors import Category
from drivecomm.link import COUNTERS, REPLY_TIME_BOUNDS_MS, ReplyTimes, Statistics, link, total
from drivecomm.virtual import VirtualLine, virtual_drive


def times(*milliseconds):
    made = ReplyTimes()
    for each in milliseconds:
        made.add(each / 1000)
    return made


def test_reply_times_without_a_reply_are_zero():
    assert (ReplyTimes().percentile_s(50), ReplyTimes().mean_s) == (0.0, 0.0)


@pytest.mark.parametrize("percent", [0, 50, 99, 100])
def test_single_reply_is_every_percentile(percent):
    assert times(12.0).percentile_s(percent) == pytest.approx(0.012)


def test_percentiles_are_as_exact_as_their_class():
    random = Random(3)
    for _ in range(50):
        given = sorted(random.expovariate(1 / 30) for _ in range(random.randint(1, 300)))
        histogram = times(*given)
        previous = 0.0
        for percent in range(101):
            found = histogram.percentile_s(percent) * 1000
            exact = given[max(0, -(-len(given) * percent // 100) - 1)]
            bounds = [0, *REPLY_TIME_BOUNDS_MS, max(given[-1], 1000) + 1]
            lower, upper = next((low, high) for low, high in pairwise(bounds) if low < exact <= high)
            assert lower - 1e-9 <= found <= upper + 1e-9
            assert given[0] - 1e-9 <= found <= given[-1] + 1e-9
            assert found >= previous - 1e-9
            previous = found


def test_bound_belongs_to_the_class_below():
    histogram = times(1.0, 1.001, 2.0)
    assert histogram.classes[:3] == [1, 2, 0]


def test_percentile_assumes_evenly_spaced_replies_within_a_class():
    assert times(11, 12, 13, 14).percentile_s(50) == pytest.approx(0.0125)


def test_longest_and_shortest_reply_times_come_in_any_order():
    histogram = times(5.0, 9.0, 2.0)
    assert (histogram.shortest_s, histogram.longest_s) == (0.002, 0.009)


def test_percentile_above_all_classes_is_the_longest_reply():
    assert times(5.0, 2500.0).percentile_s(100) == pytest.approx(2.5)


def test_total_adds_the_statistics_of_drives():
    line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3)])
    with drivecomm.open_bus(line.port) as bus:
        for _ in range(3):
            bus.drive("vabus", 1).read("481")
        bus.drive("danfoss-fc", 3).read("16-30")
        with pytest.raises(drivecomm.NoReplyError):
            bus.drive("fuji", 9, attempts=1).read("M21")
        each = bus.statistics
        both = total(each.values())
    assert both.counters == {"requests": 5, "replies": 4, "timeouts": 1}
    assert both.reply_times.count == 4
    assert both.reply_times.shortest_s == min(one.reply_times.shortest_s for one in each.values())
    assert both.reply_times.longest_s == max(one.reply_times.longest_s for one in each.values())
    assert both.reply_times.total_s == pytest.approx(sum(one.reply_times.total_s for one in each.values()))
    assert each["vabus:1"].counters == {"requests": 3, "replies": 3}, "the drives' own are left as they are"
    assert total([]) == Statistics()


def test_every_counter_of_the_link_is_documented():
    """The link names a counter by one literal, by one of two literals, or by the category of an error."""
    folder = Path(link.__file__).parent
    source = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.py"))
    used = set()
    for inside in re.findall(r"\bcount\[([^\]]*)\]", source):
        if inside.startswith('f"{'):
            used |= {f"{kind} errors" for kind in get_args(Category)}
        else:
            used |= set(re.findall(r'"([^"]+)"', re.sub(r'== "\w+"', "", inside)))
    assert used == set(COUNTERS)
