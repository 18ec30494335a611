"""One commander for each drive, over all connections and doors."""

import time
from dataclasses import replace

import pytest
from commanded_plant import DONE, MINE, NO_LEASE, NOT_ALLOWED, REFUSED, RESET, START, Plc
from served_core import OPERATOR

OTTO = replace(OPERATOR, door="modbus-tcp 127.0.0.1:1")
"""Somebody at another door of this kind, to which the drive allows the same."""


class TestCommanders:
    def test_a_second_connection_of_the_same_address(self, served, plc):
        plc.take_lease()
        with served.master() as other:
            second = Plc(other)
            second.heartbeat = 30000
            second.write()
            for _ in range(10):
                second.cycle()
                plc.cycle()
            second.cycle()
            time.sleep(0.05)
            second.command, second.sequence = START, 1
            second.write()
            assert second.results().reason == NO_LEASE
        assert not served.runs()

    def test_second_connection_that_counts_right_after_each_beat_of_the_first_gets_no_lease(self, served, plc):
        plc.take_lease()
        with served.master() as other:
            second = Plc(other)
            second.write()
            for _ in range(20):
                plc.cycle()
                # The first is neither gone nor quiet, so this one is ignored.
                second.cycle()
                time.sleep(0.02)
            second.command, second.sequence = START, 1
            plc.cycle()
            second.cycle()
            results = second.results()
            assert (results.answered, results.outcome, results.reason) == (1, REFUSED, NO_LEASE)
        assert not served.runs()

    @pytest.mark.soak
    def test_a_connection_that_comes_again_in_time_has_the_lease_still(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.master.close()
        with served.master() as again:
            plc.master = again
            plc.write()
            plc.cycles_for(1.5)
            assert served.runs()
            assert plc.results().lease == MINE

    @pytest.mark.soak
    def test_a_connection_that_nobody_has_closed_is_followed_by_the_next(self, served, plc):
        """As after a cut cable; what is too late for half of the lease's time."""
        plc.give(START, kind=1, reference=50.0)
        with served.master() as again:
            plc.master = again
            plc.write()
            plc.cycles_for(2.0)
            assert served.runs()
            assert plc.results().lease == MINE

    def test_a_fault_is_reset(self, served):
        with served.master(unit=2) as master:
            plc = Plc(master)
            served.control.order("trip", drive="fan", code=14)
            plc.cycles_until(lambda: plc.state() & 0b100000)
            assert plc.give(RESET).outcome == DONE
            plc.cycles_until(lambda: plc.state() and not plc.state() & 0b100000)
            plc.command, plc.sequence = START, plc.sequence + 1
            results = plc.answered()
            assert (results.outcome, results.reason) == (REFUSED, NOT_ALLOWED)
        assert not served.runs("fan")
