"""Modbus in ASCII and over TCP: the limits of telegrams, and the matching of replies to requests."""

import socket
import threading
from contextlib import contextmanager

import pytest

import drivecomm
from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, installed
from drivecomm.virtual import VirtualLine, virtual_drive

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


def test_ascii_telegram_is_found_after_a_cut_one():
    whole = codec("ascii").encode(reading())
    finds = Framer(codec("ascii"), "request").feed(whole[:9] + whole)
    assert [find.data for find in finds if isinstance(find, Framed)] == [whole]


@pytest.mark.parametrize("bit", range(8))
def test_ascii_detects_each_single_bit_error(bit):
    whole = codec("ascii").encode(reading())
    for place in range(len(whole)):
        changed = bytearray(whole)
        changed[place] ^= 1 << bit
        with pytest.raises(TelegramError):
            codec("ascii").decode(bytes(changed), "request")


def test_tcp_reply_to_another_transaction_does_not_match():
    first, second = reading(start=0x2100), reading(start=0x2103)
    assert PLUGIN.mismatch(first, reply_to(first)) == ""
    assert PLUGIN.mismatch(second, reply_to(first)) == "transaction"


def test_tcp_reply_repeats_the_transaction_of_its_request():
    asked = reading(transaction=7)
    assert reply_to(asked).transaction == 7
    assert reply_to(reading(transaction=8, start=0x7777)).exception == 2
    assert reply_to(reading(transaction=8, start=0x7777)).transaction == 8


def test_tcp_reply_without_a_transaction_is_not_encoded():
    reply = PLUGIN.message({"address": 1, "function": 3, "values": [1]}, "reply")
    with pytest.raises(TelegramError, match="transaction"):
        codec("tcp").encode(reply)


def test_ascii_drive_is_found_by_a_scan_with_its_framing():
    line = VirtualLine([virtual_drive("modbus", 5, model="delta", framing="ascii", bytesize=7, parity="E")])
    with drivecomm.open_bus(line.port, bytesize=7, parity="E") as bus:
        assert not list(bus.scan(["modbus"], [5]))
        assert [found.address for found in bus.scan(["modbus,framing=ascii"], [5])] == [5]


def test_ascii_drives_share_a_line():
    drives = [virtual_drive("modbus", each, model="delta", framing="ascii") for each in (1, 2, 3)]
    with drivecomm.open_bus(VirtualLine(drives).port) as bus:
        fans = [bus.drive("modbus", each, model="delta", framing="ascii") for each in (1, 2, 3)]
        for number, fan in enumerate(fans, start=1):
            fan.set_reference(hz=10 * number)
            fan.start()
        assert [each.motor.target_hz for each in drives] == [10.0, 20.0, 30.0]
        fans[1].stop()
        assert [each.motor.target_hz for each in drives] == [10.0, 0.0, 30.0]


@contextmanager
def gateway(answer):
    """Yield the address of a gateway that answers one request and waits for the end of the connection."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve():
            connection, _ = listening.accept()
            with connection:
                connection.sendall(answer(connection.recv(260)))
                connection.recv(1)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"modbus-tcp://127.0.0.1:{listening.getsockname()[1]}"
        thread.join(5)


def holding(value):
    return lambda asked: asked[:4] + bytes([0, 5, asked[6], 3, 2, 0, value])


def to_another_first(asked):
    other = bytes([asked[0] ^ 1]) + holding(66)(asked)[1:]
    return other + holding(7)(asked)


def test_tcp_reply_of_a_gateway_to_another_transaction_is_ignored():
    with gateway(to_another_first) as port, drivecomm.open_bus(port) as bus:
        assert bus.drive("modbus", 1).read("0x2100").value == 7
