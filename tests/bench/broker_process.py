"""Broker in a separate process on a loopback port, which can be killed and restarted at the same port."""

import contextlib
import signal
import socket
import subprocess
import time


class BrokerProcess:
    """A broker. log: file of its output. `command`, the command line to start it, is set by the creator."""

    def __init__(self, log):
        self.port = free_port()
        self.url = f"mqtt://127.0.0.1:{self.port}"
        self.log = log
        self.command = []
        self.process = None

    def start(self):
        """Start the broker, and wait until it listens."""
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
        """Kill the broker without an orderly shutdown."""
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait(10)

    @contextlib.contextmanager
    def away(self):
        """Keep the broker killed for the duration of the block."""
        self.end()
        try:
            yield
        finally:
            self.start()

    @contextlib.contextmanager
    def standing_still(self):
        """Suspend the broker for the duration of the block, with all connections open."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)


@contextlib.contextmanager
def running(broker):
    """Run a broker for the duration of the block; yield it."""
    try:
        yield broker.start()
    finally:
        broker.end()


def free_port():
    """Return an unused port."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]
