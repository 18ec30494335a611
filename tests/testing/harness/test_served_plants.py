"""A virtual plant with a server in a test: HTTP, library and commands reach it, and it is gone afterwards."""

import json
import os
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

import pytest

import drivecomm
from drivecomm.errors import FileFormatError
from drivecomm.testing import LineMaker

pytest_plugins = ["pytester"]

PLANT = """
format = 1

[[line]]
name = "hall"
port = "/dev/ttyUSB0"

[[drive]]
name = "pump"
drive = "vabus:1"
armed = true
options = { model = "agile" }
values = { "480" = 1200 }
poll = [{ parameters = ["output_frequency"], period_s = 0.1 }]

[server]
status_period_s = 0.1
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    return path


def asked(server, where):
    with urllib.request.urlopen(f"{server.url}/api/v1/{where}", timeout=10) as answer:
        return json.load(answer)


def until(condition, seconds=10):
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


def test_served_plant_delivers_values_by_http(lines, path):
    server = lines.server(path)
    found = until(lambda: [each for each in asked(server, "values") if each["quality"] == "good" and each["reading"]])
    assert {each["drive"] for each in found} == {"pump"}
    assert server.plant.drive("pump").received_with(kind="enquiry")


def test_trip_of_a_served_drive_is_an_event(lines, path):
    server = lines.server(path)
    until(lambda: asked(server, "drives/pump")["reachability"] == "answers")
    server.plant.drive("pump").trip(3)
    assert until(lambda: [each for each in asked(server, "events") if each["kind"] == "fault"])[0]["drive"] == "pump"


def test_client_reads_and_writes_through_the_server(lines, path):
    server = lines.server(path)
    pump = server.client.drive("pump")
    assert str(pump.read("480")) == "12.00 Hz"
    pump.write("480", 20)
    server.plant.drive("pump").assert_holds("480", 2000)


@pytest.mark.soak
def test_command_line_reads_through_the_server(lines, path):
    lines.server(path)
    done = subprocess.run(
        [sys.executable, "-m", "drivecomm", "read", "pump", "480", "--plant", path],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "12.00 Hz" in done.stdout


def test_http_door_uses_a_free_port_instead_of_the_configured_one(lines, path):
    path.write_text(PLANT + '[[door]]\nkind = "http"\nlisten = "127.0.0.1:1"\n')
    assert asked(lines.server(path), "plant")["you"]["role"] == "view"


def test_two_servers_run_in_one_process(lines, path, tmp_path):
    other = tmp_path / "other.toml"
    other.write_text(PLANT.replace("pump", "fan").replace("USB0", "USB1"))
    first, second = lines.server(path), lines.server(other)
    assert asked(first, "plant")["drives"] == ["pump"]
    assert asked(second, "plant")["drives"] == ["fan"]
    assert [str(server.client.drive(name).read("480")) for server, name in [(first, "pump"), (second, "fan")]]


def test_closing_a_server_leaves_no_threads_files_or_variables(path):
    threads, before = set(threading.enumerate()), dict(os.environ)
    with LineMaker(0, folder=lambda: path.parent) as lines:
        server = lines.server(path)
        assert server.socket.exists() or os.name == "nt"
        folder = Path(os.environ["STATE_DIRECTORY"]).parent
    assert dict(os.environ) == before
    assert not server.socket.exists()
    assert not folder.exists()
    until(lambda: set(threading.enumerate()) <= threads)
    with pytest.raises(OSError, match="refused"):
        asked(server, "plant")


def test_invalid_plant_file_raises_file_format_error(lines, path):
    path.write_text(PLANT.replace("status_period_s", "status_perod_s"))
    with pytest.raises(FileFormatError, match="status_period_s"):
        lines.server(path)


@pytest.mark.soak
def test_served_plant_fixture_returns_a_server(run_pytest, path):
    run_pytest(
        f"""
        def test_it(served_plant):
            server = served_plant({str(path)!r})
            assert server.url.startswith("http://127.0.0.1:")
            assert server.client.drive("pump").status().fault is False
        """
    ).assert_outcomes(passed=1)


def test_open_plant_uses_the_running_server(lines, path):
    lines.server(path)
    with drivecomm.open_plant(path) as plant:
        assert str(plant.drive("pump").read("480")) == "12.00 Hz"
