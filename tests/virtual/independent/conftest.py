"""The simulator as a separate process, and serial servers in front of it."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

SER2NET = shutil.which("ser2net") or shutil.which("ser2net", path="/usr/sbin")


@pytest.fixture
def tell(capsys):
    """Return a function that prints the results of a long run."""

    def told(text):
        if "DRIVECOMM_MINUTES" in os.environ:
            with capsys.disabled():
                sys.stdout.write(f"\n{text}\n")

    return told


@pytest.fixture
def simulated(tmp_path):
    """Yield a function that starts `drivecomm simulate` with a plant file and returns each line's URL by its name.

    FOLDER in the text of the plant is replaced by a folder of the test.
    """
    running = []

    def start(text):
        plant = tmp_path / f"plant{len(running)}.toml"
        plant.write_text(text.replace("FOLDER", str(tmp_path)), encoding="utf-8")
        process = subprocess.Popen(
            [sys.executable, "-m", "drivecomm", "simulate", str(plant), "--json"], stdout=subprocess.PIPE, text=True
        )
        running.append(process)
        told = process.stdout.readline()
        assert told, "the simulator did not start"
        return {line["line"]: line["listening"] for line in json.loads(told)["lines"]}

    yield start
    for process in running:
        process.terminate()
        process.communicate(timeout=10)


@pytest.fixture
def ser2net(tmp_path):
    """Yield a function that starts ser2net in front of a terminal and returns the URL of its raw or RFC 2217 port."""
    if SER2NET is None:
        pytest.skip("ser2net is not installed (apt-get install ser2net)")
    running = []

    def start(terminal, kind):
        with socket.create_server(("127.0.0.1", 0)) as free:
            number = free.getsockname()[1]
        accepter = {"socket": "tcp", "rfc2217": "telnet(rfc2217),tcp"}[kind]
        settings = tmp_path / f"{len(running)}.yaml"
        settings.write_text(
            "%YAML 1.1\n---\nconnection: &drives\n"
            f"  accepter: {accepter},127.0.0.1,{number}\n"
            f"  connector: serialdev,{terminal},9600n81,local\n",
            encoding="utf-8",
        )
        running.append(
            subprocess.Popen(
                [SER2NET, "-n", "-c", str(settings), "-P", str(settings.with_suffix(".pid"))],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        _wait_until_it_listens(number)
        return f"{kind}://127.0.0.1:{number}"

    yield start
    for process in running:
        process.terminate()
        process.wait(5)


def _wait_until_it_listens(number):
    # ser2net accepts one connection at a time, so `/proc/net/tcp` is read instead of connecting to it.
    until = time.monotonic() + 5
    while f":{number:04X} 00000000:0000 0A" not in Path("/proc/net/tcp").read_text(encoding="ascii"):
        assert time.monotonic() < until, "ser2net does not listen"
        time.sleep(0.01)
