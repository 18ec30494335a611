"""LS bus telegrams: the shared vectors, and what a decoder could be misled to."""

import tomllib
from importlib import resources

import pytest

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer
from drivecomm_ls_bus.telegrams import CODEC, COUNTS, Data

VECTORS = tomllib.loads((resources.files("drivecomm_ls_bus") / "vectors.toml").read_text())
BY_ID = {each["id"]: each for each in VECTORS["vector"]}


def fields(vector):
    return {name: tuple(value) if isinstance(value, list) else value for name, value in vector["fields"].items()}


@pytest.mark.parametrize("name", [name for name, each in BY_ID.items() if each["valid"]])
def test_telegram_is_read_and_written_as_its_vector_says(name):
    vector, data = BY_ID[name], bytes.fromhex(BY_ID[name]["hex"])
    direction, expected = vector["direction"], fields(vector)
    message = CODEC.decode(data, direction)
    assert {each: getattr(message, each) for each in expected} == expected
    assert CODEC.encode(CODEC.message(expected, direction)) == data
    assert CODEC.measure(data, direction) == len(data)


@pytest.mark.parametrize("name", [name for name, each in BY_ID.items() if not each["valid"]])
def test_wrong_telegram_is_refused(name):
    vector = BY_ID[name]
    with pytest.raises(TelegramError) as refusal:
        CODEC.decode(bytes.fromhex(vector["hex"]), vector["direction"])
    assert refusal.value.category == vector["error"]


@pytest.mark.parametrize("refused", VECTORS["refuse"], ids=lambda each: each["id"])
def test_request_is_not_written_when_no_drive_takes_it(refused):
    with pytest.raises(TelegramError):
        CODEC.encode(CODEC.message(fields(refused), refused["direction"]))


@pytest.mark.parametrize("count", COUNTS)
def test_end_alone_tells_how_many_words_a_reply_has(count):
    message = Data(station=1, values=tuple(range(count)))
    data = CODEC.encode(message)
    assert len(data) == 7 + 4 * count
    assert CODEC.decode(data, "reply") == message


def test_replies_are_found_in_a_stream():
    stream = VECTORS["stream"][0]
    found = Framer(CODEC, "reply").feed(bytes.fromhex(stream["hex"]))
    assert [each.data.hex(" ") for each in found if isinstance(each, Framed)] == [
        each.lower() for each in stream["frames"]
    ]
