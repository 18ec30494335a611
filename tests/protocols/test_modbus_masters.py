"""Virtual Modbus drives under a foreign master: mbpoll."""

import shutil
import subprocess
from contextlib import contextmanager

import pytest
from serving_threads import served_in_thread

from drivecomm.virtual import Server, parse_listen, virtual_drive

pytestmark = pytest.mark.foreign

MBPOLL = shutil.which("mbpoll")
needs_mbpoll = pytest.mark.skipif(MBPOLL is None, reason="mbpoll is not installed")


@contextmanager
def served(drive, folder):
    """Serve a virtual drive on a pseudo-terminal and yield its path."""
    path = folder / "line"
    with served_in_thread(Server([drive], parse_listen(f"pty:{path}"))):
        yield path


@needs_mbpoll
def test_mbpoll_commands_a_drive_over_tcp():
    drive = virtual_drive("modbus", 1, model="gs2", framing="tcp")
    with served_in_thread(Server([drive], parse_listen("tcp:127.0.0.1:0"))) as server:
        host, port = server.address.rpartition("/")[2].split(":")
        command = [MBPOLL, "-m", "tcp", "-p", port, "-a", "1", "-0", "-1", "-o", "1", "-t", "4"]
        for register, value in (("2330", "250"), ("2331", "1")):
            wrote = subprocess.run(
                [*command, "-r", register, host, value], capture_output=True, text=True, check=False, timeout=20
            )
            assert wrote.returncode == 0, wrote.stderr
    assert drive.motor.running
    assert drive.motor.target_hz == 25.0


def mbpoll(*arguments):
    command = [MBPOLL, "-m", "rtu", "-a", "1", "-b", "9600", "-P", "none", "-0", "-1", "-o", "1", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=20)


@needs_mbpoll
def test_mbpoll_reads_a_block_and_commands_a_drive(tmp_path):
    drive = virtual_drive("modbus", 1, model="gs2")
    with served(drive, tmp_path) as path:
        wrote = mbpoll("-t", "4", "-r", str(0x091A), str(path), "250")
        assert wrote.returncode == 0, wrote.stderr
        assert mbpoll("-t", "4", "-r", str(0x091B), str(path), "1").returncode == 0
        assert drive.motor.running
        assert drive.motor.target_hz == 25.0
        read = mbpoll("-t", "4:hex", "-r", str(0x2100), "-c", "13", str(path))
        assert read.returncode == 0, read.stderr
        assert len([line for line in read.stdout.splitlines() if line.startswith("[")]) == 13
        refused = mbpoll("-t", "4", "-r", str(0x7000), str(path))
        assert "Illegal data address" in refused.stdout + refused.stderr


@needs_mbpoll
def test_mbpoll_switches_a_coil(tmp_path):
    drive = virtual_drive("modbus", 1, model="danfoss-fc", parity="N")
    with served(drive, tmp_path) as path:
        assert mbpoll("-t", "0", "-r", "64", str(path), "1").returncode == 0
        assert drive.peek("c65", 1.0) == 1
