"""One commander for each drive, over all connections and doors."""

import time
from dataclasses import replace

import pytest
from commanded_plant import DONE, MINE, NO_LEASE, NOT_ALLOWED, REFUSED, RESET, START, Plc
from served_core import OPERATOR

OTTO = replace(OPERATOR, door="modbus-tcp 127.0.0.1:1")
"""A caller at another Modbus TCP door, with the same rights on the drive."""


class TestCommanders:
    def test_second_connection_from_the_same_address_gets_no_lease(self, served, plc):
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

    def test_second_connection_with_an_alternating_heartbeat_gets_no_lease(self, served, plc):
        plc.take_lease()
        with served.master() as other:
            second = Plc(other)
            second.write()
            for _ in range(20):
                plc.cycle()
                # The heartbeat of the first connection counts up, so the second connection is ignored.
                second.cycle()
                time.sleep(0.02)
            second.command, second.sequence = START, 1
            plc.cycle()
            second.cycle()
            results = second.results()
            assert (results.answered, results.outcome, results.reason) == (1, REFUSED, NO_LEASE)
        assert not served.runs()

    @pytest.mark.soak
    def test_reconnect_in_time_keeps_the_lease(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.master.close()
        with served.master() as again:
            plc.master = again
            plc.write()
            plc.cycles_for(1.5)
            assert served.runs()
            assert plc.results().lease == MINE

    @pytest.mark.soak
    def test_new_connection_takes_over_from_a_silent_open_one(self, served, plc):
        """A cut cable leaves the old connection open.

        It loses the drive after half of the lease time without a heartbeat.
        """
        plc.give(START, kind=1, reference=50.0)
        with served.master() as again:
            plc.master = again
            plc.write()
            plc.cycles_for(2.0)
            assert served.runs()
            assert plc.results().lease == MINE

    def test_plc_resets_a_fault_and_may_not_start_an_unlisted_drive(self, served):
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
