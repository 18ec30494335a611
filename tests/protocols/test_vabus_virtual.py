"""A virtual VABus drive on a virtual line, commanded through the public API."""

from dataclasses import replace
from decimal import Decimal
from random import Random

import pytest

import drivecomm
from drivecomm.bus import keep
from drivecomm.errors import ParameterAddressError
from drivecomm.plant import FaultPlan
from drivecomm.protocol import Damaged, DriveState, Framed, Stop
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_vabus.telegrams import BROADCAST, Enquiry, Nak, Select, telegrams
from drivecomm_vabus.virtual import VirtualVabusDrive


def line_with(**options):
    drive = virtual_drive("vabus", 1, **options)
    assert isinstance(drive, VirtualVabusDrive)
    return VirtualLine([drive]), drive


@pytest.fixture
def virtual():
    line, drive = line_with()
    with drivecomm.open_bus(line.port) as bus:
        yield line, drive, bus.drive("vabus", 1, model="agile")


def ask(drive, message, now=0.0):
    reply = drive.hear(Framed(telegrams().encode(message), message), now)
    return None if reply is None else telegrams().decode(reply.data, "reply")


@pytest.mark.parametrize(("trailing_eot", "closing"), [(True, b"\x04"), ("after writes", b""), (False, b"")])
def test_repeated_reads_take_only_the_time_of_their_telegrams(trailing_eot, closing):
    line, _ = line_with(reply_delay_s=0.010)
    sent = []
    with drivecomm.open_bus(line.port, trace=lambda event: event.what == "sent" and sent.append(event)) as bus:
        drive = bus.drive("vabus", 1, model="agile", trailing_eot=trailing_eot)
        assert {drive.read("481").value for _ in range(10)} == {Decimal("10.00")}
    assert {event.data for event in sent} - {closing} == {bytes.fromhex("0441303034383105")}
    asked = [event.time for event in sent if event.data != closing]
    # Enquiry and value, seven data bits with parity at 19200 baud; the delay of the drive; the turnaround of 2 ms.
    expected = (8 + 19 + len(closing)) * 10 / 19200 + 0.010 + 0.002
    assert asked[-1] - asked[1] == pytest.approx(expected * (len(asked) - 2))


class TestMotor:
    def test_motor_ramps_up_and_stops(self, virtual):
        line, _, drive = virtual
        drive.set_reference(hz=40)
        drive.start()
        assert not drive.status().at_reference
        line.advance(10)
        assert drive.status().at_reference
        assert str(drive.read("stator_frequency")) == "40.00 Hz"
        assert drive.read("rms_current").value > 0
        drive.stop()
        line.advance(2)
        assert 0 < drive.read("stator_frequency").value < 40
        line.advance(10)
        assert drive.status().state is DriveState.READY
        assert drive.read("stator_frequency").value == 0

    @pytest.mark.parametrize("left_over", [-20, 20])
    @pytest.mark.parametrize("percentage", [-10, 0, 10])
    def test_start_decides_the_direction_whatever_sign_the_references_have(self, virtual, left_over, percentage):
        line, _, drive = virtual
        for reverse in (False, True, False):
            drive.write("480", left_over)
            drive.write("520", percentage)
            drive.start(reverse=reverse)
            line.advance(20)
            found = drive.read("stator_frequency").value
            assert found < 0 if reverse else found > 0

    @pytest.mark.parametrize(("parameter", "least"), [("480", Decimal("-21474836.48")), ("520", Decimal("-327.68"))])
    def test_lowest_possible_reference_can_be_reversed(self, virtual, parameter, least):
        line, _, drive = virtual
        drive.write(parameter, least)
        drive.start()
        line.advance(20)
        assert drive.read("stator_frequency").value > 0

    def test_forward_start_by_another_program_turns_forwards(self, virtual):
        line, _, drive = virtual
        drive.set_reference(hz=10)
        drive.start(reverse=True)
        drive.stop()
        with drivecomm.open_bus(line.port) as bus:
            bus.drive("vabus", 1, model="agile").start()
        line.advance(10)
        assert drive.read("stator_frequency").value == 10

    def test_references_in_percent_and_hertz_do_not_add_up(self, virtual):
        line, _, drive = virtual
        drive.start()
        for reference, expected in (
            ({"percent": 30}, 15), ({"hz": 10}, 10), ({"percent": 40}, 20), ({"percent": 0}, 0), ({"hz": 5}, 5),
            ({"hz": 0}, 0),
        ):  # fmt: skip
            drive.set_reference(**reference)
            line.advance(20)
            assert drive.read("stator_frequency").value == expected

    def test_reference_above_the_maximum_frequency_is_refused(self, virtual):
        _, _, drive = virtual
        with pytest.raises(drivecomm.ValueRefusedError, match=r"above 50\.00 Hz, the maximum frequency of vabus:1"):
            drive.set_reference(hz=60)

    def test_direction_is_kept_through_a_reference_of_zero(self, virtual):
        line, _, drive = virtual
        drive.set_reference(hz=0)
        drive.start(reverse=True)
        for hz in (10, 0, 20):
            drive.set_reference(hz=hz)
            line.advance(20)
            assert abs(drive.read("stator_frequency").value + hz) <= Decimal("0.01")

    def test_coast_switches_the_output_off(self, virtual):
        line, _, drive = virtual
        drive.start()
        line.advance(10)
        drive.stop(Stop.COAST)
        assert drive.status().state is DriveState.NOT_READY
        assert drive.read("210").value == 0

    def test_quick_stop_ends_in_switch_on_disabled(self, virtual):
        line, _, drive = virtual
        drive.start()
        line.advance(10)
        drive.stop(Stop.QUICK)
        assert drive.status().state is DriveState.STOPPING
        line.advance(5)
        assert drive.status().flags[0] == "switch on disabled"

    def test_trip_can_be_reset_after_15_seconds(self, virtual):
        line, virtual_one, drive = virtual
        drive.start()
        virtual_one.trip(0x0300, line.time)
        status = drive.status()
        assert (status.fault, status.fault_code) == (True, 0x0300)
        with pytest.raises(drivecomm.StateError):
            drive.start()
        with pytest.raises(drivecomm.StateError, match="15 s"):
            drive.reset()
        line.advance(15)
        drive.reset()
        assert not drive.status().fault
        assert not virtual_one.motor.running
        drive.start()

    def test_trip_and_warning_of_the_motor_are_reported(self, virtual):
        line, virtual_one, drive = virtual
        virtual_one.motor.trip(5, line.time)
        virtual_one.motor.warning = True
        assert drive.status().fault_code == 5
        assert drive.status().warning

    def test_control_word_acts_as_contacts_in_mode_2(self, virtual):
        _, virtual_one, drive = virtual
        drive.write("412", 2)
        drive.call("control_word", word=3)
        assert virtual_one.motor.running
        drive.call("control_word", word=1)
        assert drive.status().flags[0] == "switched on"

    @pytest.mark.parametrize("how", [Stop.RAMP, Stop.COAST, Stop.QUICK])
    @pytest.mark.parametrize("mode", [0, 1, 2, 3, 5, 65535])
    @pytest.mark.parametrize("words", [(), (6,), (6, 7), (6, 7, 15), (6, 7, 15, 2)])
    def test_every_stop_stops_the_motor_in_every_mode_and_starts_none(self, how, mode, words):
        for everybody in (False, True):
            line, virtual_one = line_with()
            with drivecomm.open_bus(line.port) as bus:
                drive = bus.drive("vabus", 1, model="agile")
                for word in words:
                    drive.call("control_word", word=word)
                virtual_one.poke("412", mode)
                ran = virtual_one.motor.running
                (bus.broadcast("vabus") if everybody else drive).stop(how)
                line.advance(0.1)
                assert ran or not virtual_one.motor.running
                line.advance(20)
                drive.status()
                assert not virtual_one.motor.running

    def test_start_in_remote_contacts_is_refused_even_while_kept(self, virtual):
        _, virtual_one, drive = virtual
        virtual_one.poke("412", 2)
        with pytest.raises(drivecomm.StateError, match="write 412 = 1"):
            drive.start()
        with keep(drive, "trip"):
            assert not virtual_one.motor.running
        assert not virtual_one.motor.running

    def test_broadcast_stop_and_write_are_obeyed_without_a_reply(self):
        drives = [virtual_drive("vabus", node) for node in (1, 2)]
        line = VirtualLine(drives)
        with drivecomm.open_bus(line.port) as bus:
            for node in (1, 2):
                bus.drive("vabus", node).start()
            began = line.time
            bus.broadcast("vabus").stop(Stop.COAST)
            bus.broadcast("vabus", model="agile").write("481", "12.00")
            assert line.time - began < 0.2
            assert bus.drive("vabus", 2, model="agile").read("481").value == 12
        line.advance(0.1)
        assert not any(drive.motor.running for drive in drives)


class TestParameters:
    def test_every_readable_parameter_is_read_as_the_drive_holds_it(self, virtual):
        line, virtual_one, drive = virtual
        for address, info in drive.model.parameters.items():
            if "r" in info.access:
                assert drive.read(address).raw == virtual_one.peek(address, line.time)

    def test_power_cycle_clears_volatile_writes_only(self, virtual):
        _, virtual_one, drive = virtual
        drive.write("481", 20, store=True)
        drive.write("481", 30)
        assert drive.read("481").value == 30
        virtual_one.store.power_cycle()
        assert drive.read("481").value == 20

    def test_read_of_data_sets_that_differ_is_refused_with_code_9(self, virtual):
        _, _, drive = virtual
        drive.write("481[2]", 33)
        assert drive.read("481[2]").value == 33
        with pytest.raises(drivecomm.RefusedError) as caught:
            drive.read("481")
        assert caught.value.code == 9

    @pytest.mark.parametrize(
        ("parameter", "given", "options", "code"),
        [
            ("210", 1, {"type": "long"}, 4),
            ("999", 1, {"type": "uint"}, 11),
            ("394", 31, {"type": "uint"}, 1),
            ("481", 1, {"type": "uint"}, 14),
            ("481", "ABCDEFGH", {"type": "string"}, 13),
            ("394[2]", 1, {"type": "uint"}, 2),
        ],
    )
    def test_refused_write_has_its_code_and_leaves_no_lock(self, virtual, parameter, given, options, code):
        line, virtual_one, _ = virtual
        with drivecomm.open_bus(line.port) as bus:
            bare = bus.drive("vabus", 1)
            with pytest.raises(drivecomm.RefusedError) as caught:
                bare.write(parameter, given, **options)
            assert caught.value.code == code
            assert not virtual_one.locked
            bare.write("481", 1000, type="long")

    def test_refused_read_has_its_code(self, virtual):
        _, _, drive = virtual
        for parameter, code in (("18", 3), ("394[1]", 2), ("999", 11)):
            with pytest.raises(drivecomm.RefusedError) as caught:
                drive.read(parameter)
            assert caught.value.code == code

    def test_some_parameters_cannot_be_written_while_the_motor_runs(self, tmp_path):
        path = tmp_path / "mine.toml"
        path.write_text(
            'format = 1\nprotocol = "vabus"\nname = "mine"\n'
            '[[parameter]]\naddress = "410"\nname = "control"\ntype = "uint"\n'
            '[[parameter]]\naddress = "411"\nname = "state"\ntype = "uint"\naccess = "r"\n'
            '[[parameter]]\naddress = "412"\nname = "mode"\ntype = "uint"\nstart = "1"\n'
            '[[parameter]]\naddress = "394"\nname = "node"\ntype = "uint"\n'
            '[[parameter]]\naddress = "372"\nname = "speed"\ntype = "uint"\naccess = "rw*"\n'
            '[[parameter]]\naddress = "29"\nname = "user"\ntype = "string"\nstart = "PUMP 3"\n'
        )
        line, _ = line_with(model=path)
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("vabus", 1, model=path)
            assert drive.read("user").value == "PUMP 3"
            drive.write("speed", 1500)
            drive.start()
            with pytest.raises(drivecomm.RefusedError, match="runs"):
                drive.write("speed", 1400)

    def test_write_to_a_ram_data_set_that_the_drive_lacks_is_refused(self):
        line, _ = line_with(model="act")
        with drivecomm.open_bus(line.port) as bus:
            with pytest.raises(drivecomm.RefusedError) as caught:
                bus.drive("vabus", 1, model="agile").write("481", 1)
            assert caught.value.code == 2

    def test_block_access_reads_and_writes_several_parameters(self, virtual):
        _, _, drive = virtual
        drive.write("481", 10)
        drive.write("17", "0048100372")
        assert drive.read("19").value == "000003E8" + drive.read("372").raw
        drive.write("18", "000007D005AA")
        assert (drive.read("481").value, drive.read("372").value) == (20, 1450)
        for data in ("000007D0", "000007D005AA0"):
            with pytest.raises(drivecomm.RefusedError) as caught:
                drive.write("18", data)
            assert caught.value.code == 14
        assert drive.read("481").value == 20
        for no_list in ("004", "007BA", " ", 16 * "00481"):
            drive.write("17", no_list)
            with pytest.raises(drivecomm.RefusedError):
                drive.read("19")
        with pytest.raises(drivecomm.RefusedError) as caught:
            drive.write("17", 17 * "00411")
        assert caught.value.code == 14

    def test_control_words_written_by_a_block_are_obeyed(self):
        _, drive = line_with()
        for number, data in (
            (17, "004120041900410"),
            (18, "000100001F400006"),
            (18, "000100001F400007"),
            (18, "000100001F40000F"),
        ):
            assert ask(drive, Select(address=1, parameter=number, data=data)).kind == "ack", number
        assert ask(drive, Enquiry(address=1, parameter=411)).data == "0237"
        assert drive.motor.maximum_hz == 80

    @pytest.mark.parametrize(
        "message",
        [
            Enquiry(address=1, parameter=11),
            Enquiry(address=1, parameter=19),
            Select(address=1, parameter=18, data="00000000"),
        ],
    )
    @pytest.mark.parametrize("dataset", [1, 7])
    def test_error_register_and_block_parameters_have_no_data_sets(self, message, dataset):
        _, drive = line_with()
        assert ask(drive, Select(address=1, parameter=17, data="00481")).kind == "ack"
        assert ask(drive, replace(message, dataset=dataset)) == Nak(address=1)
        assert drive.error_register == 2

    def test_lower_case_data_are_accepted_with_the_option(self):
        _, drive = line_with(lower_case_hex=True)
        assert ask(drive, Select(address=1, parameter=481, data="000003e8")).kind == "ack"
        assert ask(drive, Enquiry(address=1, parameter=481)).data == "000003E8"

    @pytest.mark.parametrize("wrong", [12.5, -1.5, 2**40])
    def test_poke_refuses_a_number_outside_its_type(self, wrong):
        virtual_one = virtual_drive("vabus", 1)
        with pytest.raises(ValueError, match="is not a whole number from -2147483648 to 2147483647"):
            virtual_one.poke("210", wrong)

    def test_poked_values_are_read_and_unknown_parameters_are_refused(self, virtual):
        line, virtual_one, drive = virtual
        virtual_one.poke("481", 777)
        assert drive.read("481").value * 100 == 777
        virtual_one.poke("520[2]", "03E8")
        assert virtual_one.peek("520[2]", line.time) == "03E8"
        with pytest.raises(ParameterAddressError):
            virtual_one.poke("999", 1)
        with pytest.raises(ParameterAddressError):
            virtual_one.peek("999", 0)

    def test_poked_measured_value_is_overwritten(self, virtual):
        line, virtual_one, drive = virtual
        drive.set_reference(hz=40)
        drive.start()
        line.advance(10)
        virtual_one.poke("210", 777)
        drive.write("17", "0021000230")
        assert virtual_one.peek("210", line.time) == "00000FA0"
        assert drive.read("19").value == "00000FA0" + drive.read("520").raw


class TestTelegrams:
    def test_write_lock_keeps_the_first_error_code(self):
        _, drive = line_with()
        assert ask(drive, Enquiry(address=1, parameter=999)) == Nak(address=1)
        assert ask(drive, Select(address=1, parameter=480, data="00000000")) == Nak(address=1)
        assert drive.error_register == 11
        assert ask(drive, Enquiry(address=1, parameter=480)).data == "00000BB8"
        assert ask(drive, Enquiry(address=1, parameter=11)).data == "000B"
        assert ask(drive, Enquiry(address=1, parameter=11)).data == "0000"
        assert ask(drive, Select(address=1, parameter=480, data="00000000")).kind == "ack"

    def test_request_to_an_unknown_system_bus_node_is_refused_with_code_20(self):
        _, drive = line_with()
        assert ask(drive, Enquiry(address=1, sys=3, parameter=480)) == Nak(address=1)
        assert drive.error_register == 20

    def test_system_bus_node_is_unlocked_by_its_error_register(self):
        line, _ = line_with(sys=5)
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("vabus", 1, model="agile", sys=5)
            for parameter in ("999", "998"):
                with pytest.raises(drivecomm.RefusedError) as caught:
                    drive.read(parameter)
                assert caught.value.code == 11
            drive.write("481", 20)
            assert drive.read("481").value == 20

    def test_wrong_bcc_or_syntax_is_refused_and_wrong_structure_not_answered(self):
        _, drive = line_with()
        codec = telegrams()
        good = codec.encode(Select(address=1, parameter=480, data="00000000"))
        for data, code in (
            (good[:-1] + bytes([good[-1] ^ 1]), 12),
            (good[:4] + b"x" + good[5:-1] + bytes([good[-1] ^ good[4] ^ ord("x")]), 13),
            (good[:1] + b"B" + good[2:-1] + b"\0", None),
            (codec.encode(Enquiry(address=1, parameter=480))[:-1] + b"\0", None),
            (good[:1] + b"_" + good[2:], None),
        ):
            drive.error_register, drive.locked = 0, False
            with pytest.raises(drivecomm.TelegramError) as caught:
                codec.decode(data, "request")
            reply = drive.hear(Damaged(data, caught.value), 0.0)
            assert (reply is not None) is (code is not None), data
            assert drive.error_register == (code or 0)

    def test_option_silent_on_suppresses_a_refusal(self):
        _, drive = line_with(silent_on=(11,))
        assert ask(drive, Enquiry(address=1, parameter=999)) is None
        assert drive.locked

    def test_refused_broadcast_locks_the_drive_without_a_reply(self):
        _, drive = line_with()
        assert ask(drive, Select(address=BROADCAST, parameter=999, data="0000")) is None
        assert drive.locked

    def test_request_to_another_address_is_ignored(self):
        _, drive = line_with()
        assert ask(drive, Enquiry(address=2, parameter=480)) is None

    def test_invalid_option_is_refused(self):
        with pytest.raises(drivecomm.UsageError):
            virtual_drive("vabus", 1, sys=64)
        with pytest.raises(drivecomm.UsageError):
            drivecomm.decode("vabus", b"\x04", direction="request", type="float")


@pytest.mark.soak
def test_disturbed_line_gives_right_values_or_errors():
    faults = FaultPlan(rate=0.1, seed=4711)
    line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("vabus", 2)], faults=faults)
    choose = Random(1)
    failures = 0
    with drivecomm.open_bus(line.port) as bus:
        drives = [bus.drive("vabus", node, model="agile") for node in (1, 2)]
        for turn in range(2000):
            drive, virtual_one = choose.choice(list(zip(drives, line.drives, strict=True)))
            parameter = choose.choice(["480", "481", "482[2]", "372", "520", "30"])
            try:
                if turn % 5 == 0:
                    drive.write("482", choose.randint(-50, 50))
                assert drive.read(parameter).raw == virtual_one.peek(parameter, line.time), f"turn {turn}"
            except drivecomm.DriveCommError:
                failures += 1
    assert faults.happened
    assert failures < 200
