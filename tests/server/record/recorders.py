"""The recorder as a process of its own, which can be killed, and what is in its record."""

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import time

COUNTS = "SELECT (SELECT count(*) FROM value), (SELECT count(*) FROM event)"
TWICE = (
    "SELECT count(*) FROM (SELECT plant, drive, quantity, number FROM sample GROUP BY 1, 2, 3, 4 HAVING count(*) > 1) s"
)


class FileRecord:
    """A record in a file of SQLite."""

    def __init__(self, folder):
        self.url = str(folder / "record.sqlite")

    def all(self, question):
        with contextlib.closing(sqlite3.connect(self.url)) as connection:
            try:
                return connection.execute(question).fetchall()
            except sqlite3.OperationalError:
                # It is being made.
                return [(0, 0)]


class RecorderProcess:
    """`drivecomm fleet record`, as often as it is started."""

    def __init__(self, broker, record, *options):
        self._command = [
            *(sys.executable, "-m", "drivecomm", "fleet", "record"),
            *("--broker", broker, "--to", record, *options),
        ]
        self.process = None

    def start(self):
        self.process = subprocess.Popen(self._command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        return self

    def kill(self):
        self.end(signal.SIGKILL)

    def end(self, number=signal.SIGTERM):
        """End it; return what it has said."""
        if self.process is None:
            return "", ""
        if self.process.poll() is None:
            self.process.send_signal(number)
        said = self.process.communicate(timeout=30)
        self.process = None
        return said


@contextlib.contextmanager
def recording(broker, record, *options):
    """Run a recorder; yield it."""
    one = RecorderProcess(broker, record, *options).start()
    try:
        yield one
    finally:
        one.kill()


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it does not come about"
        time.sleep(0.1)


def settled(record, played, seconds=60.0):
    """Wait until the record has as many values and events as were published; return what it has in the end."""
    wanted = (played.published, played.events)
    end = time.monotonic() + seconds
    while (found := tuple(record.all(COUNTS)[0])) != wanted and time.monotonic() < end:
        time.sleep(0.2)
    return found, wanted


LONG = os.environ.get("DRIVECOMM_LONG") == "1"
