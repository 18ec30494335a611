"""A real server process for a plant whose virtual drives run in the test process."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager

from served_core import simulated

from drivecomm.client import LocalServer, server_of_plant
from drivecomm.plant import read_plant

PLANT = """\
format = 1
{head}
[[line]]
name = "yard"
listen = "{yard}"
paced = false
[[line]]
name = "hall"
listen = "{hall}"
paced = false
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "yard"
armed = true
options = {{ model = "fc302" }}
poll = [{{ parameters = ["output_frequency"], period_s = 0.1 }}]
link_loss = {{ policy = "ramp", watchdog_s = 1 }}
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
armed = true
options = {{ model = "agile" }}
link_loss = {{ policy = "trip", watchdog_s = 1 }}
{tail}
"""

QUICK = "[server]\nstatus_period_s = 0.1\n"


class Served:
    """A server process, its local socket, and the virtual drives of its plant."""

    def __init__(self, folder, control, environment):
        self.plant = folder / "plant.toml"
        self.folder = folder
        self.control = control
        self.environment = environment
        self.process = None
        self.log = folder / "server.log"

    def start(self, *options, program=("-m", "drivecomm")):
        self.end(signal.SIGKILL)
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, *program, "serve", str(self.plant), *options],
                env=self.environment, stdout=subprocess.PIPE, stderr=log, text=True, cwd=self.folder,
            )  # fmt: skip
        assert "stop with Ctrl-C" in self.process.stdout.readline(), self.log.read_text()
        return self

    def ask(self, path, content=None, method="POST"):
        found = server_of_plant(self.plant)
        assert found is not None, self.log.read_text()
        server = LocalServer(found)
        try:
            return server.ask(path) if content is None else server.order(path, content, method=method)
        finally:
            server.close()

    def drive(self, name):
        return self.ask(f"/api/v1/drives/{name}")

    def keep(self, name, seconds=30):
        """Start a motor under a lease; return the key of the lease."""
        self.until(lambda: self.drive(name)["reachability"] == "answers")
        key = self.ask(f"/api/v1/drives/{name}/lease", {"seconds": seconds})["key"]
        answer = self.ask(f"/api/v1/drives/{name}/keep", {"id": f"keep {name} {key}", "lease": key, "percent": 50})
        assert answer["outcome"] == "done", answer
        self.until(lambda: self.runs(name))
        return key

    def state(self, name):
        """Return the real state of a virtual drive."""
        return next(each for each in self.control.order("show")["drives"] if each["name"] == name)

    def runs(self, name):
        return self.state(name)["running"]

    def events(self, kind=None):
        return [each for each in self.ask("/api/v1/events") if kind in (None, each["kind"])]

    def until(self, condition, seconds=10.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, self.log.read_text()[-3000:]
            time.sleep(0.02)

    def end(self, number=signal.SIGTERM):
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(number)
            self.process.wait(20)
        if self.process is not None:
            self.process.stdout.close()


@contextmanager
def serving(folder, *, head=QUICK, tail="", start=True, **environment):
    """Serve a plant in a separate process; yield it."""
    file = folder / "plant.toml"
    file.write_text(PLANT.format(head=head, tail=tail, yard="tcp:127.0.0.1:0", hall="tcp:127.0.0.1:0"))
    with simulated(read_plant(file)) as (server, control):
        places = {name: f"tcp:{address.partition('://')[2]}" for name, address in server.addresses.items()}
        file.write_text(PLANT.format(head=head, tail=tail, **places))
        with server_of(folder, control, start=start, **environment) as one:
            yield one


@contextmanager
def server_of(folder, control, *, start=True, **environment):
    """Serve plant.toml of a folder in a separate process; yield it. control: control of its virtual drives."""
    state = folder / "state"
    state.mkdir()
    # The path of a unix socket has room for only about a hundred characters.
    runtime = tempfile.mkdtemp(prefix="dc")
    before = os.environ.get("XDG_RUNTIME_DIR")
    os.environ["XDG_RUNTIME_DIR"] = runtime
    one = Served(folder, control, {**os.environ, "STATE_DIRECTORY": str(state), **environment})
    try:
        yield one.start() if start else one
    finally:
        one.end(signal.SIGKILL)
        shutil.rmtree(runtime, ignore_errors=True)
        if before is None:
            del os.environ["XDG_RUNTIME_DIR"]
        else:
            os.environ["XDG_RUNTIME_DIR"] = before
