"""Virtual Modbus drives under masters that others have written: mbpoll, and the drivers of LinuxCNC.

LinuxCNC is used without being installed: unpack its package `linuxcnc-uspace` (`dpkg -x`), and name the folder in
DRIVECOMM_LINUXCNC.
"""

import os
import shutil
import subprocess
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivecomm.virtual import Server, parse_listen, virtual_drive

pytestmark = pytest.mark.foreign

MBPOLL = shutil.which("mbpoll")
LINUXCNC = Path(os.environ.get("DRIVECOMM_LINUXCNC", "/nowhere"))
needs_mbpoll = pytest.mark.skipif(MBPOLL is None, reason="mbpoll is not installed")
needs_linuxcnc = pytest.mark.skipif(
    not (LINUXCNC / "usr/bin/gs2_vfd").exists(), reason="DRIVECOMM_LINUXCNC names no unpacked linuxcnc-uspace"
)


@contextmanager
def served(drive, folder):
    """Serve a virtual drive on a pseudo-terminal, and return its path."""
    stop, path = threading.Event(), folder / "line"
    with Server([drive], parse_listen(f"pty:{path}")) as server:
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        try:
            yield path
        finally:
            stop.set()
            thread.join()


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


@needs_linuxcnc
def test_the_driver_of_linuxcnc_turns_a_virtual_gs2(tmp_path):
    drive = virtual_drive("modbus", 1, model="gs2")
    program = tmp_path / "spindle.hal"
    environment = {
        **os.environ,
        "LD_LIBRARY_PATH": str(LINUXCNC / "usr/lib"),
        "PATH": f"{LINUXCNC / 'usr/bin'}:{os.environ['PATH']}",
    }
    with served(drive, tmp_path) as path:
        program.write_text(
            f"loadusr -Wn gs2_vfd gs2_vfd -d {os.path.realpath(path)} -r 9600 -p none -s 1\n"
            "setp gs2_vfd.speed-command 1380\nsetp gs2_vfd.spindle-fwd 1\n"
        )
        log = tmp_path / "log"
        try:
            with log.open("w") as output:
                # The driver goes on when halcmd has ended, and has the same output.
                command = [LINUXCNC / "usr/bin/halcmd", "-k", "-f", program]
                subprocess.run(
                    command, env=environment, check=False, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                    timeout=20,
                )  # fmt: skip
            until, on = time.monotonic() + 15, True
            while not drive.motor.running and time.monotonic() < until:
                # It tells its drive what changes.
                pin = [LINUXCNC / "usr/bin/halcmd", "setp", "gs2_vfd.spindle-on", str(int(on))]
                subprocess.run(pin, env=environment, check=True, timeout=20)
                time.sleep(1)
                on = not on
            assert drive.motor.running, log.read_text()
            assert drive.motor.target_hz > 0
        finally:
            unload = [LINUXCNC / "usr/bin/halcmd", "unloadusr", "gs2_vfd"]
            subprocess.run(unload, env=environment, check=False, capture_output=True, timeout=20)
