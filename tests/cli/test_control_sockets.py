"""A stop reaches the `start` that holds the line: what it keeps ends by that, and all else is stopped over its bus."""

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

import drivecomm
from drivecomm.bus import keep, read_watchdog
from drivecomm.cli import main
from drivecomm.cli.control import sockets
from drivecomm.cli.control.client import StopRequest, broadcasts, stop_by_holder
from drivecomm.cli.control.server import control_server
from drivecomm.cli.control.sockets import ControlSocket, connect, socket_file
from drivecomm.errors import DriveError, PortError, ReplyError, UsageError
from drivecomm.protocol import Stop
from drivecomm.virtual import Server, parse_listen, virtual_drive

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")

FAN = ("fan", "danfoss-fc", 3, {"model": "fc300"})
PUMP = ("pump", "vabus", 1, {"model": "agile"})


@pytest.fixture(autouse=True)
def folder(monkeypatch):
    """A runtime folder of its own, whose name is short, as those of Unix sockets must be."""
    path = Path(tempfile.mkdtemp(prefix="dc"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(path))
    yield path / "drivecomm"
    shutil.rmtree(path)


class Line:
    """A served line with a pump and a fan; `kept` is what runs for the pump."""

    def __init__(self, path):
        self.pump = virtual_drive("vabus", 1, model="agile", reply_delay_s=0.0)
        self.fan = virtual_drive("danfoss-fc", 3, model="fc300", reply_delay_s=0.0)
        self.server = Server([self.pump, self.fan], parse_listen(f"pty:{path}"))
        self.port = str(path)
        self.left_by = []
        self.fails = None
        self.options = {"model": "agile"}

    def run_kept(self, started):
        end = threading.Event()
        with drivecomm.open_bus(self.port) as bus:
            pump = bus.drive("vabus", 1, **self.options)
            kept = keep(pump, "trip", watchdog_s=5)

            def leave(how):
                self.left_by.append(how)
                kept.stop_by(how)
                end.set()

            self.end = end
            with control_server(pump, self.port, leave, as_json=False), kept:
                pump.set_reference(percent=30)
                pump.start()
                started.set()
                end.wait(10)
                if self.fails:
                    raise self.fails
            self.watchdog = str(read_watchdog(pump))


@pytest.fixture
def line(tmp_path):
    one, stop = Line(tmp_path / "line"), threading.Event()
    with one.server:
        thread = threading.Thread(target=one.server.run, args=(stop,))
        thread.start()
        yield one
        stop.set()
        thread.join()


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


def asked(port, **what):
    answers = []
    keeper = stop_by_holder(port, StopRequest(**{"how": Stop.RAMP, **what}), answers.append)
    return keeper, answers


def test_what_it_keeps_is_stopped_and_it_ends_with_its_watchdog_as_it_was(line, folder):
    with held(line):
        keeper, answers = asked(line.port, drives=(PUMP,))
        assert (keeper.name, keeper.ended) == (f"drivecomm start vabus:1 (pid {os.getpid()})", True)
        assert [(each.drive, each.how, each.error) for each in answers] == [("pump", Stop.RAMP, None)]
    assert line.left_by == [Stop.RAMP]
    assert line.watchdog == "off"
    assert list(folder.iterdir()) == []


def test_another_drive_of_its_line_is_stopped_and_it_goes_on(line, folder):
    with held(line):
        keeper, answers = asked(line.port, drives=(FAN,), how=Stop.QUICK)
        assert not keeper.ended
        assert [(each.drive, each.how, each.error) for each in answers] == [("fan", Stop.QUICK, None)]
        keeper, answers = asked(line.port, protocols=(("danfoss-fc", {}),))
        assert [(each.protocol, each.error) for each in answers] == [("danfoss-fc", None)]
        assert not keeper.ended
        assert not line.end.is_set()
        (door,) = folder.iterdir()
        assert (door.stat().st_mode & 0o777, folder.stat().st_mode & 0o777) == (0o600, 0o700)


@pytest.mark.parametrize("what", [{"protocols": (("vabus", {}),)}, {"everything": True}])
def test_what_is_for_all_ends_it_too(line, what):
    with held(line):
        keeper, answers = asked(line.port, **what)
        assert keeper.ended
        assert answers[-1].drive == "vabus:1"


def test_what_it_cannot_by_is_stopped_down_the_ramp_and_said(line):
    with held(line):
        _, answers = asked(line.port, drives=(PUMP, FAN), how=Stop.DC_BRAKE)
        assert {each.drive: each.how for each in answers} == {"fan": Stop.DC_BRAKE, "pump": Stop.RAMP}
    assert line.left_by == [Stop.RAMP]


def test_a_drive_that_does_not_answer_and_one_that_cannot_be(line):
    with held(line):
        silent = ("mill", "vabus", 7, {"reply_timeout_s": 0.02, "attempts": 1})
        odd = ("saw", "vabus", 99, {})
        _, answers = asked(line.port, drives=(silent, odd))
    assert isinstance(answers[0].error, ReplyError)
    assert "did not answer" in str(answers[0].error)
    assert isinstance(answers[1].error, UsageError)


def test_what_goes_wrong_when_it_ends_is_not_said_to_be_as_it_was(line):
    line.fails = DriveError("it jammed")
    with held(line):
        keeper, (answer,) = asked(line.port, drives=(PUMP,))
        assert not keeper.ended
        assert answer.error is None, "the stop itself was confirmed"


@pytest.mark.soak
def test_a_stop_of_its_own_drive_that_is_not_answered_is_not_confirmed(line):
    line.options["attempts"] = 1
    with held(line):
        line.pump.hear = lambda *_: None
        _, (answer,) = asked(line.port, drives=(PUMP,))
        assert isinstance(answer.error, ReplyError)


def test_by_any_name_of_the_port(line):
    with held(line):
        keeper, _ = asked(os.path.realpath(line.port), drives=(FAN,))
        assert keeper is not None
    assert socket_file("socket://LocalHost:4001") == socket_file("rfc2217://127.0.0.1:4001?timeout=1")
    assert socket_file("socket://127.0.0.1:4001") != socket_file("socket://127.0.0.1:4002")


@pytest.mark.parametrize(
    "order",
    [
        b"nonsense\n",
        b"[]\n",
        b'{"order": "start", "how": "ramp", "drives": [], "protocols": [], "everything": true}\n',
        b'{"order": "stop", "how": "never"}\n',
        b'{"order": "stop", "how": "ramp", "drives": [["a", "vabus", 1]], "protocols": [], "everything": false}\n',
        b"x" * (sockets.LONGEST_LINE + 5000),
        b"",
    ],
)
def test_what_is_no_order_does_nothing(line, order):
    with held(line):
        with socket.socket(socket.AF_UNIX) as guest:
            guest.settimeout(5)
            guest.connect(str(socket_file(line.port)))
            # Nobody waits for who says too much.
            guest.sendall(order)
            guest.shutdown(socket.SHUT_WR)
            heard = b""
            try:
                while piece := guest.recv(1000):
                    heard += piece
            except ConnectionResetError:
                pass
        assert json.loads(heard.splitlines()[0])["drive"] == "vabus:1"
        assert not line.end.is_set()
        assert asked(line.port, drives=(FAN,))[0] is not None


def test_without_a_door_or_with_one_that_was_left_behind_nobody_is_asked(folder):
    assert asked("/dev/ttyUSB9", drives=(FAN,)) == (None, [])
    folder.mkdir(mode=0o700)
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(socket_file("/dev/ttyUSB9")))
    left.close()
    assert asked("/dev/ttyUSB9", drives=(FAN,)) == (None, [])
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("error", [PermissionError("no"), ValueError("no JSON")])
def test_whatever_is_wrong_with_a_door_keeps_no_stop_from_going_out(monkeypatch, error):
    def broken(*_):
        raise error

    monkeypatch.setattr("drivecomm.cli.control.client.connect", broken)
    assert asked("/dev/ttyUSB9", drives=(FAN,)) == (None, [])


def test_one_that_hangs_is_named(folder, monkeypatch):
    monkeypatch.setattr("drivecomm.cli.control.client._GREETING_S", 0.05)
    door = ControlSocket(socket_file("/dev/ttyUSB9"))
    pid = rf" \(pid {os.getpid()}\)" if sys.platform == "linux" else ""
    with pytest.raises(PortError, match=rf"held by drivecomm start{pid}, which does not answer"):
        asked("/dev/ttyUSB9", drives=(FAN,))
    door.close()
    assert list(folder.iterdir()) == []


def test_a_folder_of_somebody_else_has_no_door(folder):
    folder.mkdir()
    folder.chmod(0o777)
    with pytest.raises(PermissionError):
        ControlSocket(socket_file("/dev/ttyUSB9"))
    (folder / socket_file("/dev/ttyUSB9").name).write_text("")
    assert asked("/dev/ttyUSB9", drives=(FAN,)) == (None, [])


def test_a_door_is_not_taken_over_and_a_start_goes_on_without_one(line, capsys):
    door = ControlSocket(socket_file(line.port))
    with held(line):
        said = capsys.readouterr().err
        assert "will not reach this one (another program has the control socket of this port); use Ctrl-C" in said
        connect(socket_file(line.port)).close()
    door.close()


def test_where_there_are_no_unix_sockets_it_is_a_port_with_two_secrets(line, folder, monkeypatch):
    monkeypatch.setattr(sockets, "_HAS_UNIX_SOCKETS", False)
    with held(line):
        keeper, answers = asked(line.port, drives=(FAN,))
        assert (keeper.ended, answers[0].error) == (False, None)
        file = socket_file(line.port)
        assert file.stat().st_mode & 0o777 == 0o600
        number, asks, answered = json.loads(file.read_text())
        with socket.create_connection(("127.0.0.1", number), timeout=5) as stranger:
            stranger.sendall(b'{"secret": "guessed"}\n')
            assert stranger.recv(100) == b""
        # Somebody else at that port is not believed, and the file goes.
        with socket.create_server(("127.0.0.1", 0)) as other:

            def pretend():
                with other.accept()[0] as guest:
                    guest.sendall(b'{"secret": "guessed"}\n')

            thread = threading.Thread(target=pretend)
            thread.start()
            file.write_text(json.dumps([other.getsockname()[1], asks, answered]))
            assert asked(line.port, drives=(FAN,)) == (None, [])
            thread.join()
    assert list(folder.iterdir()) == []


def test_drives_with_the_same_settings_are_called_once():
    drives = [
        PUMP,
        ("lift", "vabus", 2, {"model": "act"}),
        ("far", "vabus", 3, {"baudrate": 4800}),
        FAN,
    ]
    assert broadcasts(drives) == (("vabus", {}), ("vabus", {"baudrate": 4800}), ("danfoss-fc", {}))


# The commands

PLANT = """
format = 1
[[line]]
name = "hall"
PLACE
[[drive]]
name = "pump"
line = "hall"
drive = "vabus:1"
options = { model = "agile" }
armed = true
[[drive]]
name = "fan"
line = "hall"
drive = "danfoss-fc:3"
options = { model = "fc300" }
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
    """Serve a plant of one line; gives the words that choose it, and its port."""
    place = f"pty:{tmp_path / 'line'}" if request.param == "pty" else "rfc2217:127.0.0.1:0"
    served = tmp_path / "served.toml"
    served.write_text(PLANT.replace("PLACE", f'listen = "{place}"'), encoding="utf-8")
    with program("simulate", str(served), "--json") as simulator:
        port = json.loads(simulator.stdout.readline())["lines"][0]["listening"]
        path = tmp_path / "plant.toml"
        path.write_text(PLANT.replace("PLACE", f'port = "{port}"'), encoding="utf-8")
        yield ["--plant", str(path)], port


@pytest.mark.soak
def test_the_commands(plant, capsys):
    where, _ = plant
    with started("pump", "--link-loss", "trip", *where) as start:
        by = f"by drivecomm start vabus:1 (pid {start.pid})"
        assert main(["start", "fan", "--link-loss", "hold", *where]) == 3
        assert f"drivecomm start (pid {start.pid})" in capsys.readouterr().err
        assert main(["stop", "fan", *where]) == 0
        assert f"stop (ramp) commanded, {by}\n" in capsys.readouterr().out
        assert main(["stop", "pump", "--json", *where]) == 0
        assert json.loads(capsys.readouterr().out)["by"].endswith("which has ended, its watchdog as it was")
        assert start.wait(5) == 0
        assert "stop commanded; watchdog as it was" in start.stdout.read()


@pytest.mark.soak
def test_stop_all(plant, capsys):
    where, port = plant
    with started("pump", "--link-loss", "trip", *where) as start:
        assert main(["stop", "--all", *where]) == 0
        said = capsys.readouterr()
        assert sorted(said.out.splitlines()) == [
            "hall: danfoss-fc:*  stop (ramp) sent to all",
            "hall: fan  stop (ramp) confirmed",
            "hall: pump  stop (ramp) confirmed",
            "hall: vabus:*  stop (ramp) sent to all",
        ]
        assert start.wait(5) == 0
    with started("pump", "--link-loss", "trip", *where) as start:
        assert main(["stop", "--all", "--port", port]) == 5
        said = capsys.readouterr()
        assert "vabus:1  stop (ramp) confirmed" in said.out
        assert start.wait(5) == 0


@pytest.mark.soak
def test_one_that_hangs_and_one_that_was_killed(plant, capsys):
    where, _ = plant
    with started("pump", "--link-loss", "trip", *where) as start:
        start.send_signal(signal.SIGSTOP)
        assert main(["stop", "pump", *where]) == 3
        assert f"held by drivecomm start (pid {start.pid}), which does not answer" in capsys.readouterr().err
        start.kill()
    assert main(["stop", "pump", *where]) == 0
    assert "stop (ramp) commanded\n" in capsys.readouterr().out
