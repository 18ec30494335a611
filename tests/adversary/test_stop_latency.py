"""A stop is sent after at most two telegrams of its line, for every kind of flood and every door."""

import sys

import pytest
from extents import LONG
from stop_latency import DOORS, FLOODS, OF_MANY, measured

MOST_BEHIND = 2
"""Limit of telegrams between the request for a stop and the stop, in addition to the telegram under way."""
BUSY = 0.6
"""Minimum share of the line's time in use during a flood that reaches it; the rest is the silence of the protocols."""


@pytest.mark.soak
@pytest.mark.skipif(not LONG, reason="measured with nothing beside it: DRIVECOMM_LONG=1")
@pytest.mark.skipif(sys.platform != "linux", reason="it needs descriptors of the Linux kernel")
@pytest.mark.parametrize("flood", FLOODS, ids=lambda each: each.__name__)
def test_stop_is_sent_after_two_telegrams_at_most(flood):
    found = {door: measured(flood, door) for door in DOORS}
    assert max(behind for behind, *_ in found.values()) <= MOST_BEHIND, found
    assert flood not in OF_MANY or min(busy for *_, busy in found.values()) >= BUSY, found
