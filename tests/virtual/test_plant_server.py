"""A plant in real time: many lines in one thread, with a control socket."""

import json
import socket
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from serving_threads import served_in_thread

import drivecomm
from drivecomm.errors import LinkDownError, NoReplyError, PortError, UsageError
from drivecomm.plant import Fault, Plant, PlantLine, PowerCutStep, TelegramFault
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import LONGEST_ORDER, ControlClient, PlantServer, VirtualPlant, parse_place
from drivecomm.virtual.control_socket import _MOST_CLIENTS

posix = pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets and pseudo-terminals are of POSIX systems")


@pytest.fixture(autouse=True)
def _nothing_left():
    threads = threading.active_count()
    descriptors = descriptors_open()
    yield
    assert threading.active_count() == threads
    assert descriptors_open() == descriptors


def descriptors_open():
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.exists() else 0


def plant_of(lines=1, listen="tcp::0", script=(), speed=1.0, **line):
    return VirtualPlant(
        Plant(
            lines=tuple(PlantLine(name=f"line {number}", listen=listen, **line) for number in range(lines)),
            drives=tuple(
                DriveConfig(
                    protocol="vabus",
                    address=address,
                    line=f"line {number}",
                    name=f"drive {number}-{address}",
                    options={"reply_delay_s": 0.0},
                )
                for number in range(lines)
                for address in (1, 2)
            ),
            script=script,
        ),
        speed=speed,
    )


@contextmanager
def running(plant=None, control="127.0.0.1:0"):
    with served_in_thread(PlantServer(plant or plant_of(paced=False), control=control)) as server:
        yield server


class TestLines:
    @pytest.mark.soak
    def test_one_thread_serves_many_lines(self):
        with running(plant_of(12, paced=True)) as server:
            buses = [drivecomm.open_bus(address) for address in server.addresses.values()]
            for _ in range(2):
                for bus in buses:
                    for address in (1, 2):
                        assert bus.drive("vabus", address).read("481").raw == "000003E8"
            for bus in buses:
                bus.close()

    @pytest.mark.soak
    def test_masters_connect_and_disconnect_on_every_line(self):
        with running(plant_of(3, paced=False)) as server:
            for _ in range(5):
                for address in server.addresses.values():
                    with drivecomm.open_bus(address) as bus:
                        bus.drive("vabus", 1).read("481")

    @pytest.mark.soak
    @posix
    def test_plant_serves_lines_of_all_kinds(self, tmp_path):
        plant = Plant(
            lines=(
                PlantLine(name="a", listen=f"pty:{tmp_path / 'a'}"),
                PlantLine(name="b", listen="tcp::0"),
                PlantLine(name="c", listen="rfc2217::0", paced=False),
            ),
            drives=tuple(DriveConfig(protocol="danfoss-fc", address=3, line=line, name=line) for line in "abc"),
        )
        with running(VirtualPlant(plant), control="") as server:
            assert server.control == ""
            for address in server.addresses.values():
                with drivecomm.open_bus(address) as bus:
                    assert bus.drive("danfoss-fc", 3).read("3-41")

    @pytest.mark.soak
    def test_fault_script_runs_in_real_time(self):
        script = (
            TelegramFault(line="line 0", kind=Fault.DROP, of="reply to a write", every=2),
            PowerCutStep(drive="drive 0-2", off_at_s=20, back_at_s=2000),
        )
        with (
            running(plant_of(script=script, speed=100.0, paced=False)) as server,
            drivecomm.open_bus(server.addresses["line 0"]) as bus,
        ):
            drive = bus.drive("vabus", 1, attempts=1, reply_timeout_s=0.1)
            drive.write("481", 1000, type="long")
            with pytest.raises(NoReplyError):
                drive.write("481", 1000, type="long")
            time.sleep(max(0.0, 0.25 - server.now()))
            with pytest.raises(NoReplyError):
                bus.drive("vabus", 2, attempts=1, reply_timeout_s=0.1).read("481")

    def test_line_without_a_listen_key_is_refused(self):
        with pytest.raises(UsageError, match="line line 0 has no listen key; set it to pty:PATH"):
            PlantServer(plant_of(listen=""))

    def test_address_in_use_is_refused_and_nothing_stays_open(self):
        with running() as server:
            taken = server.addresses["line 0"].rpartition(":")[2]
            lines = (PlantLine(name="a", listen="tcp::0"), PlantLine(name="b", listen=f"tcp::{taken}"))
            with pytest.raises(PortError, match=f"cannot listen at 127.0.0.1:{taken}"):
                PlantServer(VirtualPlant(Plant(lines=lines))).__enter__()
            with pytest.raises(PortError, match=f"cannot open the control socket at 127.0.0.1:{taken}"):
                PlantServer(plant_of(), control=f":{taken}").__enter__()

    @pytest.mark.soak
    def test_idle_plant_uses_no_processor_time(self):
        with running(plant_of(50)):
            before = time.process_time()
            time.sleep(0.4)
            assert time.process_time() - before < 0.08


class TestControl:
    def test_every_control_order_is_carried_out(self):
        plant = plant_of(paced=False)
        with running(plant) as server, ControlClient(server.control) as control:
            with drivecomm.open_bus(server.addresses["line 0"]) as bus:
                drive = bus.drive("vabus", 1, attempts=1, reply_timeout_s=0.1)
                assert control.order("set", drive="drive 0-1", parameter="481", value=1234) == {"value": "000004D2"}
                assert drive.read("481").raw == "000004D2"
                assert control.order("trip", drive="drive 0-1", code=5) == {}
                assert drive.status().fault
                state = control.order("show")["drives"][0]
                assert (state["name"], state["fault"], state["powered"]) == ("drive 0-1", 5, True)
                control.order("power", drive="drive 0-1", state="off")
                with pytest.raises(NoReplyError):
                    drive.read("481")
                control.order("power", drive="drive 0-1", state="on")
                assert drive.read("481").raw == "000004D2"
                control.order("power", drive="drive 0-1", state="factory")
                assert drive.read("481").raw == "000003E8"
                control.order("fault", text='drive = "drive 0-1"\nkind = "drop"')
                with pytest.raises(NoReplyError):
                    drive.read("481")
            assert control.order("show", drive="drive 0-1", parameters=["480", "481"])["values"]["481"] == "000003E8"

    def test_injected_bytes_reach_the_master_immediately(self):
        with running() as server, ControlClient(server.control) as control:
            host, _, port = server.addresses["line 0"].removeprefix("socket://").rpartition(":")
            with socket.create_connection((host, int(port)), timeout=5) as master:
                time.sleep(0.05)
                control.order("inject", line="line 0", data="68 65 6C 6C 6F")
                assert master.recv(10) == b"hello"

    @pytest.mark.parametrize(
        ("order", "sentence"),
        [
            (b"x", "an order is one JSON object"),
            (b"[1]", "an order is one JSON object"),
            (b"[" * 50_000, "an order is one JSON object"),
            (b"\xff\xfe", "an order is one JSON object"),
            (b"{}", "unknown order None; write one of trip, power, set"),
            ({"order": ["trip"]}, "unknown order ['trip']"),
            ({"order": "explode"}, "unknown order 'explode'"),
            ({"order": "trip", "drive": "drive 0-1"}, "the order trip needs code, a whole number"),
            ({"order": "trip", "drive": "drive 0-1", "code": "5"}, "invalid code '5' in the order trip"),
            ({"order": "trip", "drive": "drive 0-1", "code": True}, "invalid code True"),
            ({"order": "trip", "drive": "drive 0-1", "code": 0}, "fault code 0"),
            ({"order": "trip", "drive": "drive 9", "code": 5}, "there is no drive 'drive 9'"),
            ({"order": "show", "code": 5}, "unknown key 'code' in the order show"),
            ({"order": "power", "drive": "drive 0-1", "state": "half"}, "write one of on, off, factory"),
            ({"order": "set", "drive": "drive 0-1", "parameter": "999", "value": 1}, "999"),
            ({"order": "set", "drive": "drive 0-1", "parameter": "x", "value": 1}, "'x'"),
            ({"order": "inject", "line": "line 0", "data": "xy"}, "invalid bytes 'xy'"),
            ({"order": "inject", "line": "line 0", "data": ""}, "no bytes to inject"),
            ({"order": "fault", "text": "kind = 3"}, "the fault"),
            ({"order": "fault", "text": 'line = "yard"\nkind = "drop"'}, "there is no line 'yard'"),
            ({"order": "show", "drive": "drive 0-1", "parameters": ["999"]}, "999"),
        ],
    )
    def test_invalid_order_is_refused_and_the_plant_continues(self, order, sentence):
        text = order if isinstance(order, bytes) else json.dumps(order).encode()
        with running() as server:
            place = parse_place(server.control)
            with socket.create_connection((place.host, place.port), timeout=5) as guest:
                guest.sendall(text + b"\n\n" + b'{"order": "show"}\n')
                answers = guest.makefile("rb")
                refusal, shown = json.loads(answers.readline()), json.loads(answers.readline())
                answers.close()
            assert refusal["ok"] is False
            assert sentence in refusal["error"]
            assert "\n" not in refusal["error"]
            assert shown["ok"] is True

    def test_order_in_pieces_is_carried_out_and_an_endless_one_disconnected(self):
        with running() as server:
            place = parse_place(server.control)
            with socket.create_connection((place.host, place.port), timeout=5) as guest:
                for piece in (b'{"or', b'der": "sh', b'ow"}\n'):
                    guest.sendall(piece)
                    time.sleep(0.02)
                assert b'"ok": true' in guest.recv(100_000)
                with pytest.raises(ConnectionError):  # noqa: PT012 - either call may find the closed connection
                    for _ in range(20):
                        guest.sendall(b"x" * LONGEST_ORDER)
                        time.sleep(0.01)
                    if not guest.recv(1):
                        raise ConnectionError
            with ControlClient(server.control) as control:
                assert control.order("show")

    def test_control_socket_refuses_clients_beyond_its_limit(self):
        with running() as server:
            controls = [ControlClient(server.control) for _ in range(_MOST_CLIENTS)]
            for control in controls:
                control.order("show")
            one_more = ControlClient(server.control)
            with pytest.raises(LinkDownError):
                one_more.order("show")
            for control in [*controls, one_more]:
                control.close()
            shown = {}
            until = time.monotonic() + 5
            while not shown and time.monotonic() < until:
                with suppress(LinkDownError), ControlClient(server.control) as control:
                    shown = control.order("show")
            assert shown

    @pytest.mark.soak
    def test_control_client_that_never_reads_is_disconnected(self):
        with running(plant_of(50, paced=False)) as server:
            place = parse_place(server.control)
            with socket.create_connection((place.host, place.port), timeout=5) as guest:
                guest.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                with pytest.raises(OSError, match=r"."):  # noqa: PT012 - any of the calls may be the first to fail
                    for _ in range(2000):
                        guest.sendall(b'{"order": "show"}\n' * 10)
                        time.sleep(0.001)
            with ControlClient(server.control) as control:
                assert control.order("show")

    @posix
    def test_control_socket_is_a_unix_socket_and_removed_at_the_end(self, tmp_path):
        place = f"unix:{tmp_path / 'control'}"
        for _ in range(2):
            with running(control=place) as server:
                assert server.control == place
                with ControlClient(place) as control:
                    assert control.order("show")["speed"] == 1
            assert not (tmp_path / "control").exists()
        (tmp_path / "control").write_text("mine")
        with pytest.raises(PortError, match="exists and is not a socket"):
            PlantServer(plant_of(), control=place).__enter__()
        assert (tmp_path / "control").read_text() == "mine"
        with pytest.raises(PortError, match="cannot open the control socket"):
            PlantServer(plant_of(), control=f"unix:{tmp_path / 'no' / 'control'}").__enter__()

    @posix
    def test_abandoned_unix_socket_is_replaced(self, tmp_path):
        path = tmp_path / "control"
        left = socket.socket(socket.AF_UNIX)
        left.bind(str(path))
        left.close()
        with running(control=f"unix:{path}"), ControlClient(f"unix:{path}") as control:
            assert control.order("show")

    @posix
    def test_unix_socket_of_another_plant_is_not_taken_over(self, tmp_path):
        place = f"unix:{tmp_path / 'control'}"
        with running(control=place):
            with pytest.raises(PortError, match="another plant has its control socket at"):
                PlantServer(plant_of(), control=place).__enter__()
            with ControlClient(place) as control:
                assert control.order("show")

    @pytest.mark.parametrize("text", ["", "here", "host:", "host:x", "host:70000", "unix:"])
    def test_invalid_control_address_is_refused(self, text):
        with pytest.raises(UsageError, match=r"write HOST:PORT or unix:PATH|write unix:PATH"):
            parse_place(text)

    def test_control_address_defaults_to_the_loopback(self):
        assert str(parse_place(":4900")) == "127.0.0.1:4900"
        assert str(parse_place("[::1]:4900")) == "[::1]:4900"

    def test_control_client_without_a_plant_raises_port_error(self):
        with socket.create_server(("127.0.0.1", 0)) as door:
            place = f"127.0.0.1:{door.getsockname()[1]}"
        with pytest.raises(PortError, match=f"no plant at {place}"):
            ControlClient(place)

    def test_control_client_of_an_ended_plant_raises_link_down_error(self):
        with running() as server:
            control = ControlClient(server.control)
            control.order("show")
        with pytest.raises(LinkDownError, match="the plant at"):
            control.order("show")
        control.close()
