"""Failures and shutdowns of a server, of its clients and of its resources, each with the outcome for the motors."""

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress

import pytest
from processes import QUICK, serving

from drivecomm.client import server_of_plant
from drivecomm.errors import DriveCommError

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and unix sockets are POSIX's")


@pytest.mark.soak
@pytest.mark.soak
def test_killed_server_leaves_the_motor_to_the_watchdog_of_the_drive(tmp_path):
    with serving(tmp_path) as served:
        served.keep("fan")
        served.keep("pump")
        served.process.kill()
        served.process.wait()
        served.until(lambda: not served.runs("fan") and not served.runs("pump"), 5)
        # The restarted server does not restart the motor.
        served.start()
        served.until(lambda: served.drive("fan")["reachability"] == "answers")
        time.sleep(0.5)
        assert not served.runs("fan")
        assert served.drive("fan")["kept"] == ""


@pytest.mark.soak
def test_terminated_server_stops_kept_motors(tmp_path):
    with serving(tmp_path) as served:
        served.keep("fan")
        served.end(signal.SIGTERM)
        assert served.process.returncode == 0
        served.until(lambda: not served.runs("fan"), 3)
        assert server_of_plant(served.plant) is None


WITHOUT_UNIX = """
import asyncio, signal, sys

def refused(*_):
    raise NotImplementedError

asyncio.SelectorEventLoop.add_signal_handler = refused
from drivecomm.server.http import door
door._HAS_UNIX_SOCKETS = False
from drivecomm.cli import main
raise SystemExit(main())
"""


@pytest.mark.soak
def test_server_without_unix_sockets_is_found_and_shut_down(tmp_path):
    with serving(tmp_path, start=False) as served:
        served.start(program=("-c", WITHOUT_UNIX))
        found = server_of_plant(served.plant)
        assert (found.socket, found.port > 0, len(found.token) > 20) == ("", True, True)
        served.keep("fan")
        status = subprocess.run(
            [sys.executable, "-m", "drivecomm", "status", "fan", "--plant", str(served.plant)],
            capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
        assert "running" in status.stdout, status.stderr
        served.process.send_signal(signal.SIGINT)
        assert served.process.wait(20) == 0
        assert served.process.stdout.read() == "ended\n"
        served.until(lambda: not served.runs("fan"), 1)
        assert "Traceback" not in served.log.read_text()
        assert server_of_plant(served.plant) is None


@pytest.mark.soak
@pytest.mark.soak
@pytest.mark.parametrize(
    "seconds", [0, pytest.param(10, marks=pytest.mark.soak), pytest.param(60, marks=pytest.mark.soak)]
)
def test_suspended_server_leaves_the_motor_to_the_watchdog(tmp_path, seconds):
    with serving(tmp_path) as served:
        served.keep("fan", seconds=30)
        served.process.send_signal(signal.SIGSTOP)
        try:
            served.until(lambda: not served.runs("fan"), 6)
            time.sleep(seconds)
        finally:
            served.process.send_signal(signal.SIGCONT)
        time.sleep(1.5)
        assert not served.runs("fan")
        served.until(lambda: served.drive("pump")["reachability"] == "answers")
        if seconds > 30:
            assert served.drive("fan")["lease"] is None
            served.until(lambda: served.drive("fan")["kept"] == "")


@pytest.mark.soak
@pytest.mark.soak
def test_policy_acts_on_the_motor_of_a_killed_commander(tmp_path):
    program = (
        "import sys, time; from drivecomm.client import LocalServer, server_of_plant;"
        "server = LocalServer(server_of_plant(sys.argv[1]));"
        "key = server.order('/api/v1/drives/fan/lease', {'seconds': 4})['key'];"
        "print(server.order('/api/v1/drives/fan/keep', {'id': '1', 'lease': key})['outcome'], flush=True);"
        "[(time.sleep(0.2), server.order('/api/v1/drives/fan/lease', {'key': key, 'seconds': 4}, method='PUT'))"
        " for _ in range(1000)]"
    )
    with serving(tmp_path) as served:
        served.until(lambda: served.drive("fan")["reachability"] == "answers")
        with subprocess.Popen(
            [sys.executable, "-c", program, str(served.plant)], stdout=subprocess.PIPE, text=True
        ) as commander:
            assert commander.stdout.readline() == "done\n"
            time.sleep(2)
            assert served.runs("fan")
            commander.kill()
        served.until(lambda: not served.runs("fan"), 10)
        served.until(lambda: served.drive("fan")["kept"] == "")
        assert [each["drive"] for each in served.events("link loss")][-1] == "fan"


@pytest.mark.soak
@pytest.mark.soak
def test_policy_acts_on_the_motor_of_a_suspended_commander(tmp_path):
    with serving(tmp_path) as served:
        served.keep("fan", seconds=1)
        # The lease is not renewed.
        served.until(lambda: served.drive("fan")["kept"] == "", 4)
        served.until(lambda: not served.runs("fan"), 4)
        assert served.drive("fan")["lease"] is None


@pytest.mark.soak
def test_second_server_of_a_plant_is_refused_and_names_the_first(tmp_path):
    with serving(tmp_path) as served:
        again = subprocess.run(
            [sys.executable, "-m", "drivecomm", "serve", str(served.plant)],
            env=served.environment, capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
        assert again.returncode == 2
        assert f"pid {served.process.pid}" in again.stderr
        assert served.drive("fan")["name"] == "fan"


@pytest.mark.soak
def test_silent_drive_does_not_affect_the_other_line(tmp_path):
    with serving(tmp_path) as served:
        served.until(lambda: served.drive("pump")["reachability"] == "answers")
        served.control.order("power", drive="fan", state="off")
        served.until(lambda: served.drive("fan")["reachability"] == "silent", 20)
        before = served.drive("pump")["answered_s"]
        served.until(lambda: served.drive("pump")["answered_s"] > before)
        served.control.order("power", drive="fan", state="on")
        served.until(lambda: served.drive("fan")["reachability"] == "answers", 20)


@pytest.mark.soak
def test_reload_adds_a_drive_and_keeps_a_running_motor(tmp_path):
    more = '\n[[drive]]\nname = "second"\ndrive = "danfoss-fc:4"\nline = "yard"\n'
    with serving(tmp_path) as served:
        served.keep("pump", seconds=30)
        text = served.plant.read_text()
        served.plant.write_text(text + more)
        served.process.send_signal(signal.SIGHUP)
        served.until(lambda: "second" in {each["name"] for each in served.ask("/api/v1/drives")})
        assert served.runs("pump")
        assert served.drive("pump")["kept"] == "trip"
        served.plant.write_text(text + "\nnonsense")
        served.process.send_signal(signal.SIGHUP)
        served.until(lambda: any("nothing changes" in each["text"] for each in served.events("warning")))
        assert "second" in {each["name"] for each in served.ask("/api/v1/drives")}
        assert served.runs("pump")


@pytest.mark.soak
def test_server_waiting_for_a_door_survives_a_reload_and_can_be_terminated(tmp_path):
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        serving(tmp_path, tail=f'[[door]]\nkind = "http"\nlisten = "127.0.0.1:{taken.getsockname()[1]}"\n',
                start=False) as served,
        served.log.open("ab") as log,
    ):  # fmt: skip
        served.process = subprocess.Popen(
            [sys.executable, "-m", "drivecomm", "serve", str(served.plant)],
            env=served.environment, stdout=subprocess.PIPE, stderr=log, text=True, cwd=tmp_path,
        )  # fmt: skip
        served.until(lambda: server_of_plant(served.plant) is not None)
        # Repeated requests succeed although the server still waits up to twenty seconds for the door.
        served.until(lambda: answers(served, "fan"))
        served.keep("fan")
        served.process.send_signal(signal.SIGHUP)
        served.until(lambda: answers(served, "fan"))
        assert served.process.poll() is None
        began = time.monotonic()
        served.end(signal.SIGTERM)
        assert served.process.returncode == 0
        assert time.monotonic() - began < 5
        served.until(lambda: not served.runs("fan"), 3)


def answers(served, drive):
    with suppress(DriveCommError):
        return served.drive(drive)["reachability"] == "answers"
    return False


@pytest.mark.soak
def test_full_disk_refuses_every_command_except_a_stop(tmp_path):
    """A limit on the size of files simulates the full disk."""
    small = QUICK + 'history = false\naudit = "audit.jsonl"\n'
    with serving(tmp_path, head=small) as served:
        served.keep("fan")
        size = (tmp_path / "audit.jsonl").stat().st_size
        resource.prlimit(served.process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
        answer = served.ask("/api/v1/drives/pump/reset", {"id": "1"})
        assert answer["outcome"] == "refused", answer
        assert "audit record cannot be written" in answer["error"]["text"]
        assert served.ask("/api/v1/drives/fan/stop", {"id": "2"})["outcome"] == "done"
        served.until(lambda: not served.runs("fan"))
        resource.prlimit(served.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        served.until(lambda: served.ask("/api/v1/drives/pump/reset", {"id": "3"})["outcome"] != "refused")


@pytest.mark.soak
def test_command_is_in_the_audit_before_it_is_sent(tmp_path):
    with serving(tmp_path, head=QUICK + 'audit = "audit.jsonl"\n') as served:
        served.keep("fan")
        served.process.kill()
        served.process.wait()
        records = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
        assert [(each["record"], each["drive"], each["verb"]) for each in records][:1] == [("asked", "fan", "keep")]


@pytest.mark.soak
def test_server_counts_leases_by_the_monotonic_clock(tmp_path):
    """Leases use a clock that cannot be set, see `drivecomm.server.leases`.

    This test checks that the server passes that clock.
    """
    with serving(tmp_path) as served:
        served.keep("fan", seconds=2)
        until_s = float(served.drive("fan")["lease"]["until_s"])
        assert abs(until_s - time.time() - 2) < 3


ALARM = """
[[alarm]]
name = "no answer"
drives = ["fan"]
on = "silent"
"""


@pytest.mark.soak
def test_reload_changes_alarm_rules(tmp_path):
    with serving(tmp_path, tail=ALARM) as served:
        served.plant.write_text(served.plant.read_text().replace("no answer", "fan is gone"))
        served.process.send_signal(signal.SIGHUP)
        served.until(lambda: any("plant file read again" in each["text"] for each in served.events("server")))
        assert not any("started again" in each["text"] for each in served.events("server"))
        served.control.order("power", drive="fan", state="off")
        served.until(lambda: [each["rule"] for each in served.ask("/api/v1/alarms")] == ["fan is gone"], 20)


CABLE = """\
format = 1
[server]
status_period_s = 0.1
[[line]]
name = "yard"
port = "socket://127.0.0.1:{port}"
listen = "tcp:127.0.0.1:{port}"
"""
ON_CABLE = """\
[[drive]]
name = "fan {address}"
drive = "danfoss-fc:{address}"
"""


@pytest.mark.soak
@pytest.mark.soak
def test_lost_line_is_reported_once_and_reopened(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with serving(tmp_path, start=False) as served:
        served.plant.write_text(CABLE.format(port=port) + "".join(ON_CABLE.format(address=at) for at in range(1, 6)))
        simulate = [sys.executable, "-m", "drivecomm", "simulate", str(served.plant)]

        def all_are(reachability):
            return {each["reachability"] for each in served.ask("/api/v1/drives")} == {reachability}

        served.start()
        served.until(lambda: all_are("silent"))
        with subprocess.Popen(simulate, stdout=subprocess.PIPE, text=True) as simulator:
            served.until(lambda: all_are("answers"))
            simulator.kill()
        served.until(lambda: all_are("silent"))
        assert sum(each["kind"] == "silent" for each in served.events()) == 10
        with subprocess.Popen(simulate, stdout=subprocess.PIPE, text=True) as simulator:
            served.until(lambda: all_are("answers"), 20)
            served.end(signal.SIGTERM)
            simulator.kill()
        told = [line for line in served.log.read_text().splitlines() if " warning " in line]
        assert [text.partition("warning ")[2][:11] for text in told if "works again" not in text] == ["yard: line:"] * 2
        assert sum("works again" in text for text in told) == 2
        assert "answers again" not in served.log.read_text()
