"""The conversations of a VABus master, telegram by telegram."""

from decimal import Decimal

import pytest

from drivecomm.errors import (
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    StateError,
    UnexpectedReplyError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.exchange import Tell
from drivecomm.models.files import load_model
from drivecomm.runners.script import play
from drivecomm.status import DriveState, Stop
from drivecomm_vabus.exchanges import VabusOperations
from drivecomm_vabus.options import VabusOptions
from drivecomm_vabus.telegrams import BROADCAST, Ack, Enquiry, Eot, Nak, Select, Value

EOT = (Eot(), None)
AGILE = load_model("drivecomm_vabus", "vabus", "agile")
ACT = load_model("drivecomm_vabus", "vabus", "act")


def operations(address=1, model=None, **options):
    return VabusOperations(address, VabusOptions(**options), model)


def enquiry(parameter, dataset=0, sys=0):
    return Enquiry(address=1, sys=sys, dataset=dataset, parameter=parameter)


def value(parameter, data, dataset=0, sys=0):
    return Value(address=1, sys=sys, dataset=dataset, parameter=parameter, data=data)


def select(parameter, data, dataset=0):
    return Select(address=1, dataset=dataset, parameter=parameter, data=data)


def asked(parameter, data, dataset=0):
    return [(enquiry(parameter, dataset), value(parameter, data, dataset)), EOT]


def told(parameter, data, dataset=0):
    return [(select(parameter, data, dataset), Ack(address=1)), EOT]


def refused(telegram, code):
    return [(telegram, Nak(address=1)), EOT, *asked(11, f"{code:04X}")]


class TestRead:
    def test_without_a_type_the_characters_are_certain(self):
        reading = play(operations().read("481"), asked(481, "000003E8"))
        assert (reading.value, reading.raw, reading.type) == ("000003E8", "000003E8", "")
        assert "type not known" in reading.note

    @pytest.mark.parametrize(
        ("type", "data", "expected"),
        [("uint", "FFFF", 65535), ("int", "FFFF", -1), ("long", "FFFFD120", -12000), ("string", "FC  ", "FC  ")],
    )
    def test_with_a_type(self, type, data, expected):
        assert play(operations().read("480", type=type), asked(480, data)).value == expected

    def test_with_a_model_physical(self):
        reading = play(operations(model=AGILE).read("fixed_frequency_2"), asked(481, "000003E8"))
        assert reading.value == Decimal("10.00")
        assert (str(reading), reading.unit, reading.parameter) == ("10.00 Hz", "Hz", "481")

    def test_an_option_has_its_text(self):
        assert play(operations(model=AGILE).read("412"), asked(412, "0001")).text == "state machine"

    @pytest.mark.parametrize(
        ("text", "number", "dataset"),
        [("520[2]", 520, 2), ("C00", 1200, 0), ("A07[1]", 1007, 1), ("1599", 1599, 0), ("7", 7, 0)],
    )
    def test_parameter_addresses(self, text, number, dataset):
        play(operations().read(text), asked(number, "0000", dataset))

    @pytest.mark.parametrize(
        "text", ["48x", "", "1600", "G00", "480[", "480[10]", "-1", "²", "481[5]", "fixed_frequency_2"]
    )
    def test_refuses_what_is_no_address(self, text):
        with pytest.raises(ParameterAddressError):
            operations().read(text)

    def test_the_first_refusal_after_silence_may_be_of_what_was_not_answered(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.read("999"), [(enquiry(999), NoReplyError("silence"))])
        assert play(drive.read("481"), [*refused(enquiry(481), 11), *asked(481, "000003E8")]).raw == "000003E8"
        with pytest.raises(RefusedError):
            play(drive.read("481"), refused(enquiry(481), 11))

    def test_a_refusal_that_comes_twice_is_one(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        with pytest.raises(RefusedError):
            play(drive.read("999"), [*refused(enquiry(999), 11), *refused(enquiry(999), 11)])

    def test_data_set_named_twice(self):
        with pytest.raises(UsageError):
            operations().read("480[1]", dataset=2)

    def test_data_set_by_option(self):
        play(operations().read("480", dataset=3), asked(480, "0000", 3))
        with pytest.raises(ParameterAddressError):
            operations().read("480", dataset=11)

    def test_unknown_type(self):
        with pytest.raises(UsageError, match="uint"):
            operations().read("480", type="float")

    def test_a_value_that_is_none_of_its_type(self):
        with pytest.raises(UnexpectedReplyError):
            play(operations().read("480", type="long"), asked(480, "0000"))

    def test_system_bus_node(self):
        script = [(enquiry(210, sys=7), value(210, "0001", sys=7)), EOT]
        assert play(operations(sys=7).read("210", type="uint"), script).value == 1

    def test_without_the_trailing_eot(self):
        script = [(enquiry(210), value(210, "0001"))]
        assert play(operations(trailing_eot=False).read("210", type="uint"), script).value == 1

    def test_lower_case_only_by_option(self):
        assert play(operations(lower_case_hex=True).read("1", type="uint"), asked(1, "00ff")).value == 255
        with pytest.raises(UnexpectedReplyError):
            play(operations().read("1", type="uint"), asked(1, "00ff"))


class TestRefusal:
    def test_the_error_register_says_why(self):
        with pytest.raises(RefusedError, match="unknown parameter") as caught:
            play(operations().read("999"), refused(enquiry(999), 11))
        assert caught.value.code == 11

    def test_a_line_fault_is_asked_once_more(self):
        script = [*refused(enquiry(480), 12), *asked(480, "0001")]
        assert play(operations().read("480", type="uint"), script).value == 1

    def test_but_only_once(self):
        with pytest.raises(RefusedError) as caught:
            play(operations().read("480"), [*refused(enquiry(480), 13), *refused(enquiry(480), 13)])
        assert caught.value.code == 13

    def test_unlisted_code(self):
        with pytest.raises(RefusedError, match="unlisted error 77"):
            play(operations().read("480"), refused(enquiry(480), 77))

    def test_register_refused_too(self):
        script = [(enquiry(480), Nak(address=1)), EOT, (enquiry(11), Nak(address=1)), EOT]
        with pytest.raises(RefusedError) as caught:
            play(operations().read("480"), script)
        assert caught.value.code is None

    def test_register_with_eight_digits(self):
        script = [(enquiry(480), Nak(address=1)), EOT, *asked(11, "00000009")]
        with pytest.raises(RefusedError, match="differ"):
            play(operations().read("480"), script)

    @pytest.mark.parametrize("data", ["0000", "zz"])
    def test_register_without_a_code(self, data):
        script = [(enquiry(480), Nak(address=1)), EOT, *asked(11, data)]
        with pytest.raises(RefusedError) as caught:
            play(operations().read("480"), script)
        assert caught.value.code is None

    def test_an_unread_register_is_read_before_the_next_select(self):
        drive = operations()
        script = [(select(480, "0001", 5), Nak(address=1)), EOT, (enquiry(11), NoReplyError("silence"))]
        with pytest.raises(RefusedError):
            play(drive.write("480", 1, type="uint"), script)
        play(drive.write("480", 2, type="uint"), [*asked(11, "0001"), *told(480, "0002", 5)])
        play(drive.write("480", 3, type="uint"), told(480, "0003", 5))

    def test_an_unanswered_select_leaves_the_lock_open(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        play(drive.write("480", 2, type="uint"), [*asked(11, "0000"), *told(480, "0002", 5)])


class TestWrite:
    def test_into_ram(self):
        assert play(operations(model=AGILE).write("480", Decimal("-120.00")), told(480, "FFFFD120", 5)) is None

    def test_stored(self):
        play(operations(model=AGILE).write("480[4]", "1.5", store=True), told(480, "00000096", 4))

    def test_ram_side_by_name(self):
        play(operations(model=AGILE).write("480[9]", 1), told(480, "00000064", 9))
        with pytest.raises(UsageError):
            operations(model=AGILE).write("480[9]", 1, store=True)

    def test_control_word_is_written_as_it_is(self):
        play(operations().write("410", 6, type="uint"), told(410, "0006"))

    def test_without_ram_data_sets_only_on_demand(self):
        with pytest.raises(NotSupported, match="store=True"):
            operations(model=ACT, ram_datasets=False).write("480", 1)
        play(operations(model=ACT, ram_datasets=False).write("480", 1, store=True), told(480, "00000064"))

    def test_refused(self):
        with pytest.raises(RefusedError, match="runs"):
            play(operations().write("372", 1, type="uint"), refused(select(372, "0001", 5), 8))

    def test_text(self):
        play(operations().write("29", "PUMP", type="string"), told(29, "PUMP", 5))

    @pytest.mark.parametrize(
        ("text", "type"),
        [("65536", "uint"), ("-1", "uint"), ("32768", "int"), ("0.5", "int"), ("2147483648", "long"), ("x", "uint"),
         ("nan", "int"), ("", "string"), ("x" * 100, "string"), ("ä", "string")],
    )  # fmt: skip
    def test_what_does_not_fit_is_refused_before_anything_is_sent(self, text, type):
        with pytest.raises(ValueRefusedError):
            operations().write("480", text, type=type)

    @pytest.mark.parametrize("given", ["10.001", 1000, "-0.01", True])
    def test_physical_values_are_not_rounded_and_keep_their_limits(self, given):
        with pytest.raises(ValueRefusedError):
            operations(model=AGILE).write("419", given)

    def test_floats_mean_what_they_show(self):
        play(operations(model=AGILE).write("480", 10.1), told(480, "000003F2", 5))

    def test_unknown_type(self):
        with pytest.raises(UsageError, match="type="):
            operations().write("480", 1)


class TestBroadcast:
    def test_nobody_is_waited_for(self):
        exchange = operations(BROADCAST).stop(Stop.QUICK)
        command = next(exchange)
        assert isinstance(command, Tell)
        assert command.message == Select(address=BROADCAST, parameter=410, data="0002")
        with pytest.raises(StopIteration):
            exchange.send(None)

    @pytest.mark.parametrize(
        "verb",
        [
            lambda everybody: everybody.read("480"),
            lambda everybody: everybody.status(),
            lambda everybody: everybody.start(),
            lambda everybody: everybody.reset(),
            lambda everybody: everybody.probe(),
            lambda everybody: everybody.identify(),
        ],
    )
    def test_what_needs_an_answer_is_refused(self, verb):
        with pytest.raises(NotSupported):
            verb(operations(BROADCAST))


class TestControl:
    def test_start_walks_the_states(self):
        script = [
            *asked(411, "0250"),
            *told(410, "0006"), *asked(411, "0250"), *asked(411, "0231"),
            *told(410, "0007"), *asked(411, "0233"),
            *told(410, "000F"), *asked(411, "0237"),
        ]  # fmt: skip
        play(operations().start(), script)

    def test_start_from_where_it_stands(self):
        play(operations().start(), [*asked(411, "0023"), *told(410, "000F"), *asked(411, "0027")])
        play(operations().start(), asked(411, "0627"))

    @pytest.mark.parametrize(("word", "reason"), [("0008", "fault"), ("0007", "quick stop")])
    def test_start_refuses(self, word, reason):
        script = asked(411, word) + (asked(260, "0003") if reason == "fault" else [])
        with pytest.raises(StateError, match=reason):
            play(operations().start(), script)

    def test_a_state_that_does_not_come(self):
        script = [
            *asked(411, "0040"),
            *told(410, "0006"),
            *asked(411, "0040"),
            *asked(411, "0040"),
            *asked(411, "0040"),
        ]
        with pytest.raises(StateError, match="ready to switch on"):
            play(operations(state_timeout_s=0.1).start(), script)

    def test_a_start_backwards_turns_the_references_in_ram_and_a_start_forwards_turns_them_back(self):
        drive = operations()
        play(
            drive.start(reverse=True),
            [
                *asked(520, "0BB8"), *told(520, "F448", 5),
                *asked(480, "FFFFFC18"), *asked(411, "0627"),
            ],
        )  # fmt: skip
        play(
            drive.start(),
            [
                *asked(520, "F448"), *told(520, "0BB8", 5),
                *asked(480, "FFFFFC18"), *told(480, "000003E8", 5), *asked(411, "0627"),
            ],
        )  # fmt: skip
        play(drive.start(), asked(411, "0627"))

    def test_without_ram_nothing_is_reversed(self):
        assert not operations(ram_datasets=False).capabilities.reverse
        with pytest.raises(NotSupported, match="would go to EEPROM"):
            operations(ram_datasets=False).start(reverse=True)

    def test_the_dc_brake_is_not_supported(self):
        assert Stop.DC_BRAKE not in operations().capabilities.stops
        with pytest.raises(NotSupported):
            operations().stop(Stop.DC_BRAKE)

    @pytest.mark.parametrize(("how", "word"), [(Stop.RAMP, "0007"), (Stop.COAST, "0000"), (Stop.QUICK, "0002")])
    def test_stop(self, how, word):
        play(operations().stop(how), told(410, word))

    def test_reset_is_an_edge(self):
        script = [*asked(411, "0008"), *told(410, "0000"), *told(410, "0080"), *asked(411, "0040"), *told(410, "0000")]
        play(operations().reset(), script)

    def test_reset_without_a_fault_sends_nothing_that_could_stop_the_motor(self):
        play(operations().reset(), asked(411, "0027"))

    def test_reset_too_early(self):
        script = [*asked(411, "0008"), *told(410, "0000"), *told(410, "0080"), *asked(411, "0008")]
        with pytest.raises(StateError, match="15 s"):
            play(operations(state_timeout_s=0).reset(), script)

    def test_what_starts_goes_out_once_and_a_stop_as_often_as_needed(self):
        exchange = operations().start()
        next(exchange)
        exchange.send(value(411, "0023"))
        assert exchange.send(None).attempts == 1
        stop = next(operations().stop())
        assert stop.attempts is None
        assert stop.urgent

    def test_a_stop_does_not_wait_for_the_register(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        stop = (select(410, "0007"), None)
        play(drive.stop(), [stop, *asked(11, "0000"), stop, *told(410, "0007")])

    def test_silence_after_the_last_step_of_a_start_says_that_it_was_made(self):
        silence = (enquiry(411), NoReplyError("silence"))
        with pytest.raises(NoReplyError, match="silence; the drive had been told to run before"):
            play(operations().start(), [*asked(411, "0023"), *told(410, "000F"), silence])
        with pytest.raises(NoReplyError) as caught:
            play(operations().start(), [*asked(411, "0031"), *told(410, "0007"), silence])
        assert "told to run" not in str(caught.value)

    def test_any_control_word(self):
        play(operations().extra["control_word"](word=0x0F), told(410, "000F"))

    def test_reference(self):
        play(operations().set_reference_hz("12.34"), told(480, "000004D2", 5))
        play(operations(model=AGILE).set_reference_hz(-20), told(480, "FFFFF830", 5))
        play(operations().set_reference_percent(50), told(520, "1388", 5))
        with pytest.raises(NotSupported):
            operations(ram_datasets=False).set_reference_hz(1)
        with pytest.raises(ValueRefusedError):
            operations().set_reference_hz("0.001")


class TestStatus:
    @pytest.mark.parametrize(
        ("word", "state", "running"),
        [
            ("0000", DriveState.NOT_READY, False),
            ("0040", DriveState.NOT_READY, False),
            ("0031", DriveState.READY, False),
            ("0023", DriveState.READY, False),
            ("0637", DriveState.RUNNING, True),
            ("0027", DriveState.RUNNING, True),
            ("0007", DriveState.STOPPING, True),
            ("0002", DriveState.NOT_READY, False),
        ],
    )
    def test_states(self, word, state, running):
        status = play(operations().status(), asked(411, word))
        assert (status.state, status.running, status.fault) == (state, running, False)

    def test_bits(self):
        status = play(operations().status(), asked(411, "8EA7"))
        assert status.flags == (
            "operation enabled",
            "warning",
            "remote",
            "reference reached",
            "internal limit active",
            "warning 2",
        )
        assert status.at_reference
        assert status.remote
        assert status.warning

    def test_fault_with_code(self):
        status = play(operations().status(), [*asked(411, "000F"), *asked(260, "0102")])
        assert (status.state, status.fault_code, status.fault) == (DriveState.FAULT, 0x0102, True)

    def test_fault_code_refused(self):
        status = play(operations().status(), [*asked(411, "0008"), *refused(enquiry(260), 11)])
        assert status.fault_code is None

    def test_a_state_word_that_is_none(self):
        with pytest.raises(UnexpectedReplyError):
            play(operations().status(), asked(411, "xx"))


class TestPresence:
    def test_probe_asks_once(self):
        exchange = operations().probe()
        assert next(exchange).attempts == 1
        play(operations().probe(), asked(411, "0040"))

    def test_a_refusal_is_an_answer_and_is_cleared(self):
        play(operations().probe(), refused(enquiry(411), 11))

    def test_identity(self):
        assert play(operations().identify(), asked(411, "0637")) == {"state": "operation enabled"}
        assert play(operations().identify(), asked(411, "0002")) == {"state": "0x0002"}
        assert play(operations().identify(), refused(enquiry(411), 11)) == {}
