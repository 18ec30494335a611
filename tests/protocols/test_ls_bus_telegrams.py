"""LS bus telegrams: the shared vectors, and cases that could mislead a decoder."""

import tomllib
from importlib import resources

import pytest

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, Noise, fields_of
from drivecomm_ls_bus.telegrams import CODEC, COUNTS, Data

VECTORS = tomllib.loads((resources.files("drivecomm_ls_bus") / "vectors.toml").read_text())
BY_ID = {each["id"]: each for each in VECTORS["vector"]}


@pytest.mark.parametrize("name", [name for name, each in BY_ID.items() if each["valid"]])
def test_vector_is_decoded_and_encoded(name):
    vector, data = BY_ID[name], bytes.fromhex(BY_ID[name]["hex"])
    direction = vector["direction"]
    assert fields_of(CODEC.decode(data, direction)) == vector["fields"]
    assert CODEC.encode(CODEC.message(vector["fields"], direction)) == data
    assert CODEC.measure(data, direction) == len(data)


@pytest.mark.parametrize("name", [name for name, each in BY_ID.items() if not each["valid"]])
def test_invalid_vector_is_refused_with_its_error_category(name):
    vector = BY_ID[name]
    with pytest.raises(TelegramError) as refusal:
        CODEC.decode(bytes.fromhex(vector["hex"]), vector["direction"])
    assert refusal.value.category == vector["error"]


@pytest.mark.parametrize("refused", VECTORS["refuse"], ids=lambda each: each["id"])
def test_request_that_no_drive_accepts_is_not_encoded(refused):
    with pytest.raises(TelegramError):
        CODEC.encode(CODEC.message(refused["fields"], refused["direction"]))


@pytest.mark.parametrize("count", COUNTS)
def test_number_of_words_in_a_reply_follows_from_its_end(count):
    message = Data(address=1, values=tuple(range(count)))
    data = CODEC.encode(message)
    assert len(data) == 7 + 4 * count
    assert CODEC.decode(data, "reply") == message


def test_replies_are_framed_in_a_stream():
    stream = VECTORS["stream"][0]
    found = Framer(CODEC, "reply").feed(bytes.fromhex(stream["hex"]))
    assert [each.data.hex(" ") for each in found if isinstance(each, Framed)] == [
        each.lower() for each in stream["frames"]
    ]


@pytest.mark.parametrize("data", ["05 04 30 30", "05 30 31 04 30 04", "05 30 31 52 33 04 05 30 31 59 42 41 04"])
def test_framer_finds_the_same_byte_by_byte_as_in_one_piece(data):
    """The first piece of data is the end of a VABus enquiry and the beginning of the next one."""
    stream = bytes.fromhex(data)
    whole, pieces = Framer(CODEC, "request"), Framer(CODEC, "request")
    found = [each for byte in stream for each in pieces.feed(bytes([byte]))]
    assert [(type(each), each.data) for each in found if not isinstance(each, Noise)] == [
        (type(each), each.data) for each in whole.feed(stream) if not isinstance(each, Noise)
    ]
