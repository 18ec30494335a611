"""Codecs made of forms: lengths, contents, blind spots, and the form that fits bytes or a message."""

from dataclasses import fields

import pytest
from construct import this
from declared_telegrams import ACK, ENQ, ETX, STX, Block, counted, ct_ansi, lecom, message, mitsubishi
from hypothesis import given, strategies as st

from drivecomm.errors import TelegramError, UsageError
from drivecomm.protocol import Framed, Framer, fields_of
from drivecomm.protocol.schema import (
    CheckCharacters,
    Form,
    Leaf,
    Telegrams,
    characters,
    choice,
    constant,
    deciding,
    decimal_number,
    hex_number,
    hex_sum,
    until,
    xor_byte,
)

CODECS = {"mitsubishi": mitsubishi(), "lecom": lecom(), "ct-ansi": ct_ansi(), "counted": counted()}
REQUESTS = {"Read", "Write, 2", "Write, 4", "RECEIVE", "SEND", "Write", "Many", "One", "End"}
TEXTS = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1, max_size=12)
BYTES = st.text(st.characters(max_codepoint=255), max_size=7)
BY_NAME = {
    "address": st.integers(0, 31),
    "code": st.integers(0, 6229),
    "parameter": st.integers(0, 9999),
    "value": TEXTS,
    "wait": st.integers(0, 15),
    "error": st.integers(0, 15),
    "word": st.integers(0, 8),
    "words": BYTES,
}
MESSAGES = {
    "value2": {"data": st.integers(0, 255)}, "value4": {"data": st.integers(0, 65535)},
    "read": {"code": st.integers(0, 127)}, "write2": {"code": st.just(0xFA), "data": st.integers(0, 255)},
    "write4": {"code": st.just(0xED), "data": st.integers(0, 65535)},
    "many": {"word": st.none()}, "one": {"words": st.none()},
    "x": {"words": st.none(), "word": st.none() | st.integers(0, 8)},
}  # fmt: skip


@st.composite
def telegrams(draw):
    """Draw a codec, a direction, a message and its bytes."""
    name = draw(st.sampled_from([*CODECS]))
    codec = CODECS[name]
    title, form = draw(st.sampled_from([*codec.forms.items()]))
    kinds = {Block: {"Many": "many", "One": "one"}.get(title, "x")}
    kind = kinds.get(form.message) or form.message.kind
    known = {**BY_NAME, **MESSAGES.get(kind, {}), "kind": st.just(kind)}
    made = form.message(**{each.name: draw(known[each.name]) for each in fields(form.message)})
    direction = "request" if title in REQUESTS else "reply"
    return codec, direction, made, codec.encode(made)


@given(telegrams())
def test_telegram_is_read_as_it_was_written(telegram):
    codec, direction, made, data = telegram
    assert codec.decode(data, direction) == made
    assert codec.encode(codec.decode(data, direction)) == data
    assert codec.message(fields_of(made), direction) == made


@given(telegrams())
def test_measure_never_exceeds_the_length_of_the_telegram(telegram):
    codec, direction, _, data = telegram
    for end in range(len(data)):
        assert end < codec.measure(data[:end], direction) <= len(data) or data[:end] == b"#"
    assert codec.measure(data, direction) in (len(data), 2)
    assert codec.measure(data + b"\xff", direction) == len(data)


@given(telegrams())
def test_telegrams_are_framed_from_pieces_of_any_size(telegram):
    codec, direction, made, data = telegram
    for size in (1, 2, 3, 5 * len(data)):
        framer = Framer(codec, direction)
        whole = 5 * data
        found = [each for start in range(0, len(whole), size) for each in framer.feed(whole[start : start + size])]
        found += framer.flush()
        assert [each.message for each in found if isinstance(each, Framed)] == [made] * 5 == [made] * len(found)


@given(telegrams())
def test_blind_spots_are_the_bytes_where_a_wrong_bit_stays_unnoticed(telegram):
    codec, direction, _, data = telegram
    blind = codec.blind_spots(data, direction)
    for place in range(len(data)):
        unnoticed = 0
        for bit in range(8):
            wrong = data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]
            try:
                codec.decode(wrong, direction)
            except TelegramError:
                continue
            unnoticed += 1
        assert (place in blind) == (unnoticed > 0)


@given(telegrams(), st.binary(max_size=30), st.integers(0, 30))
def test_decode_of_random_bytes_raises_only_telegram_errors(telegram, noise, kept):
    codec, direction, _, data = telegram
    for each in (noise, data[:kept] + noise, data[:kept]):
        assert codec.measure(each, direction) >= 0
        try:
            read = codec.decode(each, direction)
        except TelegramError:
            continue
        assert codec.decode(codec.encode(read), direction) == read


ODD = [None, "x", "", -1, 1 << 70, 1.0, True, [], b"1", ("a",), {}]


@pytest.mark.parametrize("odd", ODD, ids=repr)
@pytest.mark.parametrize("name", CODECS)
def test_encode_refuses_odd_fields_with_a_telegram_error(name, odd):
    codec = CODECS[name]
    for form in codec.forms.values():
        content = {each.name: odd for each in fields(form.message)}
        if odd == "x" or not content:
            continue
        with pytest.raises(TelegramError) as caught:
            codec.encode(form.message(**content))
        assert caught.value.category == "field"


def test_encode_refuses_a_text_instead_of_a_message():
    with pytest.raises(TelegramError, match="str is not a telegram"):
        CODECS["lecom"].encode("telegram")


def test_encode_refuses_a_field_that_the_form_does_not_have():
    with pytest.raises(TelegramError, match="this one telegram has no words") as caught:
        CODECS["counted"].encode(Block(kind="one", word=1, words="ab"))
    assert caught.value.field == "words"


@pytest.mark.parametrize(
    ("name", "direction", "text", "fields"),
    [
        ("mitsubishi", "request", "05 30 31 45 31 31 30 37 41 44 46 34", {"code": 0xE1, "data": 0x07AD}),
        ("mitsubishi", "reply", "02 30 31 31 37 37 30 03 33 30", {"kind": "value4", "data": 0x1770}),
        ("lecom", "reply", "02 34 36 33 35 2E 34 03 1D", {"code": 46, "value": "35.4"}),
        ("lecom", "request", "04 33 34 02 31 31 39 35 2E 32 03 13", {"code": 11, "value": "95.2", "address": 34}),
        ("lecom", "reply", "02 34 36 3F 03 3E", {"value": "?"}),
        ("lecom", "reply", "02 34 36 04", {"kind": "unknown", "code": 46}),
        ("ct-ansi", "request", "04 31 31 32 32 30 31 32 31 05", {"kind": "read", "address": 12, "parameter": 121}),
        ("ct-ansi", "reply", "02 30 31 32 31 2D 34 37 2E 36 03 37", {"value": "-47.6"}),
        ("ct-ansi", "request", "04 32 32 36 36 02 30 31 32 31 2B 30 37 36 2E 34 03 21", {"value": "+076.4"}),
    ],
)
def test_printed_telegrams_of_the_manuals_are_read(name, direction, text, fields):
    data = bytes.fromhex(text)
    found = fields_of(CODECS[name].decode(data, direction))
    assert {key: found[key] for key in fields} == fields
    assert CODECS[name].measure(data, direction) == len(data)


def test_check_byte_equal_to_etx_is_read():
    codec = CODECS["lecom"]
    for number in range(0x20, 0x7F):
        data = codec.encode(codec.message({"kind": "value", "code": 11, "value": f"1{chr(number)}"}, "reply"))
        if data[-1:] == ETX:
            assert codec.measure(data[:-1], "reply") == codec.measure(data, "reply") == len(data)
            assert codec.decode(data, "reply").value == f"1{chr(number)}"
            break
    else:
        pytest.fail("no value has such a check byte")


def test_leaf_without_its_end_is_given_up_at_its_maximum_length():
    codec = CODECS["lecom"]
    assert codec.measure(STX + b"46" + 20 * b"1", "reply") == 25
    assert codec.measure(STX + b"46" + 21 * b"1", "reply") == 0
    assert codec.measure(STX + b"46" + 21 * b"1" + ETX, "reply") == 0


def test_measure_waits_for_more_only_if_a_longer_telegram_may_follow():
    codec = CODECS["counted"]
    assert [codec.measure(head, "request") for head in (b"#", b"#O", b"#?", b"#M\x00", b"#M\x09")] == [2, 5, 1, 1, 1]


def test_missing_constant_after_a_sized_leaf_is_a_framing_error():
    form = Form(
        A,
        *(constant(b"<"), "size" / decimal_number(1), "value" / characters(this.size), constant(b">")),
        writes={"size": lambda message: len(message.value)},
    )
    for data in (b"<2ab", b"<2abc>", b"<2a\x00c>"):
        for parse in (form.parse, form.parse_declared):
            with pytest.raises(TelegramError) as caught:
                parse(data)
            assert caught.value.category == "framing"
    with pytest.raises(TelegramError) as caught:
        form.parse(b"<2a")
    assert caught.value.category == "length"


def test_undecodable_telegram_gets_the_error_category_of_its_fault():
    codec = CODECS["mitsubishi"]
    for data, category in (
        (b"\x07010", "framing"),
        (ENQ + b"01zz0A1", "checksum"),
        (ENQ + b"01", "length"),
        (ACK + b"40", "field"),
    ):
        with pytest.raises(TelegramError) as caught:
            codec.decode(data, "request" if data[:1] == ENQ else "reply")
        assert caught.value.category == category


A, B, C, D = message("a", "value"), message("b", "value"), message("c"), message("d")
REPLIES = {"C": Form(C, constant(ACK))}
DIGIT = "value" / decimal_number(1)


@pytest.mark.parametrize(
    ("forms", "text"),
    [
        (
            [Form(A, constant(b"<"), DIGIT), Form(B, constant(b"<"), DIGIT)],
            "nothing determines which telegram is which: 'A0' or 'B1'",
        ),
        (
            [Form(A, constant(b"<"), DIGIT), Form(B, constant(b"<"), "value" / hex_number(2))],
            "nothing determines how long a telegram is",
        ),
        (
            [
                Form(A, constant(b"<"), DIGIT),
                Form(B, constant(b"<"), "value" / characters(until(b">", most=3)), constant(b">")),
            ],
            "nothing determines how long a telegram is",
        ),
        (
            [Form(C, constant(b"<")), Form(D, constant(b"<")), Form(B, constant(b"<"), constant(b">"), DIGIT)],
            "is which: 'C0' or 'D1'",
        ),
        (
            [
                Form(A, constant(b"<"), "value" / characters(until(b">", most=3)), constant(b">")),
                Form(B, constant(b"<"), DIGIT, DIGIT, DIGIT, constant(b";")),
            ],
            "nothing determines how long a telegram is",
        ),
        ([Form(A, constant(b"<"), DIGIT), Form(A, constant(b">"), DIGIT)], "in which form a A is written"),
    ],
)
def test_declaration_of_indistinguishable_telegrams_is_refused(forms, text):
    titled = {f"{form.message.__name__}{number}": form for number, form in enumerate(forms)}
    with pytest.raises(UsageError, match=text):
        Telegrams(titled, REPLIES)


def test_constant_and_digits_at_the_same_place_distinguish_forms():
    codec = Telegrams(
        {"A": Form(A, constant(b"<"), DIGIT), "B": Form(B, constant(b"<"), constant(b"-"), DIGIT)}, REPLIES
    )
    assert (codec.measure(b"<", "request"), codec.measure(b"<-", "request"), codec.measure(b"<1", "request")) == (
        2,
        3,
        2,
    )
    assert codec.decode(b"<-1", "request") == B(value=1)


def test_duplicate_form_title_is_refused():
    form = Form(A, constant(b"<"), DIGIT)
    with pytest.raises(UsageError, match="same title"):
        Telegrams({"A": form}, {"A": REPLIES["C"]})


@pytest.mark.parametrize(
    ("declare", "text"),
    [
        (lambda: Leaf(until(ETX, most=9), bytes, bytes), "never holds that"),
        (lambda: Form(A, "value" / characters(until(ETX, most=9))), "03 is missing"),
        (
            lambda: Form(
                A, "value" / characters(until(b"\r", most=9, least=1)), CheckCharacters(1, 0, xor_byte), constant(b"\r")
            ),
            "may hold 0D",
        ),
        (
            lambda: Form(A, "value" / characters(until(ETX, most=9)), characters(until(ETX, most=9)), constant(ETX)),
            "has one",
        ),
        (lambda: Form(A, "value" / object()), "unsupported operand"),
        (lambda: Form(A, "value"), "is not a leaf"),
        (lambda: deciding(hex_number(4)), "cannot decide"),
        (lambda: deciding(characters(until(ETX, most=9))), "cannot decide"),
    ],
)
def test_meaningless_declaration_is_refused(declare, text):
    with pytest.raises((UsageError, TypeError, AttributeError), match=text):
        declare()


def test_check_characters_may_precede_the_end_constant():
    form = Form(
        A, constant(b"("), "value" / characters(until(b")", most=9)), CheckCharacters(2, 1, hex_sum), constant(b")")
    )
    codec = Telegrams({"A": form}, REPLIES)
    data = codec.encode(A(value="abc"))
    assert data == b"(abc26)"
    assert [codec.measure(data[:end], "request") for end in range(8)] == [4, 4, 4, 4, 5, 6, 7, 7]
    assert codec.decode(data, "request") == A(value="abc")
    with pytest.raises(TelegramError, match="10 characters where 0 to 9 belong"):
        codec.encode(A(value="abcdefghij"))


def test_end_constant_may_have_several_characters():
    form = Form(A, constant(b"("), "value" / characters(until(b"\r\n", most=3)), constant(b"\r\n"))
    codec = Telegrams({"A": form}, REPLIES)
    assert [codec.measure(b"(ab\r\n"[:end], "request") for end in range(6)] == [3, 3, 3, 4, 5, 5]
    assert codec.measure(b"(abcde", "request") == 0


def test_custom_leaf_may_extend_until_a_constant():
    number = Leaf(until(b";", least=1, most=5), int, lambda value: b"%d" % value, alphabet=b"-0123456789")
    form = Form(A, "value" / number, constant(b";"))
    assert form.parse_compiled != form.parse_declared
    for value in (-4711, 0, 99999):
        assert (
            form.parse(form.build(A(value=value)))
            == form.parse_declared(form.build_declared(A(value=value)))
            == A(value=value)
        )
    for data in (b";", b"123456;", b"1-;"):
        with pytest.raises(TelegramError):
            form.parse(data)


@pytest.mark.parametrize(
    "leaf", [hex_number(2, allowed={1, 7}), hex_number(4, allowed={1, 7}), choice({b"01": 1, b"07": 7})]
)
def test_deciding_leaf_of_any_kind_selects_the_form(leaf):
    other = choice({b"x" * leaf.size: "x"})
    codec = Telegrams(
        {"A": Form(A, "value" / deciding(leaf)), "B": Form(B, "value" / deciding(other), DIGIT, reads={})}, REPLIES
    )
    assert codec.decode(Form(A, "value" / leaf).build(A(value=7)), "request") == A(value=7)
    assert codec.measure(b"x" * leaf.size, "request") == leaf.size + 1
