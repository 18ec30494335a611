"""A server with few file descriptors, and strangers that use up all of them: stops are sent, and lines reopen."""

import http.client
import json
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

import pytest
from hostile_peers import DOORS
from processes import PLANT, QUICK, server_of
from served_core import simulated

from drivecomm.plant import read_plant
from drivecomm.server import Role, User, add_user, token_hash

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no such limit")

DESCRIPTORS = 256
STRANGERS = 300
PROGRAM = f"""
import resource, runpy
resource.setrlimit(resource.RLIMIT_NOFILE, ({DESCRIPTORS}, {DESCRIPTORS}))
runpy.run_module("drivecomm", run_name="__main__")
"""


class Cable:
    """Proxy that carries a line until it is cut."""

    def __init__(self, port):
        self._to = port
        self._ends = []
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.mended()

    def mended(self):
        if self._listening.fileno() < 0:
            self._listening = socket.create_server(("127.0.0.1", self.port))
        threading.Thread(target=self._accept, args=(self._listening,), daemon=True).start()

    def cut(self):
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for each in self._ends:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    close = cut

    def _accept(self, listening):
        while True:
            try:
                master = listening.accept()[0]
            except OSError:
                return
            drives = socket.create_connection(("127.0.0.1", self._to))
            self._ends = [master, drives]
            for source, sink in (self._ends, self._ends[::-1]):
                threading.Thread(target=_carry, args=(source, sink), daemon=True).start()


def _carry(source, sink):
    with suppress(OSError):
        while data := source.recv(4096):
            sink.sendall(data)
    for each in (source, sink):
        with suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


@contextmanager
def limited_server(folder):
    """Yield a server with a low limit of open files, its ports by kind of door, and the cable of its line yard."""
    ports = {kind: free_port() for kind in ("http", "opcua", "modbus-tcp")}
    doors = "".join(DOORS[kind].format(port=port) for kind, port in ports.items())
    head = f'{doors}{QUICK}users = "users.toml"\n'
    add_user(folder / "users.toml", User(name="otto", role=Role.VIEW, token=token_hash("otto's")))
    file = folder / "plant.toml"
    file.write_text(PLANT.format(head=head, tail="", yard="tcp:127.0.0.1:0", hall="tcp:127.0.0.1:0"))
    with simulated(read_plant(file)) as (server, control):
        places = {name: int(address.rpartition(":")[2]) for name, address in server.addresses.items()}
        with closing(Cable(places["yard"])) as cable:
            yard, hall = f"tcp:127.0.0.1:{cable.port}", f"tcp:127.0.0.1:{places['hall']}"
            # The reply timeout is long, since threads of the test process carry the line and may be slow.
            patient = PLANT.replace('"fc302" ', '"fc302", reply_timeout_s = 2 ')
            file.write_text(patient.format(head=head, tail="", yard=yard, hall=hall))
            with server_of(folder, control, start=False) as one:
                yield one.start(program=("-c", PROGRAM)), ports, cable


def crowd(stack, ports):
    """Connect strangers to every door: some send nothing, some send one request, none disconnects."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
    says = {
        "http": b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        "modbus-tcp": bytes.fromhex("000000000006030400000001"),
    }
    for number in range(STRANGERS):
        for kind, port in ports.items():
            stranger = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=10))
            with suppress(ConnectionError):
                stranger.sendall(says.get(kind, b"") if number % 2 else b"")


def stop_over_http(port, drive):
    asking = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    with closing(asking):
        headers = {"Authorization": "Bearer otto's", "Content-Type": "application/json"}
        asking.request("POST", f"/api/v1/drives/{drive}/stop", json.dumps({"id": os.urandom(4).hex()}), headers)
        return json.loads(asking.getresponse().read())["outcome"]


def test_strangers_at_every_door_block_no_stop_and_no_reopening_of_a_line(tmp_path):
    with limited_server(tmp_path) as (served, ports, cable), ExitStack() as stack:
        served.keep("fan")
        served.keep("pump")
        crowd(stack, ports)
        assert served.runs("fan")
        assert served.runs("pump")
        began = time.monotonic()
        assert stop_over_http(ports["http"], "fan") == "done"
        assert time.monotonic() - began < 1
        served.until(lambda: not served.runs("fan"))
        stopped = subprocess.run(
            [sys.executable, "-m", "drivecomm", "stop", "pump", "--plant", str(served.plant)],
            env=served.environment, check=False, capture_output=True, text=True,
        )  # fmt: skip
        assert stopped.returncode == 0, stopped.stderr
        served.until(lambda: not served.runs("pump"))
        cable.cut()
        served.until(lambda: served.drive("fan")["reachability"] == "silent")
        cable.mended()
        served.until(lambda: served.drive("fan")["reachability"] == "answers")
        if sys.platform == "linux":
            assert len(list(Path(f"/proc/{served.process.pid}/fd").iterdir())) < DESCRIPTORS - 20
        assert "out of system resource" not in served.log.read_text()
