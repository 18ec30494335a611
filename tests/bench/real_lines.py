"""Virtual drives behind real ports, and a check for resources that tests leave behind."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from serving_threads import served_in_thread

import drivecomm
from drivecomm.virtual import Server, VirtualLine, parse_listen, virtual_drive

_DESCRIPTORS = Path("/proc/self/fd")
PATIENCE_S = 2.0


@pytest.fixture(autouse=True)
def nothing_left_behind():
    def left():
        return len(list(_DESCRIPTORS.iterdir())) if _DESCRIPTORS.exists() else 0

    # A thread of the previous test that is still stopping may end during this test.
    before, threads = left(), threading.enumerate()
    yield
    # A stopping thread may need some time to get the processor.
    for thread in threading.enumerate():
        if thread not in threads:
            thread.join(PATIENCE_S)
    assert [each for each in threading.enumerate() if each not in threads] == []
    assert left() == before


@contextmanager
def running(drives, listen, **options):
    """Serve drives in a thread until the block ends; yield the server."""
    with served_in_thread(Server(drives, parse_listen(listen), **options)) as server:
        yield server


@pytest.fixture
def serving(tmp_path, monkeypatch):
    """Return a function that serves drives until its block ends and yields the server."""
    monkeypatch.setattr("drivecomm.virtual.serving._TICK_S", 0.01)

    def serve(drives, kind="pty", **options):
        listen = {"pty": f"pty:{tmp_path / 'line'}"}.get(kind, f"{kind}:127.0.0.1:0")
        return running(drives, listen, **options)

    return serve


class Host:
    """Server of drives at one address, which can be restarted."""

    def __init__(self, kind, folder):
        self._listen = f"pty:{folder / 'line'}" if kind == "pty" else f"{kind}:127.0.0.1:0"
        self.died_at = 0.0

    def begin(self, drive):
        self._stop, begun = threading.Event(), threading.Event()

        def serve():
            with Server([drive], parse_listen(self._listen)) as self.server:
                begun.set()
                self.server.run(self._stop)
            self.died_at = time.monotonic()

        self._thread = threading.Thread(target=serve)
        self._thread.start()
        assert begun.wait(5)
        self.address = self.server.address
        if not self._listen.startswith("pty"):
            self._listen = f"{self._listen.rpartition(':')[0]}:{self.address.rpartition(':')[2]}"

    def end(self):
        self._stop.set()
        self._thread.join()


@pytest.fixture
def host_of(tmp_path, monkeypatch):
    monkeypatch.setattr("drivecomm.virtual.serving._TICK_S", 0.01)
    made = []

    def make(kind, drive):
        made.append(Host(kind, tmp_path))
        made[0].begin(drive)
        return made[0]

    yield make
    made[0].end()


class Example:
    """A virtual drive of a protocol, and a parameter that it certainly holds."""

    def __init__(self, plugin):
        self.protocol = plugin.name
        self.address = plugin.addresses[0]
        self.model = plugin.default_model
        self.parameter = self._parameter(plugin)

    def virtual(self, **options):
        return virtual_drive(self.protocol, self.address, model=self.model, **options)

    def on(self, bus, **options):
        return bus.drive(self.protocol, self.address, model=self.model, **options)

    def _parameter(self, plugin):
        virtual = self.virtual()
        with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
            drive = self.on(bus)
            for parameter in (*plugin.parameter_examples, *drive.model.parameters):
                try:
                    reading = drive.read(parameter)
                except drivecomm.DriveCommError:
                    continue
                if reading.raw == virtual.peek(parameter, 0.0):
                    return parameter
        raise AssertionError(f"the virtual {plugin.name} drive holds nothing that can be read")

    def __repr__(self):
        return self.protocol


PLUGINS = list(drivecomm.protocols().working())


@pytest.fixture(params=PLUGINS, ids=lambda plugin: plugin.name)
def example(request):
    return Example(request.param)


@pytest.fixture
def examples():
    """Return a drive of every protocol except WEG, whose requests are valid VABus requests as well."""
    return [Example(plugin) for plugin in PLUGINS if plugin.name != "weg"]
