"""PostgreSQL in separate processes and a temporary folder, which can be killed and restarted."""

import contextlib
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path

import pytest

_FOUND = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"), key=lambda path: int(path.parts[-3]))
BINARIES = _FOUND[-1].parent if _FOUND else (Path(found).parent if (found := shutil.which("postgres")) else None)

try:
    import psycopg
except ImportError:
    psycopg = None

needs_postgres = pytest.mark.skipif(
    BINARIES is None or psycopg is None or os.name != "posix",
    reason="PostgreSQL (apt install postgresql) or psycopg, which it is tried with, is not installed",
)


class Postgres:
    """A server on a loopback port and a unix socket that accepts everybody."""

    def __init__(self):
        # The path of a socket must be shorter than about 100 characters, and readable by the user of the server.
        self.folder = Path(tempfile.mkdtemp(prefix="pg", dir="/tmp"))
        self._user = None
        if os.getuid() == 0:
            # PostgreSQL does not run as root.
            self._user = pwd.getpwnam("nobody")
            os.chown(self.folder, self._user.pw_uid, self._user.pw_gid)
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.url = f"postgresql://drivecomm@127.0.0.1:{self.port}/postgres"
        self.process = None
        self._run(BINARIES / "initdb", "-D", self._data, "-U", "drivecomm", "-A", "trust", "-E", "UTF8", "--no-sync")

    @property
    def _data(self):
        return self.folder / "data"

    def _owner(self):
        # The user `nobody` has neither our folder nor our groups.
        return {} if self._user is None else {"user": self._user.pw_uid, "group": self._user.pw_gid, "extra_groups": []}

    def _run(self, *command):
        subprocess.run(command, check=True, capture_output=True, cwd="/", **self._owner())

    def start(self):
        log = (self.folder / "log").open("ab")
        with log:
            self.process = subprocess.Popen(
                [BINARIES / "postgres", "-D", self._data, "-p", str(self.port), "-k", self.folder,
                 "-c", "listen_addresses=127.0.0.1", "-c", "max_wal_size=2GB"],
                stdout=log, stderr=log, cwd="/", **self._owner(),
            )  # fmt: skip
        end = time.monotonic() + 30
        while True:
            try:
                psycopg.connect(self.url, connect_timeout=2).close()
            except psycopg.OperationalError:
                assert self.process.poll() is None, (self.folder / "log").read_text()
                assert time.monotonic() < end, (self.folder / "log").read_text()
                time.sleep(0.05)
            else:
                return self

    def all(self, question, *values):
        with psycopg.connect(self.url, options="-c search_path=drivecomm,public") as connection:
            return connection.execute(question, values).fetchall()

    def kill(self):
        """Kill the server and all its child processes, without an orderly shutdown."""
        if self.process is not None and self.process.poll() is None:
            children = subprocess.run(
                ["ps", "-o", "pid=", "--ppid", str(self.process.pid)], capture_output=True, text=True, check=False
            ).stdout.split()
            for pid in (self.process.pid, *map(int, children)):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            self.process.wait(10)

    @contextlib.contextmanager
    def away(self):
        """Keep the server killed for the duration of the block."""
        self.kill()
        try:
            yield
        finally:
            self.start()


@contextlib.contextmanager
def postgres():
    """Run a server with an empty database; yield it."""
    server = Postgres()
    try:
        yield server.start()
    finally:
        server.kill()
        shutil.rmtree(server.folder, ignore_errors=True)
