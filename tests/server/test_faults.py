"""Failures around a server: clients, the disk, ports and the clock, each with its outcome."""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import pairwise
from pathlib import Path

import pytest
from processes import QUICK, server_of, serving
from served_core import simulated

from drivecomm.client import server_of_plant
from drivecomm.plant import read_plant
from drivecomm.server.history import History

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals, mounts and terminals are POSIX's")

# A client process that prints the arrival time of each piece of a stream.
LISTENER = """
import socket, sys, time
connected = socket.socket(socket.AF_UNIX)
connected.connect(sys.argv[1])
connected.sendall(b"GET /api/v1/stream HTTP/1.1\\r\\nHost: localhost\\r\\n\\r\\n")
while data := connected.recv(1 << 16):
    sys.stdout.write(f"{time.monotonic()} {len(data)}\\n")
    sys.stdout.flush()
"""


@contextmanager
def listening(served):
    """Yield the process of a client that reads a stream, after it has received the first piece."""
    socket = server_of_plant(served.plant).socket
    with subprocess.Popen([sys.executable, "-c", LISTENER, socket], stdout=subprocess.PIPE, text=True) as client:
        try:
            assert client.stdout.readline()
            yield client
        finally:
            client.kill()


def goes_on(served, name, seconds=5.0):
    """Wait until a drive has answered twice more."""
    for _ in range(2):
        before = served.drive(name)["answered_s"]
        served.until(lambda before=before: served.drive(name)["answered_s"] != before, seconds)


def memory_mib(process):
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class TestClients:
    @pytest.mark.soak
    def test_killed_stream_client_does_not_affect_others(self, tmp_path):
        with serving(tmp_path) as served:
            served.keep("fan")
            with listening(served) as client, listening(served) as other:
                client.kill()
                goes_on(served, "pump")
                assert served.runs("fan")
                assert other.poll() is None
                assert float(other.stdout.readline().split()[0])
            assert served.ask("/api/v1/drives/fan/stop", {"id": "1"})["outcome"] == "done"

    @pytest.mark.soak
    @pytest.mark.parametrize("seconds", [2, pytest.param(40, marks=pytest.mark.soak)])
    def test_suspended_client_gets_the_latest_values_and_fills_no_memory(self, tmp_path, seconds):
        with serving(tmp_path) as served, listening(served) as client:
            goes_on(served, "fan")
            before = memory_mib(served.process)
            client.send_signal(signal.SIGSTOP)
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                goes_on(served, "fan")
                time.sleep(0.1)
            assert memory_mib(served.process) < before + 8
            client.send_signal(signal.SIGCONT)
            # Buffered pieces come first; then a newer one has to follow.
            after = time.monotonic()
            while line := client.stdout.readline():
                if float(line.split()[0]) >= after + 0.5:
                    return
            # A client that does not read for 30 s is disconnected.
            assert seconds > 30


@pytest.fixture
def small_disk(tmp_path):
    """Yield the folder of a mounted disk of 3 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(place)]
    if sys.platform != "linux" or os.getuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root on Linux can mount a disk for the test")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def fill(path):
    with suppress(OSError), path.open("wb", buffering=0) as filling:
        while True:
            filling.write(bytes(1024))


@pytest.mark.soak
def test_full_disk_delays_no_poll_or_stop_and_writing_resumes(tmp_path, small_disk):
    head = QUICK + f'audit = "{small_disk}/audit.jsonl"\nhistory = {{ file = "{small_disk}/history.sqlite" }}\n'
    with serving(tmp_path, head=head) as served:
        served.keep("fan")
        full = small_disk / "full"
        fill(full)
        # A few more records fill the rest of the last page.
        orders = (served.ask("/api/v1/drives/pump/reset", {"id": f"{number}"}) for number in range(1000))
        refused = next(answer for answer in orders if answer["outcome"] == "refused")
        assert "audit record cannot be written" in refused["error"]["text"]
        assert "No space left" in refused["error"]["text"]
        served.until(lambda: any("the history is not written from" in each["text"] for each in served.events()), 30)
        goes_on(served, "fan")
        assert served.runs("fan")
        assert served.ask("/api/v1/drives/fan/stop", {"id": "stop"})["outcome"] == "done"
        served.until(lambda: not served.runs("fan"))
        written = len(list(small_disk.iterdir()))
        full.unlink()
        served.until(lambda: served.ask("/api/v1/drives/pump/reset", {"id": ""})["outcome"] != "refused")
        served.until(lambda: any("writing the history has resumed" in each["text"] for each in served.events()), 20)
        assert written >= 2
        served.end()
        assert served.process.returncode == 0
        with History(small_disk / "history.sqlite") as history:
            times = [each.time_s for each in history.values("fan", "output_frequency") if each.value is not None]
            texts = [each.event.text for each in history.events("fan")]
        # Values of that time were buffered and are written afterwards.
        assert max(later - earlier for earlier, later in pairwise(times)) < 5
        assert any("stop" in text for text in texts)


LINES = {
    "yard": """\
[[line]]
name = "yard"
{place}
paced = false
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "yard"
armed = true
options = {{ model = "fc302" }}
link_loss = {{ policy = "ramp", watchdog_s = 10 }}
""",
    "hall": """\
[[line]]
name = "hall"
{place}
paced = false
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
poll = [{{ parameters = ["output_frequency"], period_s = 0.1 }}]
options = {{ model = "agile" }}
""",
}


@contextmanager
def line_alone(folder, name, listen):
    """Serve a single virtual line; yield its address, and the control of its drives."""
    file = folder / f"{name}.toml"
    file.write_text("format = 1\n" + LINES[name].format(place=f'listen = "{listen}"'))
    with simulated(read_plant(file)) as (server, control):
        yield server.addresses[name], control


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["pty", pytest.param("tcp", marks=pytest.mark.soak)])
def test_unplugged_port_does_not_affect_the_other_line(tmp_path, kind):
    """The port is a terminal whose other end and name disappear for a while, or a serial server that does."""
    listen = f"pty:{tmp_path / 'ttyUSB7'}" if kind == "pty" else "tcp:127.0.0.1:0"
    with line_alone(tmp_path, "yard", "tcp:127.0.0.1:0") as (yard, control), ExitStack() as plugged:
        hall, _ = plugged.enter_context(line_alone(tmp_path, "hall", listen))
        again = listen if kind == "pty" else f"tcp:{hall.partition('://')[2]}"
        ports = {"yard": f'port = "{yard}"', "hall": f'port = "{hall.removeprefix("pty:")}"'}
        text = "".join(LINES[name].format(place=place) for name, place in ports.items())
        (tmp_path / "plant.toml").write_text("format = 1\n" + QUICK + text)
        with server_of(tmp_path, control) as served:
            served.until(lambda: served.drive("pump")["reachability"] == "answers")
            served.keep("fan")
            plugged.close()
            served.until(lambda: served.drive("pump")["reachability"] == "silent", 20)
            served.until(lambda: not of_pump(served) or of_pump(served)["quality"] == "bad")
            assert not next(each for each in served.ask("/api/v1/plant")["lines"] if each["name"] == "hall")["up"]
            goes_on(served, "fan", 1)
            assert served.runs("fan")
            assert served.drive("fan")["counters"].get("timeouts", 0) == 0
            began = time.monotonic()
            assert served.ask("/api/v1/drives/fan/stop", {"id": "1"})["outcome"] == "done"
            assert time.monotonic() - began < 1
            plugged.enter_context(line_alone(tmp_path, "hall", again))
            served.until(lambda: served.drive("pump")["reachability"] == "answers", 40)
            served.until(lambda: of_pump(served)["quality"] != "bad")
            served.until(lambda: not served.runs("fan"), 3)


def of_pump(served):
    values = served.ask("/api/v1/values")
    return next((each for each in values if (each["drive"], each["name"]) == ("pump", "output_frequency")), None)


# Python imports this module before any other. libfaketime is unsuitable: it also shifts the kernel timers of a port,
# which setting the clock does not.
CLOCK = """
import time
from pathlib import Path

def away_s():
    return float(Path({file!r}).read_text() or 0)

def shifted(real=time.time):
    return real() + away_s()

time.time = shifted
"""


@pytest.mark.soak
def test_setting_the_clock_extends_no_lease_and_starts_no_motor(tmp_path):
    clock = tmp_path / "clock"
    clock.write_text("0")
    (tmp_path / "sitecustomize.py").write_text(CLOCK.format(file=str(clock)))
    head = QUICK + 'history = { file = "history.sqlite" }\n'
    with serving(tmp_path, head=head, PYTHONPATH=str(tmp_path)) as served:
        for away_s in (-3600, 86400):
            key = served.keep("fan", seconds=3)
            clock.write_text(str(away_s))
            assert abs(float(served.ask("/api/v1/plant")["time_s"]) - time.time() - away_s) < 60
            renewed = served.ask("/api/v1/drives/fan/lease", {"key": key, "seconds": 2}, method="PUT")
            assert abs(float(renewed["until_s"]) - time.time() - away_s - 2) < 2
            began = time.monotonic()
            goes_on(served, "pump")
            assert served.runs("fan")
            served.until(lambda: served.drive("fan")["kept"] == "", 5)
            assert 1 < time.monotonic() - began < 4
            served.until(lambda: not served.runs("fan"))
            goes_on(served, "fan")
            served.until(lambda: not served.runs("fan"), 3)
            assert of_fan(served)["quality"] != "bad"
        numbers = [each["number"] for each in served.events()]
        assert numbers == sorted(numbers)
        served.end()
    with closing(History(tmp_path / "history.sqlite")) as history:
        written = [each.event.number for each in history.events()]
        values = [each.row for each in history.values("fan", "output_frequency")]
    assert set(written) >= set(numbers)
    assert written == sorted(written)
    assert values == sorted(values)
    assert len(values) > 20


def of_fan(served):
    values = served.ask("/api/v1/values")
    return next(each for each in values if (each["drive"], each["name"]) == ("fan", "output_frequency"))
