"""A real server run as by a service manager: its notifications, its log output, and its sandbox."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import pytest
from processes import QUICK, serving

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="systemd is on Linux")

PACKAGING = Path(__file__).resolve().parents[2] / "packaging"
UNIT = (PACKAGING / "systemd" / "drivecomm@.service").read_text(encoding="utf-8")
HTTP = '[[door]]\nkind = "http"\nlisten = "127.0.0.1:0"\n'


class Manager:
    """The service manager's end of the notification socket."""

    def __init__(self, name):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(name)
        self.socket.settimeout(10)

    def hears(self, word):
        """Return the next message with this word, and the messages before it."""
        others = []
        while True:
            message = self.socket.recv(4096).decode().splitlines()
            if word in message:
                return message, others
            others.append(message)


@pytest.fixture
def manager(tmp_path):
    manager = Manager(str(tmp_path / "notify"))
    yield manager
    manager.socket.close()


@pytest.mark.soak
def test_service_manager_is_notified_of_start_watchdog_reload_and_end(tmp_path, manager):
    with serving(tmp_path, start=False) as served:
        served.environment.update(NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="300000")
        served.start()
        message, others = manager.hears("READY=1")
        assert "STATUS=2 lines, 2 drives" in message
        assert others in ([], [["WATCHDOG=1"]] * len(others))
        for _ in range(3):
            assert manager.hears("WATCHDOG=1")[1] == []
        served.process.send_signal(signal.SIGHUP)
        began, others = manager.hears("RELOADING=1")
        assert others in ([], [["WATCHDOG=1"]] * len(others))
        assert re.fullmatch(r"MONOTONIC_USEC=\d+", began[1])
        manager.hears("READY=1")
        served.process.send_signal(signal.SIGTERM)
        manager.hears("STOPPING=1")
        assert served.process.wait(20) == 0


@pytest.mark.soak
def test_watchdog_is_fed_while_motors_stop_at_shutdown(tmp_path, manager):
    with serving(tmp_path, start=False) as served:
        served.environment.update(NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="150000")
        served.start()
        served.keep("fan")
        served.process.send_signal(signal.SIGTERM)
        manager.hears("STOPPING=1")
        assert served.process.wait(20) == 0


@pytest.mark.soak
def test_hanging_server_does_not_feed_the_watchdog(tmp_path, manager):
    with serving(tmp_path, start=False) as served:
        served.environment.update(NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="150000")
        served.start()
        manager.hears("WATCHDOG=1")
        served.process.send_signal(signal.SIGSTOP)
        time.sleep(0.1)
        manager.socket.setblocking(False)
        try:
            while manager.socket.recv(4096):
                pass
        except BlockingIOError:
            pass
        manager.socket.settimeout(0.3)
        with pytest.raises(TimeoutError):
            manager.hears("WATCHDOG=1")
        served.process.send_signal(signal.SIGCONT)


@pytest.mark.soak
def test_log_has_priorities_for_the_journal_and_times_for_a_terminal(tmp_path):
    with serving(tmp_path, start=False) as served:
        served.log.touch()
        found = served.log.stat()
        served.environment["JOURNAL_STREAM"] = f"{found.st_dev}:{found.st_ino}"
        served.start()
        served.end()
        assert "<6>server: begins" in served.log.read_text()
        del served.environment["JOURNAL_STREAM"]
        served.start()
        served.end()
        assert re.search(r"^\d{4}-\d\d-\d\d [\d:.]{12}\S+ info    server: begins", served.log.read_text(), re.MULTILINE)


@pytest.mark.soak
def test_fault_is_one_line_of_the_log_file(tmp_path):
    with serving(tmp_path, start=False) as served:
        file = tmp_path / "logs" / "server.log"
        served.start("--log", str(file), "--level", "warning")
        served.until(lambda: served.drive("fan")["reachability"] == "answers")
        served.control.order("trip", drive="fan", code=14)
        served.until(lambda: served.events("fault"))
        served.end()
        (line,) = [line for line in file.read_text().splitlines() if "earth fault" in line]
        assert " warning yard fan: fault" in line
        assert "begins" not in file.read_text()


@pytest.mark.soak
def test_invalid_log_file_gives_a_one_line_error(tmp_path):
    with serving(tmp_path, start=False) as served:
        (tmp_path / "file").touch()
        done = subprocess.run(
            [sys.executable, "-m", "drivecomm", "serve", str(served.plant), "--log", str(tmp_path / "file" / "log")],
            env=served.environment, capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.soak
def test_container_health_check_follows_the_server(tmp_path):
    def is_well(served):
        folder = Path(served.environment["XDG_RUNTIME_DIR"]) / "drivecomm"
        return subprocess.run(
            [sys.executable, str(PACKAGING / "container" / "healthy.py")],
            env={**served.environment, "RUNTIME_DIRECTORY": str(folder)},
            timeout=30,
            check=False,
        ).returncode

    with serving(tmp_path) as served:
        assert is_well(served) == 0
        served.process.kill()
        served.process.wait()
        assert is_well(served) == 1


@cache
def calls_of(name):
    """Return the system calls of a systemd set such as @system-service."""
    told = subprocess.run(
        ["systemd-analyze", "syscall-filter", name], capture_output=True, text=True, check=True
    ).stdout
    words = [line.strip() for line in told.splitlines()[1:] if not line.strip().startswith("#")]
    return {each for word in words if word for each in (calls_of(word) if word.startswith("@") else {word})}


def allowed_calls():
    allowed = set()
    for line in re.findall(r"^SystemCallFilter=(.*)$", UNIT, re.MULTILINE):
        named = set().union(*(calls_of(word) for word in line.lstrip("~").split()))
        allowed = allowed - named if line.startswith("~") else allowed | named
    return allowed


NEVER_WRITE_AND_EXECUTE = """
import ctypes, os, sys
if ctypes.CDLL(None).prctl(65, 1, 0, 0, 0):  # PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN
    print("this kernel has no PR_SET_MDWE", file=sys.stderr)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_server_uses_only_allowed_system_calls_and_no_executable_memory(tmp_path):
    with serving(tmp_path, head=f"{QUICK}{HTTP}", start=False) as served:
        counted = tmp_path / "calls"
        with served.log.open("ab") as log:
            served.process = subprocess.Popen(
                [
                    *("strace", "-f", "-c", "-o", str(counted), sys.executable, "-c", NEVER_WRITE_AND_EXECUTE),
                    *("-m", "drivecomm", "serve", str(served.plant)),
                ],
                env=served.environment, stdout=subprocess.PIPE, stderr=log, text=True, cwd=tmp_path,
            )  # fmt: skip
        assert "stop with Ctrl-C" in served.process.stdout.readline(), served.log.read_text()
        served.keep("fan")
        served.ask("/api/v1/history/events")
        served.control.order("trip", drive="pump", code=3)
        served.until(lambda: served.events("fault"))
        child = int(Path(f"/proc/{served.process.pid}/task/{served.process.pid}/children").read_text().split()[0])
        os.kill(child, signal.SIGHUP)
        served.until(lambda: any("plant file" in each["text"] for each in served.events("server")))
        os.kill(child, signal.SIGTERM)
        assert served.process.wait(30) == 0
        served.process.stdout.close()
        used = set(re.findall(r"^ *[\d.]+ .* (\w+)$", counted.read_text(), re.MULTILINE)) - {"total"}
        assert {"execve", "openat"} <= used
        # SQLite calls fchown only as root, so that other users can continue with the file.
        used -= {"fchown"} if os.geteuid() == 0 else set()
        assert used <= allowed_calls(), used - allowed_calls()
