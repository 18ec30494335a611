"""Commands through a server and at bare ports: the same output and the same exit code."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from extents import every
from fake_server import FakeServer, serving
from running_server import running_server
from serving_threads import served_in_thread

from drivecomm.capture import read_capture
from drivecomm.cli import main
from drivecomm.plant import read_plant
from drivecomm.server import Caller, Role
from drivecomm.virtual import PlantServer, VirtualPlant

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

PLANT = """
format = 1

[[line]]
name = "hall"
listen = "pty:{folder}/hall"
paced = false

[[drive]]
name = "pump"
drive = "vabus:1"
options = {{ model = "agile" }}
armed = true
poll = [{{ parameters = ["output_frequency"], period_s = 0.05 }}]
link_loss = {{ policy = "trip", watchdog_s = 5 }}
reply_delay_s = 0.0

[[drive]]
name = "fan"
title = "exhaust fan"
drive = "danfoss-fc:3"
options = {{ model = "fc300" }}
reply_delay_s = 0.0

[[fault]]
drive = "fan"
trip = {{ code = 14, at_s = 0 }}
"""

PORT = "{folder}/hall"
"""Port of the plant's line; `PlantFolder` fills in the folder."""

COMMANDS = {
    "read": ["read", "pump", "output_frequency", "480"],
    "read in JSON": ["read", "pump", "output_frequency", "480", "--json"],
    "read by address": ["read", "vabus:1", "481", "--port", PORT],
    "read of another model": ["read", "pump,model=active", "481"],
    "read what there is not": ["read", "pump", "output_frequncy"],
    "read with one that fails": ["read", "pump", "99999", "480"],
    "read of a drive that there is not": ["read", "pomp", "480"],
    "read of a silent one": ["read", "vabus:9", "480", "--port", PORT, "--attempts", "1", "--timeout", "0.05"],
    "read of no address": ["read", "vabus:77", "480", "--port", PORT],
    "write": ["write", "pump", "480", "12.50"],
    "write and read back": ["write", "pump", "480", "10", "--read-back"],
    "write an exact decimal": ["write", "pump", "480", "10.10", "--json"],
    "write what does not fit": ["write", "pump", "480", "1e30"],
    "write a read-only one": ["write", "fan", "3-03", "50"],
    "write a read-only one for once": ["write", "fan", "3-03", "50", "--arm"],
    "arm an armed one": ["write", "pump", "480", "1", "--arm"],
    "status": ["status", "pump"],
    "status in JSON": ["status", "pump", "--json"],
    "status with a fault": ["status", "fan"],
    "status of all": ["status"],
    "status of all in JSON": ["status", "--json"],
    "start and leave": ["start", "pump", "--link-loss", "hold", "--percent", "50"],
    "start without a policy": ["start", "fan", "--arm"],
    "start a read-only one": ["start", "fan", "--link-loss", "hold"],
    "stop": ["stop", "pump"],
    "stop in JSON": ["stop", "pump", "--json"],
    "stop all of a protocol on a line": ["stop", "danfoss-fc:*", "--port", PORT],
    "stop all of a protocol": ["stop", "danfoss-fc:*"],
    "stop all of a protocol that cannot all at once": ["stop", "vabus:*", "--json"],
    "stop otherwise": ["stop", "pump", "--how", "coast"],
    "stop as it cannot": ["stop", "fan", "--how", "dc-brake", "--json"],
    "stop a silent one": ["stop", "vabus:9", "--port", PORT, "--attempts", "1", "--timeout", "0.05"],
    "reset": ["reset", "pump"],
    "reset a read-only one": ["reset", "fan"],
    "reference": ["reference", "pump", "12.5Hz"],
    "reference in per cent": ["reference", "pump", "--percent", "33.3", "--json"],
    "wait": ["wait", "pump", "ready", "--seconds", "1"],
    "wait in vain": ["wait", "pump", "running", "--seconds", "0.3"],
    "wait for a fault": ["wait", "fan", "running", "--seconds", "1"],
    "call": ["call", "fan", "jog", "--arm"],
    "call what there is not": ["call", "pump", "fly"],
    "call on a read-only one": ["call", "fan", "jog"],
    "poll": ["poll", "--cycles", "2"],
    "poll in JSON": ["poll", "pump", "480@0.05", "fan", "3-03@0.05", "--cycles", "2", "--json"],
    "poll what cannot be": ["poll", "pump", "nonsense", "--cycles", "1"],
    "scan": ["scan", "--protocol", "vabus", "-a", "1-3", "--timeout", "0.05"],
    "scan in JSON": ["scan", "--protocol", "vabus", "-a", "1-2", "--timeout", "0.05", "--json"],
    "scan in vain": ["scan", "--protocol", "vabus", "-a", "7", "--timeout", "0.05"],
    "stats": ["stats", "pump", "--for", "0.2", "--json"],
    "doctor": ["doctor", "--quick", "--protocol", "vabus", "-a", "1-2", "--timeout", "0.05"],
    "backup": ["backup", "pump", "{folder}/pump.toml"],
    "backup of everything": ["backup", "pump", "{folder}/pump.toml", "--everything", "--within", "28..60"],
    "backup of everything in JSON": [
        "backup",
        "pump",
        "{folder}/pump.toml",
        "--everything",
        "--within",
        "29",
        "--json",
    ],
    "grow a model of what answers": ["models", "grow", "pump", "480", "29", "3", "--write", "{folder}/grown.toml"],
    "restore": ["restore", "fan", "{folder}/fan.toml", "--arm", "--volatile", "--json"],
    "grow a model": ["models", "grow", "fan", "3-41", "3-42", "--write", "{folder}/grown.toml"],
    "compare": ["compare", "pump", "pump"],
}
"""Command lines by the name of the test case."""

TIMES = (
    (re.compile(r"^(ok|note) +time .*", re.MULTILINE), "REPLY TIMES"),
    (re.compile(r"\d\d:\d\d:\d\d(\.\d+)?"), "CLOCK"),
    (re.compile(r'"(time_s|age_s|late_s|took_s|due_s|seconds)": [-\d.e]+'), r'"\1": T'),
    (re.compile(r"\d\d\d\d-\d\d-\d\d[T ]CLOCK(\+\d\d:\d\d|Z)?"), "DATE"),
    (re.compile(r"^ +\d+\.\d+  (?=->|<-|  )", re.MULTILINE), " T  "),
    (re.compile(r'"missed": \d+'), '"missed": N'),
    (re.compile(r'"counters": .*'), "COUNTS"),
    (re.compile(r"\d+\.\d s\b"), "T s"),
    (re.compile(r"pid \d+"), "PID"),
)


def masked(text):
    for pattern, instead in TIMES:
        text = pattern.sub(instead, text)
    return text


class PlantFolder:
    """Folder with a running virtual plant, in which commands are run. file: the plant file."""

    def __init__(self, folder, capsys):
        self.folder = folder
        self.file = folder / "plant.toml"
        self.file.write_text(PLANT.format(folder=folder), encoding="utf-8")
        self._capsys = capsys

    def __call__(self, *arguments):
        self._capsys.readouterr()
        code = main([str(each).format(folder=self.folder) for each in arguments])
        said = self._capsys.readouterr()
        return code, masked(said.out), masked(said.err)


@pytest.fixture
def place(request, tmp_path, capsys, monkeypatch):
    """Serve the drives of a plant file in a thread; yield the folder as a `PlantFolder`."""
    # The path of a Unix socket has at most about a hundred characters.
    runtime = Path(tempfile.mkdtemp(prefix="dc"))
    request.addfinalizer(lambda: shutil.rmtree(runtime, ignore_errors=True))  # noqa: PT021 - runs even if a later step fails
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("DRIVECOMM_PORT", "DRIVECOMM_PLANT", "RUNTIME_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    one = PlantFolder(tmp_path, capsys)
    with served_in_thread(PlantServer(VirtualPlant(read_plant(one.file)))):
        yield one


@pytest.mark.soak
@pytest.mark.parametrize("command", every(4, COMMANDS))
def test_command_prints_the_same_through_a_server_as_at_bare_ports(place, command):
    words = COMMANDS[command]
    if words[0] == "restore":
        assert place("backup", "fan", words[2])[0] == 0
    bare = place(*words)
    (place.folder / "grown.toml").unlink(missing_ok=True)
    with running_server(place.file):
        served = place(*words)
    assert served == bare


def run_start(*arguments, end=lambda process: process.send_signal(signal.SIGINT)):
    """Run a start that stays, call `end` when the motor has started, and return the exit code and the output."""
    command = [sys.executable, "-m", "drivecomm", "start", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        said = []
        for text in process.stdout:
            said.append(text)
            if "started" in text:
                try:
                    end(process)
                except BaseException:
                    process.kill()
                    raise
        complaint = process.stderr.read()
    return process.returncode, masked("".join(said)), masked(complaint)


@pytest.mark.soak
@pytest.mark.parametrize("further", [[], ["--json"], ["--watchdog", "3", "--percent", "40", "--reverse"]], ids=str)
def test_start_until_ctrl_c_prints_the_same_through_a_server(place, further):
    bare = run_start("pump", *further)
    with running_server(place.file):
        served = run_start("pump", *further)
    assert served == bare
    assert bare[0] == 0
    assert place("wait", "pump", "ready")[0] == 0


@pytest.mark.soak
def test_start_ended_by_another_stop_prints_the_same_through_a_server(place):
    def stop(_):
        subprocess.run([sys.executable, "-m", "drivecomm", "stop", "pump"], check=True, capture_output=True)

    bare = run_start("pump", end=stop)
    with running_server(place.file):
        served = run_start("pump", end=stop)
    assert served == bare
    assert bare[0] == 0


def test_drift_is_the_same_through_a_server(place):
    accepted = place("baseline", "accept", "pump", "--by", "Anna")
    assert place("write", "pump", "482", "15", "--store")[0] == 0
    bare = place("drift", "pump")
    with running_server(place.file):
        assert place("drift", "pump") == bare
        served = place("baseline", "accept", "pump", "--by", "Anna")
        assert place("drift", "pump")[0] == 0
    assert bare[0] == 1
    assert (accepted[0], served[0]) == (0, 0)
    assert served[1].splitlines()[-1] == accepted[1].splitlines()[-1]
    assert "482[1] fixed_frequency_3  25.00 Hz -> 15.00 Hz" in bare[1]


def test_refused_start_prints_the_same_through_a_server(place):
    bare = place("start", "fan", "--arm", "--link-loss", "ramp", "--watchdog", "2.55")
    with running_server(place.file):
        served = place("start", "fan", "--arm", "--link-loss", "ramp", "--watchdog", "2.55")
    assert served == bare
    assert bare[0] == 2


@pytest.mark.parametrize("as_json", [[], ["--json"]], ids=["text", "json"])
def test_stop_all_through_a_server_reports_each_confirmed_drive(place, as_json):
    code, bare, _ = place("stop", "--all", *as_json)
    with running_server(place.file):
        code_served, served, complaint = place("stop", "--all", *as_json)
    assert code_served == code == 0
    assert complaint == ""
    # The drives are printed in the order of their confirmations.
    assert sorted(served.splitlines()) == sorted(bare.splitlines())
    assert ":*" in served


def wait_until(condition):
    """Wait until the condition holds, which the server brings about in the background; fail after 10 s."""
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_status_shows_a_standing_stop_of_the_server(place):
    plc = Caller(name="10.0.0.4", role=Role.OPERATE, door="modbus-tcp 127.0.0.1:502")
    said = "stop (ramp) demanded by 10.0.0.4 (modbus-tcp 127.0.0.1:502)"
    with running_server(place.file) as plant:
        release = plant.hold_stop(plc, "pump", "ramp")
        wait_until(lambda: str(plant.standing_stops().get("pump")) == said)
        code, text, _ = place("status", "pump")
        assert (code, text.splitlines()[0]) == (0, f"pump  {said}")
        assert f'"standing_stop": "{said}"' in place("status", "pump", "--json")[1]
        assert f'"standing_stop": "{said}"' in place("status", "--json")[1]
        assert said in " ".join(place("status")[1].split())
        release()
        wait_until(lambda: not plant.standing_stops())
        assert "demanded" not in place("status")[1]


def test_stop_all_of_a_port_stops_the_drives_of_its_line(place):
    with running_server(place.file):
        code, said, _ = place("stop", "--all", "--port", PORT)
    assert code == 0
    assert sorted(said.splitlines()) == [
        "hall: danfoss-fc:*  stop (ramp) sent to all",
        "hall: fan  stop (ramp) confirmed",
        "hall: pump  stop (ramp) confirmed",
    ]


@pytest.mark.soak
@pytest.mark.parametrize("command", [["stop", "pump"], ["stop", "--all"], ["stop", "danfoss-fc:*"]], ids=" ".join)
def test_stop_goes_to_the_port_if_the_server_does_not_answer(place, command):
    bare = place(*command)
    with serving(place.file) as server:
        for plant in server.plants.values():
            plant.close()
        server.hang.set()
        began = time.monotonic()
        code, said, complaint = place(*command)
        took_s = time.monotonic() - began
    assert (code, said) == bare[:2]
    assert "does not answer" in complaint
    assert "; trying " in complaint
    assert took_s < 5


@pytest.mark.soak
def test_command_names_the_server_that_does_not_answer(place):
    with serving(place.file) as server:
        server.hang.set()
        code, _, complaint = place("read", "pump", "480")
    assert code == 3
    assert f"the server of {place.file} (PID) does not answer" in complaint


@pytest.mark.parametrize("command", [["tune", "pump"], ["replay", "{folder}/said.jsonl"]], ids=lambda each: each[0])
def test_command_that_needs_the_port_itself_names_the_server(place, command):
    assert place("read", "pump", "480", "--record", "{folder}/said.jsonl")[0] == 0
    with running_server(place.file):
        code, _, complaint = place(*command)
    assert code == 3
    assert f"in use by drivecomm serve {place.file} (PID), and {command[0]} needs it alone; stop that" in complaint


@pytest.mark.parametrize("flag", ["--rs485", "--echo", "--low-latency"])
def test_line_flag_without_effect_at_a_server_is_refused(place, flag):
    with running_server(place.file):
        code, _, complaint = place("read", "pump", "480", flag)
    assert code == 2
    assert f"so {flag} has no effect; leave it out" in complaint


def test_trace_through_a_server_holds_the_telegrams_of_the_command(place):
    code, said, trace = place("read", "pump", "480", "--trace")
    with running_server(place.file):
        code_served, said_served, trace_served = place("read", "pump", "480", "--trace")
    assert (code_served, said_served) == (code, said)
    asked = [text for text in trace.splitlines() if "->" in text or "<-" in text]
    assert len(asked) == 3
    # The trace also holds the requests of the server itself.
    left = iter(trace_served.splitlines())
    assert all(text in left for text in asked)


def test_recording_through_a_server_holds_the_telegrams_of_the_command(place):
    with running_server(place.file):
        code, _, complaint = place("read", "pump", "480", "--record", "{folder}/said.jsonl")
    assert (code, complaint) == (0, "")
    pieces = read_capture(place.folder / "said.jsonl").pieces
    asked = next(each for each in pieces if each.data == bytes.fromhex("0441303034383005"))
    assert asked.source == "master"
    assert "<-" in place("sniff", "{folder}/said.jsonl")[1]


@pytest.mark.soak
def test_sniff_listens_to_the_servers_own_traffic(place):
    with running_server(place.file):
        code, said, complaint = place("sniff", PORT, "--protocol", "vabus", "--for", "0.5")
    assert code == 0
    assert "parameter=210" in said
    assert "listening at" in complaint
    assert "through its server" in complaint


def test_stop_all_reports_each_drive_as_it_confirms_or_fails(place, monkeypatch):
    """Hold the failure of the silent drive back until the other drive has been reported."""
    reported, carry_out = threading.Event(), FakeServer.command

    def command(server, drive, verb, body):
        if getattr(drive, "name", "") != "vabus:1":
            return carry_out(server, drive, verb, body)
        assert reported.wait(10), "the report of one drive waits for another one"
        silent = {"kind": "NoReplyError", "text": "vabus:1 did not answer", "exit_code": 4}
        return {"id": "", "outcome": "open", "result": None, "error": silent}

    def say(text=""):
        if "fan  stop (ramp) confirmed" in text:
            reported.set()
        sys.stdout.write(text + "\n")

    monkeypatch.setattr(FakeServer, "command", command)
    monkeypatch.setattr("drivecomm.cli.stop.results.say", say)
    with serving(place.file):
        code, said, complaint = place("stop", "--all")
    assert code == 5
    assert "hall: fan  stop (ramp) confirmed\n" in said
    assert "pump" not in said
    assert complaint.startswith("drivecomm: hall: pump has not confirmed its stop: vabus:1 did not answer")


LOADING = """
import sys
from drivecomm_command import main
sys.argv[0] = "drivecomm"
code = main()
print("loaded", *sorted(sys.modules))
sys.exit(code)
"""
UNNEEDED_MODULES = {
    *("construct", "serial", "ssl", "email", "http.client", "asyncio", "hashlib", "platformdirs", "logging", "rich"),
    *("drivecomm_vabus", "drivecomm_danfoss_fc", "drivecomm.bus.bus", "drivecomm.bus.line_drives", "drivecomm.server"),
    *(
        "drivecomm.models.files",
        "drivecomm.link.link",
        "drivecomm.transport.serial_port",
        "drivecomm.client.line_trace",
    ),
}
"""Modules that no command through a server needs."""


@pytest.mark.soak
@pytest.mark.parametrize(
    "command", [["read", "pump", "output_frequency"], ["status", "pump"], ["reference", "pump", "1Hz"]]
)
def test_command_through_a_server_loads_few_modules(place, command):
    with running_server(place.file):
        done = subprocess.run(
            [sys.executable, "-c", LOADING, *command], capture_output=True, text=True, check=True, timeout=60
        )
    assert not UNNEEDED_MODULES & set(done.stdout.split())
