"""The framer alone, with a telegram form that is easy to see: `<`, one digit n, n letters."""

from dataclasses import dataclass
from typing import ClassVar

import pytest

from drivecomm.errors import TelegramError
from drivecomm.framing import Damaged, Framed, Framer, Noise


@dataclass(frozen=True)
class Word:
    kind: ClassVar[str] = "word"
    text: str


class Letters:
    """`<3abc`; `<` alone is a telegram too when nothing follows; capitals are damage."""

    def measure(self, head, direction):
        assert direction == "reply"
        if head[:1] != b"<":
            return 0
        if len(head) < 2:
            return 2
        return 2 + int(head[1:2]) if head[1:2].isdigit() else 1

    def decode(self, data, direction):
        assert direction == "reply"
        text = data[2:].decode("latin-1")
        if data == b"<":
            return Word("")
        if len(data) < 2 or len(text) != int(data[1:2]):
            raise TelegramError("length", "cut")
        if not text.islower():
            raise TelegramError("field", "no small letters")
        return Word(text)


@pytest.fixture
def framer():
    return Framer(Letters(), "reply")


def shape(found):
    return [(type(find).__name__, find.data) for find in found]


def test_a_whole_telegram(framer):
    assert framer.feed(b"<3abc") == [Framed(b"<3abc", Word("abc"))]
    assert framer.missing == 1


def test_a_telegram_in_pieces_says_how_much_is_missing(framer):
    assert framer.missing == 1
    assert framer.feed(b"") == []
    assert framer.missing == 1
    assert framer.feed(b"<") == []
    assert framer.missing == 1
    assert framer.feed(b"4") == []
    assert framer.missing == 4
    assert framer.feed(b"abc") == []
    assert framer.missing == 1
    assert shape(framer.feed(b"d")) == [("Framed", b"<4abcd")]


def test_noise_around_telegrams_is_handed_out_in_order(framer):
    found = framer.feed(b"xy<1az<2bc!")
    assert shape(found) == [
        ("Noise", b"xy"),
        ("Framed", b"<1a"),
        ("Noise", b"z"),
        ("Framed", b"<2bc"),
        ("Noise", b"!"),
    ]


def test_only_the_first_byte_of_a_damaged_telegram_is_dropped(framer):
    found = framer.feed(b"<4AB<1a")
    assert shape(found) == [("Damaged", b"<4AB<1"), ("Noise", b"<4AB"), ("Framed", b"<1a")]
    assert found[0].error.category == "field"


def test_damage_after_noise_comes_in_order(framer):
    assert shape(framer.feed(b"x<1A")) == [("Noise", b"x"), ("Damaged", b"<1A"), ("Noise", b"<1A")]


def test_a_gap_ends_a_telegram_that_could_have_been_longer(framer):
    assert framer.feed(b"<") == []
    assert framer.flush() == [Framed(b"<", Word(""))]
    assert framer.flush() == []


def test_a_gap_makes_damage_of_a_cut_telegram(framer):
    assert framer.feed(b"<5abc") == []
    assert shape(framer.flush()) == [("Damaged", b"<5abc"), ("Noise", b"<5abc")]
    assert framer.missing == 1
    assert shape(framer.feed(b"<1a")) == [("Framed", b"<1a")]


def test_a_gap_behind_a_cut_telegram_frees_the_whole_one_inside_it(framer):
    assert framer.feed(b"<9<1a") == []
    assert shape(framer.flush()) == [("Damaged", b"<9<1a"), ("Noise", b"<9"), ("Framed", b"<1a")]


class Capricious(Letters):
    """Nothing is ever sound."""

    def decode(self, *_):
        raise TelegramError("checksum", "never")


def test_a_single_byte_that_is_cut_off_is_noise_and_no_damage():
    framer = Framer(Capricious(), "reply")
    assert framer.feed(b"<") == []
    assert framer.flush() == [Noise(b"<")]


def test_a_shape_of_one_byte_that_is_no_telegram_is_damaged():
    framer = Framer(Capricious(), "reply")
    assert shape(framer.feed(b"<x")) == [("Damaged", b"<"), ("Noise", b"<x")]


def test_garbage_for_ever_does_not_pile_up():
    framer = Framer(Letters(), "reply")
    for _ in range(1000):
        assert framer.feed(b"?" * 100) == [Noise(b"?" * 100)]
    assert framer.missing == 1
    false_starts = Framer(Capricious(), "reply")
    for _ in range(1000):
        false_starts.feed(b"<9aaaa")
    assert sum(len(find.data) for find in false_starts.flush() if isinstance(find, Noise)) <= 11


def test_what_a_codec_raises_on_its_own_is_not_hidden():
    class Broken(Letters):
        def decode(self, *_):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        Framer(Broken(), "reply").feed(b"<1a")


def test_damaged_holds_what_was_wrong(framer):
    (damaged, noise) = framer.feed(b"<1A")
    assert isinstance(damaged, Damaged)
    assert str(damaged.error) == "no small letters"
    assert noise == Noise(b"<1A")
