"""Starts by registers: a new command of a PLC starts a motor once, and no other register content does."""

import time

import pytest
from commanded_plant import (
    AGAIN,
    BACKWARDS,
    DONE,
    HEARTBEAT,
    MINE,
    NO_COMMAND,
    NO_LEASE,
    NOBODY,
    NOT_ALLOWED,
    REFUSED,
    SEQUENCE,
    START,
    STOP,
    Plc,
)
from raw_master import until


class TestStart:
    @pytest.mark.soak
    def test_start_by_the_full_handshake_runs_the_motor(self, served, plc):
        results = plc.give(START, kind=1, reference=50.0)
        assert (results.outcome, results.reason) == (DONE, 0)
        assert served.runs()
        assert served.verbs() == ["keep"]
        assert served.notes.asked_for[0][0] == f"127.0.0.1 ({served.door.name})"
        state = plc.cycles_until(lambda: plc.state() & 0b1000 and plc.state())
        assert state & 0b1100_0000_0000 == 0b1100_0000_0000
        assert not state & 0b100000

    @pytest.mark.soak
    def test_motor_runs_only_while_the_heartbeat_counts(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.cycles_for(1.5)
        assert served.runs()
        # The PLC halts: its connection stays open, and its block keeps its content.
        for _ in range(10):
            plc.write()
            time.sleep(0.02)
        until(lambda: not served.runs())
        assert any(event.kind == "link loss" for event in served.plant.events())
        plc.cycles_for(1.5)
        assert not served.runs(), "a resumed heartbeat must not start the motor"

    @pytest.mark.soak
    def test_lost_connection_lets_the_lease_expire(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.master.close()
        assert served.runs()
        until(lambda: not served.runs())

    @pytest.mark.soak
    def test_heartbeat_zero_releases_the_lease_immediately(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.heartbeat = 0
        plc.write()
        until(lambda: not served.plant.leases(), 0.5)
        time.sleep(0.2)
        assert not served.plant.leases(), "the earlier heartbeat must not acquire the lease again"
        until(lambda: not served.runs())

    def test_reverse_start_needs_its_own_permission(self, served, plc):
        results = plc.give(BACKWARDS, kind=1, reference=50.0)
        assert (results.outcome, results.reason) == (REFUSED, NOT_ALLOWED)
        assert not served.runs()

    @pytest.mark.soak
    def test_start_of_a_running_motor_is_refused(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        results = plc.give(START)
        assert results.outcome == REFUSED
        assert served.runs()

    def test_start_works_with_single_register_writes(self, served, plc):
        """Some masters know only function 06; they set the reference, a number of two registers, in another way."""
        master = plc.master
        for heartbeat in range(1, 100):
            master.write_one(HEARTBEAT, heartbeat)
            if plc.results().lease == MINE:
                break
            time.sleep(0.02)
        master.write_one(SEQUENCE, 7)
        master.write_one(1003, START)
        assert not served.verbs()
        master.write_one(SEQUENCE, 8)
        until(lambda: plc.results().outcome == DONE)
        assert plc.results().answered == 8
        assert served.runs()

    def test_start_works_with_write_and_read_in_one_telegram(self, plc):
        plc.take_lease()
        plc.heartbeat += 1
        plc.sequence, plc.command, plc.kind, plc.reference = 1, START, 1, 50.0
        words = (0, plc.heartbeat, 1, START, 1, 0, 0x4248, 0)
        answer = plc.master.write_and_read(STOP, words, STOP, 16)
        assert answer[:8] == list(words)
        assert answer[8] == 1
        # The heartbeat has to count on, or the lease expires before a busy machine has started the motor.
        assert plc.answered().outcome == DONE


class TestNoUnwantedStart:
    @pytest.mark.soak
    def test_first_block_of_a_connection_starts_no_motor(self, served, plc):
        plc.heartbeat, plc.sequence, plc.command, plc.kind, plc.reference = 500, 17, START, 1, 50.0
        plc.write()
        plc.cycles_for(0.5)
        assert plc.results().lease == MINE
        assert (plc.results().answered, plc.results().outcome) == (0, 0)
        assert "keep" not in served.verbs()
        assert not served.runs()

    @pytest.mark.soak
    def test_reconnect_with_the_old_block_starts_no_motor(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        with served.master() as other:
            other.write_one(STOP, 1)
        until(lambda: not served.runs())
        plc.master.close()
        with served.master() as again:
            plc.master = again
            plc.cycles_for(1.5)
            assert plc.results().lease == MINE
            assert served.verbs().count("keep") == 1
            assert not served.runs()

    @pytest.mark.soak
    def test_restarted_door_does_not_start_a_motor_from_the_old_block(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        served.opened.close()
        until(lambda: not served.runs())
        served.open_door()
        plc.master.close()
        with served.master() as again:
            plc.master = again
            plc.cycles_for(1.0)
            plc.write()
            assert served.verbs().count("keep") == 1
            assert not served.runs()

    def test_sequence_changed_with_the_first_heartbeat_starts_no_motor(self, served, plc):
        plc.heartbeat, plc.command = 5, START
        plc.write()
        plc.heartbeat, plc.sequence = 6, 1
        plc.write()
        results = plc.results()
        assert (results.answered, results.outcome, results.reason) == (1, REFUSED, NO_LEASE)
        plc.cycles_for(0.3)
        assert not served.runs()
        assert served.notes.ended_with == [("pump", "start", "refused: start: no lease")]

    def test_sequence_without_a_heartbeat_starts_no_motor(self, served, plc):
        plc.command = START
        for plc.sequence in (1, 2, 3):
            plc.write()
        assert (plc.results().answered, plc.results().outcome, plc.results().reason) == (3, REFUSED, NO_LEASE)
        assert not served.runs()

    def test_heartbeat_that_jumps_back_gets_no_lease(self, plc):
        """Two programs writing in turn, or a replay of old blocks, never count up for long."""
        for heartbeat in (900, 500, 100, 65000, 33000, 1000):
            plc.heartbeat = heartbeat
            plc.write()
        time.sleep(0.1)
        assert plc.results().lease == NOBODY

    def test_result_of_an_earlier_connection_is_not_shown_to_a_later_one(self, served, plc):
        results = plc.give(AGAIN, kind=1, reference=40.0)
        assert (results.answered, results.outcome, results.reference_outcome) == (1, DONE, DONE)
        with served.master() as again:
            later = Plc(again)
            later.sequence, later.command = 1, START
            later.write()
            results = later.results()
            assert (results.answered, results.outcome, results.reference_outcome) == (0, 0, 0)

    def test_sequence_without_a_command_is_refused(self, plc):
        plc.take_lease()
        plc.sequence += 1
        results = plc.answered()
        assert (results.outcome, results.reason) == (REFUSED, NO_COMMAND)
