"""Every protocol over real ports: pseudo-terminal, TCP, RFC 2217, and ser2net as a foreign serial server."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time

import pytest
from two_faces import each_face, open_on

import drivecomm
from drivecomm.protocol import LineSettings
from drivecomm.transport import Rfc2217Client, SerialPort
from drivecomm.virtual import virtual_drive

SER2NET = shutil.which("ser2net") or shutil.which("ser2net", path="/usr/sbin")
KINDS = ("pty", "tcp", "rfc2217")


@pytest.mark.soak
@each_face
@pytest.mark.parametrize("kind", KINDS)
def test_drive_is_read_over_every_kind_of_port(face, example, kind, serving):
    virtual = example.virtual()
    with serving([virtual], kind) as server, open_on(face, server.address) as bus:
        drive = example.on(bus)
        for _ in range(5):
            assert drive.read(example.parameter).raw == virtual.peek(example.parameter, server.now())
        counters = bus.counters[drive.name]
        assert counters["retries"] == 0
        assert counters["replies"] == counters["requests"]


@pytest.mark.soak
def test_rfc_2217_server_is_sent_only_changed_settings(serving, monkeypatch):
    asked, confirmed = [], Rfc2217Client._confirmed

    def note(self, items, limit_s):
        asked.append(sorted(item.name for item in items))
        confirmed(self, items, limit_s)

    with serving([], "rfc2217") as server:
        port = SerialPort(server.address)
        port.configure(LineSettings(baudrate=19200))
        monkeypatch.setattr(Rfc2217Client, "_confirmed", note)
        port.configure(LineSettings(baudrate=4800))
        port.configure(LineSettings(baudrate=4800, parity="E"))
        port.close()
    assert [names for names in asked if names] == [["baudrate"], ["parity"]]


@pytest.mark.soak
@each_face
@pytest.mark.parametrize("kind", KINDS)
def test_drives_of_all_protocols_share_a_real_line(face, examples, kind, serving):
    """Each drive has its own line settings; over RFC 2217 the server really changes them between two exchanges."""
    drives = [example.virtual() for example in examples]
    with serving(drives, kind) as server, open_on(face, server.address) as bus:
        for example, virtual in list(zip(examples, drives, strict=True)) * 3:
            reading = example.on(bus).read(example.parameter)
            assert reading.raw == virtual.peek(example.parameter, server.now())


def test_present_drive_is_written_and_a_silent_one_raises_no_reply_error(serving):
    with serving([virtual_drive("vabus", 3)]) as server, drivecomm.open_bus(server.address) as bus:
        drive = bus.drive("vabus", 3, model="agile")
        drive.write("fixed_frequency_2", "12.34")
        assert str(drive.read("481").value) == "12.34"
        with pytest.raises(drivecomm.NoReplyError):
            bus.drive("vabus", 4, attempts=1, reply_timeout_s=0.05).read("481", type="long")
        assert str(drive.read("481").value) == "12.34"


@each_face
def test_short_reply_timeout_is_kept_after_a_long_one(face, serving):
    with serving([virtual_drive("vabus", 1)]) as server, open_on(face, server.address) as bus:
        bus.drive("vabus", 1, reply_timeout_s=20.0).probe()
        began = time.monotonic()
        with pytest.raises(drivecomm.NoReplyError):
            bus.drive("vabus", 9, reply_timeout_s=0.1, attempts=1).probe()
        assert time.monotonic() - began < 5.0


def notes_of(address, **options):
    events = []
    with drivecomm.open_bus(address, trace=events.append, **options) as bus:
        bus.drive("vabus", 1).read("481", type="long")
    return [event.detail for event in events if event.what == "note"]


@pytest.mark.soak
def test_settings_that_a_port_cannot_carry_are_noted(serving):
    with serving([virtual_drive("vabus", 1)], "pty") as server:
        assert notes_of(server.address) == ["pseudo-terminal: 7E1 is not carried, characters pass as they are"]
        assert notes_of(server.address, bytesize=8, parity="N") == []
    with serving([virtual_drive("vabus", 1)], "tcp") as server:
        assert notes_of(server.address) == ["raw TCP: 19200 7E1 is not carried, the server has its own line settings"]
    with serving([virtual_drive("vabus", 1)], "rfc2217") as server:
        assert notes_of(server.address) == []


@pytest.mark.soak
@pytest.mark.parametrize("wrong", [{"baudrate": 9600}, {"bytesize": 8, "parity": "N"}], ids=["baud", "format"])
def test_line_settings_are_applied_over_rfc_2217(serving, wrong):
    with serving([virtual_drive("vabus", 1)], "rfc2217") as server, drivecomm.open_bus(server.address) as bus:
        right = bus.drive("vabus", 1)
        assert right.read("481", type="long").raw == "000003E8"
        with pytest.raises(drivecomm.ReplyError):
            bus.drive("vabus", 1, attempts=1, reply_timeout_s=0.05, **wrong).read("481", type="long")
        assert right.read("481", type="long").raw == "000003E8"


def test_line_settings_change_without_reopening_the_port():
    port = SerialPort("loop://")
    for settings in (LineSettings(), LineSettings(baudrate=19200, bytesize=7, parity="E", stopbits=2)):
        assert port.configure(settings) == ""
        port.write(b"\x00\xffabc")
        assert port.read(port.now() + 1, 5) == b"\x00\xffabc"
    port.close()


@each_face
def test_loop_port_is_a_line_with_echo_and_no_drive(face):
    with open_on(face, "loop://", echo=True, reply_timeout_s=0.02, attempts=2) as bus:
        drive = bus.drive("vabus", 1)
        with pytest.raises(drivecomm.NoReplyError):
            drive.read("481", type="long")
        assert bus.counters[drive.name]["echo bytes"] == 16


def test_drive_is_read_through_an_echoing_adapter(serving):
    with serving([virtual_drive("vabus", 1)], "tcp", echo=True) as server:
        bus = drivecomm.open_bus(server.address, echo=True)
        assert bus.drive("vabus", 1).read("481", type="long").raw == "000003E8"
        bus.close()


def test_paced_line_takes_its_wire_time(serving):
    with serving([virtual_drive("vabus", 1)], "tcp", paced=True) as server, drivecomm.open_bus(server.address) as bus:
        drive = bus.drive("vabus", 1, baudrate=19200)
        drive.read("481", type="long")
        began = time.monotonic()
        drive.read("481", type="long")
        # 8 characters of the request, a reply delay of 10 ms, and 20 characters of the reply.
        assert time.monotonic() - began >= drive.facts.settings.wire_s(28) + 0.010


class TestReading:
    """The read contract that the link relies on: at_least, until, and a time in the past."""

    @pytest.fixture(params=["pty", "tcp", "rfc2217", "loop"])
    def port(self, request, serving):
        if request.param == "loop":
            port = SerialPort("loop://")
            yield port
            port.close()
            return
        with serving([], request.param, echo=True) as server:
            port = SerialPort(server.address)
            port.configure(LineSettings())
            yield port
            port.close()

    def test_read_returns_as_soon_as_enough_bytes_have_arrived(self, port):
        port.write(b"abcde")
        began = port.now()
        assert port.read(began + 5, 5) == b"abcde"
        assert port.now() - began < 1

    def test_read_returns_at_its_time_with_the_bytes_so_far(self, port):
        port.write(b"abc")
        until = port.now() + 0.06
        assert port.read(until, 10) == b"abc"
        assert until <= port.now() < until + 0.2

    def test_read_until_a_past_time_does_not_wait(self, port):
        began = port.now()
        assert port.read(began - 1, 10) == b""
        assert port.read(began, 10) == b""
        assert port.now() - began < 0.2
        port.write(b"abc")
        assert port.read(port.now() + 1, 3) == b"abc"

    def test_all_byte_values_pass_in_pieces_of_any_length(self, port):
        every = bytes(range(256)) * 4
        port.write(every)
        got = b""
        while len(got) < len(every):
            piece = port.read(port.now() + 2, min(100, len(every) - len(got)))
            assert piece
            got += piece
        assert got == every

    def test_wait_ends_at_its_time_on_a_real_port(self, port):
        until = port.now() + 0.02
        port.wait(until)
        assert until <= port.now() < until + 0.2
        port.wait(until - 1)


@pytest.fixture
def ser2net(tmp_path):
    """Yield a function that starts ser2net in front of a terminal and returns the URL of its raw or RFC 2217 port."""
    if SER2NET is None:
        pytest.skip("ser2net is not installed (apt-get install ser2net)")
    running = []

    def start(terminal, kind):
        with socket.create_server(("127.0.0.1", 0)) as free:
            number = free.getsockname()[1]
        accepter = {"socket": "tcp", "rfc2217": "telnet(rfc2217),tcp"}[kind]
        settings = tmp_path / f"{kind}.yaml"
        settings.write_text(
            "%YAML 1.1\n---\nconnection: &drives\n"
            f"  accepter: {accepter},127.0.0.1,{number}\n"
            f"  connector: serialdev,{terminal},9600n81,local\n"
        )
        running.append(
            subprocess.Popen(
                [SER2NET, "-n", "-c", str(settings), "-P", str(tmp_path / f"{kind}.pid")],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        return f"{kind}://127.0.0.1:{number}"

    yield start
    for process in running:
        process.terminate()
        process.wait(5)


def opened_when_it_listens(url, **options):
    until = time.monotonic() + 5
    while True:
        try:
            return drivecomm.open_bus(url, **options)
        except drivecomm.PortError as error:
            if "nothing listens" not in str(error) or time.monotonic() > until:
                raise
            time.sleep(0.01)


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["socket", "rfc2217"])
def test_drives_are_read_through_ser2net(kind, examples, serving, ser2net):
    drives = [example.virtual() for example in examples]
    with serving(drives) as server:
        url = ser2net(server.address, kind)
        with opened_when_it_listens(url) as bus:
            for example, virtual in list(zip(examples, drives, strict=True)) * 2:
                reading = example.on(bus).read(example.parameter)
                assert reading.raw == virtual.peek(example.parameter, server.now())


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["socket", "rfc2217"])
def test_ser2net_in_use_refuses_a_second_client(kind, serving, ser2net):
    with serving([virtual_drive("vabus", 1)]) as virtual:
        url = ser2net(virtual.address, kind)
        with opened_when_it_listens(url) as bus:
            bus.drive("vabus", 1).probe()
            with pytest.raises(drivecomm.PortError, match="is in use by another program or machine"):
                drivecomm.open_bus(url)
            bus.drive("vabus", 1).probe()
