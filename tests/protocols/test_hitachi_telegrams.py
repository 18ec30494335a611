"""Telegrams of Hitachi's ASCII protocol: printed examples, misprints of the manuals, and the end of a telegram."""

from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import TelegramError
from drivecomm.protocol import Damaged, Framed, Framer, fields_of, installed

HITACHI = installed["hitachi"]
CODEC = HITACHI.codec(HITACHI.options())
PARAMETERS = st.from_regex(r"[A-CFHPUb][0-9]{3}", fullmatch=True)
NODES = st.integers(1, 32)


def request(**fields):
    return HITACHI.message(fields, "request")


def reply(**fields):
    return HITACHI.message(fields, "reply")


@pytest.mark.parametrize(
    ("printed", "fields"),
    [
        ("02 30 31 30 30 31 33 30 0D", {"kind": "run", "node": 1, "value": 1}),
        ("02 30 31 30 31 30 30 30 35 30 30 30 35 0D", {"kind": "frequency", "node": 1, "value": 500}),
    ],
)
def test_printed_example_is_read_and_written(printed, fields):
    """SJ300 manual NB613X, p. B-6."""
    data = bytes.fromhex(printed)
    message = CODEC.decode(data, "request")
    assert fields.items() <= fields_of(message).items()
    assert CODEC.encode(request(**fields)) == data


def test_misprinted_example_of_terminals_is_refused():
    """SJ300 manual, p. B-8: command, last digit and sum are wrong; the telegram is meant to be 02 with 0D."""
    printed = bytes.fromhex("02 30 31 30 31 30 30 30 30 30 30 30 30 30 30 30 30 30 30 30 68 30 35 0D")
    with pytest.raises(TelegramError):
        CODEC.decode(printed, "request")
    assert CODEC.encode(request(kind="terminals", node=1, value=0xD)) == b"\x020102000000000000000D77\r"


@pytest.mark.parametrize("kind", ["monitor", "status", "history", "check", "store"])
def test_broadcast_of_a_request_that_needs_a_reply_is_refused(kind):
    with pytest.raises(TelegramError):
        CODEC.encode(request(kind=kind, node=255))


def test_factory_reset_is_decoded_and_never_encoded():
    message = CODEC.decode(b"\x02010809\r", "request")
    assert message.kind == "initialise"
    assert not HITACHI.intent(message).moves_nothing
    with pytest.raises(TelegramError):
        CODEC.encode(message)


@given(node=NODES, parameter=PARAMETERS, value=st.integers(0, 10**8 - 1))
def test_write_telegram_is_decoded_as_encoded(node, parameter, value):
    message = request(kind="write", node=node, parameter=parameter, value=value)
    assert CODEC.decode(CODEC.encode(message), "request") == message


@given(node=NODES, image=st.integers(0, 2**64 - 1), kind=st.sampled_from(["terminals", "further_terminals"]))
def test_terminal_image_is_decoded_as_encoded(node, image, kind):
    message = request(kind=kind, node=node, value=image)
    assert CODEC.decode(CODEC.encode(message), "request") == message


@given(node=NODES, digits=st.sampled_from([8, 104, 440]), seed=st.randoms(use_true_random=False))
def test_data_reply_is_decoded_as_encoded(node, digits, seed):
    message = reply(kind="data", node=node, data="".join(seed.choice("0123456789") for _ in range(digits)))
    assert CODEC.decode(CODEC.encode(message), "reply") == message


@pytest.mark.parametrize("kind", ["ack", "ack_data", "data", "nak", "bogus"])
def test_reply_without_its_data_is_refused(kind):
    if kind == "ack":
        assert CODEC.encode(reply(kind=kind, node=1)) == b"\x0201\x0607\r"
        return
    with pytest.raises(TelegramError):
        CODEC.encode(reply(kind=kind, node=1))


def test_reply_matches_its_request_by_length_and_node_only():
    """No reply names its request: a reply to 06 matches any other request 06, and no other command."""
    value = reply(kind="ack_data", node=1, data="00000003")
    kinds = {
        kind: HITACHI.mismatch(request(kind=kind, node=1), value)
        for kind in ("run", "monitor", "status", "history", "check", "store")
    }
    assert set(kinds.values()) == {"length"}
    for parameter in ("A001", "F002"):
        assert not HITACHI.mismatch(request(kind="read", node=1, parameter=parameter), value)
    assert HITACHI.mismatch(request(kind="read", node=2, parameter="A001"), value) == "node"


def test_address_of_a_message_is_its_node():
    message = request(kind="run", node=3, value=0)
    assert message.address == 3
    assert replace(message, address=4).node == 4


def test_carriage_return_ends_an_overheard_telegram():
    """A status reply of another drive starts like command 02, which is longer; the next request must still be found."""
    framer = Framer(CODEC, "request")
    overheard, own = b"\x020102000000" + b"03\r", b"\x02020406\r"
    found = framer.feed(overheard + own)
    assert [type(each) for each in found if not hasattr(each, "data") or each.data == own] == [Framed]
    assert isinstance(found[0], Damaged)
