"""The recorder in a separate process, which can be killed, and the content of its record."""

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
    """A record in an SQLite file."""

    def __init__(self, folder):
        self.url = str(folder / "record.sqlite")

    def all(self, question):
        with contextlib.closing(sqlite3.connect(self.url)) as connection:
            try:
                return connection.execute(question).fetchall()
            except sqlite3.OperationalError:
                # The tables are not created yet.
                return [(0, 0)]


class RecorderProcess:
    """A process of `drivecomm fleet record`, which can be started repeatedly."""

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
        """End the process; return its standard output and error."""
        if self.process is None:
            return "", ""
        if self.process.poll() is None:
            self.process.send_signal(number)
        said = self.process.communicate(timeout=30)
        self.process = None
        return said


@contextlib.contextmanager
def recording(broker, record, *options):
    """Run a recorder until the block ends; yield it."""
    one = RecorderProcess(broker, record, *options).start()
    try:
        yield one
    finally:
        one.kill()


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.1)


def settled(record, played, seconds=60.0):
    """Wait until the record has as many values and events as were published; return the final counts."""
    wanted = (played.published, played.events)
    end = time.monotonic() + seconds
    while (found := tuple(record.all(COUNTS)[0])) != wanted and time.monotonic() < end:
        time.sleep(0.2)
    return found, wanted


LONG = os.environ.get("DRIVECOMM_LONG") == "1"
