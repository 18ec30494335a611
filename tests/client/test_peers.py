"""Local sockets identify the user at their other end; tested with programs of two users on real sockets."""

import os
import socket
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from fake_server import serving

from drivecomm.cli import main
from drivecomm.client import check_peer, local_socket, may_command, peers, stop_door, user_of_peer
from drivecomm.errors import PortError
from drivecomm.plant import read_plant
from drivecomm.virtual import ControlClient, PlantServer, VirtualPlant

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="there are no Unix sockets")

NOBODY = 65534
as_root = pytest.mark.skipif(os.name == "posix" and os.getuid() != 0, reason="only root can be another user")

# Confirms every request, as a server would that has stopped everything.
IMPOSTOR = """
import os, socket, sys
os.setgid(65534); os.setuid(65534)
server = socket.socket(socket.AF_UNIX); server.bind(sys.argv[1]); server.listen()
print("listens", flush=True)
while True:
    guest, _ = server.accept()
    if b"/drives " in guest.recv(65536):
        body = b"[]"
    else:
        body = b'{"id": "", "outcome": "done", "result": null, "error": null}'
    try:
        guest.sendall(b"HTTP/1.1 200 OK\\r\\nContent-Length: %d\\r\\n\\r\\n" % len(body) + body)
    except ConnectionError:
        pass
    guest.close()
"""

GUEST = """
import os, socket, sys
os.setgid(65534); os.setuid(65534)
guest = socket.socket(socket.AF_UNIX); guest.settimeout(10); guest.connect(sys.argv[1])
try:
    guest.sendall(sys.argv[2].encode())
    print(guest.recv(1000).decode() or "closed")
except ConnectionError:
    print("closed")
"""


@pytest.fixture
def shared():
    """Create a folder with a short path in which all users can write."""
    with tempfile.TemporaryDirectory(prefix="dc") as name:
        Path(name).chmod(0o777)
        yield Path(name)


def test_user_of_the_other_end_is_known_and_may_command():
    ours, theirs = socket.socketpair(socket.AF_UNIX)
    with ours, theirs:
        assert user_of_peer(ours) == os.getuid()
        assert may_command(ours)
        check_peer(ours, "here")


def test_tcp_connection_has_no_user():
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as ours:
        assert not may_command(ours)
        with pytest.raises(PermissionError):
            check_peer(ours, "here")


def test_second_word_of_xucred_is_the_user(monkeypatch):
    """macOS and FreeBSD return `xucred`: version, user, groups."""

    class Connected:
        def getsockopt(self, level, option, size):
            assert (level, option) == (0, 1)
            return struct.pack("2I", 0, 501).ljust(size, b"\0")

    monkeypatch.delattr("socket.SO_PEERCRED", raising=False)
    monkeypatch.setattr(peers, "_LOCAL_PEERCRED", 1)
    assert user_of_peer(Connected()) == 501


@as_root
def test_stop_is_not_confirmed_by_another_users_program(plant, shared, capsys, monkeypatch):
    """The record is valid, but another user's program listens at its socket: the stop goes to the port."""
    shared.chmod(0o755)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(shared))
    with serving(plant) as server:
        for each in server.plants.values():
            each.close()
        place = local_socket(plant)
        place.unlink()
        # Lets the other user create the socket in this folder.
        place.parent.chmod(0o733)
        with impostor(place):
            place.parent.chmod(0o700)
            assert main(["stop", "pump", "--plant", str(plant)]) == 0
            said = capsys.readouterr()
            assert f"user {NOBODY}, neither this user nor root" in said.err
            assert "trying another way" in said.err
            assert main(["stop", "--all", "--plant", str(plant)]) == 0
            assert f"user {NOBODY}" in capsys.readouterr().err
            assert main(["read", "pump", "480", "--plant", str(plant)]) == 3


@as_root
def test_door_for_stops_refuses_requests_of_another_user(shared, monkeypatch, runtime_folder):
    came = []
    runtime_folder.mkdir(mode=0o700)
    monkeypatch.setattr("drivecomm.client.door_for_stops.holders_socket", lambda _: shared / "door.sock")
    with stop_door("/dev/ttyUSB9", "drivecomm poll", came.append, print):
        (shared / "door.sock").chmod(0o777)
        request = "POST /api/v1/lines/line/drives/vabus:1/stop HTTP/1.1\r\nContent-Length: 30\r\n\r\n"
        said = guest(shared / "door.sock", request + '{"arguments": {"how": "ramp"}}')
    assert "HTTP/1.1 403" in said
    assert came == []


@as_root
def test_control_socket_refuses_another_user_at_either_end(shared, tmp_path):
    file = tmp_path / "virtual.toml"
    file.write_text('format = 1\n[[line]]\nname = "hall"\nlisten = "tcp:127.0.0.1:0"\n[[drive]]\ndrive = "vabus:1"\n')
    place = shared / "control.sock"
    program = [sys.executable, "-m", "drivecomm", "simulate", str(file), "--control", f"unix:{place}"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            # Printed when the socket listens.
            assert "control at" in process.stdout.readline()
            place.chmod(0o777)
            assert guest(place, '{"order": "show"}\n') == "closed\n"
            with ControlClient(f"unix:{place}") as ours:
                assert ours.order("show")["drives"]
        finally:
            process.terminate()
            process.wait()
    with impostor(shared / "other.sock"), pytest.raises(PortError, match="neither this user nor root"):
        ControlClient(f"unix:{shared / 'other.sock'}")


def test_link_at_the_path_of_a_control_socket_is_not_followed(shared, tmp_path):
    (shared / "control.sock").symlink_to(tmp_path / "elsewhere.sock")
    file = tmp_path / "virtual.toml"
    file.write_text('format = 1\n[[line]]\nname = "hall"\nlisten = "tcp:127.0.0.1:0"\n[[drive]]\ndrive = "vabus:1"\n')
    plant = VirtualPlant(read_plant(file))
    with (
        pytest.raises(PortError, match="is not a socket"),
        PlantServer(plant, control=f"unix:{shared / 'control.sock'}"),
    ):
        pass


def guest(place, request):
    """Send a request to a socket as another user; return the answer."""
    done = subprocess.run(
        [sys.executable, "-c", GUEST, str(place), request], capture_output=True, text=True, check=True, timeout=30
    )
    return done.stdout


class impostor:  # noqa: N801 - used as a function
    """Program of another user that listens at a socket path."""

    def __init__(self, place):
        self._place = place

    def __enter__(self):
        self._process = subprocess.Popen(
            [sys.executable, "-c", IMPOSTOR, str(self._place)], stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout.readline() == "listens\n"

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()
