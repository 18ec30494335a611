"""Bytes are held back until a whole telegram has arrived, and are never lost after any earlier holding back."""

from __future__ import annotations

import array
import fcntl
import os
import select
import socket
import sys
import termios
import threading
import time

import pytest
from peers import Server, Terminal

from drivecomm.protocol import LineSettings
from drivecomm.transport import SerialPort, SocketChannel, tty_channel

linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds bytes back")


@pytest.fixture(params=[Terminal, Server], ids=["terminal", "socket"])
def peer(request):
    made = request.param()
    yield made
    made.close()


@pytest.fixture
def port(peer):
    opened = SerialPort(peer.url)
    if isinstance(peer, Terminal):
        # Force holding back, which a slow machine would switch off.
        opened._channel._holds_back = sys.platform == "linux"
    opened.configure(LineSettings())
    peer.send(b"")
    yield opened
    opened.close()


def readable(port, wait_s=0.05):
    return bool(select.select([port.descriptor], [], [], wait_s)[0])


@linux
class TestHoldingBack:
    def test_descriptor_wakes_for_the_requested_number_of_bytes(self, port, peer):
        port.hold_back(5)
        peer.send(b"abc")
        assert not readable(port)
        peer.send(b"de")
        assert readable(port, 1)
        assert port.take() == b"abcde"
        assert not readable(port)

    def test_bytes_already_there_count_when_more_are_requested(self, port, peer):
        peer.send(b"abc")
        assert readable(port, 1)
        port.hold_back(5)
        assert not readable(port)
        peer.send(b"de")
        assert readable(port, 1)
        assert port.take() == b"abcde"

    def test_bytes_already_there_count_when_fewer_are_requested(self, port, peer):
        port.hold_back(5)
        peer.send(b"abc")
        assert not readable(port)
        port.hold_back(3)
        assert readable(port, 1)
        assert port.take() == b"abc"

    def test_epoll_loop_wakes_when_fewer_bytes_are_requested(self, port, peer):
        with select.epoll() as loop:
            loop.register(port.descriptor, select.EPOLLIN)
            port.hold_back(5)
            peer.send(b"abc")
            assert loop.poll(0.05) == []
            port.hold_back(3)
            assert [descriptor for descriptor, _ in loop.poll(1)] == [port.descriptor]

    def test_bytes_held_back_can_be_taken(self, port, peer):
        port.hold_back(200)
        peer.send(b"abc")
        assert not readable(port)
        assert port.take() == b"abc"
        assert port.take() == b""

    def test_bytes_held_back_are_read_as_stale_at_the_next_exchange(self, port, peer):
        port.hold_back(200)
        peer.send(b"abc")
        assert not readable(port)
        assert port.read(0.0, 1) == b"abc"
        assert port.read(0.0, 1) == b""

    def test_read_returns_more_bytes_than_can_be_held_back(self, port, peer):
        whole = bytes(range(256)) * 4
        thread = threading.Thread(target=lambda: [peer.send(whole[at : at + 100]) for at in range(0, 1024, 100)])
        thread.start()
        assert port.read(port.now() + 5, 1024) == whole
        thread.join()

    def test_read_returns_more_bytes_than_can_be_held_back_in_pieces(self, port, peer):
        def speak():
            for _ in range(4):
                peer.send(b"x" * 256)
                time.sleep(0.005)

        thread = threading.Thread(target=speak)
        thread.start()
        assert port.read(port.now() + 5, 1024) == b"x" * 1024
        thread.join()

    def test_reads_of_any_lengths_follow_each_other(self, port, peer):
        for first in (1, 2, 14, 254, 255, 256, 300):
            for second in (1, 13, 255, 256):
                peer.send(b"x" * first)
                assert len(port.read(port.now() + 5, first)) == first
                peer.send(b"y" * second)
                assert port.read(port.now() + 5, second) == b"y" * second

    def test_short_telegram_is_returned_at_the_end_of_the_wait(self, port, peer):
        peer.send(b"abc")
        until = port.now() + 0.03
        assert port.read(until, 14) == b"abc"
        assert port.now() >= until

    def test_read_collects_single_bytes(self, port, peer):
        def speak():
            for byte in b"a telegram of 26 characters":
                peer.send(bytes([byte]))
                time.sleep(0.0005)

        thread = threading.Thread(target=speak)
        thread.start()
        assert port.read(port.now() + 5, 27) == b"a telegram of 26 characters"
        thread.join()


@linux
class TestTerminals:
    @pytest.fixture
    def peer(self):
        made = Terminal()
        yield made
        made.close()

    @pytest.mark.parametrize("baudrate", [9600, 12345])
    def test_holding_back_and_line_settings_do_not_change_each_other(self, port, baudrate):
        settings = LineSettings(baudrate=baudrate, stopbits=2)
        before = termios.tcgetattr(port.descriptor)[6][termios.VMIN]
        assert before == 1
        port.configure(settings)
        set_up = termios.tcgetattr(port.descriptor)
        speed = kernel_speed(port.descriptor)
        assert speed == baudrate
        port.hold_back(14)
        held = termios.tcgetattr(port.descriptor)
        assert held[6][termios.VMIN] == 14
        assert held[:6] == set_up[:6]
        assert kernel_speed(port.descriptor) == baudrate
        port.configure(LineSettings(baudrate=19200))
        port.hold_back(14)
        assert termios.tcgetattr(port.descriptor)[6][termios.VMIN] == 14

    def test_waiting_bytes_survive_a_change_of_settings(self, port, peer):
        port.hold_back(14)
        peer.send(b"abc")
        port.configure(LineSettings(baudrate=115200))
        assert port.read(port.now() + 1, 3) == b"abc"

    def test_reader_sleeps_through_a_telegram(self, port, peer, monkeypatch):
        """Holding back exists for this: a single wake for a telegram that comes byte by byte."""
        reads = []
        read = os.read
        monkeypatch.setattr(tty_channel.os, "read", lambda *given: reads.append(given) or read(*given))

        def speak():
            for _ in range(14):
                peer.send(b"x")
                time.sleep(0.001)

        thread = threading.Thread(target=speak)
        thread.start()
        assert port.read(port.now() + 5, 14) == b"x" * 14
        thread.join()
        assert len(reads) == 1

    def test_change_of_the_held_number_is_one_system_call(self, port, monkeypatch):
        """The change is made several times in each exchange, and `tcsetattr` needs four system calls."""
        calls = []
        call = fcntl.ioctl
        monkeypatch.setattr(tty_channel.fcntl, "ioctl", lambda *given: calls.append(given[1]) or call(*given))
        monkeypatch.setattr(termios, "tcsetattr", None)
        port.hold_back(14)
        assert calls == [termios.TCSETS]
        assert termios.tcgetattr(port.descriptor)[6][termios.VMIN] == 14

    def test_port_with_slow_changes_wakes_for_any_byte(self, peer, monkeypatch):
        """With ftdi_sio each change of a terminal's settings is a message on the USB."""
        set_attributes = termios.tcsetattr
        changes = []

        def slowly(*given):
            changes.append(given)
            time.sleep(0.0005)
            set_attributes(*given)

        monkeypatch.setattr(termios, "tcsetattr", slowly)
        port = SerialPort(peer.url)
        port.configure(LineSettings())
        changes.clear()
        port.hold_back(5)
        peer.send(b"abc")
        assert readable(port, 1)
        thread = threading.Timer(0.02, peer.send, [b"de"])
        thread.start()
        assert port.read(port.now() + 5, 5) == b"abcde"
        thread.join()
        assert changes == []
        port.close()


def test_socket_sends_immediately_and_checks_its_peer():
    with socket.create_server(("127.0.0.1", 0)) as server:
        channel = SocketChannel(f"socket://127.0.0.1:{server.getsockname()[1]}")
        with socket.socket(fileno=os.dup(channel.descriptor)) as same:
            assert same.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert same.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        peer, _ = server.accept()
        peer.close()
        channel.close()


def kernel_speed(descriptor):
    """Return the output speed in struct termios2, which has more speeds than termios."""
    words = array.array("i", [0] * 16)
    fcntl.ioctl(descriptor, 0x802C542A, words)
    return words[10]
