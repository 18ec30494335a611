"""The framer alone, with a simple telegram form: `<`, one digit n, n letters."""

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import pytest
from extents import extents
from hypothesis import HealthCheck, given, settings, strategies as st

from drivecomm.errors import TelegramError
from drivecomm.protocol import Damaged, Framed, Framer, Noise, installed
from drivecomm.testing import near_telegrams, pieces


@dataclass(frozen=True)
class Word:
    kind: ClassVar[str] = "word"
    text: str


class Letters:
    """Codec of `<3abc`; a lone `<` is a telegram too if nothing follows; capital letters are damage."""

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


def test_whole_telegram_is_framed(framer):
    assert framer.feed(b"<3abc") == [Framed(b"<3abc", Word("abc"))]
    assert framer.missing == 1


def test_missing_counts_the_bytes_until_the_telegram_is_whole(framer):
    assert framer.missing == 1
    assert framer.feed(b"") == []
    assert framer.missing == 1
    assert framer.feed(b"<") == []
    assert framer.missing == 1
    assert framer.begun
    assert framer.feed(b"4") == []
    assert framer.missing == 4
    assert framer.feed(b"abc") == []
    assert framer.missing == 1
    assert shape(framer.feed(b"d")) == [("Framed", b"<4abcd")]
    assert not framer.begun


def test_cut_telegram_consumes_bytes_of_the_next_one(framer):
    assert framer.feed(b"<4ab") == []
    assert shape(framer.feed(b"<1a")) == [("Framed", b"<4ab<1"), ("Noise", b"a")]


def test_noise_around_telegrams_is_returned_in_order(framer):
    found = framer.feed(b"xy<1az<2bc!")
    assert shape(found) == [
        ("Noise", b"xy"),
        ("Framed", b"<1a"),
        ("Noise", b"z"),
        ("Framed", b"<2bc"),
        ("Noise", b"!"),
    ]


def test_search_resumes_after_the_first_byte_of_a_damaged_telegram(framer):
    found = framer.feed(b"<4AB<1a")
    assert shape(found) == [("Damaged", b"<4AB<1"), ("Noise", b"<4AB"), ("Framed", b"<1a")]
    assert found[0].error.category == "field"


def test_damage_after_noise_is_returned_in_order(framer):
    assert shape(framer.feed(b"x<1A")) == [("Noise", b"x"), ("Damaged", b"<1A"), ("Noise", b"<1A")]


def test_flush_ends_a_telegram_that_could_be_longer(framer):
    assert framer.feed(b"<") == []
    assert framer.flush() == [Framed(b"<", Word(""))]
    assert framer.flush() == []


def test_flush_reports_a_cut_telegram_as_damaged(framer):
    assert framer.feed(b"<5abc") == []
    assert shape(framer.flush()) == [("Damaged", b"<5abc"), ("Noise", b"<5abc")]
    assert framer.missing == 1
    assert shape(framer.feed(b"<1a")) == [("Framed", b"<1a")]


def test_flush_finds_a_whole_telegram_inside_a_cut_one(framer):
    assert framer.feed(b"<9<1a") == []
    assert shape(framer.flush()) == [("Damaged", b"<9<1a"), ("Noise", b"<9"), ("Framed", b"<1a")]


class Capricious(Letters):
    """A codec that rejects every telegram."""

    def decode(self, *_):
        raise TelegramError("checksum", "never")


def test_flushed_single_byte_is_noise_and_not_damage():
    framer = Framer(Capricious(), "reply")
    assert framer.feed(b"<") == []
    assert framer.flush() == [Noise(b"<")]


def test_rejected_telegram_of_one_byte_is_damaged():
    framer = Framer(Capricious(), "reply")
    assert shape(framer.feed(b"<x")) == [("Damaged", b"<"), ("Noise", b"<x")]


def test_endless_garbage_is_not_buffered():
    framer = Framer(Letters(), "reply")
    for _ in range(1000):
        assert framer.feed(b"?" * 100) == [Noise(b"?" * 100)]
    assert framer.missing == 1
    false_starts = Framer(Capricious(), "reply")
    for _ in range(1000):
        false_starts.feed(b"<9aaaa")
    assert sum(len(find.data) for find in false_starts.flush() if isinstance(find, Noise)) <= 11


def test_exception_of_the_codec_passes_through_the_framer():
    class Broken(Letters):
        def decode(self, *_):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        Framer(Broken(), "reply").feed(b"<1a")


def test_damaged_find_holds_the_telegram_error(framer):
    (damaged, noise) = framer.feed(b"<1A")
    assert isinstance(damaged, Damaged)
    assert str(damaged.error) == "no small letters"
    assert noise == Noise(b"<1A")


class ByTheByte:
    """A reference framer in the simplest form: it advances byte by byte and measures everything again each time."""

    def __init__(self, codec, direction):
        self.codec, self.direction, self.pending = codec, direction, b""

    def feed(self, data):
        self.pending += data
        return list(self.search(final=False))

    def flush(self):
        return list(self.search(final=True))

    @property
    def missing(self):
        return self.codec.measure(self.pending, self.direction) - len(self.pending)

    def search(self, *, final):
        noise = b""
        while self.pending:
            needed = self.codec.measure(self.pending, self.direction)
            cut = needed > len(self.pending)
            if cut and not final:
                break
            found = self.read(self.pending if cut else self.pending[:needed]) if needed else None
            if cut and isinstance(found, Damaged) and len(self.pending) == 1:
                found = None
            if noise and found is not None:
                yield Noise(noise)
                noise = b""
            if found is not None:
                yield found
            taken = len(found.data) if isinstance(found, Framed) else 1
            if not isinstance(found, Framed):
                noise += self.pending[:1]
            self.pending = self.pending[taken:]
        if noise:
            yield Noise(noise)

    def read(self, data):
        try:
            return Framed(data, self.codec.decode(data, self.direction))
        except TelegramError as error:
            return Damaged(data, error)


def told(found):
    return [(type(find).__name__, find.data, str(getattr(find, "error", ""))) for find in found]


@lru_cache
def parts_for(name, direction):
    return near_telegrams(installed[name], direction)


UNHURRIED = settings(
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@pytest.mark.soak
@pytest.mark.parametrize("direction", ["request", "reply"])
@pytest.mark.parametrize("name", ["vabus", "danfoss-fc", "vlt3500", "fuji"])
@extents(15, 100)
def test_framer_finds_the_same_as_the_byte_by_byte_reference(name, direction, extent):
    plugin = installed[name]

    @settings(UNHURRIED, max_examples=extent)
    @given(data=st.data())
    def found_alike(data):
        stream = b"".join(data.draw(st.lists(parts_for(name, direction), max_size=4)))
        framer = Framer(plugin.codec(plugin.options()), direction)
        plain = ByTheByte(plugin.codec(plugin.options()), direction)
        for piece in data.draw(pieces(stream)):
            assert told(framer.feed(piece)) == told(plain.feed(piece))
            assert framer.missing == plain.missing
            if data.draw(st.booleans()):
                assert told(framer.flush()) == told(plain.flush())
        assert told(framer.flush()) == told(plain.flush())

    found_alike()


@pytest.mark.parametrize(
    ("name", "request_length", "reply_length"),
    [("vabus", 1, 2), ("danfoss-fc", 8, 8), ("vlt3500", 22, 22), ("fuji", 8, 8)],
)
def test_empty_framer_waits_for_the_shortest_telegram(name, request_length, reply_length):
    plugin = installed[name]
    codec = plugin.codec(plugin.options())
    for direction, length in (("request", request_length), ("reply", reply_length)):
        framer = Framer(codec, direction)
        assert framer.missing == length == codec.measure(b"", direction)
        framer.feed(b"\xaa")
        assert framer.missing == length


def test_telegram_longer_than_the_first_chunk_examined_is_framed():
    class Long(Letters):
        def measure(self, head, _):
            return 2 + 1000 if head[:1] == b"<" else 0

        def decode(self, data, _):
            return Word(data[2:].decode())

    telegram = b"<x" + b"a" * 1000
    assert shape(Framer(Long(), "reply").feed(b"!" + telegram + b"?")) == [
        ("Noise", b"!"),
        ("Framed", telegram),
        ("Noise", b"?"),
    ]


def test_length_field_beyond_the_first_chunk_examined_is_found():
    class Late(Letters):
        """A codec of 600 letters, a digit n, and n thousand further letters."""

        def measure(self, head, _):
            if head[:1] != b"<":
                return 0
            return 602 if len(head) < 602 else 602 + 1000 * int(head[601:602])

        def decode(self, data, _):
            return Word(data.decode())

    telegram = b"<" + b"a" * 600 + b"2" + b"a" * 2000
    assert shape(Framer(Late(), "reply").feed(b"!" + telegram + b"?")) == [
        ("Noise", b"!"),
        ("Framed", telegram),
        ("Noise", b"?"),
    ]


def test_telegram_of_chained_blocks_is_framed():
    class Chained(Letters):
        """A codec of blocks of 600 letters, each ending with a mark that says whether another block follows."""

        def measure(self, head, _):
            length = 601 if head[:1] == b"<" else 0
            while length and head[length - 1 : length] == b"+":
                length += 600
            return length

        def decode(self, data, _):
            return Word(data.decode())

    telegram = b"<" + (b"a" * 599 + b"+") * 3 + b"a" * 599 + b"."
    assert shape(Framer(Chained(), "reply").feed(b"!" + telegram + b"?")) == [
        ("Noise", b"!"),
        ("Framed", telegram),
        ("Noise", b"?"),
    ]


@pytest.mark.soak
def test_framing_time_of_noise_grows_linearly():
    def seconds(length):
        began = time.process_time()
        assert Framer(Letters(), "reply").feed(b"?" * length) == [Noise(b"?" * length)]
        return time.process_time() - began

    # Twenty times the noise; quadratic growth would take four hundred times as long.
    assert min(seconds(200_000) for _ in range(3)) < 100 * min(seconds(10_000) for _ in range(5))
