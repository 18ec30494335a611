"""Holders of a port: other programs are kept out of our ports, and named if they keep us out of theirs."""

import contextlib
import fcntl
import os
import shutil
import socket
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

import pytest
from python_processes import named_python

import drivecomm
from drivecomm.protocol import LineSettings
from drivecomm.transport import (
    Holder,
    SerialPort,
    holder_of_port,
    listening_port,
    server_of_terminal,
    shared_listening_port,
    tty_channel,
)
from drivecomm.virtual import virtual_drive

SETTINGS = LineSettings()
HOLDS = "import sys, fcntl, os, socket; %s; print(flush=True); sys.stdin.read()"
OPENS = "descriptor = os.open(sys.argv[1], os.O_RDONLY | os.O_NOCTTY)"
LOCKS = f"{OPENS}; fcntl.flock(descriptor, fcntl.LOCK_EX)"
CONNECTS = "connection = socket.create_connection(('127.0.0.1', int(sys.argv[1])))"

linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells who holds a port")


@contextlib.contextmanager
def other_program(does, where):
    """Run a program that holds something until the block ends; yield its process."""
    words = [sys.executable, "-c", HOLDS % does, str(where)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        yield process
        process.stdin.close()


def refused(open_port):
    with pytest.raises(drivecomm.PortError) as caught:
        open_port()
    return str(caught.value)


@linux
@named_python
@pytest.mark.parametrize("opens", [SerialPort, lambda name: listening_port(name, SETTINGS)])
def test_port_locked_by_another_program_is_refused_with_its_name(terminal, opens):
    with other_program(LOCKS, terminal) as process:
        text = refused(lambda: opens(terminal))
    assert text.startswith(f"port {terminal} is in use by python")
    assert f"(pid {process.pid}); stop that program first" in text
    opens(terminal).close()


@linux
def test_listening_is_refused_on_a_port_opened_without_a_lock(terminal):
    with other_program(OPENS, terminal) as process:
        assert f"(pid {process.pid})" in refused(lambda: listening_port(terminal, SETTINGS))


@linux
def test_program_that_serves_a_terminal_is_not_its_holder(terminal, tmp_path):
    program = "near, far = os.openpty(); os.symlink(os.ttyname(far), sys.argv[1])"
    with other_program(program, tmp_path / "line") as process:
        assert holder_of_port(str(tmp_path / "line")) is None
        assert server_of_terminal(str(tmp_path / "line")).pid == process.pid
        listening_port(str(tmp_path / "line"), SETTINGS).close()
    assert server_of_terminal(terminal) is None


def test_listening_port_keeps_others_out_until_it_is_closed(terminal):
    port = listening_port(terminal, SETTINGS)
    assert "in use" in refused(lambda: SerialPort(terminal))
    assert "in use" in refused(lambda: listening_port(terminal, SETTINGS))
    port.close()
    SerialPort(terminal).close()


def test_shared_listening_leaves_the_line_settings_of_the_other_program(terminal):
    used = SerialPort(terminal)
    used.configure(LineSettings(baudrate=19200))
    looker = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    before = termios.tcgetattr(looker)
    port = shared_listening_port(terminal, SETTINGS)
    assert "the other program's line settings hold" in port.configure(SETTINGS)
    assert termios.tcgetattr(looker) == before
    port.close()
    used.write(b"still there")
    used.close()
    os.close(looker)


def test_only_a_local_port_can_be_shared():
    with pytest.raises(drivecomm.UsageError, match="shared by its server"):
        shared_listening_port("socket://127.0.0.1:1", SETTINGS)


def test_open_real_port_is_marked_exclusive_in_the_kernel(terminal, monkeypatch):
    """The kernel then refuses programs that check no lock, unless they run as root."""
    monkeypatch.setattr("drivecomm.transport.tty_channel.is_pseudo", lambda _: False)
    looker = os.open(terminal, os.O_RDWR | os.O_NOCTTY)

    def marked():
        # Linux, include/uapi/asm-generic/ioctls.h: TIOCGEXCL, for which termios has no name.
        return fcntl.ioctl(looker, 0x80045440, bytes(4)) != bytes(4)

    for opens in (SerialPort, lambda name: listening_port(name, SETTINGS)):
        port = opens(terminal)
        assert marked()
        port.close()
        assert not marked()
    os.close(looker)


def test_pseudo_terminal_is_not_marked_exclusive(terminal, monkeypatch):
    asked = []
    monkeypatch.setattr(tty_channel.fcntl, "ioctl", lambda _, request: asked.append(request))
    descriptor = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    tty_channel.keep_others_out(descriptor)
    os.close(descriptor)
    assert asked == []


@linux
def test_exclusive_mark_keeps_out_a_program_without_root_rights(terminal, monkeypatch):
    if os.getuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("needs a user that may become another user")
    monkeypatch.setattr("drivecomm.transport.tty_channel.is_pseudo", lambda _: False)
    Path(terminal).chmod(0o666)
    plain = ["setpriv", "--reuid=65534", "--clear-groups", "sh", "-c", f": <{terminal}"]
    assert subprocess.run(plain, check=False).returncode == 0
    port = SerialPort(terminal)
    kept_out = subprocess.run(plain, check=False, capture_output=True, text=True)
    assert kept_out.returncode != 0
    assert "busy" in kept_out.stderr
    port.close()
    assert subprocess.run(plain, check=False).returncode == 0


# Serial servers


@contextlib.contextmanager
def busy_server(says=b""):
    """Run a server that serves its first client and closes each further connection immediately; yield its port."""
    with socket.create_server(("127.0.0.1", 0)) as door:
        first = threading.Event()

        def serve():
            clients = []
            while True:
                try:
                    client, _ = door.accept()
                except OSError:
                    break
                if first.is_set():
                    client.sendall(says)
                    client.close()
                else:
                    clients.append(client)
                    first.set()
            for client in clients:
                client.close()

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield door.getsockname()[1]
        finally:
            door.shutdown(socket.SHUT_RDWR)
            thread.join()


@linux
@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_server_in_use_by_a_local_program_names_that_program(scheme):
    with busy_server() as number, other_program(CONNECTS, number) as process:
        began = time.monotonic()
        text = refused(lambda: SerialPort(f"{scheme}://127.0.0.1:{number}"))
        assert time.monotonic() - began < 1.5
        listens = refused(lambda: listening_port(f"socket://127.0.0.1:{number}", SETTINGS))
    for told in (text, listens):
        assert f"(pid {process.pid}): the server closed" in told
        assert "closed the connection at once" in told


@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_server_in_use_from_elsewhere_is_refused_with_its_message(scheme):
    says = b"\xff\xfb\x01Port already in use\r\n"
    with busy_server(says) as number, socket.create_connection(("127.0.0.1", number)):
        text = refused(lambda: SerialPort(f"{scheme}://127.0.0.1:{number}"))
    assert "in use by another program or machine" in text
    if scheme == "socket":
        assert 'and said "Port already in use"' in text


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["tcp", "rfc2217"])
def test_own_simulator_in_use_refuses_a_second_client(serving, kind):
    with serving([virtual_drive("vabus", 1)], kind) as server, drivecomm.open_bus(server.address):
        began = time.monotonic()
        assert "in use by another program or machine" in refused(lambda: drivecomm.open_bus(server.address))
        assert time.monotonic() - began < 1.5


def test_nothing_is_sent_into_a_connection_closed_by_the_server():
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = SerialPort(f"socket://127.0.0.1:{door.getsockname()[1]}")
        door.accept()[0].close()
        time.sleep(0.01)
        with pytest.raises(drivecomm.LinkDownError, match="the server closed it"):
            port.write(b"stop")
        port.close()


def test_bytes_sent_immediately_by_a_server_are_received():
    with socket.create_server(("127.0.0.1", 0)) as door:
        sender = threading.Thread(target=lambda: clients.append(door.accept()[0]) or clients[0].sendall(b"first"))
        clients = []
        sender.start()
        port = listening_port(f"socket://127.0.0.1:{door.getsockname()[1]}", SETTINGS)
        sender.join()
        assert port.read(port.now() + 2) == b"first"
        port.close()
        clients[0].close()


def test_holder_is_unknown_without_proc(tmp_path, monkeypatch, terminal):
    monkeypatch.setattr("drivecomm.transport.holders._PROC", tmp_path / "nothing")
    assert holder_of_port(terminal) is None
    assert holder_of_port("socket://127.0.0.1:1") is None
    assert holder_of_port("socket://nowhere") is None
    assert server_of_terminal(terminal) is None


def test_str_of_a_holder_is_its_name_and_pid():
    assert str(Holder(name="minicom", pid=7)) == "minicom (pid 7)"
