"""Modbus in ASCII and over TCP: where telegrams begin and end, and which reply belongs to which request."""

import pytest

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, installed
from drivecomm.virtual import virtual_drive

PLUGIN = installed["modbus"]


def codec(framing):
    return PLUGIN.codec(PLUGIN.options(framing=framing))


def reading(**fields):
    return PLUGIN.message({"address": 1, "function": 3, "start": 0x2100, "count": 2, **fields}, "request")


def reply_to(request, model="delta"):
    drive = virtual_drive("modbus", 1, model=model, framing="tcp")
    data = drive.codec.encode(request)
    said = drive.hear(Framed(data, drive.codec.decode(data, "request")), 1.0)
    return codec("tcp").decode(said.data, "reply")


def test_ascii_ends_with_the_lrc_of_all_bytes():
    assert codec("ascii").encode(reading(count=4)) == b":010321000004D7\r\n"


def test_ascii_is_found_behind_a_telegram_that_broke_off():
    whole = codec("ascii").encode(reading())
    finds = Framer(codec("ascii"), "request").feed(whole[:9] + whole)
    assert [find.data for find in finds if isinstance(find, Framed)] == [whole]


@pytest.mark.parametrize("bit", range(8))
def test_ascii_notices_each_wrong_bit(bit):
    whole = codec("ascii").encode(reading())
    for place in range(len(whole)):
        changed = bytearray(whole)
        changed[place] ^= 1 << bit
        with pytest.raises(TelegramError):
            codec("ascii").decode(bytes(changed), "request")


def test_tcp_believes_no_reply_to_another_transaction():
    first, second = reading(start=0x2100), reading(start=0x2103)
    assert PLUGIN.mismatch(first, reply_to(first)) == ""
    assert PLUGIN.mismatch(second, reply_to(first)) == "transaction"


def test_tcp_repeats_the_transaction_of_a_foreign_master():
    asked = reading(transaction=7)
    assert reply_to(asked).transaction == 7
    assert reply_to(reading(transaction=8, start=0x7777)).exception == 2
    assert reply_to(reading(transaction=8, start=0x7777)).transaction == 8


def test_tcp_writes_no_reply_without_a_transaction():
    reply = PLUGIN.message({"address": 1, "function": 3, "values": [1]}, "reply")
    with pytest.raises(TelegramError, match="transaction"):
        codec("tcp").encode(reply)
