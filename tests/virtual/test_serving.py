"""Virtual drives served to programs that know nothing of drivecomm: bytes in, bytes out."""

from __future__ import annotations

import contextlib
import os
import random
import select
import selectors
import socket
import struct
import subprocess
import sys
import threading
import time
import tty
from pathlib import Path

import pytest
from python_processes import named_python
from real_lines import running as served

from drivecomm.errors import PortError, UsageError
from drivecomm.virtual import PretendedPort, Rfc2217Listener, Server, TcpListener, parse_listen, virtual_drive
from drivecomm.virtual.waiting import ready_within

ENQUIRY = bytes.fromhex("04 41 30 30 34 38 31 05")
VALUE = bytes.fromhex("41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03")
IAC = b"\xff"


@pytest.fixture(autouse=True)
def _no_thread_left():
    before = threading.active_count()
    yield
    assert threading.active_count() == before


def running(listen, drives=None, **options):
    return served([virtual_drive("vabus", 1, reply_delay_s=0.0)] if drives is None else drives, listen, **options)


def connected(server):
    host, _, port = server.address.partition("://")[2].rpartition(":")
    master = socket.create_connection((host.strip("[]"), int(port)), timeout=5)
    master.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return master


def answered(master, request=ENQUIRY):
    master.sendall(request)
    return received(master, len(VALUE) + 1)


def until_answered(master):
    """Read until the value has come; with RFC 2217, negotiation comes before it."""
    data = b""
    while VALUE not in data:
        piece = master.recv(1000)
        assert piece
        data += piece


def closed(master):
    """Return whether the server closes the connection; bytes received before that are dropped."""
    try:
        while master.recv(1000):
            pass
    except ConnectionResetError:
        return True
    except TimeoutError:
        return False
    return True


def received(master, length):
    data = b""
    while len(data) < length:
        piece = master.recv(length - len(data))
        if not piece:
            break
        data += piece
    return data


class TestPlaces:
    @pytest.mark.parametrize(
        "text",
        [
            "",
            "pty",
            "pty:",
            "com:1",
            "tcp:",
            "tcp:localhost",
            "tcp:localhost:",
            "tcp:localhost:x",
            "tcp::65536",
            "tcp:-1",
        ],
    )
    def test_invalid_listen_address_is_refused(self, text):
        with pytest.raises(UsageError) as caught:
            parse_listen(text)
        assert repr(text) in str(caught.value)
        assert "pty:PATH" in str(caught.value)

    def test_listen_address_defaults_to_the_loopback(self):
        assert parse_listen("tcp::4001").address == "socket://127.0.0.1:4001"
        assert parse_listen("tcp:0.0.0.0:4001").address == "socket://0.0.0.0:4001"
        assert parse_listen("rfc2217:[::1]:4001").address == "rfc2217://[::1]:4001"

    def test_pseudo_terminal_is_refused_on_windows(self, monkeypatch):
        monkeypatch.setattr(os, "name", "nt")
        with pytest.raises(UsageError, match="listen at tcp:HOST:PORT instead"):
            parse_listen("pty:line")

    def test_port_number_in_use_is_refused(self):
        with running("tcp::0") as server:
            number = server.address.rpartition(":")[2]
            with pytest.raises(PortError, match=rf"cannot listen at 127.0.0.1:{number} .*choose another"):
                parse_listen(f"tcp::{number}").open()

    def test_foreign_host_is_refused_as_a_listen_address(self):
        with pytest.raises(PortError, match=r"cannot listen at 192\.0\.2\.1:4001"):
            parse_listen("tcp:192.0.2.1:4001").open()

    def test_server_listens_on_ipv6(self):
        if not socket.has_ipv6:
            pytest.skip("this machine has no IPv6")
        try:
            socket.create_server(("::1", 0), family=socket.AF_INET6).close()
        except OSError:
            pytest.skip("this machine has no IPv6 loopback")
        with running("tcp:[::1]:0") as server, connected(server) as master:
            assert answered(master)[:-1] == VALUE

    @pytest.mark.parametrize("listen", ["tcp::0", "rfc2217::0", "pty:line"])
    def test_closed_listener_receives_and_sends_nothing(self, listen, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        listener = parse_listen(listen)
        assert listener.receive(0.0) == b""
        listener.send(b"x")
        listener.close()
        listener.open()
        listener.send(b"x")
        listener.close()
        listener.close()
        assert listener.receive(0.0) == b""


class TestTcp:
    def test_masters_are_served_one_after_the_other(self):
        with running("tcp::0") as server:
            for _ in range(20):
                with connected(server) as master:
                    assert answered(master)[:-1] == VALUE

    @pytest.mark.parametrize("kind", ["tcp", "rfc2217"])
    def test_second_master_is_disconnected_immediately(self, kind):
        with running(f"{kind}::0") as server, connected(server) as first:
            first.sendall(ENQUIRY)
            until_answered(first)
            began = time.monotonic()
            with connected(server) as second:
                assert closed(second)
            assert time.monotonic() - began < 0.5
            first.sendall(ENQUIRY)
            until_answered(first)
            first.close()
            with connected(server) as third:
                third.sendall(ENQUIRY)
                until_answered(third)

    def test_bytes_of_a_disconnected_master_are_sent_before_the_next_is_served(self):
        with running("tcp::0") as server:
            heard = []
            server.line.monitors.append(lambda sent: heard.append(sent.data))
            for _ in range(20):
                with connected(server) as master:
                    master.sendall(ENQUIRY)
                with connected(server) as master:
                    time.sleep(0.01)
                    assert answered(master)[:-1] == VALUE
            assert heard.count(ENQUIRY) == 40

    @pytest.mark.soak
    def test_flood_ends_with_the_master_that_sent_it(self):
        with running("tcp::0", paced=True) as server:
            with connected(server) as master:
                master.settimeout(0.2)
                with pytest.raises(TimeoutError):
                    master.sendall(bytes(16_000_000))
            began = time.monotonic()
            data = b""
            while not data and time.monotonic() - began < 5:
                # Until the flood has been discarded, a new master may be disconnected.
                with connected(server) as master, contextlib.suppress(ConnectionError, TimeoutError):
                    master.settimeout(1)
                    time.sleep(0.6)
                    data = answered(master)
            assert data[:-1] == VALUE

    @pytest.mark.soak
    def test_flood_of_a_connected_master_keeps_others_out(self):
        with running("tcp::0", paced=True) as server, connected(server) as master:
            master.settimeout(0.2)
            with pytest.raises(TimeoutError):
                master.sendall(bytes(16_000_000))
            with connected(server) as second:
                assert closed(second)

    def test_reset_connection_does_not_disturb_the_next_master(self):
        with running("tcp::0") as server:
            for _ in range(3):
                master = connected(server)
                master.sendall(ENQUIRY[:4])
                # Closing like this sends a reset instead of an orderly end.
                master.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                master.close()
            with connected(server) as master:
                # The next master's request is not the rest of the broken one: a pause lies between them.
                time.sleep(0.06)
                assert answered(master)[:-1] == VALUE

    def test_truncated_request_does_not_spoil_the_next_one(self):
        with running("tcp::0") as server, connected(server) as master:
            master.sendall(ENQUIRY[:5])
            time.sleep(0.06)
            assert answered(master)[:-1] == VALUE

    @pytest.mark.soak
    def test_endless_garbage_does_not_disturb_the_next_master(self):
        noise = random.Random(3)
        with running(
            "tcp::0", [virtual_drive("vabus", address, reply_delay_s=0.0) for address in range(1, 6)]
        ) as server:
            with connected(server) as master:
                # Bytes that wait in this socket are still received after it is closed.
                master.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
                master.settimeout(0.1)
                until = time.monotonic() + 0.3
                while time.monotonic() < until:
                    try:
                        master.sendall(noise.randbytes(5000))
                    except TimeoutError:
                        continue
            with connected(server) as master:
                time.sleep(0.06)
                master.settimeout(10)
                assert answered(master)[:-1] == VALUE
            for station in server.line._stations:
                assert len(station.pending) < 200

    def test_master_that_never_reads_holds_one_reply_per_drive(self):
        slow = virtual_drive("vabus", 1, reply_delay_s=30.0)
        asked, hear = [], slow.hear
        slow.hear = lambda find, now: asked.append(now) or hear(find, now)
        with running("tcp::0", [slow]) as server, connected(server) as master:
            for _ in range(100):
                master.sendall(ENQUIRY * 10)
            until = time.monotonic() + 5
            while len(asked) < 1000 and time.monotonic() < until:
                time.sleep(0.01)
            # A drive has room for one reply, so the line keeps no more than that.
            assert len(asked) == 1000
            assert len(server.line._events) == 1

    def test_master_with_full_buffers_is_disconnected(self):
        listener = TcpListener("127.0.0.1", 0)
        listener.open()
        number = int(listener.address.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", number)) as master:
            listener.receive(1.0)
            # More than all buffers hold: a master that reads on after a gap would receive partial telegrams.
            listener.send(b"x" * 32_000_000)
            assert listener._master is None
            master.settimeout(5)
            while master.recv(1_000_000):
                pass
        listener.close()

    def test_server_stops_promptly_and_can_run_again(self):
        stop = threading.Event()
        with Server([], parse_listen("tcp::0")) as server:
            for _ in range(2):
                stop.clear()
                thread = threading.Thread(target=server.run, args=(stop,))
                thread.start()
                began = time.monotonic()
                stop.set()
                thread.join()
                assert time.monotonic() - began < 0.3

    def test_idle_server_uses_no_processor_time(self):
        with running("tcp::0"):
            before = time.process_time()
            time.sleep(0.3)
            assert time.process_time() - before < 0.05

    def test_address_is_known_after_entering_the_server(self):
        with Server([virtual_drive("vabus", 1)], parse_listen("tcp::0")) as server:
            assert server.address.startswith("socket://127.0.0.1:")
            server.run(set_event())
        with Server([], parse_listen("tcp::0")) as server:
            server.run(set_event())


def set_event():
    stop = threading.Event()
    stop.set()
    return stop


class TestTiming:
    def test_reply_delay_of_a_drive_is_kept_in_real_time(self):
        with (
            running("tcp::0", [virtual_drive("vabus", 1, reply_delay_s=0.0305)]) as server,
            connected(server) as master,
        ):
            answered(master)
            began = time.monotonic()
            answered(master)
            assert 0.0305 <= time.monotonic() - began < 0.2

    def test_paced_line_takes_the_time_of_its_characters(self):
        with running("tcp::0", paced=True) as server, connected(server) as master:
            wire = server.drives[0].settings.wire_s
            answered(master)
            began = time.monotonic()
            for _ in range(2):
                answered(master)
            assert time.monotonic() - began >= wire(2 * (len(ENQUIRY) + len(VALUE) + 1))

    def test_master_that_sends_ahead_on_a_paced_line_is_held_back(self):
        with running("tcp::0", paced=True) as server, connected(server) as master:
            master.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
            master.settimeout(0.2)
            with pytest.raises(TimeoutError):
                master.sendall(bytes(16_000_000))
            # Half a second is 480 characters at 9600 baud; a piece that was taken is not given back.
            assert server.line.backlog_s < 0.5 + server.drives[0].settings.wire_s(512)

    def test_drive_answers_only_the_last_of_several_requests_in_a_row(self):
        with running("tcp::0") as server, connected(server) as master:
            master.sendall(ENQUIRY + ENQUIRY)
            assert received(master, len(VALUE) + 1)[:-1] == VALUE
            master.settimeout(0.1)
            with pytest.raises(TimeoutError):
                master.recv(1)

    def test_served_line_echoes(self):
        with running("tcp::0", echo=True) as server, connected(server) as master:
            master.sendall(ENQUIRY)
            assert received(master, len(ENQUIRY) + len(VALUE) + 1)[:-1] == ENQUIRY + VALUE

    def test_drives_receive_each_others_telegrams(self):
        """The reply of one drive, ending like a request to another, reaches that one as well."""
        with running("tcp::0", [virtual_drive("vabus", address, reply_delay_s=0.0) for address in (1, 2)]) as server:
            heard = []
            server.line._stations[1].hear = lambda data, *_: heard.append(data) or []
            with connected(server) as master:
                answer = answered(master)
            until = time.monotonic() + 5
            while len(heard) < 2 and time.monotonic() < until:
                time.sleep(0.001)
            assert heard == [ENQUIRY, answer]


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are of POSIX systems")
class TestPseudoTerminal:
    def ask(self, path, request=ENQUIRY):
        """Send a request as a program does that sets up nothing, and return the reply."""
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(descriptor, request)
            data = b""
            while len(data) < len(VALUE) + 1 and select.select([descriptor], [], [], 2)[0]:
                data += os.read(descriptor, 100)
            return data
        finally:
            os.close(descriptor)

    def test_link_to_the_terminal_exists_only_while_the_server_runs(self, tmp_path):
        path = tmp_path / "drive"
        with running(f"pty:{path}") as server:
            assert server.address == str(path)
            assert path.is_symlink()
            assert path.is_char_device()
        assert not path.is_symlink()

    def test_masters_open_and_close_the_terminal_repeatedly(self, tmp_path):
        with running(f"pty:{tmp_path / 'drive'}") as server:
            for _ in range(20):
                assert self.ask(server.address)[:-1] == VALUE

    def test_bytes_pass_the_terminal_unchanged(self, tmp_path):
        every = bytes(range(256)) + b"\x03\x04\x11\x13\r\n"
        with running(f"pty:{tmp_path / 'drive'}", [], echo=True) as server:
            descriptor = os.open(server.address, os.O_RDWR | os.O_NOCTTY)
            os.write(descriptor, every)
            got = b""
            while len(got) < len(every):
                assert select.select([descriptor], [], [], 5)[0]
                got += os.read(descriptor, 1000)
            os.close(descriptor)
        assert got == every

    def test_abandoned_link_is_replaced(self, tmp_path):
        path = tmp_path / "drive"
        path.symlink_to(tmp_path / "nowhere")
        with running(f"pty:{path}") as server:
            assert self.ask(server.address)[:-1] == VALUE

    def test_link_in_use_is_not_taken_over(self, tmp_path):
        path = tmp_path / "drive"
        with running(f"pty:{path}") as server:
            with pytest.raises(PortError, match=rf"{path} leads to /dev/.*, which another program serves; choose"):
                parse_listen(f"pty:{path}").open()
            assert self.ask(server.address)[:-1] == VALUE

    @named_python
    def test_link_in_use_error_names_the_serving_program(self, tmp_path):
        path = tmp_path / "drive"
        program = [sys.executable, "-m", "drivecomm", "simulate", "-d", "vabus:1", "-l", f"pty:{path}", "--json"]
        with subprocess.Popen(program, stdout=subprocess.PIPE) as simulator:
            simulator.stdout.readline()
            try:
                with pytest.raises(PortError, match=rf"which drivecomm simulate \(pid {simulator.pid}\) serves"):
                    parse_listen(f"pty:{path}").open()
            finally:
                simulator.kill()
        # The link is abandoned now.
        assert path.is_symlink()
        with running(f"pty:{path}") as server:
            assert self.ask(server.address)[:-1] == VALUE

    def test_serve_leaves_a_regular_file_in_place_of_the_link_alone(self, tmp_path):
        path = tmp_path / "drive"
        path.write_text("mine")
        with pytest.raises(PortError, match="exists and is not a symbolic link"):
            parse_listen(f"pty:{path}").open()
        assert path.read_text() == "mine"

    def test_link_in_a_missing_folder_is_refused(self, tmp_path):
        with pytest.raises(PortError, match="choose a path in an existing folder"):
            parse_listen(f"pty:{tmp_path / 'no' / 'drive'}").open()

    def test_link_replaced_by_another_program_is_not_removed(self, tmp_path):
        path = tmp_path / "drive"
        with running(f"pty:{path}"):
            path.unlink()
            path.symlink_to("/dev/null")
        assert path.readlink() == Path("/dev/null")

    @pytest.mark.soak
    def test_terminal_works_again_after_a_master_that_never_reads(self, tmp_path):
        with running(f"pty:{tmp_path / 'drive'}") as server:
            descriptor = os.open(server.address, os.O_RDWR | os.O_NOCTTY)
            for _ in range(200):
                os.write(descriptor, ENQUIRY * 10)
            tty.setraw(descriptor)
            os.close(descriptor)
            time.sleep(0.06)
            descriptor = os.open(server.address, os.O_RDWR | os.O_NOCTTY)
            while select.select([descriptor], [], [], 0.2)[0]:
                os.read(descriptor, 65536)
            os.close(descriptor)
            assert self.ask(server.address)[:-1] == VALUE


class TestRfc2217:
    def test_plain_client_without_settings_is_served(self):
        with running("rfc2217::0") as server, connected(server) as master:
            master.sendall(ENQUIRY)
            data = b""
            while not data.endswith(VALUE[-4:]) and VALUE not in data:
                data += master.recv(100)
            assert VALUE in data

    @pytest.mark.parametrize(
        "garbage",
        [
            IAC + b"\xf0",
            IAC + b"\xfa\x2c\x01" + IAC + b"\xf0",
            IAC + b"\xfa\x2c\x03\x63" + IAC + b"\xf0",
            IAC + b"\xfa" + b"A" * 1000,
        ],
        ids=["end without beginning", "baud rate without bytes", "parity that does not exist", "without end"],
    )
    def test_malformed_telnet_commands_do_not_disturb_the_next_master(self, garbage):
        with running("rfc2217::0") as server:
            with connected(server) as master:
                master.sendall(garbage)
                with_all = b""
                try:
                    while piece := master.recv(100):
                        with_all += piece
                except ConnectionResetError:
                    pass
            with connected(server) as master:
                master.sendall(ENQUIRY)
                data = b""
                while VALUE not in data:
                    data += master.recv(100)

    def test_random_bytes_do_not_break_the_rfc_2217_listener(self):
        noise = random.Random(5)
        listener = Rfc2217Listener("127.0.0.1", 0)
        listener.open()
        number = int(listener.address.rpartition(":")[2])
        for _ in range(200):
            with socket.create_connection(("127.0.0.1", number)) as master:
                listener.receive(1.0)
                master.sendall(
                    bytes(noise.choice(b"\xff\xfa\xf0\xfb\xfd\x2c\x00\x01\x02\x03\x05AB") for _ in range(80))
                )
                listener.receive(1.0)
            until = time.monotonic() + 5
            while listener._master is not None and time.monotonic() < until:
                listener.receive(0.1)
            assert listener._master is None
        listener.close()

    def test_impossible_line_setting_raises_value_error(self):
        port = PretendedPort()
        assert port.settings is None
        for name, value in (("baudrate", 1), ("bytesize", 5), ("parity", "X"), ("stopbits", 3)):
            with pytest.raises(ValueError, match="not"):
                setattr(port, name, value)
        port.baudrate, port.bytesize, port.parity, port.stopbits = 19200, 7, "E", 2
        assert str(port.settings) == "19200 7E2"
        assert (port.baudrate, port.bytesize, port.parity, port.stopbits) == (19200, 7, "E", 2)
        port.reset_input_buffer()
        port.reset_output_buffer()


class TestWaiting:
    """Waiting for several sockets together, as a server of lines does."""

    @pytest.fixture(params=["the system's own", "a plain one", "many descriptors"])
    def watched(self, request, monkeypatch):
        if request.param == "many descriptors":
            monkeypatch.setattr("drivecomm.virtual.waiting._MOST_DESCRIPTORS", 0)
        selector = selectors.SelectSelector() if request.param == "a plain one" else selectors.DefaultSelector()
        ours, theirs = socket.socketpair()
        with selector, ours, theirs:
            selector.register(ours, selectors.EVENT_READ, "ours")
            yield selector, theirs

    @pytest.mark.parametrize("seconds", [-1.0, 0.0, 0.0003, 0.0204])
    def test_wait_ends_when_its_time_is_over(self, watched, seconds):
        selector, _ = watched
        began = time.monotonic()
        # A wait in two steps returns in between.
        while time.monotonic() - began < seconds:
            assert ready_within(selector, seconds - (time.monotonic() - began)) == []
        assert ready_within(selector, 0.0) == []
        assert max(0.0, seconds) <= time.monotonic() - began < seconds + 2.0

    @pytest.mark.parametrize("seconds", [0.0, 0.0003, 60.0])
    def test_wait_ends_when_bytes_have_come(self, watched, seconds):
        selector, theirs = watched
        theirs.send(b"x")
        assert [key.data for key in ready_within(selector, seconds)] == ["ours"]
