"""A virtual VLT: its replies, its motor over time, and 2,000 exchanges on a disturbed line."""

from __future__ import annotations

from decimal import Decimal
from random import Random
from typing import Any

import pytest

import drivecomm
from drivecomm.errors import NoReplyError, ParameterAddressError, RefusedError, StateError, ValueRefusedError
from drivecomm.plant import FaultPlan
from drivecomm.protocol import Damaged, DriveState, Framed, Framer, Stop
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_vlt3500.messages import Control, ControlReply, ReadIndex, Reply
from drivecomm_vlt3500.telegrams import telegrams
from drivecomm_vlt3500.virtual import VirtualVltDrive

CODEC = telegrams()


def make(address: int = 1, **options: Any) -> VirtualVltDrive:
    found = virtual_drive("vlt3500", address, **options)
    assert isinstance(found, VirtualVltDrive)
    return found


def tell(drive: VirtualVltDrive, data: bytes, now: float = 0.0) -> Any:
    """Pass bytes to a drive; return the decoded reply, or None."""
    framer = Framer(drive.codec, "request")
    finds = [find for find in framer.feed(data) + framer.flush() if isinstance(find, Framed | Damaged)]
    answers = [drive.hear(find, now) for find in finds]
    answer = next((answer for answer in answers if answer is not None), None)
    return None if answer is None else CODEC.decode(answer.data, "reply")


def ask(drive: VirtualVltDrive, text: str, now: float = 0.0) -> Any:
    """Pass the characters between start and check characters to a drive; return the decoded reply, or None."""
    return tell(drive, b"<%s%02d>" % (text.encode(), sum(text.encode()) % 100), now)


def word(drive: VirtualVltDrive, control_word: int, now: float = 0.0, mask: int | None = None) -> int:
    message = Control(address=drive.address, control_word=control_word, control_mask=mask)
    reply = tell(drive, CODEC.encode(message), now)
    assert isinstance(reply, ControlReply)
    return reply.status_word


@pytest.fixture
def line_and_drives() -> Any:
    virtual = make()
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        yield line, virtual, bus.drive("vlt3500", 1, model="vlt3500", maximum_hz=50)


class TestMotor:
    def test_motor_ramps_up_reverses_and_stops(self, line_and_drives: Any) -> None:
        line, _, drive = line_and_drives
        assert drive.status().word == 0x0630
        drive.set_reference(percent=80)
        drive.start()
        assert not drive.status().at_reference
        line.advance(10)
        assert drive.status().word == 0x0F07
        assert drive.read("502[1]").value == Decimal("40.0")
        drive.start(reverse=True)
        line.advance(20)
        assert drive.read("502[1]").value == -40
        drive.stop()
        line.advance(1)
        assert drive.status().running
        line.advance(10)
        assert drive.status().word == 0x0607

    def test_printed_reply_is_given_by_a_motor_outside_its_range(self) -> None:
        virtual = make(reference_decimals=0)
        virtual.poke("211", 30)
        tell(virtual, b"<01UOGD@0516+00080007>")
        reply = virtual.hear(
            Framed(b"<01UOGD@0516+00080007>", CODEC.decode(b"<01UOGD@0516+00080007>", "request")), 10.0
        )
        assert reply is not None
        assert reply.data == b"<01UGHK@0516+00080007>"

    @pytest.mark.parametrize(("how", "after"), [(Stop.COAST, 0x0610), (Stop.QUICK, 0x0620)])
    def test_coast_and_quick_stop_show_their_status_words(self, line_and_drives: Any, how: Stop, after: int) -> None:
        line, virtual, drive = line_and_drives
        drive.set_reference(percent=100)
        drive.start()
        line.advance(10)
        drive.stop(how)
        assert drive.status().state is (DriveState.STOPPING if how is Stop.QUICK else DriveState.NOT_READY)
        line.advance(5)
        assert drive.status().word == after
        assert virtual.motor.output_hz == 0
        drive.start()

    def test_dc_brake_brakes_the_motor_with_its_option(self) -> None:
        virtual = make(dc_brake=True)
        line = VirtualLine([virtual])
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("vlt3500", 1, dc_brake=True)
            drive.set_reference(percent=100)
            drive.start()
            line.advance(10)
            drive.stop(Stop.DC_BRAKE)
            assert virtual.motor.command.value == "dc_brake"

    def test_parameter_514_selects_the_meaning_of_bit_4(self) -> None:
        virtual = make()
        virtual.poke("516", 50)
        word(virtual, 0x047F)
        assert word(virtual, 0x046F, 10.0) & 0x0800
        assert virtual.motor.command.value == "quick_stop"
        virtual.poke("514", 1)
        word(virtual, 0x047F, 20.0)
        word(virtual, 0x046F, 30.0)
        assert virtual.motor.command.value == "dc_brake"

    def test_off1_and_coast_bit_show_their_status_words(self) -> None:
        virtual = make()
        virtual.poke("bus_reference", 50)
        word(virtual, 0x047F)
        assert word(virtual, 0x047E, 10.0) == 0x0E00
        assert word(virtual, 0x0477, 10.1) == 0x0603

    def test_trip_is_logged_and_cleared_by_a_reset(self, line_and_drives: Any) -> None:
        line, virtual, drive = line_and_drives
        drive.set_reference(percent=50)
        drive.start()
        virtual.trip(7, line.time)
        assert drive.status().word == 0x0608
        with pytest.raises(StateError, match="reset"):
            drive.start()
        drive.reset()
        assert drive.status().word == 0x0607
        virtual.trip(9, line.time + 7200)
        assert [str(drive.read(f"602[{n},0]").value) for n in range(3)] == ["9", "7", "0"]
        assert drive.read("602[0,1]").value == 2
        assert drive.read("502[18]").value == 9

    def test_reset_bit_left_set_does_not_reset(self) -> None:
        virtual = make()
        assert word(virtual, 0x04FF) & 0x0800
        virtual.trip(3, 1.0)
        assert word(virtual, 0x04FF, 2.0) & 0x0008
        assert word(virtual, 0x047F, 3.0) & 0x0008
        assert not word(virtual, 0x04FF, 4.0) & 0x0008

    def test_trip_of_the_motor_shows_its_code(self) -> None:
        virtual = make()
        virtual.motor.trip(12, 1.0)
        assert virtual.peek("502[18]", 2.0) == "12"

    def test_start_inhibit_blocks_starts_until_it_is_released(self) -> None:
        virtual = make(start_inhibit=True)
        line = VirtualLine([virtual])
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("vlt3500", 1)
            assert drive.status().word == 0x0670
            assert not word(virtual, 0x047F) & 0x0800
            drive.set_reference(percent=50)
            drive.start()
            assert drive.status().running
            line.advance(10)
            drive.stop(Stop.QUICK)
            assert drive.status().state is DriveState.STOPPING
            line.advance(5)
            assert drive.status().word == 0x0660
            drive.start()
            virtual.trip(1, line.time)
            drive.reset()
            assert drive.status().word == 0x0647
            virtual.poke("309", 0)
            assert drive.status().word == 0x0607

    @pytest.mark.parametrize(("number", "hz"), [(1, 5.0), (2, 10.0)])
    def test_jog_turns_the_motor_at_its_frequency(self, number: int, hz: float) -> None:
        virtual = make()
        assert word(virtual, 0x043F | 0x80 << number) & 0x0800
        virtual.machine.live(10.0)
        assert virtual.motor.output_hz == hz
        word(virtual, 0x043F, 10.0)
        assert not word(virtual, 0x043F, 20.0) & 0x0800

    def test_hold_step_and_set_up_bits_act_on_the_motor(self) -> None:
        virtual = make()
        virtual.poke("516", 50)
        word(virtual, 0x047F)
        word(virtual, 0x045F, 1.0)
        assert virtual.motor.output_hz == 10
        virtual.machine.live(5.0)
        assert virtual.motor.output_hz == 10
        word(virtual, 0x147F, 10.0)
        word(virtual, 0x147F, 11.0)
        assert virtual.motor.target_hz == 25.5
        word(virtual, 0x047F, 12.0)
        word(virtual, 0x1C7F, 13.0)
        assert virtual.motor.target_hz == 25.0
        word(virtual, 0x647F, 14.0)
        assert virtual.machine.setup == 4

    def test_hold_without_a_start_does_not_run_the_motor(self) -> None:
        virtual = make()
        virtual.poke("516", 50)
        assert not word(virtual, 0x045F) & 0x0800

    def test_extra_functions_act_on_the_virtual_drive(self, line_and_drives: Any) -> None:
        line, virtual, drive = line_and_drives
        drive.set_reference(percent=50)
        drive.start()
        line.advance(10)
        drive.call("catch_up")
        assert virtual.motor.target_hz == 25.5
        drive.call("slow_down")
        assert virtual.motor.target_hz == 25.0
        drive.call("hold")
        assert virtual.motor.command.value == "hold"
        drive.call("select_setup", number=2)
        assert virtual.machine.setup == 2
        assert drive.call("control_word", word=0x047D).word == 0x0610
        drive.call("jog", number=2)
        line.advance(10)
        assert drive.read("502[1]").value == 10

    def test_start_in_local_operation_is_refused(self, line_and_drives: Any) -> None:
        line, virtual, drive = line_and_drives
        drive.set_reference(percent=50)
        drive.start()
        line.advance(10)
        virtual.poke("003", 2)
        with pytest.raises(StateError, match="local"):
            drive.start()
        line.advance(20)
        assert not drive.status().running

    def test_reply_equal_to_an_echo_is_reported_with_the_option_idle_word(self, line_and_drives: Any) -> None:
        line, virtual, drive = line_and_drives
        # Local operation, stopped by OFF1, outside the range, value 0: the reply consists of zeros.
        virtual.machine.status = lambda: 0
        with pytest.raises(NoReplyError, match="idle_word=0x000F"):
            drive.read("001")
        with drivecomm.open_bus(line.port) as bus:
            assert bus.drive("vlt3500", 1, idle_word=0x000F).read("001").value == 0

    def test_warnings_set_their_status_bits(self) -> None:
        virtual = make()
        virtual.motor.mains_v = 300
        assert word(virtual, 0x043F) == 0x2687
        virtual.motor.mains_v = 400
        virtual.motor.temperature_c = 120.0
        assert word(virtual, 0x043F) == 0x8687
        virtual.motor.temperature_c = 30.0
        virtual.motor.load = 2.0
        assert word(virtual, 0x047F, 1.0) & 0x4080 == 0x4080
        virtual.machine.overloaded = True
        assert word(virtual, 0x047F, 2.0) & 0x1800 == 0x1000


class TestControlWord:
    def test_idle_words_do_not_change_the_control_word(self) -> None:
        virtual = make()
        word(virtual, 0x047F)
        for idle in (0x0000, 0x000F, 0x0020, 0xF0FF):
            assert word(virtual, idle, 1.0) & 0x0800
        assert virtual.machine.word == 0x047F

    def test_masked_groups_keep_the_last_valid_word(self) -> None:
        virtual = make()
        word(virtual, 0x847F)
        word(virtual, 0x0400, mask=0x0F00)
        assert virtual.machine.word == 0x847F
        word(virtual, 0x2400, mask=0xFF00)
        assert virtual.machine.word == 0x247F

    def test_control_word_with_p_in_byte_7_is_invalid(self) -> None:
        virtual = make()
        assert not ask(virtual, "01COGP@0000+000000").status_word & 0x0800
        assert virtual.machine.word == 0

    def test_control_word_is_obeyed_even_if_the_parameter_is_refused(self) -> None:
        virtual = make()
        reply = ask(virtual, "01ROGD@0999+000000")
        assert (reply.fault_code, reply.status_word & 0x0800) == (0, 0x0800)

    def test_broadcast_is_obeyed_by_all_without_a_reply(self) -> None:
        drives = [make(1), make(31)]
        line = VirtualLine(drives)
        with drivecomm.open_bus(line.port) as bus:
            for virtual in drives:
                drive = bus.drive("vlt3500", virtual.address)
                drive.start()
            everybody = bus.broadcast("vlt3500")
            everybody.write("516", "12.5")
            everybody.stop(Stop.COAST)
            line.advance(1)
            assert [virtual.peek("516", line.time) for virtual in drives] == ["12.50", "12.50"]
            assert not any(virtual.motor.running for virtual in drives)
            assert not bus.counters.get("vlt3500:*", {}).get("replies")


class TestCauses:
    @pytest.mark.parametrize(
        ("request_text", "code"),
        [
            ("01R@@@@0999+000000", 0),
            ("01I@@@@0999+000010", 0),
            ("01U@@@@0999+000010", 0),
            ("01R@@@@0502+000000", 2),
            ("01I@@@@0502+000060", 2),
            ("01I@@@@0602+050012", 2),
            ("01I@@@@0502+001002", 2),
            ("01I@@@@0516+000010", 3),
            ("01U@@@@0602+000010", 4),
            ("01U@@@@0606+000010", 4),
            ("01U@@@@0516+002000", 6),
            ("01U@@@@0110+999990", 6),
            ("01U@@@@0516+000806", 7),
            ("01U@@@@0516+0x0809", 7),
            ("01I@@@@0502+000017", 7),
        ],
    )
    def test_refusal_has_the_fault_code_of_its_cause(self, request_text: str, code: int) -> None:
        reply = ask(make(), request_text)
        assert isinstance(reply, Reply)
        assert (reply.fault_code, reply.kind[0].upper()) == (code, {"I": "R"}.get(request_text[2], request_text[2]))

    def test_unreadable_parameter_is_refused_with_cause_1(self) -> None:
        model = drivecomm_model('access = "w"')
        assert ask(make(model=model), "01R@@@@0777+000000").fault_code == 1

    def test_write_while_running_or_in_factory_set_up_is_refused(self) -> None:
        virtual = make()
        assert ask(virtual, "01U@@@@0104+003800").value == 380
        word(virtual, 0x047F)
        assert ask(virtual, "01U@@@@0104+004000").fault_code == 5
        virtual.store.factory_setup = True
        assert ask(virtual, "01U@@@@0516+000100").fault_code == 4

    def test_value_above_99999_cannot_be_read(self, line_and_drives: Any) -> None:
        _, virtual, drive = line_and_drives
        virtual.poke("606", 123456)
        with pytest.raises(RefusedError, match="99999"):
            drive.read("606")
        with pytest.raises(ParameterAddressError):
            virtual.peek("606", 0.0)

    def test_control_word_beside_an_invalid_byte_19_is_obeyed(self) -> None:
        virtual = make()
        assert ask(virtual, "01UOGD@0516+000806").status_word & 0x0800
        assert tell(virtual, b"<01U@@@@0516+000806??>").unchecked

    @pytest.mark.parametrize(
        "data",
        [
            b"<01R@@@@0516+00000071>",
            b"<02R@@@@0516+00000071>",
            b"<01X@@@@0516+000000??>",
            b"<01R@@@@ 516+000000??>",
            b"<01U@@@@0516+ 00000??>",
            b"<01U@@@@0516+00080",
            b"<01C@@@@0516+00080000>",
        ],
    )
    def test_malformed_or_foreign_telegram_is_not_answered(self, data: bytes) -> None:
        assert tell(make(), data) is None

    def test_damaged_telegram_is_refused_with_cause_99_by_option(self) -> None:
        virtual = make(answers_broken=True)
        for data in (b"<01R@@@@0516+00000071>", b"<01U@@@@0516+ 00000??>", b"<01U@@@@0516+000800??"):
            reply = tell(virtual, data + b"x" if len(data) == 21 else data)
            assert (reply.fault_code, reply.unchecked) == (99, None)
        for data in (b"<01R@@@@ 516+000000??>", b"<02R@@@@0516+00000071>", b"<01C@@@@0516+00080000>", b"<01"):
            assert tell(virtual, data) is None
        tell(virtual, b"<01ROGD@0516+00000071>")
        assert virtual.machine.word == 0


class TestStore:
    def test_written_value_is_rounded_to_the_decimals_of_the_parameter(self, line_and_drives: Any) -> None:
        _, virtual, drive = line_and_drives
        assert "instead of 23.755" in drive.write("516", "23.755").note
        assert virtual.peek("516", 0.0) == "23.76" == drive.read("516").raw
        assert drive.write("516", "-0.001").raw == "0.00"

    def test_option_sets_the_decimals_of_the_reference(self) -> None:
        virtual = make(reference_decimals=0)
        assert virtual.peek("516", 0.0) == "0"

    def test_parameter_500_changes_the_address(self, line_and_drives: Any) -> None:
        _, virtual, drive = line_and_drives
        with pytest.raises(ValueRefusedError):
            drive.write("500", 0)
        assert ask(virtual, "01U@@@@0500+000000").fault_code == 6
        drive.write("500", 7)
        assert virtual.address == 7
        virtual.poke("500", 9)
        assert virtual.address == 9
        with pytest.raises(NoReplyError):
            drive.read("516")

    def test_poked_values_are_held_and_invalid_ones_refused(self) -> None:
        virtual = make()
        virtual.poke("516", 80)
        assert virtual.peek("bus_reference", 0.0) == "80.00"
        virtual.poke("516", "23.755")
        assert virtual.peek("516", 0.0) == "23.755"
        virtual.poke("502[12]", 5)
        virtual.poke("602[10,2]", "4")
        assert (virtual.peek("502[12]", 0.0), virtual.peek("602[10,2]", 0.0)) == ("5", "4")
        virtual.poke("502[1]", "7.25")
        assert virtual.peek("502[1]", 0.0) == "0.00"
        for parameter in ("999", "502", "516[1]", "602[11,0]"):
            with pytest.raises(ParameterAddressError):
                virtual.peek(parameter, 0.0)
            with pytest.raises(ParameterAddressError):
                virtual.poke(parameter, 1)
        for raw in ("fast", "NaN", "0.123456", "1e60"):
            with pytest.raises(ValueRefusedError):
                virtual.poke("516", raw)

    @pytest.mark.parametrize("model", ["vlt3500", "vlt3000", "vlt2000"])
    def test_every_parameter_is_read_as_the_drive_holds_it(self, model: str) -> None:
        virtual = make(model=model)
        line = VirtualLine([virtual])
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("vlt3500", 1, model=model)
            for info in drive.model.parameters.values():
                if "indexed" in info.extra:
                    continue
                assert drive.read(info.address).raw == virtual.peek(info.address, line.time), info.address

    def test_minimal_model_makes_a_working_drive(self) -> None:
        virtual = make(model=drivecomm_model(""))
        assert word(virtual, 0x047F) & 0x0800
        virtual.trip(1, 1.0)
        assert ask(virtual, "01U@@@@0777+000010").value == 1


class TestReplies:
    def test_reply_to_a_control_telegram_copies_its_filler(self) -> None:
        assert ask(make(), "01C@@@@0516+000800").filler == "0516+000800"

    def test_unchecked_request_gets_an_unchecked_reply_unless_disabled(self) -> None:
        assert tell(make(), b"<01R@@@@0516+000000??>").unchecked
        assert not tell(make(copies_unchecked=False), b"<01R@@@@0516+000000??>").unchecked

    def test_reply_of_another_drive_is_not_answered(self) -> None:
        assert make().hear(Framed(b"", Reply(kind="read", address=1, status_word=0, parameter=1)), 0.0) is None

    def test_index_may_have_any_sign_and_form(self) -> None:
        virtual = make()
        virtual.poke("602[10,2]", 8)
        data = CODEC.encode(ReadIndex(address=1, parameter=602, index=(10, 2)))
        assert tell(virtual, data).value == 8
        assert ask(virtual, "01I@@@@0602-010022").value == 8
        assert ask(virtual, "01I@@@@0602+001021").value == 8


def test_silence_after_an_echo_suggests_the_option_idle_word() -> None:
    line = VirtualLine([], echo=True)
    with drivecomm.open_bus(line.port) as bus:
        with pytest.raises(NoReplyError, match="idle_word=0x000F"):
            bus.drive("vlt3500", 1).status()
        with pytest.raises(NoReplyError) as caught:
            bus.drive("vlt3500", 1, idle_word=0x000F).status()
        assert "idle_word" not in str(caught.value)


def test_vlt_2000_is_read_and_started_over_an_echo() -> None:
    line = VirtualLine([make(model="vlt2000")], echo=True)
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vlt3500", 1, model="vlt2000")
        assert drive.read("502[9]").value == 566
        drive.start()
        assert drive.status().running


def test_scan_finds_drives_and_commands_none() -> None:
    drives = [make(3), make(8)]
    line = VirtualLine(drives)
    with drivecomm.open_bus(line.port) as bus:
        found = list(bus.scan(["vlt3500"], range(1, 10)))
    assert [(each.address, each.identity["software"]) for each in found] == [(3, "1.20"), (8, "1.20")]
    assert all(virtual.machine.word == 0 for virtual in drives)


@pytest.mark.soak
@pytest.mark.parametrize("seed", [1, 2])
def test_readings_on_a_disturbed_line_are_right_or_errors(seed: int) -> None:
    chance = Random(seed)
    drives = [make(1), make(2)]
    for virtual in drives:
        for place in range(11):
            virtual.poke(f"602[{place},0]", 100 * virtual.address + place)
    line = VirtualLine(drives, faults=FaultPlan(rate=0.1, seed=seed))
    failures = 0
    with drivecomm.open_bus(line.port) as bus:
        ours = [bus.drive("vlt3500", virtual.address, model="vlt3500") for virtual in drives]
        parameters = ["516", "500", "205", "110", "606", *(f"602[{place},0]" for place in range(11)), "502[9]"]
        for _ in range(1000):
            which = chance.randrange(2)
            parameter = chance.choice(parameters)
            try:
                if chance.random() < 0.3:
                    sent = Decimal(chance.randint(-10000, 10000)).scaleb(-2)
                    reading = ours[which].write("516", sent)
                    parameter = "516"
                else:
                    reading = ours[which].read(parameter)
            except drivecomm.DriveCommError:
                failures += 1
                continue
            assert reading.raw == drives[which].peek(parameter, line.time), parameter
    assert 0 < failures < 300


@pytest.mark.parametrize("seed", [3, 4])
def test_motor_on_a_disturbed_line_runs_only_after_a_start(seed: int) -> None:
    chance = Random(seed)
    virtual = make()
    line = VirtualLine([virtual], faults=FaultPlan(rate=0.1, seed=seed))
    asked_to_run = False
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vlt3500", 1)
        for _ in range(500):
            verb = chance.choice(["start", "stop", "reset", "status", "read", "reference", "trip"])
            asked_to_run = verb == "start" or (asked_to_run and verb not in ("stop", "trip"))
            try:
                if verb == "start":
                    drive.start(reverse=chance.random() < 0.5)
                elif verb == "stop":
                    drive.stop(chance.choice([Stop.RAMP, Stop.COAST, Stop.QUICK]))
                elif verb == "reference":
                    drive.set_reference(percent=chance.randint(-100, 100))
                elif verb == "trip":
                    virtual.trip(5, line.time)
                else:
                    {"reset": drive.reset, "status": drive.status, "read": lambda: drive.read("516")}[verb]()
            except drivecomm.DriveCommError:
                asked_to_run = asked_to_run or virtual.motor.running
                continue
            line.advance(10)
            virtual.machine.live(line.time)
            assert asked_to_run or not virtual.motor.running, verb


def drivecomm_model(lines: str) -> Any:
    """Return a model with parameter 777 and the address parameter 500."""
    from drivecomm.protocol import Model, ParameterInfo

    facts: dict[str, Any] = {"access": "w"} if 'access = "w"' in lines else {}
    infos = {
        "777": ParameterInfo(address="777", name="belt", title="belt", **facts),
        "500": ParameterInfo(address="500", name="address", title="address"),
    }
    return Model(protocol="vlt3500", name="own", title="", source="", parameters=infos, faults={}, options={})
