"""A stop goes out behind two telegrams of its line at most, whoever floods the line and whichever door it comes by."""

import sys

import pytest
from extents import LONG
from stop_latency import DOORS, FLOODS, OF_MANY, measured

MOST_BEHIND = 2
"""Telegrams that may go out after a stop was asked for and before its own, besides the one that is under way."""
BUSY = 0.6
"""Of the line's time, while a flood that reaches it goes on; the rest is the silence that protocols want."""


@pytest.mark.soak
@pytest.mark.skipif(not LONG, reason="measured with nothing beside it: DRIVECOMM_LONG=1")
@pytest.mark.skipif(sys.platform != "linux", reason="it needs descriptors of the Linux kernel")
@pytest.mark.parametrize("flood", FLOODS, ids=lambda each: each.__name__)
def test_a_stop_goes_out_behind_two_telegrams_at_most(flood):
    found = {door: measured(flood, door) for door in DOORS}
    assert max(behind for behind, *_ in found.values()) <= MOST_BEHIND, found
    assert flood not in OF_MANY or min(busy for *_, busy in found.values()) >= BUSY, found
