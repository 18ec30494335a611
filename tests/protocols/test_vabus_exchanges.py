"""Conversations of a VABus master, telegram by telegram."""

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
from drivecomm.models import load_model
from drivecomm.protocol import DriveState, Stop, Tell, protocol_options
from drivecomm.testing import play
from drivecomm_vabus.conversation import VabusMemory
from drivecomm_vabus.exchanges import VabusOperations
from drivecomm_vabus.options import VabusOptions
from drivecomm_vabus.plugin import protocol
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


def read_steps(parameter, data, dataset=0):
    return [(enquiry(parameter, dataset), value(parameter, data, dataset)), EOT]


def write_steps(parameter, data, dataset=0):
    return [(select(parameter, data, dataset), Ack(address=1)), EOT]


def refused(telegram, code):
    return [(telegram, Nak(address=1)), EOT, *read_steps(11, f"{code:04X}")]


def standing(word, *, percent="0000", hz="000003E8", shown="000003E8"):
    """Return the reads that a start makes before it commands anything."""
    return [
        *read_steps(411, word), *read_steps(412, "0001"),
        *read_steps(520, percent), *read_steps(480, hz), *read_steps(283, shown),
    ]  # fmt: skip


class TestRead:
    def test_read_without_a_type_returns_the_characters_with_a_note(self):
        reading = play(operations().read("481"), read_steps(481, "000003E8"))
        assert (reading.value, reading.raw, reading.type) == ("000003E8", "000003E8", "")
        assert "type not known" in reading.note

    @pytest.mark.parametrize(
        ("type", "data", "expected"),
        [("uint", "FFFF", 65535), ("int", "FFFF", -1), ("long", "FFFFD120", -12000), ("string", "FC  ", "FC  ")],
    )
    def test_read_with_a_type_returns_the_number(self, type, data, expected):
        assert play(operations().read("480", type=type), read_steps(480, data)).value == expected

    def test_read_with_a_model_returns_the_physical_value(self):
        reading = play(operations(model=AGILE).read("fixed_frequency_2"), read_steps(481, "000003E8"))
        assert reading.value == Decimal("10.00")
        assert (str(reading), reading.unit, reading.parameter) == ("10.00 Hz", "Hz", "481")

    def test_option_value_has_its_text(self):
        assert play(operations(model=AGILE).read("412"), read_steps(412, "0001")).text == "state machine"

    @pytest.mark.parametrize(
        ("text", "number", "dataset"),
        [("520[2]", 520, 2), ("C00", 1200, 0), ("A07[1]", 1007, 1), ("1599", 1599, 0), ("7", 7, 0)],
    )
    def test_parameter_address_is_read_in_every_form(self, text, number, dataset):
        play(operations().read(text), read_steps(number, "0000", dataset))

    @pytest.mark.parametrize(
        "text", ["48x", "", "1600", "G00", "480[", "480[10]", "-1", "²", "481[5]", "fixed_frequency_2"]
    )
    def test_malformed_address_is_refused(self, text):
        with pytest.raises(ParameterAddressError):
            operations().read(text)

    def test_first_refusal_after_a_missing_reply_is_retried(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.read("999"), [(enquiry(999), NoReplyError("silence"))])
        assert play(drive.read("481"), [*refused(enquiry(481), 11), *read_steps(481, "000003E8")]).raw == "000003E8"
        with pytest.raises(RefusedError):
            play(drive.read("481"), refused(enquiry(481), 11))

    def test_refusal_that_is_repeated_on_the_retry_is_raised(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        with pytest.raises(RefusedError):
            play(drive.read("999"), [*refused(enquiry(999), 11), *refused(enquiry(999), 11)])

    def test_contradicting_data_sets_are_refused(self):
        with pytest.raises(UsageError):
            operations().read("480[1]", dataset=2)

    def test_data_set_may_be_given_as_an_argument(self):
        play(operations().read("480", dataset=3), read_steps(480, "0000", 3))
        with pytest.raises(ParameterAddressError):
            operations().read("480", dataset=11)

    def test_read_with_an_unknown_type_is_refused(self):
        with pytest.raises(UsageError, match="uint"):
            operations().read("480", type="float")

    def test_value_that_does_not_fit_its_type_is_an_unexpected_reply(self):
        with pytest.raises(UnexpectedReplyError):
            play(operations().read("480", type="long"), read_steps(480, "0000"))

    def test_read_of_a_system_bus_node_carries_its_number(self):
        script = [(enquiry(210, sys=7), value(210, "0001", sys=7)), EOT]
        assert play(operations(sys=7).read("210", type="uint"), script).value == 1

    def test_trailing_eot_of_a_read_can_be_disabled(self):
        script = [(enquiry(210), value(210, "0001"))]
        assert play(operations(trailing_eot=False).read("210", type="uint"), script).value == 1

    def test_only_reads_are_closed_by_the_next_request(self):
        vabus = operations(trailing_eot="after writes")
        play(vabus.read("210", type="uint"), [(enquiry(210), value(210, "0001"))])
        play(vabus.write("480", 1, type="uint"), write_steps(480, "0001", 5))
        play(vabus.probe(), [(enquiry(411), value(411, "0040"))])

    def test_refusal_is_closed_by_eot_and_the_error_register_read_is_not(self):
        for exchange, telegram in (
            (operations(trailing_eot="after writes").read("210", type="uint"), enquiry(210)),
            (operations(trailing_eot="after writes").write("480", 1, type="uint"), select(480, "0001", 5)),
        ):
            script = [(telegram, Nak(address=1)), EOT, (enquiry(11), value(11, "0003"))]
            with pytest.raises(RefusedError):
                play(exchange, script)

    def test_unknown_value_of_trailing_eot_is_refused(self):
        with pytest.raises(UsageError, match="True or False or after writes"):
            protocol_options(protocol, {"trailing_eot": "sometimes"})

    def test_lower_case_value_needs_the_option(self):
        assert play(operations(lower_case_hex=True).read("1", type="uint"), read_steps(1, "00ff")).value == 255
        with pytest.raises(UnexpectedReplyError):
            play(operations().read("1", type="uint"), read_steps(1, "00ff"))


class TestRefusal:
    def test_refusal_has_the_code_of_the_error_register(self):
        with pytest.raises(RefusedError, match="unknown parameter") as caught:
            play(operations().read("999"), refused(enquiry(999), 11))
        assert caught.value.code == 11

    def test_refusal_for_a_line_fault_is_retried(self):
        script = [*refused(enquiry(480), 12), *read_steps(480, "0001")]
        assert play(operations().read("480", type="uint"), script).value == 1

    def test_refusal_for_a_line_fault_is_retried_only_once(self):
        with pytest.raises(RefusedError) as caught:
            play(operations().read("480"), [*refused(enquiry(480), 13), *refused(enquiry(480), 13)])
        assert caught.value.code == 13

    def test_unlisted_error_code_is_reported_by_number(self):
        with pytest.raises(RefusedError, match="unlisted error 77"):
            play(operations().read("480"), refused(enquiry(480), 77))

    def test_refusal_without_a_readable_error_register_has_no_code(self):
        script = [(enquiry(480), Nak(address=1)), EOT, (enquiry(11), Nak(address=1)), EOT]
        with pytest.raises(RefusedError) as caught:
            play(operations().read("480"), script)
        assert caught.value.code is None

    def test_error_register_of_eight_digits_is_read(self):
        script = [(enquiry(480), Nak(address=1)), EOT, *read_steps(11, "00000009")]
        with pytest.raises(RefusedError, match="differ"):
            play(operations().read("480"), script)

    @pytest.mark.parametrize("data", ["0000", "zz"])
    def test_invalid_error_register_gives_no_code(self, data):
        script = [(enquiry(480), Nak(address=1)), EOT, *read_steps(11, data)]
        with pytest.raises(RefusedError) as caught:
            play(operations().read("480"), script)
        assert caught.value.code is None

    def test_unread_error_register_is_read_before_the_next_write(self):
        drive = operations()
        script = [(select(480, "0001", 5), Nak(address=1)), EOT, (enquiry(11), NoReplyError("silence"))]
        with pytest.raises(RefusedError):
            play(drive.write("480", 1, type="uint"), script)
        play(drive.write("480", 2, type="uint"), [*read_steps(11, "0001"), *write_steps(480, "0002", 5)])
        play(drive.write("480", 3, type="uint"), write_steps(480, "0003", 5))

    def test_error_register_is_read_before_a_write_after_a_missing_reply(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        play(drive.write("480", 2, type="uint"), [*read_steps(11, "0000"), *write_steps(480, "0002", 5)])


class TestWrite:
    def test_write_goes_to_ram_by_default(self):
        assert play(operations(model=AGILE).write("480", Decimal("-120.00")), write_steps(480, "FFFFD120", 5)) is None

    def test_stored_write_goes_to_the_eeprom_data_set(self):
        play(operations(model=AGILE).write("480[4]", "1.5", store=True), write_steps(480, "00000096", 4))

    def test_ram_data_set_may_be_named_but_not_stored(self):
        play(operations(model=AGILE).write("480[9]", 1), write_steps(480, "00000064", 9))
        with pytest.raises(UsageError):
            operations(model=AGILE).write("480[9]", 1, store=True)

    def test_control_word_is_written_without_a_data_set(self):
        play(operations().write("410", 6, type="uint"), write_steps(410, "0006"))

    def test_write_without_ram_data_sets_needs_store(self):
        with pytest.raises(NotSupported, match="store=True"):
            operations(model=ACT, ram_datasets=False).write("480", 1)
        play(operations(model=ACT, ram_datasets=False).write("480", 1, store=True), write_steps(480, "00000064"))

    def test_refused_write_raises_refused_error(self):
        with pytest.raises(RefusedError, match="runs"):
            play(operations().write("372", 1, type="uint"), refused(select(372, "0001", 5), 8))

    def test_text_is_written_as_given(self):
        play(operations().write("29", "PUMP", type="string"), write_steps(29, "PUMP", 5))

    @pytest.mark.parametrize(
        ("text", "type"),
        [("65536", "uint"), ("-1", "uint"), ("32768", "int"), ("0.5", "int"), ("2147483648", "long"), ("x", "uint"),
         ("nan", "int"), ("", "string"), ("x" * 100, "string"), ("ä", "string")],
    )  # fmt: skip
    def test_value_that_does_not_fit_its_type_is_refused_unsent(self, text, type):
        with pytest.raises(ValueRefusedError):
            operations().write("480", text, type=type)

    @pytest.mark.parametrize("given", ["10.001", 1000, "-0.01", True])
    def test_physical_value_between_steps_or_outside_limits_is_refused(self, given):
        with pytest.raises(ValueRefusedError):
            operations(model=AGILE).write("419", given)

    def test_float_is_written_with_its_shown_digits(self):
        play(operations(model=AGILE).write("480", 10.1), write_steps(480, "000003F2", 5))

    def test_write_without_a_known_type_is_refused(self):
        with pytest.raises(UsageError, match="type="):
            operations().write("480", 1)


class TestBroadcast:
    @pytest.mark.parametrize("how", [Stop.RAMP, Stop.COAST, Stop.QUICK])
    def test_broadcast_stop_sends_0000_and_waits_for_no_reply(self, how):
        assert operations(BROADCAST).capabilities.stops == {Stop.COAST}
        exchange = operations(BROADCAST).stop(how)
        command = next(exchange)
        assert isinstance(command, Tell)
        assert command.message == Select(address=BROADCAST, parameter=410, data="0000")
        with pytest.raises(StopIteration):
            exchange.send(None)

    @pytest.mark.parametrize(
        "verb",
        [
            lambda everybody: everybody.set_reference_hz(10),
            lambda everybody: everybody.set_reference_percent(10),
            lambda everybody: everybody.read("480"),
            lambda everybody: everybody.status(),
            lambda everybody: everybody.start(),
            lambda everybody: everybody.reset(),
            lambda everybody: everybody.probe(),
            lambda everybody: everybody.identify(),
        ],
    )
    def test_broadcast_of_a_verb_that_needs_an_answer_is_refused(self, verb):
        with pytest.raises(NotSupported):
            verb(operations(BROADCAST))


class TestControl:
    def test_start_goes_through_the_states(self):
        script = [
            *standing("0250"),
            *write_steps(410, "0006"), *read_steps(411, "0250"), *read_steps(411, "0231"),
            *write_steps(410, "0007"), *read_steps(411, "0233"),
            *write_steps(410, "000F"), *read_steps(411, "0237"),
        ]  # fmt: skip
        play(operations().start(), script)

    def test_start_begins_at_the_present_state(self):
        play(operations().start(), [*standing("0023"), *write_steps(410, "000F"), *read_steps(411, "0027")])
        play(operations().start(), standing("0627"))

    @pytest.mark.parametrize(("word", "reason"), [("0008", "fault"), ("0007", "quick stop")])
    def test_start_in_a_fault_or_quick_stop_is_refused(self, word, reason):
        script = read_steps(411, word) + (read_steps(260, "0003") if reason == "fault" else [])
        with pytest.raises(StateError, match=reason):
            play(operations().start(), script)

    def test_start_fails_if_a_state_is_not_reached_in_time(self):
        script = [
            *standing("0040"),
            *write_steps(410, "0006"),
            *read_steps(411, "0040"),
            *read_steps(411, "0040"),
            *read_steps(411, "0040"),
        ]
        with pytest.raises(StateError, match="come to 'ready to switch on' within"):
            play(operations(state_timeout_s=0.1).start(), script)

    def test_start_that_is_not_obeyed_is_taken_back(self):
        script = [
            *standing("0023"),
            *write_steps(410, "000F"),
            *read_steps(411, "0023"),
            *read_steps(411, "0023"),
            *read_steps(411, "0023"),
            *write_steps(410, "0007"),
        ]
        with pytest.raises(StateError, match="taken back; after 0x000F"):
            play(operations(state_timeout_s=0.1).start(), script)

    def test_reverse_start_negates_the_references_and_a_forward_start_restores(self):
        play(
            operations().start(reverse=True),
            [
                *read_steps(411, "0627"), *read_steps(412, "0001"),
                *read_steps(520, "0BB8"), *write_steps(520, "F448", 5),
                *read_steps(480, "FFFFFC18"), *read_steps(283, "FFFFF254"),
            ],
        )  # fmt: skip
        play(
            operations().start(),
            [
                *read_steps(411, "0627"), *read_steps(412, "0001"),
                *read_steps(520, "F448"), *write_steps(520, "0BB8", 5),
                *read_steps(480, "FFFFFC18"), *write_steps(480, "000003E8", 5), *read_steps(283, "00000DAC"),
            ],
        )  # fmt: skip

    def test_references_are_negated_in_each_data_set_that_differs(self):
        script = [
            *read_steps(411, "0627"), *read_steps(412, "0001"), *read_steps(520, "0000"),
            *refused(enquiry(480), 9), *read_steps(480, "000003E8", 1), *read_steps(480, "FFFFFC18", 2),
            *read_steps(480, "00000000", 3), *read_steps(480, "000007D0", 4),
            *write_steps(480, "000003E8", 7), *read_steps(283, "000003E8"),
        ]  # fmt: skip
        play(operations().start(), script)

    def test_reference_of_zero_becomes_minus_one_step_for_a_reverse_start(self):
        script = [
            *read_steps(411, "0627"),
            *read_steps(412, "0001"),
            *read_steps(520, "0000"),
            *read_steps(480, "00000000"),
        ]
        play(
            operations().start(reverse=True), [*script, *write_steps(480, "FFFFFFFF", 5), *read_steps(283, "FFFFFFFF")]
        )
        script = [
            *read_steps(411, "0627"),
            *read_steps(412, "0001"),
            *read_steps(520, "0000"),
            *read_steps(480, "FFFFFFFF"),
        ]
        play(operations().start(), [*script, *write_steps(480, "00000000", 5), *read_steps(283, "00000000")])

    @pytest.mark.parametrize(
        ("reverse", "hz", "shown"), [(False, "000003E8", "FFFFFC18"), (True, "FFFFFC18", "000003E8")]
    )
    def test_start_is_refused_if_the_final_reference_has_the_wrong_sign(self, reverse, hz, shown):
        with pytest.raises(StateError, match="the other way round"):
            play(operations().start(reverse=reverse), standing("0250", hz=hz, shown=shown))

    def test_drive_without_readable_references_can_be_started(self):
        script = [*read_steps(411, "0627"), *read_steps(412, "0001")]
        for number in (520, 480, 283):
            script += refused(enquiry(number), 11)
        play(operations().start(), script)
        script = standing("0627")[:-2]
        play(operations(reference_shown_parameter=0).start(), script)

    def test_start_with_a_negative_reference_is_refused_without_ram_data_sets(self):
        script = [
            *read_steps(411, "0250"),
            *read_steps(412, "0001"),
            *read_steps(520, "0000"),
            *read_steps(480, "FFFFFC18"),
        ]
        with pytest.raises(StateError, match=r"480 is -10\.00 Hz now, which turns the motor the other way"):
            play(operations(ram_datasets=False).start(), script)

    @pytest.mark.parametrize("mode", ["0000", "0002", "0005", "FFFF"])
    def test_start_is_refused_if_the_control_word_may_act_as_contacts(self, mode):
        with pytest.raises(StateError, match="write 412 = 1"):
            play(operations().start(), [*read_steps(411, "0250"), *read_steps(412, mode)])

    def test_start_is_refused_if_the_control_mode_differs_by_data_set(self):
        script = [*read_steps(411, "0250"), *refused(enquiry(412), 9)]
        for dataset, mode in enumerate(("0001", "0002", "0001", "0001"), 1):
            script += read_steps(412, mode, dataset)
        with pytest.raises(StateError, match="is 1, 2, 1, 1 in data sets 1 to 4"):
            play(operations().start(), script)
        with pytest.raises(StateError, match="not known to the drive"):
            play(operations().start(), [*read_steps(411, "0250"), *refused(enquiry(412), 11)])

    def test_reverse_start_without_ram_data_sets_is_refused(self):
        assert not operations(ram_datasets=False).capabilities.reverse
        with pytest.raises(NotSupported, match="would go to EEPROM"):
            operations(ram_datasets=False).start(reverse=True)

    def test_dc_brake_is_not_supported(self):
        assert Stop.DC_BRAKE not in operations().capabilities.stops
        with pytest.raises(NotSupported):
            operations().stop(Stop.DC_BRAKE)

    @pytest.mark.parametrize(("how", "word"), [(Stop.RAMP, "0007"), (Stop.QUICK, "0002")])
    def test_stop_checks_the_control_mode_and_sends_its_word(self, how, word):
        play(operations().stop(how), [*read_steps(412, "0001"), *write_steps(410, word)])

    def test_coast_is_sent_without_a_read(self):
        play(operations().stop(Stop.COAST), write_steps(410, "0000"))

    @pytest.mark.parametrize("how", [Stop.RAMP, Stop.QUICK])
    @pytest.mark.parametrize("mode", ["0000", "0002", "0005", "FFFF"])
    def test_stop_sends_0000_if_the_control_word_may_act_as_contacts(self, how, mode):
        play(operations().stop(how), [*read_steps(412, mode), *write_steps(410, "0000")])

    def test_stop_sends_0000_if_the_control_mode_is_unreadable(self):
        play(operations().stop(), [*refused(enquiry(412), 11), *write_steps(410, "0000")])
        play(operations().stop(), [*refused(enquiry(412), 3), *write_steps(410, "0000")])
        script = refused(enquiry(412), 9)
        for dataset, mode in enumerate(("0001", "0001", "0001", "0002"), 1):
            script += read_steps(412, mode, dataset)
        play(operations().stop(), [*script, *write_steps(410, "0000")])

    def test_stop_of_a_silent_drive_sends_0000_after_one_read(self):
        silence = enquiry(412), NoReplyError("silence")
        play(operations().stop(), [silence, *write_steps(410, "0000")])
        with pytest.raises(NoReplyError):
            play(operations().stop(), [silence, (select(410, "0000"), NoReplyError("silence"))])

    @pytest.mark.parametrize(("runs", "word"), [(False, "0000"), (True, "0007")])
    def test_stop_of_a_silent_drive_does_not_wait_if_others_are_waiting(self, runs, word):
        silence = NoReplyError("silence")
        silence.others_wait = True
        drive = VabusOperations(1, VabusOptions(), None, VabusMemory(runs=runs))
        with pytest.raises(NoReplyError):
            play(drive.stop(), [(enquiry(412), silence), (select(410, word), None)])

    def test_stop_is_sent_first_while_a_write_lock_is_possible(self):
        drive = operations()
        lost = (select(410, "0000"), NoReplyError("silence"))
        with pytest.raises(NoReplyError):
            play(drive.stop(Stop.COAST), [lost])
        silence, at_once = (enquiry(412), NoReplyError("silence")), (select(410, "0000"), None)
        unsaid = (enquiry(11), NoReplyError("silence")), lost
        with pytest.raises(NoReplyError):
            play(drive.stop(), [at_once, silence, *unsaid])

    def test_stop_of_a_motor_started_here_sends_its_word_in_silence(self):
        drive = VabusOperations(1, VabusOptions(), None, VabusMemory(runs=True))
        play(drive.stop(), [(enquiry(412), NoReplyError("silence")), *write_steps(410, "0007")])

    @pytest.mark.parametrize("forget", ["nothing", "forget", "stop", "write"])
    def test_first_stop_word_depends_on_a_start_made_here(self, forget):
        memory = VabusMemory()
        drive = VabusOperations(1, VabusOptions(), None, memory)
        play(drive.start(), standing("0627"))
        if forget == "stop":
            play(drive.stop(Stop.COAST), write_steps(410, "0000"))
        elif forget == "write":
            play(drive.write("410", 7, type="uint"), write_steps(410, "0007"))
        elif forget != "nothing":
            getattr(memory, forget)()
        with pytest.raises(NoReplyError):
            play(drive.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        at_once = (select(410, "0007" if forget == "nothing" else "0000"), None)
        play(drive.stop(), [at_once, *read_steps(412, "0001"), *read_steps(11, "0000"), *write_steps(410, "0007")])

    def test_operations_of_the_same_drive_share_their_memory(self):
        memory = VabusMemory()
        one, other = (VabusOperations(1, VabusOptions(), None, memory) for _ in range(2))
        with pytest.raises(NoReplyError):
            play(one.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        play(other.write("480", 2, type="uint"), [*read_steps(11, "0000"), *write_steps(480, "0002", 5)])

    def test_error_register_is_read_before_a_write_after_a_cancelled_one(self):
        drive = operations()
        exchange = drive.write("480", 1, type="uint")
        next(exchange)
        exchange.close()
        play(drive.write("480", 2, type="uint"), [*read_steps(11, "0000"), *write_steps(480, "0002", 5)])

    def test_reset_sends_a_rising_edge(self):
        script = [
            *read_steps(411, "0008"),
            *write_steps(410, "0000"),
            *write_steps(410, "0080"),
            *read_steps(411, "0040"),
            *write_steps(410, "0000"),
        ]
        play(operations().reset(), script)

    def test_reset_without_a_fault_sends_no_control_word(self):
        play(operations().reset(), read_steps(411, "0027"))

    def test_reset_within_15_seconds_of_a_trip_raises_state_error(self):
        script = [
            *read_steps(411, "0008"),
            *write_steps(410, "0000"),
            *write_steps(410, "0080"),
            *read_steps(411, "0008"),
        ]
        with pytest.raises(StateError, match="15 s"):
            play(operations(state_timeout_s=0).reset(), script)

    def test_start_word_is_sent_once_and_a_stop_may_be_repeated(self):
        exchange = operations(trailing_eot=False).start()
        next(exchange)
        for number, data in ((411, "0023"), (412, "0001"), (520, "0000"), (480, "000003E8")):
            exchange.send(value(number, data))
        start = exchange.send(value(283, "000003E8"))
        assert (start.message.data, start.attempts) == ("000F", 1)
        stop = next(operations().stop(Stop.COAST))
        assert stop.attempts is None
        assert stop.urgent

    def test_stop_is_sent_before_the_error_register_is_read(self):
        drive = operations()
        with pytest.raises(NoReplyError):
            play(drive.write("480", 1, type="uint"), [(select(480, "0001", 5), NoReplyError("silence"))])
        at_once = (select(410, "0000"), None)
        play(drive.stop(), [at_once, *read_steps(412, "0001"), *read_steps(11, "0000"), *write_steps(410, "0007")])

    def test_no_reply_error_after_the_last_start_word_mentions_the_start(self):
        silence = (enquiry(411), NoReplyError("silence"))
        with pytest.raises(NoReplyError, match="silence; the drive had been commanded to run before"):
            play(operations().start(), [*standing("0023"), *write_steps(410, "000F"), silence])
        with pytest.raises(NoReplyError) as caught:
            play(operations().start(), [*standing("0031"), *write_steps(410, "0007"), silence])
        assert "commanded to run" not in str(caught.value)

    def test_raw_control_word_is_written(self):
        play(operations().extra["control_word"](word=0x0F), write_steps(410, "000F"))


class TestReference:
    def test_reference_in_hz_clears_the_percentage_and_is_read_back(self):
        script = [
            *read_steps(480, "000003E8"),
            *read_steps(520, "0BB8"),
            *write_steps(520, "0000", 5),
            *write_steps(480, "000004D2", 5),
        ]
        for model in (None, AGILE):
            play(operations(model=model).set_reference_hz("12.34"), [*script, *read_steps(283, "000004D2")])

    def test_reference_in_percent_clears_the_frequency_and_is_read_back(self):
        script = [
            *read_steps(520, "0000"), *read_steps(480, "000003E8"), *read_steps(419, "00001770"),
            *write_steps(480, "00000000", 5), *write_steps(520, "1388", 5), *read_steps(283, "00000BB8"),
        ]  # fmt: skip
        for model in (None, AGILE):
            play(operations(model=model).set_reference_percent(50), script)

    def test_reference_in_percent_may_be_shown_rounded(self):
        script = [
            *read_steps(520, "0000"),
            *read_steps(480, "00000000"),
            *read_steps(419, "00001388"),
            *write_steps(520, "0D05", 5),
        ]
        for shown in ("00000682", "00000683"):
            play(operations().set_reference_percent("33.33"), [*script, *read_steps(283, shown)])

    @pytest.mark.parametrize("shown", ["00000BB8", "FFFFFC18", "000003EA"])
    def test_reference_that_the_drive_does_not_adopt_raises_state_error(self, shown):
        script = [
            *read_steps(480, "000003E8"),
            *read_steps(520, "0000"),
            *write_steps(480, "000003E8", 5),
            *read_steps(283, shown),
        ]
        with pytest.raises(StateError, match=r"with 10\.00 Hz in parameter 480 the reference of the drive was"):
            play(operations().set_reference_hz(10), script)

    @pytest.mark.parametrize("standing", ["0031", "0023", "0040"])
    def test_final_reference_of_zero_in_standstill_is_accepted(self, standing):
        script = [
            *read_steps(480, "000003E8"),
            *read_steps(520, "0000"),
            *write_steps(480, "000003E8", 5),
            *read_steps(283, "00000000"),
        ]
        play(operations().set_reference_hz(10), [*script, *read_steps(411, standing)])

    @pytest.mark.parametrize("turning", ["0027", "0007"])
    def test_final_reference_of_zero_while_turning_is_an_error(self, turning):
        script = [
            *read_steps(480, "000003E8"),
            *read_steps(520, "0000"),
            *write_steps(480, "000003E8", 5),
            *read_steps(283, "00000000"),
        ]
        with pytest.raises(StateError, match="the reference of the drive was 0"):
            play(operations().set_reference_hz(10), [*script, *read_steps(411, turning)])

    def test_references_are_restored_if_the_new_one_is_not_adopted(self):
        script = [
            *read_steps(520, "0000"),
            *read_steps(480, "000003E8"),
            *read_steps(419, "00001388"),
            *write_steps(480, "00000000", 5),
        ]
        script += [
            *write_steps(520, "1388", 5),
            *read_steps(283, "000007D0"),
            *write_steps(520, "0000", 5),
            *write_steps(480, "000003E8", 5),
        ]
        with pytest.raises(StateError, match=r"was 20\.00 Hz \(parameter 283\), so the references were set back"):
            play(operations().set_reference_percent(50), script)

    def test_unreadable_final_reference_needs_the_option_to_skip_it(self):
        script = [*read_steps(480, "000003E8"), *read_steps(520, "0000"), *write_steps(480, "000003E8", 5)]
        with pytest.raises(StateError, match="reference_shown_parameter=0"):
            play(operations().set_reference_hz(10), [*script, *refused(enquiry(283), 11)])
        play(operations(reference_shown_parameter=0).set_reference_hz(10), script)
        script = [*read_steps(520, "0BB8"), *read_steps(480, "00000000"), *write_steps(520, "03E8", 5)]
        play(operations(reference_shown_parameter=0).set_reference_percent(10), script)

    def test_reference_in_percent_without_a_maximum_is_refused_unsent(self):
        script = [*read_steps(520, "0000"), *read_steps(480, "000003E8"), *refused(enquiry(419), 11)]
        with pytest.raises(StateError, match="419"):
            play(operations().set_reference_percent(50), script)

    def test_reference_keeps_the_sign_of_a_reverse_start(self):
        script = [*read_steps(480, "FFFFFC18"), *read_steps(520, "0000")]
        play(
            operations().set_reference_hz(20), [*script, *write_steps(480, "FFFFF830", 5), *read_steps(283, "FFFFF830")]
        )
        play(
            operations().set_reference_hz(0), [*script, *write_steps(480, "FFFFFFFF", 5), *read_steps(283, "FFFFFFFF")]
        )
        script = [
            *read_steps(480, "FFFFFC18"),
            *read_steps(520, "0BB8"),
            *read_steps(283, "000001F4"),
            *write_steps(520, "0000", 5),
        ]
        play(
            operations().set_reference_hz(20), [*script, *write_steps(480, "000007D0", 5), *read_steps(283, "000007D0")]
        )

    def test_invalid_reference_is_refused_unsent(self):
        with pytest.raises(NotSupported):
            operations(ram_datasets=False).set_reference_hz(1)
        with pytest.raises(ValueRefusedError):
            operations().set_reference_hz("0.001")
        for verb in (operations().set_reference_hz, operations().set_reference_percent):
            with pytest.raises(ValueRefusedError, match="reversed by its start"):
                verb(-10)


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
    def test_state_word_gives_the_drive_state(self, word, state, running):
        status = play(operations().status(), read_steps(411, word))
        assert (status.state, status.running, status.fault) == (state, running, False)

    def test_status_reports_the_bits_of_the_state_word(self):
        status = play(operations().status(), read_steps(411, "8EA7"))
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

    def test_status_of_a_fault_has_its_code(self):
        status = play(operations().status(), [*read_steps(411, "000F"), *read_steps(260, "0102")])
        assert (status.state, status.fault_code, status.fault) == (DriveState.FAULT, 0x0102, True)

    def test_status_of_a_fault_with_an_unreadable_code_has_none(self):
        status = play(operations().status(), [*read_steps(411, "0008"), *refused(enquiry(260), 11)])
        assert status.fault_code is None

    def test_malformed_state_word_is_an_unexpected_reply(self):
        with pytest.raises(UnexpectedReplyError):
            play(operations().status(), read_steps(411, "xx"))


class TestPresence:
    def test_probe_is_sent_once(self):
        exchange = operations().probe()
        assert next(exchange).attempts == 1
        play(operations().probe(), read_steps(411, "0040"))

    def test_refused_probe_succeeds_and_reads_the_error_register(self):
        play(operations().probe(), refused(enquiry(411), 11))

    def test_identify_reports_the_state(self):
        assert play(operations().identify(), read_steps(411, "0637")) == {"state": "operation enabled"}
        assert play(operations().identify(), read_steps(411, "0002")) == {"state": "0x0002"}
        assert play(operations().identify(), refused(enquiry(411), 11)) == {}
