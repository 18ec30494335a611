"""Every command with unusual standard streams (closed, full, without a reader, ASCII only), and interrupted early."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from extents import LONG, every
from forked_commands import Commands

from drivecomm.cli.app import READING, app

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")

PLANT = """
format = 1
[[line]]
name = "hall"
listen = "tcp:127.0.0.1:0"
paced = false
[[drive]]
name = "Lüfter"
drive = "vabus:1"
options = { model = "agile", reply_timeout_s = 5 }
armed = true
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = { model = "fc300", reply_timeout_s = 5 }
armed = true
"""

MODEL = """
format = 1
protocol = "vabus"
name = "small"
source = "this test"
[[parameter]]
address = "480"
name = "reference"
type = "int"
access = "rw"
"""

# Long reply timeouts, because the machine that runs the tests may be busy.
# Arguments with which each command does something and ends soon. PORT and CONTROL are those of the served plant.
CALLS = {
    "demo": "--port nowhere",
    "protocols": "",
    "decode": "0441303034383105",
    "encode": "vabus kind=enquiry address=1 parameter=481",
    "scan": "--port PORT --protocol vabus --addresses 1 --timeout 5 --write found.toml --force",
    "doctor": "--port nowhere",
    "stats": "vabus:1 --port PORT --for 0.05 --timeout 5",
    "tune": "vabus:1 --port nowhere",
    "read": "Lüfter 481",
    "write": "Lüfter 480 500",
    "status": "",
    "start": "Lüfter --link-loss hold",
    "stop": "--all",
    "reset": "Lüfter",
    "reference": "Lüfter 10Hz",
    "wait": "Lüfter ready --seconds 0.2",
    "call": "fan set_relay number=1 on=true",
    "backup": "Lüfter set.toml --model small.toml",
    "compare": "factory.toml factory.toml",
    "restore": "Lüfter factory.toml --model small.toml",
    "replace": "Lüfter factory.toml",
    "baseline accept": "Lüfter,model=small.toml --from factory.toml",
    "baseline show": "",
    "drift": "",
    "report": "Lüfter --model small.toml",
    "poll": "Lüfter output_frequency --period 0.01 --cycles 3",
    "watch": "",
    "plot": "nowhere.csv -o values.png",
    "history": "--file nowhere.sqlite",
    "forecast": "Lüfter output_frequency@1",
    "cohabit": "--drive vabus:1",
    "alarms list": "",
    "alarms acknowledge": "none-1",
    "alarms check": "nowhere.toml",
    "simulate": "nowhere.toml",
    "serve": "nowhere.toml",
    "fleet show": "mqtt://127.0.0.1:1",
    "fleet history": "hall fan --from nowhere://record",
    "fleet alarms": "--from nowhere://record",
    "fleet acknowledge": "mqtt://127.0.0.1:1 hall none-1",
    "fleet record": "--broker mqtt://127.0.0.1:1 --to nowhere://record",
    "replay": "heard.jsonl --port PORT --faster 100 --timeout 5",
    "sniff": "heard.jsonl",
    "conformance": "vabus --only no_such_check",
    "plant trip": "fan 14 --control CONTROL",
    "plant power": "fan on --control CONTROL",
    "plant set": "Lüfter 480 500 --control CONTROL",
    "plant inject": "hall 00 --control CONTROL",
    "plant fault": "fault.toml --control CONTROL",
    "plant show": "--control CONTROL",
    "plant telegrams": "--control CONTROL",
    "plant violations": "--control CONTROL",
    "plant counters": "--control CONTROL",
    "plant state": "--control CONTROL",
    "judge": "--drive vabus:1 --task read=481 --list",
    "prove": "vabus:1 --port nowhere --model agile",
    "models list": "vabus",
    "models show": "agile --quantities",
    "models check": "nowhere.toml",
    "models names": "",
    "models draw": "--seed 1 --count 2",
    "models apply-proof": "nowhere.toml",
    "models grow": "vabus:1 grown.toml --port nowhere",
    "tags export": "plant.toml",
    "tags import": "nowhere.csv plant.toml",
    "models import": "nowhere.csv",
    "models setup": "vabus/agile",
    "users add": "anna --role boss",
    "users list": "--file nowhere.toml",
    "users remove": "anna --file nowhere.toml",
    "vectors check": "nowhere.toml",
    "vectors from-capture": "heard.jsonl --protocol vabus",
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Serve a plant from a folder with the files of all calls; yield the folder and the values of PORT and CONTROL."""
    folder = tmp_path_factory.mktemp("plant")
    (folder / "served.toml").write_text(PLANT, encoding="utf-8")
    (folder / "small.toml").write_text(MODEL, encoding="utf-8")
    (folder / "fault.toml").write_text('line = "hall"\ninject = { data = "00", at_s = 1e6 }\n', encoding="utf-8")
    command = [sys.executable, "-m", "drivecomm", "simulate", "served.toml", "--json"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as served:
        told = json.loads(served.stdout.readline())
        places = {"PORT": told["lines"][0]["listening"], "CONTROL": told["control"]}
        text = PLANT.replace("listen = ", "port = ").replace("tcp:127.0.0.1:0", places["PORT"])
        (folder / "plant.toml").write_text(text, encoding="utf-8")
        yield folder, places
        served.send_signal(signal.SIGTERM)


@pytest.fixture(scope="module")
def run(place):
    """Yield a function that runs a command of `CALLS` with its standard streams as given."""
    folder, places = place
    commands = Commands(folder)

    def call(command, **conditions):
        words = f"{command} {CALLS[command]}".split()
        done = commands(*(places.get(word, word) for word in words), **conditions)
        assert "Traceback" not in done.err, (command, conditions, done.err)
        assert "Exception ignored" not in done.err, (command, conditions, done.err)
        return done

    commands("read", "Lüfter", "481", "--record", "heard.jsonl")
    assert commands("backup", "Lüfter", "factory.toml", "--model", "small.toml").code == 0
    yield call
    commands.close()


def names(command=None, before=""):
    for name, each in (app if command is None else command).commands.items():
        loaded = getattr(each, "loaded", each)
        if hasattr(loaded, "commands"):
            yield from names(loaded, f"{before}{name} ")
        else:
            yield f"{before}{name}"


def test_table_of_calls_has_every_command():
    assert set(CALLS) == set(names())
    assert {name.partition(" ")[0] for name in CALLS} >= READING


def reads_only(command):
    return command.partition(" ")[0] in READING


# Commands that do more than read
DOING = [command for command in CALLS if not reads_only(command)]


@pytest.mark.soak
@pytest.mark.parametrize("command", every(4, [*DOING, *filter(reads_only, CALLS)]))
def test_command_copes_with_broken_standard_streams(run, command):
    usual = run(command)
    reads = reads_only(command)

    def allowed(when_lost):
        if not (reads and usual.out):
            return {usual.code}
        # A command may fail on its output before it finds its usual error.
        return {when_lost, usual.code} - {0}

    gone = run(command, stdout="gone")
    assert gone.code in allowed(141)
    assert gone.err == usual.err
    full = run(command, stdout="full")
    assert full.code in allowed(1)
    assert ("standard output cannot be written: No space left" in full.err) == bool(usual.out)
    assert run(command, stdin="closed", stdout="closed", stderr="closed").code == usual.code
    ascii_only = run(command, stdin="closed", encoding="ascii")
    assert ascii_only.code == usual.code
    assert ascii_only.out.isascii()
    if LONG:
        assert run(command, stdout="closed").code == usual.code
        assert run(command, stdout="full", stderr="full").code == full.code
        assert run(command, stdout="gone", stderr="gone").code == gone.code


@pytest.mark.parametrize("command", every(10, CALLS))
def test_early_ctrl_c_ends_a_command_with_130_or_its_usual_code(run, command):
    usual = run(command).code
    # A stop is never interrupted, and a command may have finished before the signal comes.
    codes = {usual} if command == "stop" else {usual, 130}
    for milliseconds in (1, 2, 5, 10, 20, 40, 80) if LONG else (2, 20):
        done = run(command, signal_after_s=milliseconds / 1000)
        # The signal ends a process that has not installed its handler yet.
        assert done.code in {*codes, -signal.SIGINT}
        if done.code == 130:
            assert "drivecomm: interrupted" in done.err


# Importing takes longest, so the signal comes during a chosen import, counted from the first import of our own code.
INTERRUPTED_IMPORT = """
import os, signal, sys
count = int(sys.argv.pop(1))
def importing(event, arguments):
    global count
    if event == "import" and "drivecomm_command" in sys.modules:
        count -= 1
        if not count:
            os.kill(os.getpid(), signal.SIGINT)
sys.addaudithook(importing)
from drivecomm_command import main
sys.exit(main())
"""


@pytest.mark.parametrize("number", range(1, 300, 7) if LONG else (1, 5, 60, 200))
def test_ctrl_c_during_imports_exits_with_130_and_one_sentence(number):
    command = [sys.executable, "-c", INTERRUPTED_IMPORT, str(number), "protocols"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "drivecomm: interrupted\n")
