"""The virtual FC drive on a virtual line: parameters, refusals, and the effects of control words over time."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import NoReplyError, ParameterAddressError, RefusedError, StateError
from drivecomm.protocol import DriveState, Framed, Framer, Noise, Stop
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_danfoss_fc.messages import ParameterRequest, ProcessRequest, TextRequest
from drivecomm_danfoss_fc.telegrams import DanfossFcCodec

CODEC = DanfossFcCodec()


class Bench:
    """A virtual drive, and the drive object of its master."""

    def __init__(self, model="fc300", **options):
        self.virtual = virtual_drive("danfoss-fc", 3, model=model, **options)
        self.line = VirtualLine([self.virtual])
        self.bus = drivecomm.open_bus(self.line.port)
        self.drive = self.bus.drive("danfoss-fc", 3, model=model, **options)

    def wait(self, seconds):
        self.line.advance(seconds)
        self.virtual.peek(next(iter(self.drive.model.parameters)), self.line.time)

    @property
    def hz(self):
        self.wait(0)
        return round(self.virtual.motor.output_hz, 2)

    def run(self, percent=100):
        self.drive.set_reference(percent=percent)
        self.drive.start()
        self.wait(10)


@pytest.fixture
def bench():
    return Bench()


def heard(virtual, message, now=0.0):
    """Pass a message to a drive; return its decoded replies."""
    framer = Framer(virtual.codec, "request")
    finds = [*framer.feed(virtual.codec.encode(message)), *framer.flush()]
    replies = [virtual.hear(find, now) for find in finds if not isinstance(find, Noise)]
    return [virtual.codec.decode(reply.data, "reply") for reply in replies if reply is not None]


def asked(ak, pnu, ind=0, pwe=0, **more):
    fields = {"address_format": "1-126", "address": 3, "control_word": 0, "reference": 0, **more}
    return ParameterRequest(ak=ak, pnu=pnu, ind=ind, pwe=pwe, **fields)


def commanded(word, reference=0, **more):
    fields = {"address_format": "1-126", "address": 3, **more}
    return ProcessRequest(control_word=word, reference=reference, **fields)


class TestParameters:
    @pytest.mark.parametrize("model", ["fc300", "fc302", "fc202", "fc102", "fc101", "vlt5000", "vlt6000"])
    def test_every_parameter_is_read_as_the_drive_holds_it(self, model):
        bench = Bench(model)
        for address, info in bench.drive.model.parameters.items():
            reading = bench.drive.read(address)
            assert reading.raw == bench.virtual.peek(address, bench.line.time), address
            assert reading.name == info.name
            assert bool(reading.note) is (info.sure != "printed" and info.type != "text")

    def test_array_elements_are_read_and_written(self, bench):
        assert [bench.drive.read(f"3-10[{index}]").value for index in range(4)] == [0, 10, 25, 50]
        bench.drive.write("3-10[7]", -12.5)
        assert bench.drive.read("3-10[7]").value == Decimal("-12.5")
        assert bench.virtual.peek("3-10[7]", bench.line.time) == 0xFB1E

    def test_power_cycle_clears_volatile_writes_only(self, bench):
        bench.drive.write("3-41", 7)
        bench.drive.write("3-42", 8, store=True)
        bench.virtual.power_cycle(bench.line.time)
        assert bench.drive.read("3-41").value == 3
        assert bench.drive.read("3-42").value == 8
        assert bench.drive.read("15-03").value == 43

    def test_texts_are_read_and_written(self, bench):
        assert bench.drive.read("15-40").value == "FC-302"
        assert bench.drive.write("0-37", "Lüfter").value == "Lüfter"
        assert bench.drive.read("0-37").value == "Lüfter"
        assert bench.drive.read("8-04", option_text=5).value == "stop and trip"

    def test_poked_value_is_read_and_unknown_parameters_are_refused(self, bench):
        bench.virtual.poke("16-14", 524)
        assert bench.drive.read("16-14").value == Decimal("5.24")
        bench.drive.start()
        bench.virtual.power_cycle(bench.line.time)
        assert bench.drive.read("16-14").value == Decimal("5.24")
        bench.virtual.poke("3-02", -50000)
        assert bench.virtual.peek("3-02", 0) == 0xFFFF3CB0
        assert bench.drive.read("3-02").value == -50
        for unknown in ("9-99", "3-10[8]"):
            with pytest.raises(ParameterAddressError, match="holds no"):
                bench.virtual.peek(unknown, 0)
            with pytest.raises(ParameterAddressError, match="holds no"):
                bench.virtual.poke(unknown, 1)

    @pytest.mark.parametrize(
        ("element", "value"),
        [(1, 0x4003), (2, 8), (4, 0xFE18), (7, 0xD8F0), (8, 10000), (20, 0)],
    )
    def test_array_has_its_description_elements(self, bench, element, value):
        assert bench.drive.read("3-10", element=element).raw == value

    def test_options_texts_and_words_have_description_elements(self, bench):
        assert bench.drive.read("8-04", element=1).text == "data type 5, option texts available"
        bench.drive.write("8-04", 2)
        assert "differs" in bench.drive.read("8-04", element=1).text
        assert bench.drive.read("15-40", element=1).text == (
            "data type 9, text available, read only, limits not relevant"
        )
        assert bench.drive.read("16-00", element=1).text == "data type 35, read only"
        assert bench.drive.read("16-00", element=2).raw == 1
        assert bench.drive.read("3-10", element=6).value == "preset reference"
        assert bench.drive.read("16-14", element=7).raw == 0x80000000


class TestFaults:
    def refused(self, bench, call, code):
        with pytest.raises(RefusedError) as caught:
            call(bench.drive)
        assert caught.value.code == code

    @pytest.mark.parametrize(
        ("call", "code"),
        [
            (lambda drive: drive.read("9-99"), 0),
            (lambda drive: drive.write("16-14", 1), 1),
            (lambda drive: drive.write("4-14", 1001), 2),
            (lambda drive: drive.read("3-10[8]"), 3),
            (lambda drive: drive.read("16-14[1]"), 4),
            (lambda drive: drive.write("3-41", 5, type="uint16"), 5),
            (lambda drive: drive.read("15-40", type="uint16"), 5),
            (lambda drive: drive.read("3-10", element=21), 9),
            (lambda drive: drive.read("15-40", element=4), 9),
            (lambda drive: drive.read("16-13", type="text"), 15),
            (lambda drive: drive.read("8-04", option_text=6), 15),
        ],
    )
    def test_refusal_has_the_fault_code_of_its_cause(self, bench, call, code):
        self.refused(bench, call, code)

    def test_text_too_long_for_its_parameter_is_refused(self):
        bench = Bench()
        bare = bench.bus.drive("danfoss-fc", 3)
        with pytest.raises(RefusedError) as caught:
            bare.write("0-37", "x" * 26, type="text")
        assert caught.value.code == 2

    def test_text_written_to_a_number_is_refused(self, bench):
        bare = bench.bus.drive("danfoss-fc", 3)
        with pytest.raises(RefusedError) as caught:
            bare.write("3-41", "fast", type="text")
        assert caught.value.code == 5

    def test_some_parameters_cannot_be_written_while_the_motor_runs(self, bench):
        bench.drive.write("1-23", 60)
        bench.run()
        self.refused(bench, lambda drive: drive.write("1-23", 50), 17)
        bench.drive.write("3-41", 5)

    def test_access_without_bus_rights_or_in_factory_set_up_is_refused(self, bench):
        bench.virtual.store.without_bus_access.add(341)
        self.refused(bench, lambda drive: drive.read("3-41"), 130)
        bench.virtual.store.factory_set_up = True
        self.refused(bench, lambda drive: drive.write("3-42", 5), 131)

    def test_text_write_to_an_fc_101_is_refused_by_the_drive(self):
        (reply,) = heard(
            virtual_drive("danfoss-fc", 3, model="fc101"),
            TextRequest(
                address_format="1-126", address=3, ak=15, pnu=37, ind=0x0500, text="A", control_word=0, reference=0
            ),
        )
        assert (reply.ak, reply.pwe) == (7, 253)

    def test_unlisted_command_is_refused(self):
        virtual = virtual_drive("danfoss-fc", 3)
        data = bytes.fromhex("02 0E 83 91 9E 00 00 00 00 00 01 00 00 00 00")
        checked = 0
        for byte in data:
            checked ^= byte
        (find,) = Framer(virtual.codec, "request").feed(data + bytes([checked]))
        reply = virtual.codec.decode(virtual.hear(find, 0).data, "reply")
        assert (reply.ak, reply.pwe) == (7, 253)

    def test_ak_0_is_answered_with_ak_0(self):
        (reply,) = heard(virtual_drive("danfoss-fc", 3), asked(0, 1614))
        assert (reply.ak, reply.pnu, reply.pwe) == (0, 1614, 0)

    @pytest.mark.parametrize("ind", [0x0000, 0x0300])
    def test_text_read_with_an_invalid_ind_is_refused(self, ind):
        (reply,) = heard(virtual_drive("danfoss-fc", 3), asked(15, 1, ind))
        assert (reply.ak, reply.pwe) == (7, 15)

    def test_high_byte_of_ind_is_ignored_for_numbers(self):
        (reply,) = heard(virtual_drive("danfoss-fc", 3), asked(1, 310, 0x0702))
        assert (reply.ak, reply.ind, reply.pwe) == (1, 0x0702, 2500)


class TestSilence:
    def test_request_to_another_address_is_not_answered(self):
        virtual = virtual_drive("danfoss-fc", 3)
        assert heard(virtual, asked(1, 1, address=4)) == []
        far = virtual_drive("danfoss-fc", 35)
        assert heard(far, asked(1, 1, address=3, address_format="1-31")) == []

    def test_reply_uses_the_address_format_of_the_request(self):
        (reply,) = heard(virtual_drive("danfoss-fc", 3), asked(1, 1, address_format="1-31"))
        assert (reply.address_format, reply.address) == ("1-31", 3)

    def test_bit_6_of_the_short_format_is_returned_unchanged(self):
        virtual = virtual_drive("danfoss-fc", 3, model="fc300")
        request = bytes.fromhex("02 06 43 00 00 00 00 47")
        reply = virtual.hear(Framed(request, CODEC.decode(request, "request")), 0.0)
        assert reply.data.hex(" ") == "02 06 43 06 07 00 00 46"

    def test_broadcast_is_obeyed_and_not_answered(self, bench):
        bench.run()
        bench.bus.broadcast("danfoss-fc").stop()
        bench.wait(10)
        assert bench.hz == 0

    def test_damaged_request_is_not_answered(self):
        virtual = virtual_drive("danfoss-fc", 3)
        framer = Framer(virtual.codec, "request")
        finds = framer.feed(CODEC.encode(asked(1, 1))[:-1] + b"\x00")
        assert [virtual.hear(find, 0) for find in finds if not isinstance(find, Noise)] == [None]

    def test_read_from_an_unused_address_raises_no_reply_error(self, bench):
        with pytest.raises(NoReplyError):
            bench.bus.drive("danfoss-fc", 4).read("16-14")

    @pytest.mark.parametrize(
        ("options", "delay"), [({}, 0.005), ({"reply_delay_s": 0.02}, 0.02), ({"model": "vlt5000"}, 22 / 9600)]
    )
    def test_reply_delay_depends_on_options_and_model(self, options, delay):
        virtual = virtual_drive("danfoss-fc", 3, **options)
        (find,) = Framer(virtual.codec, "request").feed(virtual.codec.encode(asked(1, 1)))
        assert virtual.hear(find, 0).delay_s == pytest.approx(delay)


class TestMotor:
    def test_motor_follows_the_ramps_up_and_down(self, bench):
        bench.drive.set_reference(percent=50)
        bench.drive.start()
        assert bench.drive.status().word == 0x0E07
        bench.wait(1)
        assert 0 < bench.hz < 25
        bench.wait(5)
        status = bench.drive.status()
        assert (status.word, status.actual_percent) == (0x0F07, 50)
        assert bench.drive.read("16-13").value == 25
        bench.drive.stop()
        bench.wait(1)
        assert 0 < bench.hz < 25
        bench.wait(5)
        assert bench.drive.status().word == 0x0607

    def test_reply_shows_the_status_before_the_command(self):
        virtual = virtual_drive("danfoss-fc", 3)
        (reply,) = heard(virtual, commanded(0x047C, 8192))
        assert reply.status_word == 0x0607
        (reply,) = heard(virtual, commanded(0x047C, 8192))
        assert reply.status_word == 0x0E07

    def test_invalid_control_word_is_ignored_with_its_reference(self):
        virtual = virtual_drive("danfoss-fc", 3)
        heard(virtual, commanded(0xFBFF, 8192))
        assert not virtual.motor.running
        assert virtual.peek("16-86", 0) == 0

    @pytest.mark.parametrize("how", list(Stop))
    def test_every_stop_stops_the_motor(self, bench, how):
        bench.run()
        bench.drive.stop(how)
        bench.wait(0.2)
        after = bench.hz
        assert after == 0 if how is Stop.COAST else 0 < after < 50
        assert bench.drive.status().state is (DriveState.NOT_READY if how is Stop.COAST else DriveState.RUNNING)
        bench.wait(10)
        assert bench.hz == 0
        assert not bench.drive.status().running

    def test_quick_stop_takes_about_one_second(self, bench):
        bench.run()
        bench.drive.stop(Stop.QUICK)
        bench.wait(1.1)
        assert bench.hz == 0

    def test_reverse_start_reverses_only_if_parameter_8_54_allows_it(self, bench):
        bench.run()
        bench.drive.start(reverse=True)
        bench.wait(10)
        assert bench.hz == -50
        status = bench.drive.status()
        assert (status.reverse, status.actual_percent) == (True, -100)
        bench.drive.write("8-54", 0)
        bench.drive.start(reverse=True)
        bench.wait(10)
        assert bench.hz == 50

    def test_negative_reference_needs_a_negative_range_and_both_directions(self, bench):
        bench.run(-50)
        assert bench.hz == 0
        bench.drive.write("3-00", 1)
        bench.run(-50)
        assert bench.hz == -25
        assert bench.drive.status().actual_percent == -50
        bench.drive.stop(Stop.COAST)
        bench.drive.write("4-10", 0)
        bench.run(-50)
        assert bench.hz == 0

    def test_preset_is_added_to_the_bus_reference(self, bench):
        bench.drive.call("select_preset", number=3)
        bench.run(10)
        assert bench.hz == 17.5
        assert bench.drive.read("16-02").value == 35

    def test_preset_may_replace_the_bus_reference(self):
        bench = Bench(presets_added=False)
        bench.drive.call("select_preset", number=3)
        bench.run(10)
        assert bench.hz == 12.5
        bench.drive.call("select_preset", number=1)
        bench.wait(10)
        assert bench.hz == 5

    def test_preset_selection_is_ignored_without_bus_access(self, bench):
        bench.drive.write("8-56", 0)
        bench.drive.call("select_preset", number=3)
        bench.run(10)
        assert bench.hz == 5

    def test_jog_turns_the_motor_at_the_jog_speed(self, bench):
        bench.drive.call("jog")
        bench.wait(5)
        assert bench.hz == 5

    def test_ramp_2_uses_its_own_ramp_time(self, bench):
        bench.drive.call("ramp", number=2)
        bench.drive.set_reference(percent=100)
        bench.drive.start()
        bench.wait(3)
        assert bench.hz == pytest.approx(25, abs=1)

    def test_hold_freezes_the_output_frequency(self, bench):
        bench.drive.set_reference(percent=100)
        bench.drive.start()
        bench.wait(1)
        bench.drive.call("hold")
        held = bench.hz
        bench.wait(5)
        assert bench.hz == held
        bench.drive.start()
        bench.wait(5)
        assert bench.hz == 50

    def test_actual_percent_is_zero_if_the_reference_range_ends_at_zero(self):
        bench = Bench(reference_maximum_hz=50)
        bench.run()
        bench.drive.write("3-00", 0)
        bench.drive.write("3-02", -10)
        bench.drive.write("3-03", 0)
        bench.drive.jog(1)
        bench.wait(5)
        assert bench.hz != 0
        assert bench.drive.status().actual_percent == 0

    def test_output_frequency_stays_within_the_limits(self, bench):
        bench.drive.write("4-12", 20)
        bench.drive.write("4-14", 40)
        bench.run(10)
        assert bench.hz == 20
        bench.run(100)
        assert bench.hz == 40

    def test_set_up_is_selected_only_if_the_drive_allows_it(self, bench):
        bench.drive.stop()
        bench.drive.call("select_setup", number=4)
        assert bench.virtual.machine.set_up == 4
        bench.drive.write("0-10", 1)
        bench.drive.call("select_setup", number=2)
        assert bench.virtual.machine.set_up == 4

    def test_relays_switch_only_if_the_bus_controls_them(self, bench):
        bench.drive.stop()
        bench.drive.call("set_relay", number=2, on=True)
        assert bench.drive.read("16-71").value == 2
        bench.drive.write("5-40[1]", 0)
        bench.drive.call("set_relay", number=1, on=True)
        assert bench.drive.read("16-71").value == 1

    def test_start_and_coast_need_bus_control(self, bench):
        bench.drive.write("8-53", 0)
        bench.drive.start()
        assert not bench.drive.status().running
        bench.drive.write("8-53", 1)
        bench.drive.start()
        bench.drive.set_reference(percent=100)
        bench.wait(10)
        bench.drive.write("8-50", 0)
        bench.drive.stop(Stop.COAST)
        bench.wait(1)
        assert bench.hz == 50

    def test_start_in_local_operation_is_refused(self, bench):
        bench.virtual.machine.local = True
        with pytest.raises(StateError, match="local"):
            bench.drive.start()
        heard(bench.virtual, commanded(0x047C, 8192))
        assert not bench.virtual.motor.running
        assert bench.drive.status().remote is False

    def test_conditions_are_shown_in_the_status_word(self, bench):
        bench.virtual.machine.conditions = 1 << 13
        assert "DC link voltage outside limits" in bench.drive.status().flags


class TestTrip:
    def test_trip_is_logged_and_cleared_by_a_reset(self, bench):
        bench.run()
        bench.virtual.trip(14, bench.line.time)
        status = bench.drive.status()
        assert (status.word, status.state, status.fault_code) == (0x0608, DriveState.FAULT, 14)
        assert status.fault_text == "earth fault"
        assert [bench.drive.read(f"15-30[{place}]").value for place in range(3)] == [14, 14, 7]
        with pytest.raises(StateError, match="tripped"):
            bench.drive.start()
        bench.drive.reset()
        bench.wait(5)
        assert bench.drive.status().word == 0x0607

    def test_reset_needs_a_rising_edge(self):
        virtual = virtual_drive("danfoss-fc", 3)
        heard(virtual, commanded(0x04BC))
        virtual.trip(4, 1.0)
        heard(virtual, commanded(0x04BC), 2.0)
        assert virtual.motor.fault == 4
        heard(virtual, commanded(0x043C), 3.0)
        heard(virtual, commanded(0x04BC), 4.0)
        assert virtual.motor.fault == 0

    def test_trip_lock_is_cleared_by_a_power_cycle_only(self, bench):
        bench.virtual.trip(16, bench.line.time)
        bench.virtual.machine.locked = True
        with pytest.raises(StateError, match="mains"):
            bench.drive.reset()
        bench.virtual.power_cycle(bench.line.time)
        assert bench.drive.status().state is DriveState.READY

    def test_start_of_a_tripped_motor_is_ignored(self):
        virtual = virtual_drive("danfoss-fc", 3)
        virtual.trip(4, 1.0)
        heard(virtual, commanded(0x047C, 8192), 2.0)
        assert not virtual.motor.running


class TestControlWordTimeout:
    def timed_out(self, function, seconds=0.5):
        bench = Bench()
        bench.drive.write("8-03", 2)
        bench.drive.write("8-04", function)
        bench.drive.set_reference(percent=50)
        bench.drive.start()
        bench.wait(1.9)
        bench.drive.call("set_relay", number=1, on=True)
        bench.wait(1.9)
        assert not bench.virtual.machine.timed_out
        bench.wait(0.2)
        assert bench.virtual.machine.timed_out
        assert bench.virtual.machine.relays == [False, False]
        bench.wait(seconds)
        return bench

    def test_motor_runs_on_in_silence_with_the_timeout_function_off(self, bench):
        bench.run()
        bench.wait(1000)
        assert bench.hz == 50

    def test_timeout_function_1_freezes_the_output_frequency(self):
        bench = self.timed_out(1)
        bench.virtual.poke("3-41", 1)
        assert bench.hz == 25
        assert bench.virtual.motor.warning

    def test_timeout_function_2_stops_the_motor_until_the_next_valid_word(self):
        bench = self.timed_out(2, 5)
        assert bench.hz == 0
        bench.drive.read("16-13")
        bench.drive.status()
        bench.wait(1.9)
        assert bench.hz == 0, "neither reading nor asking for the status is a command"
        bench.drive.start()
        bench.wait(1.9)
        assert bench.hz > 0
        assert not bench.virtual.motor.warning

    def test_timeout_function_3_jogs_the_motor(self):
        assert self.timed_out(3, 5).hz == 5

    def test_timeout_function_4_runs_the_motor_at_maximum_speed(self):
        assert self.timed_out(4, 10).hz == 65

    def test_timeout_function_5_stops_and_trips(self):
        bench = self.timed_out(5, 5)
        assert bench.virtual.motor.fault == 17
        assert bench.drive.status().fault_text == "control word timeout"

    def test_timeout_function_10_selects_set_up_4(self):
        assert self.timed_out(10).virtual.machine.set_up == 4

    def test_invalid_control_words_do_not_feed_the_timeout(self):
        bench = Bench()
        bench.drive.write("8-04", 2)
        bench.run()
        watcher = bench.bus.drive("danfoss-fc", 3)
        for _ in range(10):
            watcher.read("16-13")
            bench.wait(0.5)
        assert bench.hz == 0


class TestProfidrive:
    @pytest.fixture
    def bench(self):
        return Bench(profile="profidrive")

    def test_profidrive_start_takes_two_steps(self, bench):
        bench.run()
        assert bench.hz == 50
        assert bench.drive.status().word == 0x0F37

    def test_second_profidrive_step_alone_does_not_start_the_motor(self):
        virtual = virtual_drive("danfoss-fc", 3, profile="profidrive")
        heard(virtual, commanded(0x047F, 8192))
        heard(virtual, commanded(0x047F, 8192))
        assert not virtual.motor.running

    @pytest.mark.parametrize(("how", "bits"), [(Stop.COAST, 0x0660), (Stop.QUICK, 0x0657)])
    def test_profidrive_stops_show_their_status_bits(self, bench, how, bits):
        bench.run()
        bench.drive.stop(how)
        bench.wait(10)
        assert bench.hz == 0
        word = bench.drive.status().word
        assert word & 0x0FF0 == bits & 0x0FF0

    def test_vlt_5000_shows_the_off_bits_inverted(self):
        bench = Bench("vlt5000", profile="profidrive")
        assert bench.virtual.peek("512", 0) == 0
        bench.run()
        assert bench.drive.status().word & 0x30 == 0
        bench.drive.stop(Stop.COAST)
        assert bench.drive.status().word & 0x30 == 0x10

    def test_profidrive_motor_reverses_after_a_ramp_stop(self, bench):
        bench.run()
        bench.drive.stop()
        bench.wait(10)
        assert bench.hz == 0
        bench.drive.start(reverse=True)
        bench.wait(10)
        assert bench.hz == -50

    def test_jog_speed_is_in_rpm_or_in_hz_by_series(self, bench):
        bench.drive.call("jog", number=2)
        bench.wait(5)
        assert bench.hz == pytest.approx(200 / 1450 * 50, abs=0.01)
        old = Bench("vlt5000", profile="profidrive")
        old.drive.call("jog", number=1)
        old.wait(5)
        assert old.hz == 10

    def test_catch_up_and_slow_down_change_the_reference(self):
        bench = Bench(profile="profidrive", catch_up_percent=2)
        bench.run(50)
        bench.drive.call("catch_up")
        bench.drive.call("catch_up")
        bench.wait(5)
        assert bench.hz == 27
        bench.drive.call("slow_down")
        bench.wait(5)
        assert bench.hz == 26

    def test_profidrive_drive_starts_again_after_a_trip_and_reset(self, bench):
        bench.run()
        bench.virtual.trip(14, bench.line.time)
        assert bench.drive.status().fault
        bench.drive.reset()
        bench.wait(5)
        assert bench.hz == 0
        bench.run()
        assert bench.hz == 50


class TestOldSeries:
    def test_vlt_5000_reports_preset_unit_fault_and_identity(self):
        bench = Bench("vlt5000", address_format="1-31", output_maximum_hz=50)
        bench.drive.call("select_preset", number=2)
        bench.run(40)
        status = bench.drive.status()
        assert (status.actual_hz, status.actual_percent) == (25, None)
        assert bench.drive.read("520").unit == "A"
        bench.virtual.trip(8, bench.line.time)
        assert bench.drive.status().fault_code == 8
        assert bench.drive.read("615[1]").value == 8
        assert bench.drive.identify()["unit type"] == "VLT 5004"

    def test_vlt_6000_switches_relays_runs_and_trips(self):
        bench = Bench("vlt6000")
        bench.drive.stop()
        bench.drive.call("set_relay", number=1, on=True)
        bench.drive.call("set_relay", number=2, on=True)
        assert bench.virtual.machine.relays == [True, True]
        bench.run(50)
        assert bench.hz == 25
        bench.virtual.trip(4, bench.line.time)
        assert bench.drive.status().fault

    def test_profile_comes_from_the_options_if_no_parameter_holds_it(self):
        bench = Bench("vlt6000", profile="profidrive")
        bench.run()
        assert bench.hz == 50


def test_scan_finds_the_danfoss_drives_among_others():
    line = VirtualLine(
        [
            virtual_drive("danfoss-fc", 3),
            virtual_drive("vabus", 4),
            virtual_drive("danfoss-fc", 5, model="vlt5000"),
        ]
    )
    with drivecomm.open_bus(line.port) as bus:
        found = {one.name: one.identity for one in bus.scan(["danfoss-fc"], range(1, 8))}
    assert set(found) == {"danfoss-fc:3", "danfoss-fc:5"}
    assert found["danfoss-fc:3"]["FC type"] == "FC-302"
    assert found["danfoss-fc:5"] == {"unit type": "VLT 5004"}
    assert not any(drive.motor.running for drive in line.drives)


def test_read_succeeds_over_an_echoing_adapter():
    line = VirtualLine([virtual_drive("danfoss-fc", 3)], echo=True)
    for echo in (True, False):
        with drivecomm.open_bus(line.port, echo=echo) as bus:
            assert bus.drive("danfoss-fc", 3, model="fc300").read("4-14").value == 65
