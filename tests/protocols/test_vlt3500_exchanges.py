"""Conversations of a VLT master, played against scripts: the requests sent and the results of the replies."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import pytest

from drivecomm.errors import (
    DamagedReplyError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    StateError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.models import load_model
from drivecomm.protocol import Ask, DriveState, Model, Pause, Stop
from drivecomm.testing import play
from drivecomm_vlt3500.exchanges import VltOperations
from drivecomm_vlt3500.messages import Control, ControlReply, Read, ReadIndex, Reply, Update
from drivecomm_vlt3500.options import VltOptions

READY, RUNNING, TRIPPED = 0x0607, 0x0F07, 0x0608


def drive(model: Model | None = None, address: int = 1, **options: Any) -> VltOperations:
    return VltOperations(address, VltOptions(**options), model)


def word(control_word: int, **rest: Any) -> Control:
    return Control(address=1, control_word=control_word, **rest)


def status(status_word: int) -> ControlReply:
    return ControlReply(address=1, status_word=status_word)


def value(kind: Any, parameter: int, text: str) -> Reply:
    number = Decimal(text)
    places = -int(number.as_tuple().exponent)
    return Reply(kind=kind, address=1, status_word=READY, parameter=parameter, value=number, decimals=places)


def refusal(kind: Any, parameter: int, code: int) -> Reply:
    return Reply(kind=kind, address=1, status_word=READY, parameter=parameter, fault_code=code)


def update(parameter: int, text: str, decimals: int, **rest: Any) -> Update:
    return Update(address=1, parameter=parameter, value=Decimal(text), decimals=decimals, **rest)


def started(operations: VltOperations, control_word: int = 0x047F) -> VltOperations:
    play(
        operations.start(reverse=bool(control_word & 0x8000)),
        [(word(0), status(READY)), (word(control_word), status(RUNNING))],
    )
    return operations


class TestReading:
    def test_parameter_is_read_with_its_decimals(self) -> None:
        found = play(drive().read("0516"), [(Read(address=1, parameter=516), value("read", 516, "23.750"))])
        assert (found.parameter, found.value, found.raw) == ("516", Decimal("23.750"), "23.750")

    def test_array_element_is_read_by_one_or_two_indices(self) -> None:
        one = ReadIndex(address=1, parameter=502, index=(17,), decimals=0)
        assert play(drive().read("502[17]"), [(one, value("read_index", 502, "1584"))]).value == 1584
        two = ReadIndex(address=1, parameter=602, index=(13, 5), decimals=2)
        assert play(drive().read("602", index=(13, 5)), [(two, value("read_index", 602, "7"))]).parameter == "602[13,5]"

    def test_read_carries_the_idle_word_of_the_options(self) -> None:
        request = Read(address=1, control_word=0x000F, parameter=516)
        play(drive(idle_word=0x000F).read("516"), [(request, value("read", 516, "0"))])

    @pytest.mark.parametrize(("code", "words"), [(0, "unknown parameter"), (8, "99999"), (42, "unlisted cause 42")])
    def test_refused_read_has_code_and_reason(self, code: int, words: str) -> None:
        with pytest.raises(RefusedError, match=words) as caught:
            play(drive().read("999"), [(Read(address=1, parameter=999), refusal("read", 999, code))])
        assert (caught.value.parameter, caught.value.code) == ("999", code)

    def test_malformed_address_is_refused(self) -> None:
        with pytest.raises(ParameterAddressError):
            drive().read("51x")

    def test_reads_and_writes_are_nameless(self) -> None:
        operations = drive()
        for exchange in (operations.read("516"), operations.read("502[1]"), operations.write("516", 1)):
            command = next(exchange)
            assert isinstance(command, Ask)
            assert command.nameless


class TestWriting:
    def test_write_returns_the_value_that_the_drive_reports(self) -> None:
        found = play(drive().write("516", "23.75"), [(update(516, "23.75", 2), value("update", 516, "23.75"))])
        assert found is not None
        assert (found.value, found.note) == (Decimal("23.75"), "unit not known")

    def test_rounded_value_is_noted(self) -> None:
        found = play(drive().write("516", "23.755"), [(update(516, "23.755", 3), value("update", 516, "23.76"))])
        assert found is not None
        assert found.value == Decimal("23.76")
        assert "reports 23.76 instead of 23.755" in found.note

    def test_write_uses_the_given_decimals_and_attempts(self) -> None:
        command = next(drive().write("516", "80", decimals=2, attempts=3))
        assert isinstance(command, Ask)
        assert (command.message, command.attempts, command.acts) == (update(516, "80.00", 2), 3, True)
        command = next(drive().write("516", "80"))
        assert isinstance(command, Ask)
        assert command.attempts == 1

    def test_refused_write_raises_refused_error(self) -> None:
        with pytest.raises(RefusedError, match="code 6"):
            play(drive().write("516", 500), [(update(516, "500", 0), refusal("update", 516, 6))])

    def test_invalid_write_is_refused_unsent(self) -> None:
        with pytest.raises(ValueRefusedError):
            drive().write("516", 100_000)
        with pytest.raises(ValueRefusedError):
            drive().write("516", "23.755", decimals=2)
        with pytest.raises(ValueRefusedError):
            drive().write("516", "1", decimals=6)
        with pytest.raises(UsageError):
            drive().write("516", 1, attempts=0)
        with pytest.raises(NotSupported, match="read-only"):
            drive().write("502[1]", 1)
        with pytest.raises(NotSupported, match="whether 516 is kept without mains is unknown"):
            drive().write("516", 1, store=True)

    def test_broadcast_write_returns_no_reading(self) -> None:
        request = Update(address=0, parameter=516, value=Decimal(5), decimals=0)
        assert play(drive(address=0).write("516", 5), [(request, None)]) is None


class TestStatus:
    @pytest.mark.parametrize(
        ("status_word", "state"),
        [
            (READY, DriveState.READY),
            (RUNNING, DriveState.RUNNING),
            (0x0B87, DriveState.RUNNING),
            (TRIPPED, DriveState.FAULT),
            (0x0E20, DriveState.STOPPING),
            (0x0620, DriveState.NOT_READY),
            (0x0647, DriveState.NOT_READY),
            (0x0630, DriveState.NOT_READY),
        ],
    )
    def test_status_word_gives_the_drive_state(self, status_word: int, state: DriveState) -> None:
        found = play(drive().status(), [(word(0), status(status_word))])
        assert (found.word, found.state) == (status_word, state)

    def test_printed_status_word_gives_its_flags(self) -> None:
        found = play(drive().status(), [(word(0), status(0x0B87))])
        assert found.flags == (
            "control ready",
            "drive ready",
            "enabled",
            "warning",
            "speed equals the reference",
            "bus control",
            "running",
        )
        assert found.warning
        assert found.at_reference
        assert found.remote

    def test_fault_code_is_read_from_the_configured_parameter(self) -> None:
        model = Model(
            protocol="vlt3500", name="", title="", source="", parameters={}, faults={14: "earth fault"}, options={}
        )
        request = ReadIndex(address=1, parameter=502, index=(18,), decimals=0)
        script: list[Any] = [(word(0), status(TRIPPED)), (request, value("read_index", 502, "14"))]
        found = play(drive(model, fault_parameter="502[18]").status(), script)
        assert (found.fault_code, found.fault_text) == (14, "earth fault")
        script[1] = (request, refusal("read_index", 502, 0))
        assert play(drive(model, fault_parameter="502[18]").status(), script).fault_code is None
        script[1] = (request, value("read_index", 502, "1.5"))
        assert play(drive(fault_parameter="502[18]").status(), script).fault_code is None
        assert play(drive(fault_parameter="502[18]").status(), [(word(0), status(READY))]).fault_code is None

    def test_status_and_read_carry_no_command_after_a_start(self) -> None:
        operations = started(drive())
        play(operations.status(), [(word(0), status(RUNNING))])
        play(operations.read("516"), [(Read(address=1, parameter=516), value("read", 516, "0"))])


class TestStarting:
    def test_start_sends_the_forward_or_reverse_word(self) -> None:
        started(drive())
        started(drive(), 0x847F)

    def test_start_is_sent_once(self) -> None:
        exchange = drive().start()
        next(exchange)
        command = exchange.send(status(READY))
        assert isinstance(command, Ask)
        assert (command.attempts, command.acts) == (1, True)

    def test_start_first_releases_the_start_inhibit(self) -> None:
        play(
            drive().start(),
            [(word(0), status(0x0647)), (word(0x047E), status(0x0600)), (word(0x047F), status(RUNNING))],
        )

    def test_start_waits_until_the_drive_runs(self) -> None:
        play(
            drive().start(),
            [
                (word(0), status(READY)),
                (word(0x047F), status(READY)),
                (word(0), status(READY)),
                (word(0), status(RUNNING)),
            ],
        )

    @pytest.mark.parametrize(("status_word", "why"), [(TRIPPED, "tripped"), (0x0407, "local")])
    def test_start_of_a_tripped_or_local_drive_is_refused_unsent(self, status_word: int, why: str) -> None:
        with pytest.raises(StateError, match=why):
            play(drive().start(), [(word(0), status(status_word))])

    def test_start_is_taken_back_if_the_drive_does_not_run(self) -> None:
        script = [(word(0), status(READY)), (word(0x047F), status(READY)), (word(0x043F), status(READY))]
        with pytest.raises(StateError, match="taken back"):
            play(drive(state_timeout_s=0.0).start(), script)

    def test_missing_reply_after_a_start_mentions_the_start(self) -> None:
        script = [(word(0), status(READY)), (word(0x047F), status(READY)), (word(0), NoReplyError("silence"))]
        with pytest.raises(NoReplyError, match="had been commanded to run"):
            play(drive().start(), script)


class TestStopping:
    @pytest.mark.parametrize(
        ("how", "control_word", "status_word"),
        [(Stop.RAMP, 0x043F, READY), (Stop.COAST, 0x047D, 0x0610), (Stop.QUICK, 0x047B, 0x0620)],
    )
    def test_stop_sends_its_control_word(self, how: Stop, control_word: int, status_word: int) -> None:
        play(drive().stop(how), [(word(control_word), status(status_word))])

    def test_stop_may_be_repeated(self) -> None:
        command = next(drive().stop())
        assert isinstance(command, Ask)
        assert (command.attempts, command.acts) == (None, True)

    def test_dc_brake_needs_its_option(self) -> None:
        with pytest.raises(NotSupported, match="514"):
            drive().stop(Stop.DC_BRAKE)
        assert Stop.DC_BRAKE not in drive().capabilities.stops
        braking = drive(dc_brake=True)
        assert Stop.DC_BRAKE in braking.capabilities.stops
        play(braking.stop(Stop.DC_BRAKE), [(word(0x046F), status(0x0E07))])

    def test_stop_that_the_drive_does_not_report_raises_state_error(self) -> None:
        with pytest.raises(StateError, match="does not report"):
            play(drive(state_timeout_s=0.0).stop(Stop.COAST), [(word(0x047D), status(RUNNING))])
        with pytest.raises(StateError, match="local"):
            play(drive().stop(), [(word(0x043F), status(0x0D07))])
        play(drive().stop(Stop.QUICK), [(word(0x047B), status(RUNNING)), (word(0), status(0x0E20))])

    def test_broadcast_stop_sends_one_control_telegram(self) -> None:
        play(drive(address=0).stop(), [(Control(address=0, control_word=0x043F), None)])


class TestReset:
    EDGE = ((word(0x043F), status(TRIPPED)), (word(0x04BF), status(TRIPPED)), (word(0x043F), status(READY)))

    def test_reset_sends_an_edge_without_a_start(self) -> None:
        play(drive().reset(), [(word(0), status(TRIPPED)), *self.EDGE])

    def test_reset_without_a_trip_sends_no_control_word(self) -> None:
        play(drive().reset(), [(word(0), status(RUNNING))])

    def test_reset_waits_until_the_trip_is_cleared(self) -> None:
        slow = [*self.EDGE[:2], (word(0x043F), status(TRIPPED)), (word(0), status(READY))]
        play(drive().reset(), [(word(0), status(TRIPPED)), *slow])

    def test_reset_of_a_lasting_trip_raises_state_error(self) -> None:
        script = [(word(0), status(TRIPPED)), *self.EDGE[:2], (word(0x043F), status(TRIPPED))]
        with pytest.raises(StateError, match="still tripped"):
            play(drive(state_timeout_s=0.0).reset(), script)


class TestReference:
    def test_reference_in_percent_is_written_to_516(self) -> None:
        play(drive().set_reference_percent("-12.5"), [(update(516, "-12.5", 1), value("update", 516, "-12.50"))])

    def test_reference_reported_with_another_value_raises_state_error(self) -> None:
        with pytest.raises(StateError, match="instead of -50"):
            play(drive().set_reference_percent(-50), [(update(516, "-50", 0), value("update", 516, "50"))])

    def test_reference_limit_is_an_option(self) -> None:
        for percent in ("100.01", -101):
            with pytest.raises(ValueRefusedError, match="100"):
                drive().set_reference_percent(percent)
        play(
            drive(reference_limit=120).set_reference_percent(110),
            [(update(516, "110", 0), value("update", 516, "110"))],
        )

    def test_reference_in_hz_needs_the_maximum_frequency(self) -> None:
        assert not drive().capabilities.reference_hz
        with pytest.raises(NotSupported, match="maximum_hz"):
            drive().set_reference_hz(40)
        assert drive(maximum_hz=50).capabilities.reference_hz

    @pytest.mark.parametrize(
        ("options", "hz", "percent"),
        [
            ({"maximum_hz": 50}, 40, "80"),
            ({"maximum_hz": 50}, "-33.33", "-66.66"),
            ({"maximum_hz": "50.0", "minimum_hz": 10}, 10, "20"),
            ({"maximum_hz": 50, "minimum_hz": 10, "reference_span": "span"}, 10, "0"),
            ({"maximum_hz": 50, "minimum_hz": 10, "reference_span": "span"}, -30, "-50"),
            ({"maximum_hz": 62.5}, 0, "0"),
        ],
    )
    def test_reference_in_hz_is_scaled_to_percent(self, options: dict[str, Any], hz: Any, percent: str) -> None:
        number = Decimal(percent)
        sent = update(516, percent, -int(number.as_tuple().exponent))
        play(drive(**options).set_reference_hz(hz), [(sent, value("update", 516, percent))])

    def test_invalid_reference_in_hz_is_refused(self) -> None:
        for hz in (10, 61, "0.0001"):
            with pytest.raises(ValueRefusedError):
                drive(maximum_hz=60).set_reference_hz(hz)
        with pytest.raises(ValueRefusedError, match="minimum"):
            drive(maximum_hz=50, minimum_hz=10, reference_span="span").set_reference_hz(5)

    def test_broadcast_reference_waits_for_no_reply(self) -> None:
        request = Update(address=0, parameter=516, value=Decimal(0), decimals=0)
        play(drive(address=0).set_reference_percent(0), [(request, None)])


class TestScanning:
    def test_probe_is_sent_once_with_control_word_zero(self) -> None:
        exchange = drive().probe()
        command = next(exchange)
        assert isinstance(command, Ask)
        assert (command.message, command.attempts) == (word(0), 1)
        play(drive().probe(), [(word(0), status(READY))])

    def test_identify_reads_the_software_version(self) -> None:
        request = ReadIndex(address=1, parameter=502, index=(19,), decimals=0)
        script: list[Any] = [(word(0), status(READY)), (request, value("read_index", 502, "1.20"))]
        assert play(drive().identify(), script)["software"] == "1.20"
        script[1] = (request, refusal("read_index", 502, 0))
        assert "software" not in play(drive().identify(), script)


class TestVerbsBeyondTheCommonOnes:
    def test_extra_lists_every_function(self) -> None:
        assert set(drive().extra) == {"jog", "slow_down", "catch_up", "hold", "select_setup", "control_word"}

    @pytest.mark.parametrize(("number", "control_word"), [(1, 0x053F), (2, 0x063F)])
    def test_jog_sends_its_bit_without_the_start_bit(self, number: int, control_word: int) -> None:
        play(drive().extra["jog"](number=number), [(word(0), status(READY)), (word(control_word), status(0x0E07))])

    def test_jog_3_is_refused(self) -> None:
        with pytest.raises(UsageError):
            drive().jog(number=3)

    @pytest.mark.parametrize(("verb", "control_word"), [("slow_down", 0x0C7F), ("catch_up", 0x147F)])
    def test_catch_up_and_slow_down_clear_their_bit(self, verb: str, control_word: int) -> None:
        operations = started(drive())
        script: list[Any] = [
            (word(0), status(RUNNING)),
            (word(control_word), status(RUNNING)),
            (word(0x047F), status(RUNNING)),
        ]
        play(operations.extra[verb](), script)

    def test_catch_up_with_a_damaged_reply_clears_its_bit(self) -> None:
        operations = started(drive())
        script: list[Any] = [
            (word(0), status(RUNNING)),
            (word(0x147F), DamagedReplyError("noise")),
            (word(0x047F), status(RUNNING)),
        ]
        with pytest.raises(DamagedReplyError):
            play(operations.catch_up(), script)

    def test_hold_keeps_the_direction(self) -> None:
        operations = started(drive(), 0x847F)
        play(operations.hold(), [(word(0), status(RUNNING)), (word(0x845F), status(RUNNING))])

    @pytest.mark.parametrize("verb", ["slow_down", "catch_up", "hold"])
    def test_hold_and_steps_need_a_command_of_this_program(self, verb: str) -> None:
        with pytest.raises(StateError, match="start or stop"):
            play(drive().extra[verb](), [])

    def test_hold_after_an_unanswered_stop_is_refused(self) -> None:
        operations = started(drive())
        with pytest.raises(NoReplyError):
            play(operations.stop(), [(word(0x043F), NoReplyError("silence"))])
        with pytest.raises(StateError):
            play(operations.hold(), [])

    def test_slow_down_does_not_restart_a_stopped_motor(self) -> None:
        operations = started(drive())
        with pytest.raises(StateError, match="use start"):
            play(operations.slow_down(), [(word(0), status(READY))])

    def test_selected_set_up_is_kept_in_each_control_word(self) -> None:
        operations = drive()
        play(operations.stop(), [(word(0x043F), status(READY))])
        play(operations.select_setup(number=3), [(word(0), status(READY)), (word(0x443F), status(READY))])
        play(
            operations.start(),
            [(word(0), status(0x0647)), (word(0x447E), status(READY)), (word(0x447F), status(RUNNING))],
        )
        play(operations.stop(Stop.QUICK), [(word(0x447B), status(0x0620))])
        play(operations.select_setup(number=1), [(word(0), status(RUNNING)), (word(0x047B), status(RUNNING))])

    def test_set_up_that_the_drive_lacks_is_refused(self) -> None:
        with pytest.raises(UsageError):
            drive().select_setup(number=5)
        vlt2000 = load_model("drivecomm_vlt3500", "vlt3500", "vlt2000")
        with pytest.raises(UsageError, match="1 to 2"):
            drive(**vlt2000.options).select_setup(number=3)

    def test_raw_control_word_is_sent_and_remembered(self) -> None:
        operations = drive()
        found = play(operations.control_word(word=0x04FF), [(word(0x04FF), status(RUNNING))])
        assert found.running
        held = word(0x2400, control_mask=0xFF00)
        play(operations.control_word(word=0x2400, mask=0xFF00), [(held, status(RUNNING))])
        script: list[Any] = [(word(0), status(RUNNING)), (word(0x24DF), status(RUNNING))]
        play(operations.hold(), script)
        play(operations.control_word(word=0x000F), [(word(0x000F), status(RUNNING))])
        play(operations.stop(), [(word(0x243F), status(READY))])

    def test_hold_after_a_partial_control_word_only_is_refused(self) -> None:
        operations = drive()
        held = word(0x0400, control_mask=0x0F00)
        play(operations.control_word(word=0x0400, mask=0x0F00), [(held, status(RUNNING))])
        with pytest.raises(StateError):
            play(operations.hold(), [])

    @pytest.mark.parametrize(
        ("control_word", "mask"),
        [(0x10000, None), ("start", None), (0, -1), (0x0400, 0x0F01), (0, 0xF0FF), (0x847F, 0x0FFF)],
    )
    def test_invalid_control_word_or_mask_is_refused(self, control_word: Any, mask: Any) -> None:
        with pytest.raises(UsageError):
            drive().control_word(word=control_word, mask=mask)


def test_broadcast_of_a_verb_that_needs_an_answer_is_refused() -> None:
    everybody = drive(address=0)
    for verb in (
        lambda: everybody.read("516"),
        everybody.status,
        everybody.start,
        everybody.reset,
        everybody.probe,
        everybody.identify,
        everybody.jog,
        everybody.slow_down,
        everybody.catch_up,
        everybody.hold,
        lambda: everybody.select_setup(number=1),
        lambda: everybody.control_word(word=0),
    ):
        with pytest.raises(NotSupported, match="broadcast"):
            verb()


def test_capabilities_contain_only_documented_abilities() -> None:
    known = drive().capabilities
    assert (known.stored_writes, known.volatile_writes) == (False, False)
    assert known.reverse
    assert known.broadcast
    assert known.reference_percent


def test_start_pauses_between_status_polls() -> None:
    exchange = drive().start()
    next(exchange)
    exchange.send(status(READY))
    assert isinstance(exchange.send(status(READY)), Pause)
