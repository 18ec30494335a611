"""Listening ports receive all bytes and never send."""

import errno
import fcntl
import os
import select
import socket
import termios
import time
import tty

import pytest

from drivecomm.errors import LinkDownError, PortError, UsageError
from drivecomm.protocol import LineSettings
from drivecomm.transport import MarkedCharacters, listening_port

SETTINGS = LineSettings(baudrate=9600, bytesize=7, parity="E")


@pytest.fixture
def terminal():
    """Yield both ends of a pseudo-terminal; the far one echoes until a program changes that."""
    near, far = os.openpty()
    yield near, os.ttyname(far)
    os.close(near)
    os.close(far)


def soon(port):
    return port.read(port.now() + 2)


def test_listening_port_reads_a_terminal_and_cannot_write_to_it(terminal):
    near, name = terminal
    port = listening_port(name, SETTINGS)
    try:
        assert fcntl.fcntl(port.descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY
        with pytest.raises(OSError, match=os.strerror(errno.EBADF)):
            os.write(port.descriptor, b"x")
        os.write(near, b"\x04A00481\x05\xff\x03\x0d\x11")
        assert soon(port) == b"\x04A00481\x05\xff\x03\x0d\x11"
        port.configure(LineSettings(baudrate=19200))
        os.write(near, b"more")
        assert soon(port) == b"more"
        # The kernel does not echo it either.
        assert select.select([near], [], [], 0.05) == ([], [], [])
        assert not termios.tcgetattr(near)[tty.LFLAG] & termios.ECHO
    finally:
        port.close()


def test_read_without_traffic_ends_at_its_time(terminal):
    port = listening_port(terminal[1], SETTINGS)
    began = time.monotonic()
    assert port.read(port.now() + 0.03) == b""
    assert 0.02 < time.monotonic() - began < 1
    port.close()


def test_lost_terminal_is_reported():
    near, far = os.openpty()
    port = listening_port(os.ttyname(far), SETTINGS)
    os.close(far)
    os.close(near)
    with pytest.raises(LinkDownError, match="is gone"):
        soon(port)
    port.close()


def test_listening_port_reads_a_serial_server_and_sends_nothing():
    with socket.create_server(("127.0.0.1", 0)) as door:
        address = f"socket://127.0.0.1:{door.getsockname()[1]}"
        port = listening_port(address, SETTINGS)
        server, _ = door.accept()
        with server:
            assert "own line settings" in port.configure(SETTINGS)
            server.sendall(b"<01R")
            assert soon(port) == b"<01R"
            assert select.select([server], [], [], 0.05) == ([], [], [])
            port.close()
            # The listener sends nothing but the end of the connection.
            assert server.recv(10) == b""


def test_serial_server_that_hangs_up_is_reported():
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = listening_port(f"socket://127.0.0.1:{door.getsockname()[1]}", SETTINGS)
        door.accept()[0].close()
        with pytest.raises(LinkDownError, match="closed the connection"):
            soon(port)
        port.close()


@pytest.mark.parametrize("name", ["rfc2217://127.0.0.1:1", "loop://"])
def test_url_that_needs_sending_is_refused_for_listening(name):
    with pytest.raises(UsageError, match="without sending"):
        listening_port(name, SETTINGS)


def test_missing_port_or_plain_file_is_refused(tmp_path):
    with pytest.raises(PortError, match="does not exist"):
        listening_port(str(tmp_path / "nothing"), SETTINGS)
    file = tmp_path / "file"
    file.write_bytes(b"")
    with pytest.raises(PortError, match="is not a serial port"):
        listening_port(str(file), SETTINGS)


def test_unusual_baud_rate_is_refused(terminal):
    with pytest.raises(UsageError, match="187500"):
        listening_port(terminal[1], LineSettings(baudrate=187500))


@pytest.mark.parametrize(
    ("data", "plain", "spoilt"),
    [
        (b"abc", b"abc", 0),
        (b"a\xff\xffb", b"a\xffb", 0),
        (b"a\xff\x00bc", b"abc", 1),
        (b"\xff\x00\xff\xff\xff", b"\xff\xff", 1),
        (b"\xff\x00\x00", b"\x00", 1),
    ],
)
def test_marks_of_spoilt_characters_are_removed(data, plain, spoilt):
    assert MarkedCharacters().feed(data) == (plain, spoilt)
    marks = MarkedCharacters()
    parts = [marks.feed(data[place : place + 1]) for place in range(len(data))]
    assert b"".join(part for part, _ in parts) == plain
    assert sum(number for _, number in parts) == spoilt
