"""Errors of an operating system or of pyserial, without the hardware that causes them."""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys
import termios
import time
import types
from contextlib import closing

import pytest
import serial
from port_peers import Terminal
from serial.rfc2217 import SET_CONTROL, PortManager

from drivecomm.errors import LinkDownError, PortError
from drivecomm.protocol import LineSettings
from drivecomm.transport import (
    ChannelGoneError,
    PyserialChannel,
    Rfc2217Client,
    SerialPort,
    SettingsRefusedError,
    cannot_open,
    error_number,
    opening,
    port_names,
    tty_channel,
)
from drivecomm.virtual import PretendedPort


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOENT, "does not exist"),
        (errno.EBUSY, "in use by another program; stop that program first"),
        (errno.EAGAIN, "in use by another program"),
        (errno.EACCES, "may not be opened by this user"),
        (errno.EIO, "no hardware; plug the adapter in"),
        (errno.ENODEV, "no hardware"),
        (errno.ENOTTY, "is not a serial port"),
        (errno.ENOMEM, "cannot be opened"),
    ],
)
def test_error_number_becomes_a_sentence(number, words):
    text = str(cannot_open("/dev/ttyUSB0", serial.SerialException(number, os.strerror(number))))
    assert "/dev/ttyUSB0" in text
    assert words in text


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("could not open port 'COM3': FileNotFoundError(2, 'not found', None, 2)", "does not exist"),
        ("could not open port 'COM3': PermissionError(13, 'Access is denied.', None, 5)", "in use by another program"),
    ],
)
def test_windows_error_text_becomes_a_sentence(said, words):
    assert words in str(cannot_open("COM3", serial.SerialException(said)))


def test_refusal_names_the_group_of_the_port(monkeypatch):
    def stat(_):
        return types.SimpleNamespace(st_gid=20, st_mode=0o20660)

    monkeypatch.setattr(opening.os, "stat", stat)
    monkeypatch.setattr("grp.getgrgid", lambda _: types.SimpleNamespace(gr_name="dialout"))
    text = str(cannot_open("/dev/ttyUSB0", serial.SerialException(errno.EACCES, "no")))
    assert "group dialout, so join it (sudo usermod -a -G dialout $USER)" in text
    monkeypatch.setattr("grp.getgrgid", lambda _: types.SimpleNamespace(gr_name="root"))
    assert "group root, so ask" in str(cannot_open("/dev/ttyUSB0", serial.SerialException(errno.EACCES, "no")))


def test_refusal_names_the_existing_ports(monkeypatch):
    found = [types.SimpleNamespace(device="/dev/ttyUSB1"), types.SimpleNamespace(device="/dev/ttyUSB0")]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
    missing = serial.SerialException(errno.ENOENT, "no")
    assert "this machine has /dev/ttyUSB0, /dev/ttyUSB1" in str(cannot_open("/dev/ttyUSB9", missing))
    found.clear()
    assert "plug the adapter in" in str(cannot_open("/dev/ttyUSB9", missing))


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ConnectionResetError(errno.ECONNRESET, "reset"), "closed the connection at once"),
        (OSError(errno.EHOSTUNREACH, "No route to host"), "cannot be reached"),
    ],
)
def test_network_error_becomes_a_sentence(error, words):
    assert words in str(cannot_open("socket://10.0.0.9:4001", error))


def test_other_pyserial_url_is_refused_with_a_port_error():
    with pytest.raises(PortError, match=r"hwgrep://no-such-adapter cannot be opened"):
        SerialPort("hwgrep://no-such-adapter")


def test_error_number_is_found_in_an_exception():
    assert error_number(termios.error(22, "Invalid argument")) == 22
    assert error_number(ValueError("words")) is None


@pytest.fixture
def real_terminal(terminal):
    """Yield a channel on a pseudo-terminal that counts as a real port."""
    channel = tty_channel.TtyChannel(serial.Serial(terminal))
    channel._pseudo = False
    yield channel
    channel.close()


def test_damaged_characters_are_dropped_by_the_terminal(real_terminal):
    real_terminal.apply(LineSettings(baudrate=19200))
    flags = termios.tcgetattr(real_terminal.descriptor)[0]
    assert flags & termios.INPCK
    assert flags & termios.IGNPAR


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux refuses 7E1 on a pseudo-terminal")
def test_adapter_that_refuses_a_format_raises_port_error(real_terminal, monkeypatch):
    with pytest.raises(SettingsRefusedError):
        real_terminal.apply(LineSettings(bytesize=7, parity="E"))
    monkeypatch.setattr("drivecomm.transport.serial_port._open", lambda *_, **__: (None, real_terminal))
    with pytest.raises(PortError, match=r"port COM-7 refuses the line settings 9600 7E1"):
        SerialPort("COM-7").configure(LineSettings(bytesize=7, parity="E"))
    assert real_terminal.apply(LineSettings(baudrate=19200)) == ""


def test_adapter_lost_during_configuration_raises_link_down_error():
    with closing(Terminal()) as made:
        port = SerialPort(made.url)
        made.end()
        with pytest.raises(LinkDownError, match="unplugged"):
            port.configure(LineSettings())
        port.close()


class AlwaysReadable:
    """A descriptor that is always readable, as one with bytes or with a closed peer."""

    now = staticmethod(lambda: True)
    wait = staticmethod(lambda until: time.monotonic() < until)


def test_spurious_wake_is_not_the_end_of_a_port(real_terminal, monkeypatch):
    def nothing(*_):
        raise BlockingIOError

    monkeypatch.setattr(real_terminal, "_readable", AlwaysReadable)
    monkeypatch.setattr(tty_channel.os, "read", nothing)
    assert real_terminal.receive(time.monotonic() + 0.01, 1) == b""
    assert real_terminal.take() == b""


def test_unknown_terminal_error_raises_channel_gone_error(real_terminal, monkeypatch):
    def fail(*_):
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    monkeypatch.setattr(tty_channel.os, "write", fail)
    with pytest.raises(ChannelGoneError, match="Cannot allocate memory"):
        real_terminal.send(b"x", 1.0)
    monkeypatch.undo()
    monkeypatch.setattr(tty_channel.os, "read", fail)
    monkeypatch.setattr(real_terminal, "_readable", AlwaysReadable)
    with pytest.raises(ChannelGoneError, match="Cannot allocate memory"):
        real_terminal.receive(time.monotonic() + 5, 1)


def test_readable_terminal_without_bytes_is_gone(real_terminal, monkeypatch):
    """Some systems report an unplugged adapter like this: always readable, and nothing to read."""
    monkeypatch.setattr(real_terminal, "_readable", AlwaysReadable)
    monkeypatch.setattr(tty_channel.os, "read", lambda *_: b"")
    with pytest.raises(ChannelGoneError, match="unplugged"):
        real_terminal.receive(time.monotonic() + 5, 1)


@pytest.mark.parametrize(
    ("name", "pseudo"), [("/dev/ttys003", True), ("/dev/pts/4", True), ("/dev/cu.usbserial-1", False)]
)
def test_pseudo_terminals_on_other_systems_are_recognised_by_name(name, pseudo, monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(port_names.os, "ttyname", lambda _: name)
    assert port_names.is_pseudo(0) is pseudo


def test_terminal_without_a_name_counts_as_real(monkeypatch):
    def nameless(_):
        raise OSError(errno.ENODEV, "no name")

    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(port_names.os, "ttyname", nameless)
    assert port_names.is_pseudo(0) is False


def test_last_bytes_are_delivered_although_replies_are_unread():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = SerialPort(f"socket://127.0.0.1:{server.getsockname()[1]}")
        master, _ = server.accept()
        master.sendall(b"unread")
        port.read(port.now() + 5, 1)
        master.sendall(b"unread as well")
        port.write(b"stop")
        port.close()
        assert master.recv(100) == b"stop"
        assert master.recv(100) == b""
        master.close()


def test_ctrl_c_while_a_port_is_opened_is_raised(monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(serial.Serial, "open", interrupted)
    with pytest.raises(KeyboardInterrupt):
        SerialPort("/dev/ttyUSB0")


class Broken:
    """A pyserial port with a failure in each call."""

    def __init__(self, error):
        self._error = error

    def _fail(self, *_):
        raise self._error

    read = write = _reconfigure_port = close = _fail
    in_waiting = property(_fail)


class TestPyserialChannel:
    @pytest.mark.parametrize("error", [serial.SerialException("reader died"), OSError(errno.EIO, "gone")])
    def test_foreign_exceptions_become_channel_gone_error(self, error):
        channel = PyserialChannel(Broken(error))
        with pytest.raises(ChannelGoneError):
            channel.apply(LineSettings())
        with pytest.raises(ChannelGoneError):
            channel.send(b"x", 1.0)
        with pytest.raises(ChannelGoneError):
            channel.receive(time.monotonic() + 5, 1)
        with pytest.raises(ChannelGoneError):
            channel.take()
        channel.close()

    def test_refused_setting_of_a_present_port_raises_settings_refused_error(self):
        port = Broken(ValueError("Invalid baud rate"))
        channel = PyserialChannel(types.SimpleNamespace(in_waiting=0, _reconfigure_port=port._fail))
        with pytest.raises(SettingsRefusedError, match="Invalid baud rate"):
            channel.apply(LineSettings())


@pytest.mark.soak
def test_rfc_2217_server_that_refuses_a_setting_raises_port_error(serving, monkeypatch):
    """An RFC 2217 server refuses a setting by a reply with its present setting."""

    def refuse(_, baudrate):
        if baudrate == 600:
            raise ValueError("no such baud rate")

    with serving([], "rfc2217") as server:
        port = SerialPort(server.address)
        assert port.configure(LineSettings(baudrate=19200)) == ""
        monkeypatch.setattr(PretendedPort, "baudrate", property(lambda _: 19200, refuse))
        with pytest.raises(PortError, match="refuses the line settings 600 8N1"):
            port.configure(LineSettings(baudrate=600))
        monkeypatch.undo()
        assert port.configure(LineSettings(baudrate=9600)) == ""
        port.close()


@pytest.mark.soak
def test_rfc_2217_server_without_control_lines_is_noted(serving, monkeypatch):
    answer = PortManager._telnet_process_subnegotiation

    def answer_all_but_control(manager, request):
        if request[1:2] != SET_CONTROL:
            answer(manager, request)

    monkeypatch.setattr("drivecomm.transport.rfc2217_client._CONTROL_S", 0.01)
    monkeypatch.setattr(PortManager, "_telnet_process_subnegotiation", answer_all_but_control)
    with serving([], "rfc2217") as server:
        port = SerialPort(server.address)
        assert "does not confirm control lines" in port.configure(LineSettings())
        port.close()


@pytest.mark.soak
def test_rfc_2217_server_that_stops_answering_raises_port_error(serving, monkeypatch):
    with serving([], "rfc2217") as server:
        port = SerialPort(server.address + "?timeout=0.2")
        monkeypatch.setattr(PortManager, "_telnet_process_subnegotiation", lambda *_: None)
        with pytest.raises(PortError, match="does not confirm line settings"):
            port.configure(LineSettings(baudrate=600))
        port.close()


def test_broken_connection_leaves_no_traceback(monkeypatch):
    def broken(_):
        raise BrokenPipeError

    monkeypatch.setattr(serial.rfc2217.Serial, "_telnet_read_loop", broken)
    client = Rfc2217Client(None)
    ended = []
    client._read_buffer = types.SimpleNamespace(put=ended.append)
    client._telnet_read_loop()
    assert ended == [None]


def test_importing_drivecomm_does_not_load_pyserial():
    code = "import sys, drivecomm, drivecomm.virtual.serving; sys.exit('serial' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


LIKE_WINDOWS = """
import os, select, serial, serial.rfc2217, serial.tools.list_ports, socket, sys
sys.modules["fcntl"] = sys.modules["termios"] = sys.modules["grp"] = None
sys.platform = "win32"
for name in ("poll", "epoll"):
    delattr(select, name)
from drivecomm.transport import SerialPort
with socket.create_server(("127.0.0.1", 0)) as server:
    ports = [SerialPort("loop://"), SerialPort(f"socket://127.0.0.1:{server.getsockname()[1]}")]
    peer, _ = server.accept()
    peer.sendall(b"abc")
    ports[0].write(b"abc")
    for port in ports:
        assert port.read(port.now() + 5, 3) == b"abc"
        assert port.read(port.now() + 0.01, 3) == b""
        port.wait(port.now() + 0.001)
        port.hold_back(3)
        assert port.take() == b""
        assert port.report().url == port.url
        port.close()
    peer.close()
"""


def test_posix_functions_are_not_used_on_other_systems():
    ran = subprocess.run([sys.executable, "-c", LIKE_WINDOWS], check=False, capture_output=True, text=True)
    assert ran.stderr == ""
    assert ran.returncode == 0
