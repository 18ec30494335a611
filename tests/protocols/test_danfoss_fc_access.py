"""Reading and writing parameters over the FC protocol, telegram by telegram."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import (
    AddressError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    UnexpectedReplyError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.models import load_model
from drivecomm.protocol import Ask, Stop, Tell, installed
from drivecomm.testing import play
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_danfoss_fc.exchanges import DanfossFcOperations
from drivecomm_danfoss_fc.messages import (
    ParameterReply,
    ParameterRequest,
    ProcessReply,
    ProcessRequest,
    TextReply,
    TextRequest,
)
from drivecomm_danfoss_fc.options import DanfossFcOptions

MODELS = {
    name: load_model("drivecomm_danfoss_fc", "danfoss-fc", name) for name in ("fc300", "fc101", "vlt5000", "vlt6000")
}
AT_3 = {"address_format": "1-126", "address": 3}
IDLE = {"control_word": 0, "reference": 0}
EVERYBODY = {"address_format": "1-126", "broadcast": True}
READY = {"status_word": 0x0607, "main_actual": 0}


def operations(model=None, address=3, **options):
    known = MODELS.get(model)
    return DanfossFcOperations(address, DanfossFcOptions(**{**(known.options if known else {}), **options}), known)


def ask(ak, pnu, ind=0, pwe=0):
    return ParameterRequest(**AT_3, ak=ak, pnu=pnu, ind=ind, pwe=pwe, **IDLE)


def answer(ak, pnu, ind=0, pwe=0):
    return ParameterReply(**AT_3, ak=ak, pnu=pnu, ind=ind, pwe=pwe, **READY)


def text_answer(pnu, ind, text, ak=15):
    return TextReply(**AT_3, ak=ak, pnu=pnu, ind=ind, text=text, **READY)


def text_ask(pnu, text):
    return TextRequest(**AT_3, ak=15, pnu=pnu, ind=0x0500, text=text, **IDLE)


class TestRead:
    def test_double_word_is_scaled_by_the_model(self):
        reading = play(operations("fc300").read("16-14"), [(ask(1, 1614), answer(2, 1614, pwe=524))])
        assert (reading.value, reading.unit, reading.raw, reading.type) == (Decimal("5.24"), "A", 524, "int32")
        assert (reading.parameter, reading.name, reading.note) == ("16-14", "motor_current", "")

    def test_value_without_a_type_is_unsigned_with_a_note(self):
        reading = play(operations().read("1614"), [(ask(1, 1614), answer(2, 1614, pwe=0xFFFFFFFF))])
        assert (reading.value, reading.raw, reading.type) == (0xFFFFFFFF, 0xFFFFFFFF, "")
        assert "type not known" in reading.note

    def test_word_reply_uses_the_low_half_of_pwe_only(self):
        reading = play(operations().read("16-16"), [(ask(1, 1616), answer(1, 1616, pwe=0xABCDFF83))])
        assert reading.value == reading.raw == 0xFF83

    def test_negative_word_is_read_with_its_sign(self):
        reading = play(operations("fc300").read("16-16"), [(ask(1, 1616), answer(1, 1616, pwe=0xFF83))])
        assert (reading.value, reading.raw, reading.unit) == (Decimal("-12.5"), 0xFF83, "Nm")
        assert "derived" in reading.note

    def test_negative_double_word_is_read_with_its_sign(self):
        reading = play(operations().read("3-02", type="int32"), [(ask(1, 302), answer(2, 302, pwe=0xFFFF3CB0))])
        assert reading.value == -50000
        assert "scale not known" in reading.note

    def test_width_of_the_reply_overrides_the_type(self):
        word = play(operations("fc300").read("3-41"), [(ask(1, 341), answer(1, 341, pwe=1000))])
        assert word.value == 10
        assert "answered uint32 with a word" in word.note
        double = play(operations().read("1", type="int16"), [(ask(1, 1), answer(2, 1, pwe=0xFFFFFFFE))])
        assert double.value == -2
        assert "with a double word" in double.note

    @pytest.mark.parametrize(("ak", "pwe"), [(1, 0xFDA8), (1, 0xFFFFFDA8), (2, 0xFDA8), (2, 0xFFFFFDA8)])
    def test_negative_word_may_have_its_sign_in_the_high_word(self, ak, pwe):
        reading = play(operations("vlt5000").read("521"), [(ask(1, 521), answer(ak, 521, pwe=pwe))])
        assert (reading.value, reading.unit) == (Decimal("-60.0"), "%")
        assert "as seen on a drive" in reading.note
        assert "high word" in MODELS["vlt5000"].find("521").source

    def test_double_word_beyond_16_bits_keeps_all_bits(self):
        read = operations().read("1", type="int16")
        assert play(read, [(ask(1, 1), answer(2, 1, pwe=0x00012345))]).value == 0x12345
        read = operations().read("1", type="int32")
        assert play(read, [(ask(1, 1), answer(2, 1, pwe=0xFDA8))]).value == 0xFDA8

    def test_array_element_is_read_by_its_index(self):
        reading = play(operations("fc300").read("3-10[3]"), [(ask(1, 310, 3), answer(1, 310, 3, 2500))])
        assert (reading.parameter, reading.value, reading.unit) == ("3-10[3]", 25, "%")

    def test_array_without_an_index_reads_the_element_of_the_index_base(self):
        reading = play(operations("vlt5000").read("615"), [(ask(1, 615, 1), answer(1, 615, 1, 14))])
        assert (reading.parameter, reading.value) == ("615[1]", 14)

    def test_option_value_has_its_text(self):
        reading = play(operations("fc300").read("8-04"), [(ask(1, 804), answer(1, 804, pwe=5))])
        assert (reading.value, reading.text) == (5, "stop and trip")

    @pytest.mark.parametrize(
        ("code", "words"),
        [
            (0, "does not exist"),
            (11, "no parameter write access"),
            (17, "present mode"),
            (130, "no bus access"),
            (77, "unlisted fault 77"),
        ],
    )
    def test_refused_read_has_code_and_text(self, code, words):
        with pytest.raises(RefusedError, match=words) as caught:
            play(operations().read("19-99"), [(ask(1, 1999), answer(7, 1999, pwe=code))])
        assert (caught.value.code, caught.value.parameter) == (code, "19-99")

    def test_number_read_of_a_text_is_retried_as_text_and_remembered(self):
        drive = operations()
        refused, told = (ask(1, 1543), answer(7, 1543, pwe=5)), (ask(4, 1543, 1), answer(3, 1543, 1, pwe=0x0209))
        text = (ask(15, 1543, 0x0400), text_answer(1543, 0x0400, "5.11 "))
        reading = play(drive.read("15-43"), [refused, told, text])
        assert (reading.value, reading.type, reading.parameter) == ("5.11", "text", "15-43")
        assert "refuses to read it as a number" in reading.note
        assert play(drive.read("1543"), [text]).value == "5.11", "it is remembered"

    @pytest.mark.parametrize("untold", [answer(7, 1543, 1, pwe=9), answer(0, 1543, 1), answer(3, 1543, 1, pwe=10)])
    def test_text_is_tried_if_the_drive_does_not_report_its_type(self, untold):
        steps = [(ask(1, 1543), answer(7, 1543, pwe=5)), (ask(4, 1543, 1), untold)]
        steps.append((ask(15, 1543, 0x0400), text_answer(1543, 0x0400, "5.11")))
        assert play(operations().read("15-43"), steps).value == "5.11"

    def test_text_read_of_a_number_is_retried_with_the_reported_type(self):
        steps = [
            (ask(15, 1543, 0x0400), answer(7, 1543, 0x0400, pwe=5)),
            (ask(4, 1543, 1), answer(3, 1543, 1, pwe=0x0203)),
            (ask(1, 1543), answer(1, 1543, pwe=0xFFFE)),
        ]
        reading = play(operations("fc300").read("15-43"), steps)
        assert (reading.value, reading.type) == (-2, "int16")
        assert "refuses to read it as a text" in reading.note

    def test_first_refusal_is_raised_if_the_retry_fails(self):
        first, untold = (ask(1, 1543), answer(7, 1543, pwe=5)), (ask(4, 1543, 1), answer(7, 1543, 1, pwe=9))
        with pytest.raises(RefusedError, match="1543 with code 5"):
            play(operations().read("1543"), [first, untold, (ask(15, 1543, 0x0400), answer(7, 1543, 0x0400, pwe=15))])
        with pytest.raises(RefusedError, match="1543 with code 5"):
            play(operations().read("1543"), [first, (ask(4, 1543, 1), answer(3, 1543, 1, pwe=0x0206))])
        with pytest.raises(RefusedError, match="1543 with code 5"):
            play(operations().read("1543", type="uint16"), [first])

    def test_type_detection_sends_only_read_requests(self):
        heard = []
        line = VirtualLine([virtual_drive("danfoss-fc", 3, model="fc300")])
        with drivecomm.open_bus(line.port, trace=heard.append) as bus:
            drive = bus.drive("danfoss-fc", 3)
            assert drive.read("15-43").value == "5.11"
        sent = [event.message for event in heard if event.what == "sent"]
        assert len(sent) == 3
        assert all(installed["danfoss-fc"].intent(message).only_asks for message in sent)

    def test_no_response_ak_is_an_unexpected_reply(self):
        with pytest.raises(UnexpectedReplyError, match="no response"):
            play(operations().read("16-14"), [(ask(1, 1614), answer(0, 1614, pwe=524))])

    def test_unlisted_response_is_reported_with_its_ak(self):
        with pytest.raises(UnexpectedReplyError, match="AK 8"):
            play(operations().read("16-14"), [(ask(1, 1614), answer(8, 1614, pwe=524))])

    def test_missing_reply_raises_no_reply_error(self):
        with pytest.raises(NoReplyError):
            play(operations().read("16-14"), [(ask(1, 1614), NoReplyError("silence"))])


class TestTexts:
    def test_text_is_read_without_its_padding(self):
        script = [(ask(15, 1543, 0x0400), text_answer(1543, 0x0400, "5.1 \0"))]
        reading = play(operations("fc300").read("15-43"), script)
        assert (reading.value, reading.raw, reading.type) == ("5.1", "5.1 \0", "text")

    def test_text_is_read_by_type_without_a_model(self):
        reading = play(operations().read("621", type="text"), [(ask(15, 621, 0x0400), text_answer(621, 0x0400, "VLT"))])
        assert reading.value == "VLT"

    def test_missing_text_is_refused_with_its_reason(self):
        with pytest.raises(RefusedError, match="no text available"):
            play(operations().read("16-13", type="text"), [(ask(15, 1613, 0x0400), answer(7, 1613, 0x0400, 15))])

    def test_option_text_is_read_from_the_drive(self):
        script = [(ask(15, 1, 1), text_answer(1, 1, "ENGLISH"))]
        reading = play(operations("vlt5000").read("001", option_text=0), script)
        assert (reading.value, reading.note) == ("ENGLISH", "text of option 0")

    @pytest.mark.parametrize("option", [-1, 254, "1"])
    def test_option_number_outside_0_to_253_is_refused(self, option):
        with pytest.raises(ParameterAddressError, match="0 to 253"):
            operations().read("0-01", option_text=option)

    def test_written_text_is_sent_as_given(self):
        script = [(text_ask(37, "PUMP 3"), text_answer(37, 0x0500, "PUMP 3"))]
        reading = play(operations("fc300").write("0-37", "PUMP 3"), script)
        assert reading.value == "PUMP 3"
        assert "power-off" in reading.note

    @pytest.mark.parametrize("reply", [answer(1, 37, 0x0500), answer(2, 37, 0x0500)])
    def test_text_write_may_be_confirmed_by_a_number(self, reply):
        assert play(operations("fc300").write("0-37", "A"), [(text_ask(37, "A"), reply)]) is None

    def test_text_write_may_be_confirmed_by_zero_bytes(self):
        script = [(text_ask(37, "A"), text_answer(37, 0x0500, "\0\0\0\0"))] * 2
        assert play(operations("fc300").write("0-37", "A"), script) is None

    def test_confirmation_with_another_text_is_noted(self):
        script = [(text_ask(37, "NEW"), text_answer(37, 0x0500, "OLD"))] * 2
        reading = play(operations("fc300").write("0-37", "NEW"), script)
        assert reading.value == "OLD"
        assert "another text" in reading.note

    def test_late_text_reply_does_not_confirm_a_write(self):
        script = [
            (text_ask(37, "NEW"), text_answer(37, 0x0400, "OLD")),
            (text_ask(37, "NEW"), text_answer(37, 0x0500, "NEW")),
        ]
        assert play(operations("fc300").write("0-37", "NEW"), script).value == "NEW"

    def test_refused_text_write_raises_refused_error(self):
        with pytest.raises(RefusedError):
            play(operations("fc300").write("0-37", "A"), [(text_ask(37, "A"), answer(7, 37, 0x0500, 1))])

    def test_text_write_to_an_fc_101_is_refused_unsent(self):
        with pytest.raises(NotSupported, match="FC 101"):
            operations("fc101").write("0-37", "A")


class TestDescription:
    def read(self, pnu, element, reply, model="fc300", parameter="3-41"):
        return play(operations(model).read(parameter, element=element), [(ask(4, pnu, element), reply)])

    def test_element_4_is_explained_as_conversion_and_unit(self):
        reading = self.read(341, 4, answer(3, 341, 4, 0xFE04))
        assert (reading.value, reading.raw) == (0xFE04, 0xFE04)
        assert reading.text == "conversion index -2 (factor 0.01), unit index 4 (time)"
        assert "conversion index and unit" in reading.note

    def test_unlisted_unit_index_gets_a_note_on_the_byte_order(self):
        reading = self.read(341, 4, answer(3, 341, 4, 0x04FE))
        assert "other way round" in reading.note

    def test_element_1_is_explained_as_characteristics(self):
        reading = self.read(310, 1, answer(3, 310, 1, 0x4203), parameter="3-10")
        assert reading.text == "data type 3, array, read only"

    def test_parameter_name_element_is_a_text(self):
        reading = self.read(1, 6, text_answer(1, 6, "LANGUAGE", ak=3), "vlt5000", "001")
        assert reading.value == "LANGUAGE"

    def test_limit_elements_are_scaled_as_the_parameter(self):
        assert self.read(310, 7, answer(3, 310, 7, 0xD8F0), parameter="3-10").value == -100
        assert self.read(341, 8, answer(3, 341, 8, 360000)).value == 3600
        unknown = self.read(999, 20, answer(3, 999, 20, 5), parameter="9-99")
        assert unknown.value == 5
        assert "type not known" in unknown.note

    def test_other_description_elements_are_plain_numbers(self):
        assert self.read(341, 21, answer(3, 341, 21, 7)).value == 7
        assert "element 99" in self.read(341, 99, answer(3, 341, 99, 7)).note

    def test_missing_description_element_is_refused(self):
        with pytest.raises(RefusedError, match="description element"):
            self.read(341, 21, answer(7, 341, 21, 9))

    @pytest.mark.parametrize("element", [0, 256, "4"])
    def test_invalid_element_number_is_refused(self, element):
        with pytest.raises(ParameterAddressError):
            operations().read("3-41", element=element)

    @pytest.mark.parametrize(
        "given", [{"element": 1, "option_text": 1}, {"element": 1, "index": 1}, {"option_text": 1, "index": 0}]
    )
    def test_element_option_text_and_index_exclude_each_other(self, given):
        with pytest.raises(UsageError, match="IND holds one thing"):
            operations().read("3-41", **given)


class TestWrite:
    @pytest.mark.parametrize(
        ("parameter", "value", "store", "ak", "ind", "pwe", "confirm"),
        [
            ("4-14", 100, False, 2, 0, 1000, 1),
            ("4-14", 100, True, 14, 0, 1000, 1),
            ("3-03", 50, False, 3, 0, 50000, 2),
            ("3-03", 50, True, 13, 0, 50000, 2),
            ("3-02", -50, False, 3, 0, 0xFFFF3CB0, 2),
            ("3-10[1]", "-12.5", False, 2, 1, 0xFB1E, 1),
        ],
    )
    def test_write_sends_the_command_and_the_raw_value(self, parameter, value, store, ak, ind, pwe, confirm):  # noqa: PLR0917
        pnu = int(parameter.partition("[")[0].replace("-", ""))
        script = [(ask(ak, pnu, ind, pwe), answer(confirm, pnu, ind, pwe))]
        reading = play(operations("fc300").write(parameter, value, store=store), script)
        assert reading.value == Decimal(value)
        assert "where" not in reading.note

    def test_confirmation_may_have_the_sign_in_the_high_word(self):
        script = [(ask(2, 310, 1, 0xFB1E), answer(1, 310, 1, 0xFFFFFB1E))]
        assert play(operations("fc300").write("3-10[1]", -12.5), script).value == Decimal("-12.5")

    def test_write_by_type_needs_no_model(self):
        script = [(ask(2, 415, 0, 20), answer(1, 415, 0, 20))]
        assert play(operations().write("415", 20, type="uint8"), script).value == 20

    def test_confirmation_with_another_value_is_retried_once_and_noted(self):
        script = [(ask(2, 414, 0, 1000), answer(1, 414, 0, 900))] * 2
        reading = play(operations("fc300").write("4-14", 100), script)
        assert reading.value == 90
        assert "reports 900 where 1000 was written" in reading.note

    def test_late_reply_to_a_read_does_not_confirm_a_write(self):
        script = [
            (ask(2, 414, 0, 1000), answer(1, 414, 0, 650)),
            (ask(2, 414, 0, 1000), answer(1, 414, 0, 1000)),
        ]
        reading = play(operations("fc300").write("4-14", 100), script)
        assert (reading.value, reading.note) == (100, "")

    def test_refused_write_raises_refused_error(self):
        with pytest.raises(RefusedError, match="limits"):
            play(operations("fc300").write("4-14", 100), [(ask(2, 414, 0, 1000), answer(7, 414, 0, 2))])

    def test_value_that_does_not_fit_is_refused_unsent(self):
        with pytest.raises(ValueRefusedError):
            operations("fc300").write("4-14", "100.05")

    def test_write_acts_and_may_be_repeated(self):
        command = next(operations("fc300").write("4-14", 100))
        assert isinstance(command, Ask)
        assert command.acts
        assert command.attempts is None


class TestAddressing:
    def test_address_format_1_31_is_used_in_requests(self):
        command = next(operations(address=22, address_format="1-31").read("520"))
        assert (command.message.address_format, command.message.address) == ("1-31", 22)

    def test_address_format_1_31_ends_at_31(self):
        with pytest.raises(AddressError, match="1 to 31"):
            operations(address=32, address_format="1-31")

    def test_parameter_number_has_eleven_bits_on_old_drives(self):
        with pytest.raises(ParameterAddressError):
            operations("vlt5000").read("20-48")


class TestBroadcast:
    def told(self, exchange):
        (command,) = exchange
        assert isinstance(command, Tell)
        return command.message

    @pytest.mark.parametrize(
        ("how", "word"),
        [(Stop.RAMP, 0x043C), (Stop.COAST, 0x0474), (Stop.QUICK, 0x046C), (Stop.DC_BRAKE, 0x0478)],
    )
    def test_broadcast_stop_sends_the_control_word_to_all(self, how, word):
        message = self.told(operations(address=0).stop(how))
        assert message == ProcessRequest(**EVERYBODY, control_word=word, reference=0)

    def test_broadcast_write_is_refused_by_default(self):
        with pytest.raises(NotSupported, match="broadcast_parameters"):
            operations("fc300", address=0).write("4-14", 100)

    @pytest.mark.parametrize(
        ("parameter", "value", "store", "ak", "pwe"),
        [
            ("4-14", 100, False, 2, 1000),
            ("4-14", 100, True, 14, 1000),
            ("3-03", 50, False, 3, 50000),
            ("3-03", 50, True, 13, 50000),
        ],
    )
    def test_broadcast_write_is_sent_with_the_option(self, parameter, value, store, ak, pwe):
        everybody = operations("fc300", address=0, broadcast_parameters=True)
        message = self.told(everybody.write(parameter, value, store=store))
        assert (message.broadcast, message.address, message.ak, message.pwe) == (True, None, ak, pwe)

    def test_broadcast_text_write_is_refused(self):
        with pytest.raises(NotSupported):
            operations("fc300", address=0, broadcast_parameters=True).write("0-37", "A")

    @pytest.mark.parametrize(
        "verb",
        [
            lambda drive: drive.read("16-14"),
            lambda drive: drive.status(),
            lambda drive: drive.start(),
            lambda drive: drive.reset(),
            lambda drive: drive.set_reference_percent(1),
            lambda drive: drive.set_reference_hz(1),
            lambda drive: drive.probe(),
            lambda drive: drive.identify(),
            lambda drive: drive.extra["jog"](),
            lambda drive: drive.extra["select_preset"](1),
            lambda drive: drive.extra["select_setup"](1),
            lambda drive: drive.extra["hold"](),
            lambda drive: drive.extra["catch_up"](),
            lambda drive: drive.extra["control_word"](0x047C),
        ],
    )
    def test_verb_that_needs_an_answer_is_refused_as_broadcast(self, verb):
        with pytest.raises(NotSupported, match="no drive answers"):
            verb(operations(address=0))


class TestIdentity:
    PLATE = (1540, 1541, 1543, 1546, 1551)

    def test_probe_is_sent_once_with_control_word_zero(self):
        command = next(operations().probe())
        assert command.message == ProcessRequest(**AT_3, **IDLE)
        assert command.attempts == 1

    def test_probe_succeeds_with_any_process_reply(self):
        reply = ProcessReply(**AT_3, **READY)
        assert play(operations().probe(), [(ProcessRequest(**AT_3, **IDLE), reply)]) is None

    def test_identify_without_a_model_reads_five_texts(self):
        script = [(ask(15, pnu, 0x0400), text_answer(pnu, 0x0400, f"T{pnu} ")) for pnu in self.PLATE]
        assert play(operations().identify(), script) == {
            "FC type": "T1540",
            "power section": "T1541",
            "software version": "T1543",
            "ordering number": "T1546",
            "serial number": "T1551",
        }

    def test_identify_reads_the_unit_type_of_an_old_drive(self):
        script = [(ask(15, pnu, 0x0400), answer(7, pnu, 0x0400)) for pnu in self.PLATE]
        script.append((ask(15, 621, 0x0400), text_answer(621, 0x0400, "VLT 5004")))
        assert play(operations().identify(), script) == {"unit type": "VLT 5004"}

    def test_identify_of_a_drive_without_texts_is_empty(self):
        script = [(ask(15, pnu, 0x0400), answer(0, pnu, 0x0400)) for pnu in self.PLATE]
        script.append((ask(15, 621, 0x0400), text_answer(621, 0x0400, "")))
        assert play(operations().identify(), script) == {}

    def test_identify_reads_the_name_plate_of_the_model(self):
        script = [(ask(15, 621, 0x0400), text_answer(621, 0x0400, "VLT 6002"))]
        script += [(ask(15, pnu, 0x0400), answer(7, pnu, 0x0400)) for pnu in range(622, 632)]
        assert play(operations("vlt6000").identify(), script) == {"unit type": "VLT 6002"}
