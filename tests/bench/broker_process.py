"""A broker as a process of its own on a port of loopback, which can be killed and started again at the same port."""

import contextlib
import signal
import socket
import subprocess
import time


class BrokerProcess:
    """A broker. log: the file of what it prints. `command` starts it; whoever makes it says which."""

    def __init__(self, log):
        self.port = free_port()
        self.url = f"mqtt://127.0.0.1:{self.port}"
        self.log = log
        self.command = []
        self.process = None

    def start(self):
        """Start it, and wait until it listens."""
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(self.command, stdout=log, stderr=log)
        end = time.monotonic() + 20
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
            except OSError:
                assert time.monotonic() < end, self.log.read_text()
                time.sleep(0.02)
            else:
                return self

    def end(self):
        """Kill it without an orderly end."""
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
def running(broker):
    """Run a broker for the time of the block; yield it."""
    try:
        yield broker.start()
    finally:
        broker.end()


def free_port():
    """Return a port that nobody has."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]
