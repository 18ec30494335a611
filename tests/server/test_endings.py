"""How a server, its clients and what it stands on may end, and what becomes of the motors: each with its outcome."""

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
def test_a_server_that_is_killed_leaves_the_motor_to_the_drives_own_watchdog(tmp_path):
    with serving(tmp_path) as served:
        served.keep("fan")
        served.keep("pump")
        served.process.kill()
        served.process.wait()
        served.until(lambda: not served.runs("fan") and not served.runs("pump"), 5)
        # Nothing is started again by itself.
        served.start()
        served.until(lambda: served.drive("fan")["reachability"] == "answers")
        time.sleep(0.5)
        assert not served.runs("fan")
        assert served.drive("fan")["kept"] == ""


@pytest.mark.soak
def test_a_server_that_is_told_to_end_stops_what_it_keeps_and_sets_the_watchdog_as_it_was(tmp_path):
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
def test_without_unix_sockets_and_signals_in_the_loop_it_is_found_and_ends_as_elsewhere(tmp_path):
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
def test_a_server_that_is_stopped_for_long_leaves_the_motor_to_the_watchdog_and_starts_nothing_after_it(
    tmp_path, seconds
):
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
def test_a_commander_that_dies_has_its_motor_treated_by_the_policy(tmp_path):
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
def test_a_commander_that_is_stopped_is_like_one_that_died(tmp_path):
    with serving(tmp_path) as served:
        served.keep("fan", seconds=1)
        # Nobody renews it.
        served.until(lambda: served.drive("fan")["kept"] == "", 4)
        served.until(lambda: not served.runs("fan"), 4)
        assert served.drive("fan")["lease"] is None


@pytest.mark.soak
def test_a_second_server_of_the_plant_refuses_and_names_the_first(tmp_path):
    with serving(tmp_path) as served:
        again = subprocess.run(
            [sys.executable, "-m", "drivecomm", "serve", str(served.plant)],
            env=served.environment, capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
        assert again.returncode == 2
        assert f"pid {served.process.pid}" in again.stderr
        assert served.drive("fan")["name"] == "fan"


@pytest.mark.soak
def test_a_port_that_goes_and_comes_back_costs_the_other_line_nothing(tmp_path):
    with serving(tmp_path) as served:
        served.until(lambda: served.drive("pump")["reachability"] == "answers")
        served.control.order("power", drive="fan", state="off")
        served.until(lambda: served.drive("fan")["reachability"] == "silent", 20)
        before = served.drive("pump")["answered_s"]
        served.until(lambda: served.drive("pump")["answered_s"] > before)
        served.control.order("power", drive="fan", state="on")
        served.until(lambda: served.drive("fan")["reachability"] == "answers", 20)


@pytest.mark.soak
def test_the_plant_file_is_read_again_without_dropping_what_did_not_change(tmp_path):
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
        served.until(lambda: any("stays as it is" in each["text"] for each in served.events("warning")))
        assert "second" in {each["name"] for each in served.ask("/api/v1/drives")}
        assert served.runs("pump")


@pytest.mark.soak
def test_while_a_door_cannot_open_the_server_is_not_ended_by_a_reload_and_ends_when_it_is_told(tmp_path):
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
        # As if it was asked for all the time: the door is given twenty seconds.
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
def test_without_room_on_the_disk_nothing_is_commanded_but_a_stop(tmp_path):
    """A limit on the size of files stands for a disk that is full."""
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
def test_what_was_commanded_is_in_the_audit_before_it_is_done(tmp_path):
    with serving(tmp_path, head=QUICK + 'audit = "audit.jsonl"\n') as served:
        served.keep("fan")
        served.process.kill()
        served.process.wait()
        records = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
        assert [(each["record"], each["drive"], each["verb"]) for each in records][:1] == [("asked", "fan", "keep")]


@pytest.mark.soak
def test_a_clock_that_is_set_changes_no_lease(tmp_path):
    """Leases count by a clock that nobody sets: see `drivecomm.server.leases`; here, that the server uses it."""
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
def test_alarms_are_read_again_with_the_plant_file(tmp_path):
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
def test_a_line_that_is_lost_is_told_once_and_opened_again(tmp_path):
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
