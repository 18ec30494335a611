"""The leaves of telegram schemas and the forms made of them."""

from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
from construct import this

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import (
    Check,
    Form,
    Leaf,
    characters,
    choice,
    constant,
    decimal_number,
    decimal_sum,
    filler,
    hex_number,
    hex_sum,
    hex_value,
    shifted_character,
    signed,
    unsigned,
    unsure,
    xor_byte,
)


@dataclass(frozen=True, kw_only=True)
class Note:
    kind: ClassVar[str] = "note"
    value: object = None
    other: object = None


def form(*leaves, **options):
    return Form(Note, *leaves, **options)


def one(leaf):
    return form("value" / leaf)


def refusal(leaf, data):
    with pytest.raises(TelegramError) as caught:
        one(leaf).parse(data)
    return caught.value


@pytest.mark.parametrize(
    ("leaf", "data", "value"),
    [
        (choice({b"A": "on", b"B": "off"}), b"B", "off"),
        (decimal_number(3), b"007", 7),
        (decimal_number(2, range(1, 100)), b"99", 99),
        (hex_number(4), b"00AF", 0xAF),
        (shifted_character(0x40, range(1, 31)), b"A", 1),
        (characters(3), b"a b", "a b"),
        (characters(2, highest=0xFF), b"\xe4!", "ä!"),
        (unsigned(2), b"\xff\xfe", 65534),
        (unsigned(4), b"\x80\x00\x00\x00", 1 << 31),
        (signed(2), b"\xff\xfe", -2),
        (signed(2), b"\x7f\xff", 32767),
        (signed(1, allowed={-3}), b"\xfd", -3),
        (unsigned(2, allowed=range(100, 200)), b"\x00\x64", 100),
        (hex_number(4, allowed=range(0x100)), b"00FF", 0xFF),
    ],
)
def test_leaf_reads_the_bytes_that_it_writes(leaf, data, value):
    assert one(leaf).parse(data) == Note(value=value)
    assert one(leaf).build(Note(value=value)) == data


@pytest.mark.parametrize(
    ("leaf", "data", "category", "text"),
    [
        (constant(b"\x02", "STX"), b"\x03", "framing", "02 STX expected, 03 found"),
        (choice({b"A": "on", b"B": "off"}), b"C", "field", "43 is none of 'on', 'off'"),
        (choice({bytes([code]): code for code in range(64)}), b"C", "field", "43 is none of 0, ..., 63"),
        (decimal_number(2), b"1A", "field", "are not 2 decimal digits"),
        (decimal_number(2), b"+1", "field", "are not 2 decimal digits"),
        (decimal_number(2, range(1, 5)), b"05", "field", "5 is not allowed here"),
        (hex_number(2), b"0a", "field", "is not made of the digits 0-9 and A-F"),
        (hex_number(2), b" 1", "field", "is not made of the digits 0-9 and A-F"),
        (hex_number(2), b"\xb2\xb3", "field", "is not made of the digits 0-9 and A-F"),
        (shifted_character(0x40, range(1, 31)), b"@", "field", "0 is not allowed here"),
        (hex_number(2, allowed=range(0x20)), b"20", "field", "32 is not allowed here"),
        (hex_number(4, allowed=range(0x100)), b"0100", "field", "256 is not allowed here"),
        (unsigned(1, allowed={1, 2}), b"\x03", "field", "3 is not allowed here"),
        (signed(2, allowed=range(-5, 5)), b"\x00\x05", "field", "5 is not allowed here"),
        (characters(2), b"a\x1f", "field", "holds a character outside 20H to 7EH"),
        (characters(2), b"a", "length", "2 characters expected, 1 found"),
        (characters(2), b"", "length", "2 characters expected, nothing found"),
        (characters(2), b"abc", "length", "2 characters expected, 3 found"),
    ],
)
def test_leaf_refuses_malformed_bytes(leaf, data, category, text):
    error = refusal(leaf, data)
    assert error.category == category
    assert text in str(error)
    assert error.field == ("value" if category == "field" else error.field)


@pytest.mark.parametrize(
    ("leaf", "value"),
    [
        (choice({b"A": "on"}), "off"),
        (choice({b"A": 1}), []),
        (decimal_number(2), 100),
        (decimal_number(2), -1),
        (decimal_number(2), True),
        (decimal_number(2), "1"),
        (decimal_number(2), None),
        (hex_number(2), 256),
        (hex_number(2), 1.0),
        (shifted_character(0x40, range(1, 31)), 31),
        (characters(2), "abc"),
        (characters(2), "a"),
        (characters(2), "a\n"),
        (characters(2), b"ab"),
        (characters(2), "a\u2126"),
        (unsigned(2), 65536),
        (unsigned(2), -1),
        (signed(2), 32768),
        (signed(2), -32769),
    ],
)
def test_leaf_refuses_to_write_an_invalid_value(leaf, value):
    with pytest.raises(TelegramError, match=r"^note telegram") as caught:
        one(leaf).build(Note(value=value))
    assert (caught.value.category, caught.value.field) == ("field", "value")


def test_build_refuses_a_missing_field():
    with pytest.raises(TelegramError):
        one(hex_number(2)).build(Note())


def test_constants_and_fillers_need_no_field():
    note = form(constant(b"<"), filler(b"  "), "value" / decimal_number(1), filler(b"0", "spare"), constant(b">"))
    assert note.build(Note(value=7)) == b"<  70>"
    assert note.parse(b"<xy7z>") == Note(value=7)


@pytest.mark.parametrize(
    ("compute", "covered", "check"),
    [(xor_byte, b"\x01\x02\x04", b"\x07"), (hex_sum, b"\xff\x02", b"01"), (decimal_sum, b"\x64\x07", b"07")],
)
def test_check_characters_are_computed_and_verified(compute, covered, check):
    assert compute(covered) == check
    checked = form("value" / characters(len(covered), lowest=0, highest=255), Check(len(check), 0, compute))
    text = covered.decode("latin-1")
    assert checked.build(Note(value=text)) == covered + check
    assert checked.parse(covered + check) == Note(value=text)
    with pytest.raises(TelegramError, match="check characters") as caught:
        checked.parse(covered + bytes([check[0] ^ 1]) + check[1:])
    assert caught.value.category == "checksum"


def test_check_characters_cover_only_bytes_from_their_start():
    checked = form("other" / characters(1), "value" / hex_number(2), Check(1, 1, xor_byte))
    assert checked.build(Note(value=0x11, other="a")) == b"a11\x00"
    assert checked.parse(b"b11\x00") == Note(value=0x11, other="b")


def test_check_characters_may_switch_the_check_off():
    checked = form("value" / characters(1), Check(2, 0, decimal_sum, off=b"??"))
    assert checked.parse(b"a??") == Note(value="a")
    assert checked.parse(b"a97") == Note(value="a")
    with pytest.raises(TelegramError):
        checked.parse(b"a?7")


def test_check_is_written_as_switched_off_on_request():
    checked = form("value" / characters(1), "other" / Check(2, 0, decimal_sum, off=b"??"))
    assert checked.build(Note(value="a", other=b"??")) == b"a??"
    assert checked.build(Note(value="a")) == checked.build(Note(value="a", other=b"11")) == b"a97"


def test_check_characters_by_a_second_rule_are_accepted():
    checked = form("value" / characters(1), Check(2, 0, decimal_sum, also=hex_sum))
    assert checked.parse_compiled != checked.parse_declared
    for parse in (checked.parse_compiled, checked.parse_declared):
        assert parse(b"a97") == parse(b"a61") == Note(value="a")
    assert checked.build(Note(value="a")) == b"a97"
    with pytest.raises(TelegramError, match="b'96' found, b'97' computed") as caught:
        checked.parse(b"a96")
    assert caught.value.category == "checksum"


def test_check_with_a_second_rule_may_be_switched_off():
    checked = form("value" / characters(1), Check(2, 0, decimal_sum, off=b"??", also=hex_sum))
    for parse in (checked.parse_compiled, checked.parse_declared):
        assert parse(b"a97") == parse(b"a61") == parse(b"a??") == Note(value="a")
    with pytest.raises(TelegramError):
        checked.parse(b"a?1")


def test_named_check_characters_become_a_field():
    checked = form("value" / Check(1, 0, xor_byte))
    assert checked.parse(b"\x00") == Note(value=b"\x00")


def test_missing_check_characters_are_a_length_error():
    with pytest.raises(TelegramError) as caught:
        form("value" / characters(1), Check(2, 0, hex_sum)).parse(b"a6")
    assert caught.value.category == "length"


SIZED = form(
    "length" / decimal_number(1),
    "value" / characters(this.length),
    writes={"length": lambda note: len(note.value)},
)


def test_size_of_a_leaf_is_read_from_the_telegram():
    assert SIZED.parse(b"3abc") == Note(value="abc")
    assert SIZED.build(Note(value="abc")) == b"3abc"
    assert SIZED.parse(b"0") == Note(value="")


def test_unreadable_size_is_a_length_error():
    with pytest.raises(TelegramError) as caught:
        SIZED.parse(b"xabc")
    assert caught.value.category == "length"


def test_size_computed_from_an_unreadable_field_is_a_length_error():
    computed = form(
        "length" / decimal_number(1),
        "value" / characters(this.length - 1),
    )
    assert computed.parse(b"3ab") == Note(value="ab")
    # `None - 1` must not leave the schema as a TypeError.
    with pytest.raises(TelegramError) as caught:
        computed.parse(b"xab")
    assert caught.value.category == "length"


def test_negative_size_is_a_length_error():
    computed = form(
        "length" / decimal_number(1),
        "value" / characters(this.length - 3),
    )
    assert computed.parse(b"4a") == Note(value="a")
    # Reading a stream with a negative size would return all that is left.
    with pytest.raises(TelegramError) as caught:
        computed.parse(b"1abc")
    assert caught.value.category == "length"


def test_negative_size_before_another_leaf_is_a_length_error():
    computed = form(
        "length" / decimal_number(1),
        "value" / characters(this.length - 3),
        "other" / characters(2),
    )
    assert computed.parse(b"3ab") == Note(value="", other="ab")
    with pytest.raises(TelegramError) as caught:
        computed.parse(b"2a")
    assert caught.value.category == "length"


def test_error_reports_the_most_severe_fault():
    checked = form(
        constant(b"<"), "value" / hex_number(2), "other" / characters(2), Check(2, 1, hex_sum), constant(b">")
    )
    good = checked.build(Note(value=0x1F, other="ab"))
    assert checked.parse(good) == Note(value=0x1F, other="ab")

    def category(data):
        with pytest.raises(TelegramError) as caught:
            checked.parse(data)
        return caught.value.category

    assert category(good.replace(b"1F", b"1f")) == "checksum"
    assert category(b"[" + good[1:]) == "framing"
    assert category(b"[" + good[1:].replace(b"1F", b"1f")) == "framing"
    assert category(good[:-1].replace(b"1F", b"1f") + b"]") == "framing"
    assert category(good[:-1]) == "length"
    assert category(b"[" + good[1:-1]) == "framing"
    assert category(good[:-2] + b"]") == "length"
    sound = checked.build(Note(value=0x1F, other="ab"))[1:5].replace(b"1F", b"1f")
    assert category(b"<" + sound + hex_sum(sound) + b">") == "field"


def test_error_names_telegram_and_field():
    error = refusal(hex_number(2), b"zz")
    assert str(error).startswith("note telegram, value: ")
    assert error.field == "value"
    assert str(refusal(constant(b"a"), b"b")).startswith("note telegram, value: ")
    with pytest.raises(TelegramError, match=r"^note telegram: 61"):
        form(constant(b"a")).parse(b"b")


def test_rejection_by_a_read_function_is_a_field_error():
    def up_to_five(value):
        if value > 5:
            raise ValueError("more than five")
        return value

    picky = form("value" / decimal_number(1), reads={"value": up_to_five})
    assert picky.parse(b"5") == Note(value=5)
    with pytest.raises(TelegramError, match="more than five") as caught:
        picky.parse(b"6")
    assert caught.value.category == "field"


def test_leaf_without_a_field_of_the_message_is_ignored():
    assert form("value" / decimal_number(1), "colour" / decimal_number(1)).parse(b"12") == Note(value=1)


def test_form_describes_its_leaves():
    described = form(
        constant(b"\x02", "STX"), "value" / hex_number(4, "the value"), Check(1, 0, xor_byte, meaning="BCC")
    ).describe()
    assert described == [("", "1", "STX"), ("value", "4", "the value"), ("", "1", "BCC")]
    assert SIZED.describe()[1] == ("value", "n", "")
    assert form(constant(b"\x02\x03"), filler(b" ")).describe() == [("", "2", "02 03"), ("", "1", "not looked at")]


def test_form_has_the_size_of_its_telegram():
    assert form(constant(b"\x02"), "value" / hex_number(4), Check(1, 0, xor_byte)).size == 6
    assert SIZED.size == 0


def test_unsure_leaf_reads_malformed_bytes_as_none():
    doubtful = one(unsure(hex_number(2), "a code, if any"))
    assert [doubtful.parse(data).value for data in (b"4E", b"  ", b"4e")] == [0x4E, None, None]
    assert [doubtful.build(Note(value=value)) for value in (0x4E, None)] == [b"4E", b"  "]
    assert doubtful.describe() == [("value", "2", "a code, if any")]
    assert one(unsure(hex_number(2, "a code"))).describe() == [("value", "2", "a code")]
    with pytest.raises(TelegramError, match="not allowed"):
        doubtful.build(Note(value=256))


def test_custom_leaf_reads_and_refuses():
    def read(data):
        if data == b"?":
            raise ValueError("a question")
        return data

    own = one(Leaf(1, read, lambda value: value, category="framing", meaning="anything but ?"))
    assert own.parse(b"!") == Note(value=b"!")
    with pytest.raises(TelegramError, match="a question") as caught:
        own.parse(b"?")
    assert caught.value.category == "framing"
    assert own.size == 1


@pytest.mark.parametrize("digits", [b"", b"0", b"FF", b"0123456789ABCDEF"])
def test_hex_value_reads_any_number_of_digits_but_not_zero(digits):
    if digits:
        assert hex_value(digits) == int(digits, 16)
    else:
        with pytest.raises(ValueError, match="invalid literal"):
            hex_value(digits)


def test_form_keeps_no_state_between_telegrams():
    first = SIZED.parse(b"3abc")
    assert SIZED.parse(b"2xy") == replace(first, value="xy")
    assert SIZED.parse(b"3abc") == first


PAIR = Leaf(2, lambda found: (found[:1], found[1:]), lambda pair: pair[0] + pair[1])


def test_fields_are_computed_from_leaves_and_back():
    paired = form(
        "both" / PAIR, reads={"value other": lambda both: both}, writes={"both": lambda note: (note.value, note.other)}
    )
    assert paired.parse(b"ab") == paired.parse_declared(b"ab") == Note(value=b"a", other=b"b")
    assert paired.build(Note(value=b"c", other=b"d")) == b"cd"
    split = form(
        "first" / decimal_number(1),
        "second" / decimal_number(1),
        reads={"value": lambda second, first: 10 * first + second},
        writes={"first second": lambda note: divmod(note.value, 10)},
    )
    assert split.parse(b"47") == split.parse_declared(b"47") == Note(value=47)
    assert split.build(Note(value=47)) == split.build_declared(Note(value=47)) == b"47"


def test_check_of_a_form_may_refuse_a_message_before_it_is_built():
    def refuse_seven(note):
        if note.value == 7:
            raise TelegramError("field", "not seven", field="value")

    picky = form("value" / decimal_number(1), check=refuse_seven)
    assert picky.build(Note(value=6)) == b"6"
    with pytest.raises(TelegramError, match="not seven"):
        picky.build(Note(value=7))


LEAVES = [
    constant(b"\x02"),
    choice({b"A": "on", b"B": "off"}),
    choice({b"AA": 1, b"BB": 2}),
    decimal_number(1),
    decimal_number(2, range(1, 100)),
    decimal_number(3),
    decimal_number(4, range(5)),
    hex_number(1),
    hex_number(2),
    hex_number(3),
    hex_number(4),
    shifted_character(0x40, range(1, 31)),
    characters(1),
    characters(2),
    characters(2, lowest=0, highest=255),
    unsigned(1),
    unsigned(2),
    unsigned(3),
    unsigned(4),
    signed(1),
    signed(2),
    signed(8),
    signed(2, allowed=range(-5, 300)),
    signed(3, allowed=range(-5, 300)),
    unsigned(1, allowed={1, 65}),
    hex_number(1, allowed={2}),
    hex_number(3, allowed=range(256)),
    filler(b"  "),
    Leaf(1, lambda found: found, lambda value: value),
    Leaf(2, int, lambda value: b"%02d" % value),
    Check(1, 0, xor_byte),
    Check(2, 0, hex_sum, off=b"??"),
]
ODD = [
    None,
    True,
    False,
    1.0,
    -1,
    0,
    1,
    2,
    255,
    256,
    65536,
    1 << 70,
    "",
    "a",
    "on",
    "ab",
    "ä",
    "\u2126",
    b"a",
    b"ab",
    [],
    (),
]


def outcome(function, given):
    try:
        return function(given)
    except Exception:  # noqa: BLE001 - any exception counts as a refusal
        return "refused"


@pytest.mark.parametrize("leaf", LEAVES, ids=lambda leaf: f"{leaf.size}-{leaf.meaning}")
def test_compiled_leaf_behaves_as_the_declared_leaf(leaf):
    declared = one(leaf)
    assert declared.parse_compiled != declared.parse_declared
    assert declared.build_compiled != declared.build_declared
    ends = b"0", b"9A", b"F0", b"?? ", b"\xff\x80", b"-_+"
    for first in range(256):
        for end in ends:
            data = (bytes([first]) + end * leaf.size)[: leaf.size]
            for each in (data, data[::-1], data[:-1], data + b"0"):
                read = outcome(declared.parse_compiled, each)
                expected = outcome(declared.parse_declared, each)
                assert (read, type(read)) == (expected, type(expected))
                if read != "refused":
                    assert repr(read) == repr(expected)
    for value in ODD:
        written = outcome(declared.build_compiled, Note(value=value))
        # Compiled code may refuse a value that the declared leaf writes.
        assert written in ("refused", outcome(declared.build_declared, Note(value=value)))
        assert outcome(declared.build, Note(value=value)) == outcome(declared.build_declared, Note(value=value))


def test_form_with_a_leaf_that_cannot_be_compiled_is_interpreted():
    interpreted = one(characters(lambda _: 2))
    assert interpreted.parse_compiled == interpreted.parse_declared
    assert interpreted.build_compiled == interpreted.build_declared
    assert interpreted.parse(b"ab") == Note(value="ab")


@dataclass(frozen=True, slots=True, kw_only=True)
class Slotted:
    kind: ClassVar[str] = "slotted"
    value: int
    other: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubting(Slotted):
    def __post_init__(self):
        if self.value > 5:
            raise ValueError("more than five")


def test_parsed_message_equals_one_by_its_constructor():
    read = Form(Slotted, "value" / decimal_number(1)).parse(b"7")
    assert (read, hash(read), repr(read)) == (Slotted(value=7), hash(Slotted(value=7)), repr(Slotted(value=7)))
    assert Form(Doubting, "value" / decimal_number(1)).parse(b"5") == Doubting(value=5)
    with pytest.raises(TelegramError, match="more than five"):
        Form(Doubting, "value" / decimal_number(1)).parse(b"6")
