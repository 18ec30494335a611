"""Ports that are missing, in use, lost during an exchange or full of garbage; the next exchange works."""

from __future__ import annotations

import random
import signal
import socket
import threading
import time

import pytest

import drivecomm
from drivecomm.transport import SerialPort
from drivecomm.virtual import virtual_drive


def refusal(url):
    with pytest.raises(drivecomm.PortError) as caught:
        drivecomm.open_bus(url)
    text = str(caught.value)
    assert url in text
    assert "\n" not in text
    return text


def hang_up(server, after=0):
    """Accept one master, and disconnect it after its first bytes, or immediately if `after` is 0."""
    master, _ = server.accept()
    if after:
        master.recv(after)
    master.close()


class TestOpening:
    def test_missing_port_is_refused(self, tmp_path):
        assert "does not exist" in refusal(str(tmp_path / "ttyUSB7"))

    @pytest.mark.parametrize("what", ["folder", "file", "null"])
    def test_folder_file_or_null_device_is_refused_as_a_port(self, tmp_path, what):
        path = {"folder": tmp_path, "file": tmp_path / "file", "null": "/dev/null"}[what]
        if what == "file":
            path.write_text("")
        assert "is not a serial port" in refusal(str(path))

    def test_port_already_open_is_refused(self, terminal):
        with drivecomm.open_bus(terminal):
            assert "in use by another program" in refusal(terminal)
        drivecomm.open_bus(terminal).close()

    @pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
    def test_server_address_without_a_listener_is_refused(self, scheme):
        with socket.create_server(("127.0.0.1", 0)) as server:
            number = server.getsockname()[1]
        assert "nothing listens there" in refusal(f"{scheme}://127.0.0.1:{number}")

    @pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
    @pytest.mark.parametrize("rest", ["", "127.0.0.1", "127.0.0.1:many", "127.0.0.1:99999", "[::1"])
    def test_url_without_host_or_port_is_refused(self, scheme, rest):
        assert "lacks a host or a port number" in refusal(f"{scheme}://{rest}")

    @pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
    def test_unknown_host_is_refused(self, scheme, monkeypatch):
        def unknown(*_, **__):
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

        monkeypatch.setattr(socket, "getaddrinfo", unknown)
        assert "the host name pump-house is not known" in refusal(f"{scheme}://pump-house:4001")

    @pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
    def test_host_that_does_not_answer_is_refused(self, scheme, monkeypatch):
        def silent(*_, **__):
            raise TimeoutError("timed out")

        monkeypatch.setattr(socket, "create_connection", silent)
        assert "192.0.2.1 does not answer" in refusal(f"{scheme}://192.0.2.1:4001")

    def test_unknown_url_scheme_is_refused(self):
        assert "unknown scheme" in refusal("gopher://127.0.0.1:70")

    @pytest.mark.soak
    def test_server_without_rfc_2217_is_refused(self, serving):
        with serving([], "tcp") as server:
            url = server.address.replace("socket", "rfc2217") + "?timeout=0.1"
            assert "does not speak RFC 2217" in refusal(url)

    def test_server_that_hangs_up_immediately_is_refused(self):
        with socket.create_server(("127.0.0.1", 0)) as server:
            thread = threading.Thread(target=hang_up, args=(server,))
            thread.start()
            text = refusal(f"rfc2217://127.0.0.1:{server.getsockname()[1]}?timeout=0.2")
            thread.join()
        assert "RFC 2217" in text or "closed the connection" in text


class TestVanishing:
    @pytest.mark.soak
    def test_adapter_that_accepts_no_more_bytes_raises_link_down_error(self, monkeypatch, terminal):
        monkeypatch.setattr("drivecomm.transport.serial_port._STUCK_S", 0.05)
        port = SerialPort(terminal)

        def chatter():
            for _ in range(10_000):
                port.write(b"x" * 100)

        with pytest.raises(drivecomm.LinkDownError, match="accepted no bytes"):
            chatter()
        port.close()

    def test_server_that_accepts_no_more_bytes_raises_link_down_error(self, monkeypatch):
        monkeypatch.setattr("drivecomm.transport.serial_port._STUCK_S", 0.05)
        monkeypatch.setattr("drivecomm.protocol.line.LineSettings.character_s", 0.0)
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = SerialPort(f"socket://127.0.0.1:{server.getsockname()[1]}")
            with pytest.raises(drivecomm.LinkDownError, match="accepted no bytes"):
                port.write(b"x" * 50_000_000)
            port.close()

    @pytest.mark.soak
    @pytest.mark.parametrize("kind", ["pty", "tcp", "rfc2217"])
    def test_port_can_be_closed_twice(self, serving, kind):
        with serving([], kind) as server:
            port = SerialPort(server.address)
            port.close()
            port.close()


@pytest.mark.soak
@pytest.mark.timeout(180, method="thread")  # the test itself has the timer
@pytest.mark.parametrize("kind", ["pty", "tcp", "rfc2217"])
def test_ctrl_c_during_an_exchange_leaves_the_next_reply_right(serving, kind):
    """The late reply to the interrupted request must not answer the next one."""
    slow = virtual_drive("vabus", 1, reply_delay_s=0.15)
    with serving([slow], kind) as server, drivecomm.open_bus(server.address) as bus:
        drive = bus.drive("vabus", 1)
        assert drive.read("481", type="long").raw == "000003E8"
        before = signal.signal(signal.SIGALRM, signal.default_int_handler)
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.05)
            began = time.monotonic()
            with pytest.raises(KeyboardInterrupt):
                drive.read("481", type="long")
            assert time.monotonic() - began < 0.14
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
        other = drive.read("480", type="long")
        assert other.raw == slow.peek("480", server.now())
        assert drive.read("481", type="long").raw == "000003E8"


def babble(make):
    """Return a server function that sends endless garbage to its first client."""

    def speak(server, stop):
        master, _ = server.accept()
        with master:
            master.settimeout(0.05)
            while not stop.is_set():
                try:
                    master.sendall(make())
                except TimeoutError:
                    continue
                except OSError:
                    return
                stop.wait(0.001)

    return speak


NOISE = random.Random(7)


@pytest.mark.soak
@pytest.mark.parametrize(
    "make",
    [
        lambda: NOISE.randbytes(20),
        lambda: b"\xff" * 20,
        lambda: b"A\x0204810081",
        lambda: b"A\x02048100810000000\x03\x00",
        lambda: b"A",
    ],
    ids=["random", "ones", "beginnings", "damaged", "addresses"],
)
def test_endless_garbage_ends_with_an_error(make):
    stop = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=babble(make), args=(server, stop))
        thread.start()
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with drivecomm.open_bus(url, attempts=2, reply_timeout_s=0.1) as bus:
            began = time.monotonic()
            with pytest.raises((drivecomm.DamagedReplyError, drivecomm.NoReplyError)):
                bus.drive("vabus", 1).read("481", type="long")
            assert time.monotonic() - began < 5
        stop.set()
        thread.join()
