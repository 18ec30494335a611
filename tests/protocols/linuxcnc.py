"""LinuxCNC in tests: its programs, and its spindle drivers as masters of virtual drives.

LinuxCNC is used without installing it, and without real time: unpack its package `linuxcnc-uspace` (`dpkg -x`), and set
DRIVECOMM_LINUXCNC to the folder. Most of its drivers also need libmodbus5.
"""

import os
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from serving_threads import served_in_thread

from drivecomm.virtual import Server, parse_listen

LINUXCNC = Path(os.environ.get("DRIVECOMM_LINUXCNC", "/nowhere"))

marks = [
    pytest.mark.foreign,
    pytest.mark.soak,
    pytest.mark.skipif(
        not (LINUXCNC / "usr/bin/gs2_vfd").exists(), reason="DRIVECOMM_LINUXCNC names no unpacked linuxcnc-uspace"
    ),
]
HALCMD = LINUXCNC / "usr/bin/halcmd"
ENVIRONMENT = {
    **os.environ,
    "LD_LIBRARY_PATH": str(LINUXCNC / "usr/lib"),
    "PATH": f"{LINUXCNC / 'usr/bin'}:{os.environ['PATH']}",
    "PYTHONPATH": f"{LINUXCNC / 'usr/lib/python3/dist-packages'}",
}


@contextmanager
def served(drive, folder):
    """Serve a virtual drive on a pseudo-terminal; yield its path and a function that trips the drive."""
    path = folder / "line"
    drive.motor.ramp_up_s = drive.motor.ramp_down_s = 1.0
    with served_in_thread(Server([drive], parse_listen(f"pty:{path}"))):
        # The clock of the served drive starts here.
        began = time.monotonic()
        yield os.path.realpath(path), lambda code: drive.trip(code, time.monotonic() - began)


class Spindle:
    """A running driver and its pins."""

    def __init__(self, name, pins, log):
        self._name, self._pins, self._log = name, pins, log

    def set(self, **pins):
        for pin, value in pins.items():
            _halcmd("setp", f"{self._pins}.{pin.replace('_', '-')}", str(value))

    def get(self, pin):
        said = _halcmd("getp", f"{self._pins}.{pin}").strip()
        return said == "TRUE" if said in ("TRUE", "FALSE") else float(said)

    def wait_for(self, what, *, within_s=20.0):
        until = time.monotonic() + within_s
        while not what():
            assert time.monotonic() < until, self._log.read_text()
            time.sleep(0.2)

    def end(self):
        """Terminate the driver by its process id and wait until it is gone; not all drivers obey `unloadusr`."""
        until = time.monotonic() + 10
        while (number := self._process()) and time.monotonic() < until:
            os.kill(number, signal.SIGTERM)
            time.sleep(0.5)

    def _process(self):
        rows = [row.split() for row in _halcmd("show", "comp").splitlines()]
        numbers = [int(row[3]) for row in rows if len(row) > 3 and row[2] == self._name and row[3].isdigit()]
        return numbers[0] if numbers and Path(f"/proc/{numbers[0]}").exists() else 0


def _halcmd(*words):
    command = [HALCMD, *words]
    return subprocess.run(
        command, env=ENVIRONMENT, check=True, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=20
    ).stdout


@contextmanager
def driver(folder, name, command, *, pins=""):
    """Run a driver and yield its spindle; its process outlives the program that starts it, and is ended afterwards."""
    program, log = folder / "spindle.hal", folder / "log"
    program.write_text(f"loadusr -Wn {name} {command}\n")
    spindle = Spindle(name, pins or name, log)
    try:
        with log.open("w") as output:
            subprocess.run(
                [HALCMD, "-k", "-f", program], env=ENVIRONMENT, check=False, stdin=subprocess.DEVNULL, stdout=output,
                stderr=output, timeout=30,
            )  # fmt: skip
        yield spindle
    finally:
        spindle.end()
