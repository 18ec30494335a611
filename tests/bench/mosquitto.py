"""Mosquitto as a process of its own, which can be killed, stopped and started again at the same port."""

import asyncio
import contextlib
import shutil
import signal
import socket
import subprocess
import time

import pytest

PROGRAM = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")

needs_mosquitto = pytest.mark.skipif(
    PROGRAM is None, reason="mosquitto, the broker that it is tried with, is not installed (apt install mosquitto)"
)


class Mosquitto:
    """A broker on a port of loopback. lines: more of its configuration."""

    def __init__(self, folder, *lines):
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.url = f"mqtt://127.0.0.1:{self.port}"
        self.log = folder / "mosquitto.log"
        self._settings = folder / "mosquitto.conf"
        said = ["allow_anonymous true"] if not any("allow_anonymous" in line for line in lines) else []
        # Debian's mosquitto gives up root for a user who may not read the folder of a test.
        self._settings.write_text("\n".join([f"listener {self.port} 127.0.0.1", "user root", *said, *lines]) + "\n")
        self.process = None

    def start(self):
        with self.log.open("ab") as log:
            self.process = subprocess.Popen([PROGRAM, "-c", str(self._settings), "-v"], stdout=log, stderr=log)
        end = time.monotonic() + 10
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
            except OSError:
                assert time.monotonic() < end, self.log.read_text()
                time.sleep(0.02)
            else:
                return self

    def end(self):
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait(10)

    @contextlib.contextmanager
    def away(self):
        """Be gone for the time of the block."""
        self.end()
        try:
            yield
        finally:
            self.start()

    @contextlib.contextmanager
    def standing_still(self):
        """Do nothing for the time of the block, with all connections open."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)


@contextlib.contextmanager
def mosquitto(folder, *lines):
    """Run a broker; yield it."""
    folder.mkdir(exist_ok=True)
    broker = Mosquitto(folder, *lines).start()
    try:
        yield broker
    finally:
        broker.end()


async def until(condition, seconds=10.0):
    """Wait until something holds. Raises TimeoutError."""
    async with asyncio.timeout(seconds):
        while not condition():  # noqa: ASYNC110 - it may be about anything
            await asyncio.sleep(0.01)
