"""Stops that reach the program holding the port: it releases its kept motor, or stops another drive over its bus."""

import asyncio
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
from serving_threads import served_in_thread

import drivecomm
from drivecomm.bus import keep, read_watchdog
from drivecomm.cli import main
from drivecomm.cli.stop.safe_lookups import SafeLookups
from drivecomm.cli.stop.stop_ways import StopWays
from drivecomm.cli.stops_from_others import StopsFromOthers
from drivecomm.client import StopOrder, holders_of_port, stop_door
from drivecomm.errors import DriveError, NotSupported, ReplyError, UsageError
from drivecomm.plant.watching import WatchedLine, Watcher
from drivecomm.protocol import DriveConfig, Stop
from drivecomm.virtual import Server, parse_listen, virtual_drive

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")

FAN = ("danfoss-fc:3", {"model": "fc300"})
PUMP = ("vabus:1", {"model": "agile"})


@pytest.fixture(autouse=True)
def folder(monkeypatch):
    """Make a runtime folder with a short path, as Unix sockets need; yield its subfolder drivecomm."""
    path = Path(tempfile.mkdtemp(prefix="dc"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(path))
    yield path / "drivecomm"
    shutil.rmtree(path)


class Line:
    """Served line with a pump and a fan; `run_kept` starts the pump and keeps its motor until a stop comes."""

    def __init__(self, path):
        self.pump = virtual_drive("vabus", 1, model="agile", reply_delay_s=0.0)
        self.fan = virtual_drive("danfoss-fc", 3, model="fc300", reply_delay_s=0.0)
        self.server = Server([self.pump, self.fan], parse_listen(f"pty:{path}"))
        self.port = str(path)
        self.left_by = []
        self.fails = None
        self.options = {"model": "agile"}

    def run_kept(self, started):
        end, stops = threading.Event(), StopsFromOthers("drivecomm start")
        with drivecomm.open_bus(self.port) as bus, stops.over(self.port, bus):
            pump = bus.drive("vabus", 1, **self.options)
            kept = keep(pump, "trip", watchdog_s=5)

            def leave(how):
                self.left_by.append(how)
                kept.stop_by(how)
                end.set()

            self.end = end
            with stops.ended_by(pump.name, leave), kept:
                pump.set_reference(percent=30)
                pump.start()
                started.set()
                end.wait(10)
                if self.fails:
                    raise self.fails
            self.watchdog = str(read_watchdog(pump))


@pytest.fixture
def line(tmp_path):
    one = Line(tmp_path / "line")
    with served_in_thread(one.server):
        yield one


@contextmanager
def held(line):
    started = threading.Event()

    def run():
        try:
            line.run_kept(started)
        except drivecomm.DriveCommError as error:
            line.error = error

    thread = threading.Thread(target=run)
    thread.start()
    assert started.wait(10)
    try:
        yield
    finally:
        line.end.set()
        thread.join()


def stopping_program(port, whom, how=Stop.RAMP):
    """Return the program that has stopped the drive, or None if no program could."""
    drive, options = whom if isinstance(whom, tuple) else (whom, {})
    return StopWays(port, SafeLookups(as_json=False)).stopped_by(drive, how, lambda _: options)


def test_stop_of_the_kept_drive_ends_its_command_and_restores_the_watchdog(line, folder):
    with held(line):
        assert str(stopping_program(line.port, PUMP)) == f"drivecomm start (pid {os.getpid()})"
        assert line.left_by == [Stop.RAMP]
    assert line.watchdog == "off"
    assert list(folder.iterdir()) == []


def test_stop_of_another_drive_goes_over_the_bus_of_the_command(line, folder):
    with held(line):
        assert stopping_program(line.port, FAN, how=Stop.QUICK)
        assert stopping_program(line.port, "danfoss-fc:*")
        assert not line.end.is_set()
        assert {each.suffix for each in folder.iterdir()} == {".json", ".sock"}
        assert {each.stat().st_mode & 0o777 for each in folder.iterdir()} == {0o600}
        assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("whom", ["vabus:*", "*:*"])
def test_stop_of_all_ends_the_kept_drive_too(line, whom):
    with held(line):
        assert stopping_program(line.port, whom)
        assert line.end.is_set()


def test_kind_of_stop_that_the_drive_lacks_is_refused_and_ends_nothing(line):
    with held(line):
        with pytest.raises(NotSupported):
            stopping_program(line.port, PUMP, how=Stop.DC_BRAKE)
        assert stopping_program(line.port, FAN, how=Stop.DC_BRAKE)
        assert not line.end.is_set()


def test_silent_drive_and_invalid_address_raise_the_errors_of_a_bus(line):
    with held(line):
        with pytest.raises(ReplyError, match="did not answer"):
            stopping_program(line.port, ("vabus:7", {"reply_timeout_s": 0.02, "attempts": 1}))
        with pytest.raises(UsageError):
            stopping_program(line.port, "vabus:99")


def test_stop_is_confirmed_although_its_command_fails_afterwards(line):
    line.fails = DriveError("it jammed")
    with held(line):
        assert stopping_program(line.port, PUMP)


def test_stop_before_the_drive_is_kept_prevents_its_start(line):
    stops, left_by = StopsFromOthers("drivecomm start"), []
    with drivecomm.open_bus(line.port) as bus, stops.over(line.port, bus):
        assert stopping_program(line.port, PUMP)
        with stops.ended_by("danfoss-fc:3", left_by.append) as asked_to_stop:
            assert not asked_to_stop.is_set()
        with stops.ended_by("vabus:1", left_by.append) as asked_to_stop:
            assert asked_to_stop.is_set()
    assert left_by == [Stop.RAMP]


@pytest.mark.soak
def test_stop_of_a_silent_kept_drive_is_not_confirmed(line):
    line.options["attempts"] = 1
    with held(line):
        line.pump.hear = lambda *_: None
        with pytest.raises(ReplyError):
            stopping_program(line.port, PUMP)


def test_program_is_found_by_any_name_of_its_port(line):
    with held(line):
        assert stopping_program(os.path.realpath(line.port), FAN)


STOP = b"POST /api/v1/lines/line/drives/vabus:1/stop HTTP/1.1\r\n%s"


@pytest.mark.parametrize(
    "request_text",
    [
        b"nonsense\r\n\r\n",
        b"POST /api/v1/lines/line/drives/vabus:1/start HTTP/1.1\r\nContent-Length: 2\r\n\r\n{}",
        b"POST /api/v1/lines/line/drives/vabus:1/stop HTTP/1.1\r\nContent-Length: 2\r\n\r\n{}",
        STOP % b'Content-Length: 31\r\n\r\n{"arguments": {"how": "never"}}',
        STOP.replace(b":1", b":x") % b'Content-Length: 30\r\n\r\n{"arguments": {"how": "ramp"}}',
        b"POST /api/v1/stop HTTP/1.1\r\nContent-Length: 2\r\n\r\n{}",
        b"POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
        b"x" * 100_000,
        b"a: b\r\n" * 1000,
        b"",
    ],
)
def test_malformed_request_stops_nothing_and_the_door_stays_open(line, request_text):
    with held(line):
        ((program, _),) = holders_of_port(line.port)
        with socket.socket(socket.AF_UNIX) as guest:
            guest.settimeout(5)
            guest.connect(program.socket)
            try:
                guest.sendall(request_text)
                guest.shutdown(socket.SHUT_WR)
                while guest.recv(1000):
                    pass
            except ConnectionError:
                # The door closes the connection of a client that sends too much.
                pass
        assert not line.end.is_set()
        assert stopping_program(line.port, FAN)


def test_missing_or_killed_program_is_not_contacted(folder):
    assert stopping_program("/dev/ttyUSB9", FAN) is None
    script = (
        "import os, time; from drivecomm.client import stop_door; door = stop_door('/dev/ttyUSB9', 'x', print, print);"
        "door.__enter__(); print('open', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as killed:
        assert killed.stdout.readline() == "open\n"
        assert len(list(holders_of_port("/dev/ttyUSB9"))) == 1
        killed.kill()
        killed.wait()
    assert list(holders_of_port("/dev/ttyUSB9")) == []
    assert len(list(folder.iterdir())) == 2
    # The next program removes the files of the killed one.
    with stop_door("/dev/ttyUSB8", "x", print, print):
        assert {each.name.partition("-")[0] for each in folder.iterdir()} == {str(os.getpid())}


def test_stop_goes_over_the_awaited_bus_of_a_watcher(line, folder):
    """As in `watch`, the stop is awaited in the event loop that polls, while another thread requests it."""
    with drivecomm.open_bus(line.port) as bus:
        fan = bus.drive("danfoss-fc", 3, model="fc300")
        fan.set_reference(percent=30)
        fan.start()
    drive = DriveConfig(protocol="danfoss-fc", address=3, options={"model": "fc300"}, name="fan")
    watched = WatchedLine(name="hall", port=line.port, drives=(drive,))

    async def watch():
        async with Watcher([watched], period_s=0.05, holding=StopsFromOthers("drivecomm watch").over_async) as watcher:
            polling = asyncio.create_task(watcher.run())
            try:
                return await asyncio.to_thread(stopping_program, line.port, FAN, Stop.COAST)
            finally:
                polling.cancel()
                await asyncio.gather(polling, return_exceptions=True)

    assert str(asyncio.run(watch())) == f"drivecomm watch (pid {os.getpid()})"
    assert not line.fan.motor.running
    assert list(folder.iterdir()) == []


def test_program_that_hangs_is_named_and_left_alone(capsys, monkeypatch):
    monkeypatch.setattr("drivecomm.client.stopping._ALIVE_S", 0.05)
    release = threading.Event()

    def hang(_door, connected):
        with connected:
            release.wait(10)

    monkeypatch.setattr("drivecomm.client.door_for_stops._Door._serve", hang)
    with stop_door("/dev/ttyUSB9", "drivecomm poll", print, print):
        assert stopping_program("/dev/ttyUSB9", FAN) is None
        release.set()
    assert f"drivecomm poll (pid {os.getpid()}) does not answer" in capsys.readouterr().err


def test_command_continues_with_a_note_if_its_door_cannot_be_opened(line, folder, capsys):
    folder.mkdir()
    folder.chmod(0o777)
    with held(line):
        said = capsys.readouterr().err
        assert "a stop from another program will not get through to this one" in said
        assert "not private to this user" in said


def test_programming_error_in_a_stop_is_reported_and_confirms_nothing():
    def fall(_: StopOrder):
        raise ZeroDivisionError

    with stop_door("/dev/ttyUSB9", "x", fall, print), pytest.raises(drivecomm.DriveCommError, match="ZeroDivision"):
        stopping_program("/dev/ttyUSB9", FAN)


def test_door_without_unix_sockets_needs_the_token_of_the_record(line, folder, monkeypatch):
    monkeypatch.setattr("drivecomm.client.door_for_stops._HAS_UNIX_SOCKETS", False)
    with held(line):
        assert stopping_program(line.port, FAN)
        ((program, _),) = holders_of_port(line.port)
        with socket.create_connection(("127.0.0.1", program.port), timeout=5) as stranger:
            stranger.sendall(b"POST /api/v1/lines/line/drives/vabus:1/stop HTTP/1.1\r\nContent-Length: 2\r\n\r\n{}")
            assert stranger.recv(1000).startswith(b"HTTP/1.1 403")
        assert not line.end.is_set()
    assert list(folder.iterdir()) == []


def test_command_that_needs_the_port_itself_ends_for_a_stop(monkeypatch, capsys):
    interrupted = threading.Event()
    monkeypatch.setattr("drivecomm.cli.signals.interrupt_main_thread", interrupted.set)
    with StopsFromOthers("drivecomm doctor").make_way("/dev/ttyUSB9"):
        assert stopping_program("/dev/ttyUSB9", FAN) is None
    assert interrupted.is_set()
    assert "drivecomm doctor exits, because its port is needed for a stop" in capsys.readouterr().err


# Stops between command processes

PLANT = """
format = 1
[[line]]
name = "hall"
PLACE
[[drive]]
name = "pump"
line = "hall"
drive = "vabus:1"
options = { model = "agile", reply_timeout_s = 1 }
armed = true
[[drive]]
name = "fan"
line = "hall"
drive = "danfoss-fc:3"
options = { model = "fc300", reply_timeout_s = 1 }
armed = true
"""


@contextmanager
def program(*words):
    with subprocess.Popen(
        [sys.executable, "-m", "drivecomm", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def started(*words):
    with program("start", *words) as process:
        while "started" not in process.stdout.readline():
            assert process.poll() is None, process.stderr.read()
        yield process


@pytest.fixture(params=["pty", "rfc2217"])
def plant(request, tmp_path):
    """Serve a plant of one line; yield the arguments that name its plant file, and its port."""
    place = f"pty:{tmp_path / 'line'}" if request.param == "pty" else "rfc2217:127.0.0.1:0"
    served = tmp_path / "served.toml"
    served.write_text(PLANT.replace("PLACE", f'listen = "{place}"'), encoding="utf-8")
    with program("simulate", str(served), "--json") as simulator:
        port = json.loads(simulator.stdout.readline())["lines"][0]["listening"]
        path = tmp_path / "plant.toml"
        path.write_text(PLANT.replace("PLACE", f'port = "{port}"'), encoding="utf-8")
        yield ["--plant", str(path)], port


@pytest.mark.soak
def test_start_holds_the_line_and_accepts_stops(plant, capsys):
    where, _ = plant
    with started("pump", "--link-loss", "trip", *where) as start:
        by = f"by drivecomm start (pid {start.pid})"
        assert main(["start", "fan", "--link-loss", "hold", *where]) == 3
        assert f"drivecomm start (pid {start.pid})" in capsys.readouterr().err
        assert main(["stop", "fan", *where]) == 0
        assert f"stop (ramp) commanded, {by}\n" in capsys.readouterr().out
        assert main(["stop", "pump", "--json", *where]) == 0
        assert json.loads(capsys.readouterr().out)["by"] == f"drivecomm start (pid {start.pid})"
        assert start.wait(5) == 0
        assert "stop commanded; watchdog restored" in start.stdout.read()


@pytest.mark.soak
def test_start_accepts_stop_all(plant, capsys):
    where, port = plant
    with started("pump", "--link-loss", "trip", *where) as start:
        assert main(["stop", "--all", *where]) == 0
        said = capsys.readouterr()
        assert sorted(said.out.splitlines()) == [
            "hall: danfoss-fc:*  stop (ramp) sent to all",
            "hall: fan  stop (ramp) confirmed",
            "hall: pump  stop (ramp) confirmed",
        ]
        assert start.wait(5) == 0
    with started("pump", "--link-loss", "trip", *where) as start:
        assert main(["stop", "--all", "--port", port]) == 5
        assert start.wait(5) == 0


@pytest.mark.soak
def test_hanging_start_is_named_and_a_killed_start_is_ignored(plant, capsys):
    where, _ = plant
    with started("pump", "--link-loss", "trip", *where) as start:
        start.send_signal(signal.SIGSTOP)
        assert main(["stop", "pump", *where]) == 3
        said = capsys.readouterr().err
        assert f"drivecomm start (pid {start.pid}) does not answer" in said
        assert f"drivecomm start (pid {start.pid})" in said.splitlines()[-1]
        start.kill()
    assert main(["stop", "pump", *where]) == 0
    assert "stop (ramp) commanded\n" in capsys.readouterr().out


HOLDERS = {
    "poll": ("poll", "pump", "output_frequency@0.1"),
    "watch of counters": ("stats", "pump", "--for", "60"),
    "status of a wait": ("wait", "pump", "running", "--seconds", "60"),
    "scan": ("scan", "--protocol", "vabus", "--wide"),
}
"""Commands that hold the port for long and continue after a stop."""


@pytest.mark.soak
@pytest.mark.parametrize("words", HOLDERS.values(), ids=HOLDERS)
def test_stop_goes_through_a_command_that_holds_the_port(plant, capsys, words):
    where, port = plant
    options = ["--port", port] if words[0] == "scan" else where
    assert main(["start", "fan", "--link-loss", "hold", *where]) == 0
    with program(*words, *options) as holder:
        wait_until_held(port, holder)
        assert main(["stop", "fan", *where]) == 0
        assert f"by drivecomm {words[0]} (pid {holder.pid})" in capsys.readouterr().out
        assert main(["stop", "--all", *where]) == 0
        assert holder.poll() is None
        assert main(["stop", "fan", "pump", *where]) == 0


@pytest.mark.soak
@pytest.mark.parametrize("words", [("doctor", "hall"), ("sniff", "PORT")], ids=" ".join)
def test_command_with_the_bare_port_ends_for_a_stop(plant, capsys, words):
    where, port = plant
    assert main(["start", "fan", "--link-loss", "hold", *where]) == 0
    capsys.readouterr()
    if words[0] == "sniff" and port.startswith("rfc2217"):
        pytest.skip("cannot be listened to")
    given = ["sniff", port] if words[0] == "sniff" else [*words, *where]
    with program(*given) as holder:
        wait_until_held(port, holder)
        assert main(["stop", "fan", *where]) == 0
        said = capsys.readouterr()
        assert said.out == "fan  stop (ramp) commanded\n"
        assert f"drivecomm {words[0]} exits, so that its port is free for this stop" in said.err
        assert holder.wait(10) in (0, 1, 130)
    assert main(["status", "fan", *where]) == 0
    assert "ready" in capsys.readouterr().out


def wait_until_held(port, holder):
    """Wait until the program accepts stops for the port."""
    while not [program for program, _ in holders_of_port(port) if program.pid == holder.pid]:
        assert holder.poll() is None, holder.stderr.read()
