"""Every command against a plant that a server owns and against bare ports: the same output, the same exit code."""

import os
import re
import threading

import pytest
from fake_server import serving

from drivecomm.cli import main
from drivecomm.plant import read_plant
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
poll = [{{ parameters = ["output_frequency"], period_s = 0 }}]
link_loss = {{ policy = "ramp", watchdog_s = 5 }}
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
"""Stands for the port of the plant's line."""

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
    "compare": ["compare", "pump", "pump"],
    "trace": ["read", "pump", "480", "--trace"],
    "record": ["read", "pump", "480", "--record", "{folder}/said.jsonl"],
}
"""By what they show."""

TIMES = (
    (re.compile(r"\d\d:\d\d:\d\d(\.\d+)?"), "CLOCK"),
    (re.compile(r'"(time_s|age_s|late_s|took_s|due_s|seconds)": [-\d.e]+'), r'"\1": T'),
    (re.compile(r"\d\d\d\d-\d\d-\d\d[T ]CLOCK(\+\d\d:\d\d|Z)?"), "DATE"),
    (re.compile(r"^ +\d+\.\d+  (?=->|<-|  )", re.MULTILINE), " T  "),
    (re.compile(r"\d+(\.\d+)? (ms|to)\b"), r"N \2"),
    (re.compile(r'"counters": .*'), "COUNTS"),
    (re.compile(r"\d+\.\d s\b"), "T s"),
    (re.compile(r"pid \d+"), "PID"),
)


def masked(text):
    for pattern, instead in TIMES:
        text = pattern.sub(instead, text)
    return text


class Place:
    """A plant of virtual drives that runs, and commands in it. file: its plant file."""

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
def place(tmp_path, capsys, monkeypatch):
    """A folder with a plant file, whose drives a thread serves."""
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    for name in ("DRIVECOMM_PORT", "DRIVECOMM_PLANT", "RUNTIME_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    one = Place(tmp_path, capsys)
    stop = threading.Event()
    with PlantServer(VirtualPlant(read_plant(one.file))) as server:
        thread = threading.Thread(target=server.run, args=(stop,), daemon=True)
        thread.start()
        yield one
        stop.set()
        thread.join()


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_the_same_through_a_server_as_on_bare_ports(place, command):
    bare = place(*command)
    with serving(place.file) as server:
        served = place(*command)
        asked = [each for each in server.requests if each[1] != "/healthz"]
    assert served == bare
    assert asked or bare[0] == 2, "it did not go through the server"
