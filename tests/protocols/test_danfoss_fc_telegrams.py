"""Telegrams of the FC protocol beyond the vectors: correlation, framing and invalid fields."""

import pytest

from drivecomm.errors import TelegramError
from drivecomm.protocol import Damaged, Framed, Framer, fields_of
from drivecomm_danfoss_fc import protocol
from drivecomm_danfoss_fc.messages import (
    ParameterReply,
    ParameterRequest,
    ProcessReply,
    ProcessRequest,
    TextReply,
    TextRequest,
    mismatch,
)
from drivecomm_danfoss_fc.telegrams import DanfossFcCodec, message_from, titled_forms

CODEC = DanfossFcCodec()
OLD = DanfossFcCodec(11)
AT_3 = {"address_format": "1-126", "address": 3}
IDLE = {"control_word": 0, "reference": 0}
READY = {"status_word": 0x0607, "main_actual": 0}


def ask(ak, pnu=1614, ind=0, pwe=0, **address):
    return ParameterRequest(**(address or AT_3), ak=ak, pnu=pnu, ind=ind, pwe=pwe, **IDLE)


def answer(ak, pnu=1614, ind=0, pwe=0, **address):
    return ParameterReply(**(address or AT_3), ak=ak, pnu=pnu, ind=ind, pwe=pwe, **READY)


class TestCorrelation:
    @pytest.mark.parametrize(
        ("command", "responses"),
        [
            (0, {0}),
            (1, {0, 1, 2, 7}),
            (2, {0, 1, 7}),
            (3, {0, 1, 2, 7}),
            (4, {0, 3, 7}),
            (13, {0, 1, 2, 7}),
            (14, {0, 1, 7}),
            (15, {0, 7}),
            (9, {0, 7}),
        ],
    )
    def test_only_listed_responses_match_a_command(self, command, responses):
        listed = {0, 1, 2, 3, 7}
        legal = {ak for ak in listed if mismatch(ask(command), answer(ak)) == ""}
        assert legal == responses
        assert all(mismatch(ask(command), answer(ak)) == "ak" for ak in listed - responses)

    def test_unlisted_response_matches_so_that_it_is_reported(self):
        assert mismatch(ask(1), answer(8)) == ""

    def test_high_byte_of_ind_must_match_for_texts_and_descriptions_only(self):
        assert mismatch(ask(1, ind=3), answer(1, ind=0x0703)) == ""
        assert mismatch(ask(4, ind=4), answer(3, ind=0x0704)) == "ind"
        assert mismatch(ask(15, ind=0x0400), answer(7, ind=0)) == "ind"

    def test_reply_in_the_other_address_format_does_not_match(self):
        old = {"address_format": "1-31", "address": 3}
        assert mismatch(ask(1), answer(1, **old)) == "address"
        assert mismatch(ask(1, **old), answer(1, **old)) == ""

    def test_no_reply_matches_a_broadcast(self):
        everybody = {"address_format": "1-126", "broadcast": True}
        assert mismatch(ask(1, **everybody), answer(1)) == "address"

    def test_request_does_not_match_as_a_reply(self):
        assert mismatch(ask(1), ask(1)) == "kind"
        assert mismatch(answer(1), answer(1)) == "kind"

    def test_process_request_matches_process_replies_only(self):
        process = ProcessRequest(**AT_3, **IDLE)
        assert mismatch(process, ProcessReply(**AT_3, **READY)) == ""
        assert mismatch(process, answer(1)) == "kind"
        assert mismatch(ask(1), ProcessReply(**AT_3, **READY)) == "kind"

    def test_text_write_matches_a_text_or_word_reply_with_any_ind(self):
        write = TextRequest(**AT_3, ak=15, pnu=37, ind=0x0500, text="A", **IDLE)
        text = TextReply(**AT_3, ak=15, pnu=37, ind=0x0400, text="A", **READY)
        name = TextReply(**AT_3, ak=3, pnu=37, ind=6, text="A", **READY)
        assert mismatch(write, text) == ""
        assert mismatch(write, answer(1, pnu=37)) == ""
        assert mismatch(write, answer(1, pnu=38)) == "pnu"
        assert mismatch(write, name) == "ak"


class TestToggleBit:
    DATA = bytes.fromhex("02 0E 81 1A 08 00 00 00 00 02 0C 06 07 00 00 90")

    def test_toggle_bit_is_a_field_with_eleven_pnu_bits_only(self):
        assert fields_of(OLD.decode(self.DATA, "reply"))["spm"] is True
        assert "spm" not in fields_of(CODEC.decode(self.DATA, "reply"))

    def test_reply_with_a_toggle_bit_can_be_encoded(self):
        assert OLD.encode(OLD.decode(self.DATA, "reply")) == self.DATA

    @pytest.mark.parametrize(("codec", "spm"), [(OLD, True), (OLD, 1), (CODEC, True), (CODEC, False)])
    def test_request_with_a_toggle_bit_is_refused(self, codec, spm):
        with pytest.raises(TelegramError, match="toggle bit") as caught:
            codec.encode(ParameterRequest(**AT_3, ak=1, spm=spm, pnu=520, ind=0, pwe=0, **IDLE))
        assert caught.value.field == "spm"

    def test_pnu_has_eleven_bits_beside_a_toggle_bit(self):
        assert OLD.encode(ask(1, pnu=2047))
        with pytest.raises(TelegramError, match="11 bits"):
            OLD.encode(ask(1, pnu=2048))


class TestFields:
    @pytest.mark.parametrize(
        ("changed", "field"),
        [
            ({"ak": 16}, "ak"),
            ({"ak": "1"}, "ak"),
            ({"ak": 6}, "ak"),
            ({"pnu": True}, "pnu"),
            ({"ind": None}, "ind"),
            ({"ind": -1}, "ind"),
            ({"pwe": 2**32}, "pwe"),
            ({"address_format": 31}, "address_format"),
            ({"broadcast": 1}, "broadcast"),
            ({"address": 1.0}, "address"),
            ({"control_word": None}, "control_word"),
        ],
    )
    def test_invalid_field_value_is_refused_with_its_name(self, changed, field):
        fields = {"kind": "parameter", **AT_3, "ak": 1, "pnu": 1, "ind": 0, "pwe": 0, **IDLE, **changed}
        with pytest.raises(TelegramError) as caught:
            CODEC.encode(message_from(fields, "request"))
        assert (caught.value.category, caught.value.field) == ("field", field)

    def test_text_field_refuses_a_number(self):
        with pytest.raises(TelegramError, match="not a text"):
            CODEC.encode(TextRequest(**AT_3, ak=15, pnu=37, ind=0x0500, text=5, **IDLE))

    @pytest.mark.parametrize(
        ("data", "direction", "category"),
        [
            ("03 04 81", "request", "framing"),
            ("02", "reply", "length"),
            ("02 09 81", "reply", "length"),
            ("02 06 81 00 00 00 00", "request", "length"),
            ("02 06 81 00 00 00 00 85 00", "request", "length"),
            ("02 0D 81 11 9E 00 00 00 03 E8 06 07 00 00 EB", "reply", "length"),
            ("02 06 81 00 00 00 00 84", "request", "checksum"),
            ("02 06 00 00 00 00 00 04", "request", "field"),
            ("02 06 80 06 07 00 00 85", "reply", "field"),
        ],
    )
    def test_malformed_telegram_has_the_error_category_of_its_fault(self, data, direction, category):
        with pytest.raises(TelegramError) as caught:
            CODEC.decode(bytes.fromhex(data), direction)
        assert caught.value.category == category

    @pytest.mark.parametrize("fields", [{}, {"kind": "ppo1"}, {"kind": "process", "unknown": 1}, {"kind": "process"}])
    def test_unknown_or_incomplete_fields_are_refused(self, fields):
        with pytest.raises(TelegramError):
            message_from(fields, "request")

    @pytest.mark.parametrize(
        "address",
        [
            {"address_format": "1-31", "address": 32},
            {"address_format": "1-126"},
            {"address_format": "1-126", "broadcast": True, "address": 1},
        ],
    )
    def test_invalid_address_is_refused(self, address):
        with pytest.raises(TelegramError, match="address"):
            CODEC.encode(ProcessRequest(**address, **IDLE))
        with pytest.raises(TelegramError, match="address"):
            CODEC.encode(ProcessReply(address_format="1-31", broadcast=True, **READY))

    def test_text_longer_than_245_characters_is_refused(self):
        long = TextRequest(**AT_3, ak=15, pnu=37, ind=0x0500, text="x" * 246, **IDLE)
        with pytest.raises(TelegramError, match="245"):
            CODEC.encode(long)

    def test_text_write_command_is_refused_as_a_parameter_block(self):
        with pytest.raises(TelegramError, match="not a parameter block"):
            CODEC.encode(ask(15, ind=0x0500))

    def test_empty_telegram_is_a_length_error(self):
        with pytest.raises(TelegramError) as caught:
            CODEC.decode(b"", "reply")
        assert caught.value.category == "length"


class TestFraming:
    REPLY = bytes.fromhex("02 0E 83 26 4E 00 00 00 00 02 0C 06 07 00 00 E8")

    @pytest.mark.parametrize("broken_off", range(3, 14))
    def test_cut_telegram_and_its_repetition_are_not_joined(self, broken_off):
        framer = Framer(CODEC, "reply")
        found = [*framer.feed(self.REPLY[:broken_off] + self.REPLY), *framer.flush()]
        assert [find.data for find in found if isinstance(find, Framed)] == [self.REPLY]

    def test_joined_halves_with_a_valid_bcc_are_rejected(self):
        # Nine bytes of a telegram and seven of its repetition have a valid BCC, and would give the value 526.
        both = self.REPLY[:9] + self.REPLY[:7]
        checked = 0
        for byte in both:
            checked ^= byte
        assert checked == 0
        with pytest.raises(TelegramError) as caught:
            CODEC.decode(both, "reply")
        assert caught.value.category == "framing"

    def test_impossible_request_does_not_delay_the_next_one(self):
        framer = Framer(CODEC, "request")
        own = bytes.fromhex("02 06 83 04 3C 00 00 BF")
        foreign = bytes.fromhex("02 10 82 F6 04 04 00")
        assert [find.data for find in framer.feed(foreign + own) if isinstance(find, Framed)] == [own]

    def test_reply_with_a_wrong_bcc_is_damaged(self):
        framer = Framer(CODEC, "reply")
        found = framer.feed(self.REPLY[:-1] + b"\x00")
        assert [type(find) for find in found][:1] == [Damaged]

    def test_reply_has_no_blind_spots(self):
        assert protocol.blind_spots(self.REPLY, "reply") == frozenset()


def test_titled_forms_show_all_blocks():
    shown = {title: form.describe() for title, form in titled_forms().items()}
    assert len(shown) == 6
    assert shown["Process block, master"][0] == ("", "1", "STX")
    assert shown["Text block, drive"][5] == ("text", "n", "characters, ISO 8859-1")


@pytest.mark.parametrize(
    "too_long",
    ["02 06 81 06 07 00 00 00 84", "02 06 24 20 00 00 00 00 00", "02 0E 81 16 4E 00 00 00 00 00 00 00 D5 00"],
)
def test_excess_length_is_reported_before_checksum_and_address(too_long):
    data = bytes.fromhex(too_long)
    with pytest.raises(TelegramError) as caught:
        DanfossFcCodec().decode(data if data[1] == 6 else data + bytes(3), "reply")
    assert caught.value.category == "length"
