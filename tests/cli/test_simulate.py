"""The simulate command: virtual drives for other programs, as processes that talk to each other."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from forked_commands import Commands

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")

EVERYBODY = ["vabus:1", "danfoss-fc:3", "vlt3500:5", "fuji:7"]
READS = {"vabus:1": "481", "danfoss-fc:3": "16-30", "vlt3500:5": "215", "fuji:7": "M21"}


@pytest.fixture(scope="module")
def drivecomm(tmp_path_factory):
    """Yield a function that runs a command at a port, as a process of its own."""
    commands = Commands(tmp_path_factory.mktemp("commands"))
    yield lambda *arguments, port: commands(*arguments, "--port", port)
    commands.close()


@pytest.fixture
def simulated():
    """Yield a function that starts a simulator at a place and returns its process and the port for a master."""
    running = []

    def start(listen, *more):
        drives = [part for name in EVERYBODY for part in ("--drive", name)]
        process = subprocess.Popen(
            [sys.executable, "-m", "drivecomm", "simulate", *drives, "--listen", listen, "--json", *more],
            stdout=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        told = json.loads(process.stdout.readline())
        assert told["drives"] == EVERYBODY
        return process, told["listening"]

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.mark.soak
@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_simulator_stops_cleanly_on_a_signal(simulated, tmp_path, number):
    path = tmp_path / "line"
    process, _ = simulated(f"pty:{path}")
    process.send_signal(number)
    assert process.wait(10) == 0
    assert not path.is_symlink()


def stop_when_it_serves(path):
    """Send SIGTERM when the pseudo-terminal exists, because from then on the signal is handled."""
    while not path.is_symlink():
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGTERM)


@posix
def test_simulate_prints_how_to_stop_and_its_end(shell, tmp_path):
    threading.Thread(target=stop_when_it_serves, args=(tmp_path / "line",)).start()
    assert shell("simulate", "-d", "vabus:1", "-l", f"pty:{tmp_path / 'line'}", port=None) == 0
    assert shell.out.endswith("stopped\n")
    assert "stop with Ctrl-C" in shell.out


@pytest.mark.soak
@posix
def test_every_command_works_over_a_pseudo_terminal(drivecomm, simulated, tmp_path):
    path = tmp_path / "line"
    simulated(f"pty:{path}")
    for drive in EVERYBODY:
        assert drivecomm("read", drive, READS[drive], port=str(path)).code == 0
        for verb in (["status"], ["start", "--link-loss", "hold"], ["stop"], ["reset"]):
            done = drivecomm(verb[0], drive, *verb[1:], port=str(path))
            assert (done.code, done.err) == (0, ""), (drive, verb)


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["tcp", "rfc2217"])
def test_every_drive_is_read_over_the_network(drivecomm, simulated, kind):
    _, address = simulated(f"{kind}:127.0.0.1:0")
    url = f"{'socket' if kind == 'tcp' else 'rfc2217'}://{address.rpartition('//')[2].removeprefix(f'{kind}:')}"
    for drive in EVERYBODY:
        done = drivecomm("read", drive, READS[drive], "--json", port=url)
        assert (done.code, done.err) == (0, "")
        assert json.loads(done.out)["drive"] == drive


@pytest.mark.soak
@posix
def test_reference_and_start_may_come_from_different_programs(drivecomm, simulated, tmp_path):
    path = tmp_path / "line"
    simulated(f"pty:{path}")
    for drive, value in zip(EVERYBODY, ("20Hz", "50%", "50%", "20Hz"), strict=True):
        assert drivecomm("reference", drive, value, port=str(path)).code == 0
        assert drivecomm("start", drive, "--link-loss", "hold", port=str(path)).code == 0
        again = drivecomm("reference", drive, value, port=str(path))
        if drive.startswith("danfoss"):
            # A Danfoss reference needs a control word beside it, and this program has commanded none.
            assert again.code == 5
            assert "came from another program" in again.err
            given = ("--percent", value.removesuffix("%"))
            assert drivecomm("start", drive, "--link-loss", "hold", *given, port=str(path)).code == 0
        else:
            assert again.code == 0
        assert json.loads(drivecomm("status", drive, "--json", port=str(path)).out)["running"] is True


@pytest.mark.soak
@posix
def test_every_drive_is_read_on_an_echoing_line(drivecomm, simulated, tmp_path):
    path = tmp_path / "line"
    simulated(f"pty:{path}", "--echo")
    for drive in EVERYBODY:
        assert drivecomm("read", drive, READS[drive], "--echo", port=str(path)).code == 0
    silent = drivecomm("read", "danfoss-fc:3", "16-30", "--attempts", "1", port=str(path))
    assert silent.code in (0, 4), "an echo is skipped, or called what it is"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--drive", "vabus:1", "--listen", "nowhere"], "pty:PATH"),
        (["--drive", "vabus:99", "--listen", "tcp:127.0.0.1:0"], "no drive at address 99"),
        (["--drive", "vabus", "--listen", "tcp:127.0.0.1:0"], "PROTOCOL:ADDRESS"),
        (["--drive", "vabus:1,speed=3", "--listen", "tcp:127.0.0.1:0"], "no option 'speed'"),
        (["--listen", "tcp:127.0.0.1:0"], "--drive"),
    ],
)
def test_simulate_refuses_wrong_arguments(shell, arguments, sentence):
    assert shell("simulate", *arguments, port=None) == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1
