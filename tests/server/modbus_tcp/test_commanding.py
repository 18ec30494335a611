"""Drives started by registers: what a PLC means starts a motor once, and nothing else does."""

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
    def test_the_handshake(self, served, plc):
        results = plc.give(START, kind=1, reference=50.0)
        assert (results.outcome, results.reason) == (DONE, 0)
        assert served.runs()
        assert served.verbs() == ["keep"]
        assert served.notes.asked_for[0][0] == f"127.0.0.1 ({served.door.name})"
        state = plc.cycles_until(lambda: plc.state() & 0b1000 and plc.state())
        assert state & 0b1100_0000_0000 == 0b1100_0000_0000
        assert not state & 0b100000

    @pytest.mark.soak
    def test_it_goes_on_while_the_heartbeat_counts_and_no_longer(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.cycles_for(1.5)
        assert served.runs()
        # The PLC halts: its connection stays, and its image is what it was.
        for _ in range(10):
            plc.write()
            time.sleep(0.02)
        until(lambda: not served.runs())
        assert any(event.kind == "link loss" for event in served.plant.events())
        plc.cycles_for(1.5)
        assert not served.runs(), "a heartbeat that counts again starts nothing"

    @pytest.mark.soak
    def test_a_connection_that_is_lost_ends_the_lease_by_its_time(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.master.close()
        assert served.runs()
        until(lambda: not served.runs())

    @pytest.mark.soak
    def test_a_heartbeat_of_zero_gives_the_lease_back_at_once(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.heartbeat = 0
        plc.write()
        until(lambda: not served.plant.leases(), 0.5)
        time.sleep(0.2)
        assert not served.plant.leases(), "what had counted before takes it again"
        until(lambda: not served.runs())

    def test_backwards_needs_to_be_allowed_too(self, served, plc):
        results = plc.give(BACKWARDS, kind=1, reference=50.0)
        assert (results.outcome, results.reason) == (REFUSED, NOT_ALLOWED)
        assert not served.runs()

    @pytest.mark.soak
    def test_one_that_runs_already_is_refused(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        results = plc.give(START)
        assert results.outcome == REFUSED
        assert served.runs()

    def test_registers_written_one_by_one(self, served, plc):
        """As masters that know function 06 only do; the reference is a number of two, and is set otherwise."""
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

    def test_written_and_read_in_one_telegram(self, plc):
        plc.take_lease()
        plc.heartbeat += 1
        plc.sequence, plc.command, plc.kind, plc.reference = 1, START, 1, 50.0
        words = (0, plc.heartbeat, 1, START, 1, 0, 0x4248, 0)
        answer = plc.master.write_and_read(STOP, words, STOP, 16)
        assert answer[:8] == list(words)
        assert answer[8] == 1
        # The heartbeat counts on, or the lease ends before a busy machine has started the motor.
        assert plc.answered().outcome == DONE


class TestWhatStartsNothing:
    @pytest.mark.soak
    def test_an_image_that_is_seen_first(self, served, plc):
        plc.heartbeat, plc.sequence, plc.command, plc.kind, plc.reference = 500, 17, START, 1, 50.0
        plc.write()
        plc.cycles_for(0.5)
        assert plc.results().lease == MINE
        assert (plc.results().answered, plc.results().outcome) == (0, 0)
        assert "keep" not in served.verbs()
        assert not served.runs()

    @pytest.mark.soak
    def test_a_reconnect_with_the_old_image(self, served, plc):
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
    def test_a_door_that_is_opened_again(self, served, plc):
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

    def test_a_sequence_that_changes_together_with_the_first_heartbeat(self, served, plc):
        plc.heartbeat, plc.command = 5, START
        plc.write()
        plc.heartbeat, plc.sequence = 6, 1
        plc.write()
        results = plc.results()
        assert (results.answered, results.outcome, results.reason) == (1, REFUSED, NO_LEASE)
        plc.cycles_for(0.3)
        assert not served.runs()
        assert served.notes.ended_with == [("pump", "start", "refused: start: no lease")]

    def test_a_sequence_without_a_heartbeat(self, served, plc):
        plc.command = START
        for plc.sequence in (1, 2, 3):
            plc.write()
        assert (plc.results().answered, plc.results().outcome, plc.results().reason) == (3, REFUSED, NO_LEASE)
        assert not served.runs()

    def test_a_heartbeat_that_jumps_back(self, plc):
        """Two programs that write in turn, or old images that are played again, never count up for long."""
        for heartbeat in (900, 500, 100, 65000, 33000, 1000):
            plc.heartbeat = heartbeat
            plc.write()
        time.sleep(0.1)
        assert plc.results().lease == NOBODY

    def test_a_number_that_was_answered_to_an_earlier_program_is_no_answer(self, served, plc):
        results = plc.give(AGAIN, kind=1, reference=40.0)
        assert (results.answered, results.outcome, results.reference_outcome) == (1, DONE, DONE)
        with served.master() as again:
            later = Plc(again)
            later.sequence, later.command = 1, START
            later.write()
            results = later.results()
            assert (results.answered, results.outcome, results.reference_outcome) == (0, 0, 0)

    def test_no_command(self, plc):
        plc.take_lease()
        plc.sequence += 1
        results = plc.answered()
        assert (results.outcome, results.reason) == (REFUSED, NO_COMMAND)
