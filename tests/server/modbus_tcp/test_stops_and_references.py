"""Stops by registers, which need no lease, and references, which need it."""

import time

import pytest
from commanded_plant import AGAIN, DONE, NO_COMMAND, OPEN, REFERENCE, REFUSED, START, STOP, STOP_IS_ON, Plc
from raw_master import Refused, until
from served_core import ENGINEER, asked


class TestStop:
    @pytest.mark.soak
    def test_stop_in_the_first_block_of_a_connection_stops_the_motor(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        with served.master() as other:
            image = Plc(other)
            image.stop = 1
            image.write()
            until(lambda: not served.runs())

    @pytest.mark.parametrize(("code", "how"), [(2, "coast"), (3, "quick"), (77, "ramp")])
    def test_stop_code_selects_the_kind_of_stop(self, served, plc, code, how):
        plc.master.write_one(STOP, code)
        until(lambda: plc.results().stop_outcome == DONE)
        assert served.notes.stops[0] == ("pump", how)

    @pytest.mark.soak
    def test_unsupported_kind_of_stop_becomes_a_ramp(self, served, plc):
        plc.give(START, kind=1, reference=50.0)
        plc.stop = 4
        plc.cycles_until(lambda: not served.runs())
        plc.cycles_until(lambda: plc.results().stop_outcome == DONE)

    @pytest.mark.soak
    @pytest.mark.parametrize(
        "words", [(1, 0, 0, 99, 0, 0, 0, 0), (1, 0, 0, 0, 1, 0, 0x7FC0, 0), (1,) * 9], ids=["command", "nan", "long"]
    )
    def test_stop_is_sent_although_the_rest_of_the_block_is_invalid(self, served, plc, words):
        plc.give(START, kind=1, reference=50.0)
        with pytest.raises(Refused):
            plc.master.write(STOP, *words)
        # The stop is sent immediately, not only after the heartbeat is missed.
        until(lambda: served.notes.stops == [("pump", "ramp")], 0.8)
        until(lambda: not served.runs())

    @pytest.mark.soak
    def test_unconfirmed_stop_is_shown_as_open_and_retried_until_confirmed(self, served, plc):
        served.control.order("power", drive="pump", state="off")
        try:
            plc.stop = 1
            plc.cycles_until(lambda: plc.results().stop_outcome == OPEN, 15)
            assert not served.plant.drive("pump").standing_stop.confirmed
        finally:
            served.control.order("power", drive="pump", state="on")
        plc.cycles_until(lambda: plc.results().stop_outcome == DONE, 15)
        assert served.plant.drive("pump").standing_stop.confirmed

    @pytest.mark.soak
    def test_standing_stop_blocks_every_door_and_stops_a_running_motor(self, served, plc):
        plc.stop = 1
        plc.write()
        until(lambda: plc.results().stop_outcome == DONE)
        with served.master() as other:
            second = Plc(other)
            second.cycle()
            refused_here = second.give(START, kind=1, reference=50.0)
            second.heartbeat = 0
            second.write()
            until(lambda: not served.plant.leases())
        assert (refused_here.outcome, refused_here.reason) == (REFUSED, STOP_IS_ON)
        answer = served.asked(asked(served.core, ENGINEER, "pump", "set_reference", arguments={"percent": 50}))
        assert answer.outcome == "done", answer.error
        answer = served.asked(asked(served.core, ENGINEER, "pump", "start", arguments={"policy": "hold"}))
        assert answer.outcome == "refused"
        assert f"demanded by 127.0.0.1 ({served.door.name})" in str(answer.error)
        refused_s = time.time()
        until(lambda: served.plant.value("pump", "status").source_s > refused_s)
        # Simulates a start at the drive's keypad, or by another master.
        served.asked(served.core.lines["hall"].drive("pump").start())
        assert plc.cycles_until(lambda: plc.results().stop_outcome == OPEN or None)
        plc.cycles_until(lambda: not served.runs())
        plc.cycles_until(lambda: plc.results().stop_outcome == DONE)
        events = [event.text for event in served.plant.events() if event.kind == "warning"]
        assert any(text.startswith("runs although a stop is demanded") for text in events)
        # Both change in one telegram. The sequence begins at 10, since lower numbers were used by the other connection.
        plc.stop, plc.sequence = 0, 10
        assert plc.give(START).outcome == DONE
        assert served.runs()

    @pytest.mark.parametrize("end", ["zero", "connection", "door"])
    def test_stop_demand_ends_with_its_block_connection_or_door(self, served, end):
        def demanded():
            return served.plant.drive("pump").standing_stop

        with served.master() as master:
            image = Plc(master)
            image.stop = 1
            image.write()
            until(lambda: demanded() is not None and demanded().demanded)
            until(lambda: image.state() & 1 << 12)
            if end == "zero":
                image.stop = 0
                image.write()
            elif end == "door":
                served.opened.close()
            else:
                master.close()
            until(lambda: demanded() is None)
        if end == "door":
            served.open_door()

    def test_start_is_refused_while_a_stop_is_on(self, served, plc):
        plc.take_lease()
        plc.stop = 1
        for command in (START, AGAIN):
            results = plc.give(command, kind=1, reference=50.0)
            assert (results.outcome, results.reason) == (REFUSED, STOP_IS_ON)
        assert not served.runs()

    @pytest.mark.soak
    def test_repeated_block_sends_one_stop_and_a_flood_is_limited(self, served, plc):
        plc.stop = 1
        plc.cycles_for(0.3)
        assert len(served.notes.stops) == 1
        end, changes = time.monotonic() + 1, 0
        while time.monotonic() < end:
            plc.stop = 1 - plc.stop
            plc.write()
            changes += 1
        assert len(served.notes.stops) <= 13
        assert changes > 50

    def test_different_kind_of_stop_is_sent_immediately(self, served, plc):
        plc.master.write_one(STOP, 1)
        plc.master.write_one(STOP, 2)
        until(lambda: ("pump", "coast") in served.notes.stops, 0.5)


class TestReference:
    @pytest.mark.soak
    def test_reference_is_sent_when_it_changes(self, served, plc):
        plc.take_lease()
        plc.kind, plc.reference = 1, 40.0
        plc.cycles_until(lambda: plc.results().reference_outcome == DONE)
        plc.cycles_for(0.6)
        assert served.verbs() == ["set_reference"]
        plc.reference = 45.0
        plc.cycles_until(lambda: served.verbs() == ["set_reference"] * 2)
        assert not served.runs()

    @pytest.mark.soak
    def test_last_of_many_references_takes_effect(self, served, plc):
        plc.give(START, kind=2, reference=10.0)
        for tenth in range(100, 300):
            plc.reference = tenth / 10
            plc.cycle()
        plc.cycles_until(lambda: abs(plc.frequency() - plc.reference) < 0.1, 30)
        assert served.verbs().count("set_reference") < 60

    def test_reference_is_not_sent_without_the_lease(self, served, plc):
        plc.kind, plc.reference = 1, 40.0
        for _ in range(10):
            plc.write()
        assert plc.results().reference_outcome == 0
        assert not served.verbs()

    @pytest.mark.parametrize(
        "words", [(1, 0, 0x7FC0, 0), (1, 0, 0x7F80, 0), (7, 0, 0x4248, 0)], ids=["nan", "infinite", "kind"]
    )
    def test_invalid_reference_gives_exception_3(self, served, plc, words):
        plc.take_lease()
        with pytest.raises(Refused) as caught:
            plc.master.write(1004, *words)
        assert caught.value.code == 3
        plc.cycles_for(0.1)
        assert not served.verbs()

    @pytest.mark.parametrize(("address", "words"), [(REFERENCE, 1), (REFERENCE + 1, 1), (1005, 2)])
    def test_half_written_reference_gives_exception_2(self, plc, address, words):
        with pytest.raises(Refused) as caught:
            plc.master.write(address, *range(words))
        assert caught.value.code == 2

    @pytest.mark.soak
    def test_reference_is_rounded_to_the_resolution_of_the_drive(self, served, plc):
        """A PLC calculates with more digits than a drive takes, and drives refuse values that need rounding."""
        plc.take_lease()
        plc.kind, plc.reference = 2, 100 / 3
        plc.cycles_until(lambda: plc.results().reference_outcome == DONE)
        plc.reference += 0.001
        plc.cycles_for(0.4)
        assert served.verbs() == ["set_reference"]

    def test_command_again_repeats_the_reference(self, served, plc):
        assert plc.give(AGAIN, kind=1, reference=40.0).outcome == DONE
        before = len(served.verbs())
        assert plc.give(AGAIN).outcome == DONE
        assert served.verbs()[before:] == ["set_reference"]

    def test_command_again_without_a_reference_is_refused(self, plc):
        results = plc.give(AGAIN)
        assert (results.outcome, results.reason) == (REFUSED, NO_COMMAND)
