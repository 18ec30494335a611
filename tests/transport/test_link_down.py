"""A port that disappears is noticed immediately, also during a wait, with any bytes held back."""

from __future__ import annotations

import select
import threading

import pytest
from peers import CrashingServer, Server, Terminal

from drivecomm.errors import LinkDownError
from drivecomm.protocol import LineSettings
from drivecomm.transport import SerialPort

LONG_S = 20.0
AT_ONCE_S = 2.0


@pytest.fixture(params=[Terminal, Server, CrashingServer], ids=["terminal", "socket", "reset"])
def line(request):
    made = request.param()
    made.port = SerialPort(made.url)
    made.port.configure(LineSettings())
    made.send(b"")
    yield made
    made.port.close()
    made.close()


def noticed_at_once(line, use):
    began = line.port.now()
    with pytest.raises(LinkDownError, match=r"was lost .*(unplugged|closed|broke)"):
        use()
    assert line.port.now() - began < AT_ONCE_S


@pytest.mark.parametrize("before", [b"", b"abc"], ids=["silence", "half a telegram"])
def test_lost_port_is_noticed_during_a_wait(line, before):
    line.send(before)
    timer = threading.Timer(0.05, line.end)
    timer.start()
    noticed_at_once(line, lambda: line.port.read(line.port.now() + LONG_S, 14))
    timer.join()


def test_lost_port_is_noticed_before_a_wait(line):
    line.end()
    noticed_at_once(line, lambda: line.port.read(line.port.now() + LONG_S, 14))


def test_lost_port_is_noticed_when_stale_bytes_are_read(line):
    line.end()
    select.select([line.port.descriptor], [], [], AT_ONCE_S)
    noticed_at_once(line, lambda: line.port.read(0.0, 1))


def test_lost_port_is_noticed_when_bytes_are_taken(line):
    line.port.hold_back(14)
    line.end()
    assert select.select([line.port.descriptor], [], [], AT_ONCE_S)[0]
    noticed_at_once(line, line.port.take)


def test_lost_port_is_noticed_after_a_change_of_the_held_number(line):
    """A socket may miss the loss at the change, but the next read notices it."""
    line.end()
    select.select([line.port.descriptor], [], [], AT_ONCE_S)

    def hold_and_take():
        line.port.hold_back(200)
        line.port.take()

    noticed_at_once(line, hold_and_take)


def test_lost_port_is_noticed_after_a_telegram_is_sent(line):
    line.end()

    def send_and_wait():
        line.port.write(b"x" * 14)
        line.port.read(line.port.now() + LONG_S, 14)

    noticed_at_once(line, send_and_wait)


def test_lost_port_is_noticed_during_traffic(line):
    """Telegrams arrive until the end, and the next read raises the error."""

    def speak():
        for _ in range(30):
            line.send(b"x" * 14)
            threading.Event().wait(0.001)
        line.end()

    thread = threading.Thread(target=speak)
    thread.start()

    def listen():
        while True:
            assert set(line.port.read(line.port.now() + LONG_S, 14)) == set(b"x")

    noticed_at_once(line, listen)
    thread.join()
