"""simulate with a plant file, and the plant commands that control it, as processes and within the test process."""

import json
import subprocess
import sys

import pytest

import drivecomm
from drivecomm.cli import main

PLANT = """
format = 1

[[line]]
name = "hall"
listen = "tcp:127.0.0.1:0"
paced = false

[[line]]
name = "yard"
listen = "rfc2217:127.0.0.1:0"
echo = true

[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
values = { "480" = 1234 }

[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "yard"
"""


class Commands:
    """Command runner with real ports; keeps the output of the latest command."""

    def __init__(self, capsys):
        self._capsys = capsys
        self.out = self.err = ""

    def __call__(self, *arguments):
        self._capsys.readouterr()
        code = main(list(arguments))
        self.out, self.err = self._capsys.readouterr()
        return code

    @property
    def objects(self):
        return [json.loads(text) for text in self.out.splitlines()]


@pytest.fixture
def run(capsys):
    return Commands(capsys)


@pytest.fixture
def plant_file(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(PLANT)
    return path


@pytest.fixture
def simulated(plant_file):
    """Yield a function that starts a simulator, of the plant file by default, and returns its process."""
    running = []

    def start(*arguments):
        process = subprocess.Popen(
            [sys.executable, "-m", "drivecomm", "simulate", *(arguments or (str(plant_file), "--json"))],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        running.append(process)
        return process

    yield start
    for process in running:
        process.terminate()
        assert process.wait(10) == 0
        process.communicate()


@pytest.fixture
def told(simulated, monkeypatch):
    answer = json.loads(simulated().stdout.readline())
    monkeypatch.setenv("DRIVECOMM_CONTROL", answer["control"])
    return answer


@pytest.mark.soak
def test_simulated_plant_is_controlled_by_plant_commands(told, run, tmp_path):
    assert [line["line"] for line in told["lines"]] == ["hall", "yard"]
    assert [line["drives"] for line in told["lines"]] == [["pump"], ["fan"]]
    hall, yard = (line["listening"] for line in told["lines"])
    with drivecomm.open_bus(hall) as bus, drivecomm.open_bus(yard, echo="expect") as other:
        pump, fan = bus.drive("vabus", 1, attempts=1), other.drive("danfoss-fc", 3, attempts=1)
        assert pump.read("480").raw == "000004D2"
        assert fan.read("3-41")

        assert run("plant", "set", "pump", "480", "99") == 0
        assert run.out == "pump 480 is 00000063\n"
        assert pump.read("480").raw == "00000063"

        assert run("plant", "trip", "fan", "14") == 0
        assert run.out == "fan has tripped with code 14\n"
        assert fan.status().fault

        assert run("plant", "power", "pump", "off") == 0
        with pytest.raises(drivecomm.NoReplyError):
            pump.read("480")
        assert run("plant", "show") == 0
        assert run.out == "pump  vabus:1 on hall  without power\nfan  danfoss-fc:3 on yard  tripped, code 14\n"
        assert run("plant", "power", "pump", "factory") == 0
        assert pump.read("480").raw == "00000BB8"

        (tmp_path / "fault.toml").write_text('drive = "pump"\nkind = "drop"\n')
        assert run("plant", "fault", str(tmp_path / "fault.toml")) == 0
        with pytest.raises(drivecomm.NoReplyError):
            pump.read("480")
        assert run("plant", "inject", "hall", "04 41") == 0
    assert run("plant", "show", "pump", "480", "481", "--json") == 0
    assert run.objects == [{"values": {"480": "00000BB8", "481": "000003E8"}, "drive_name": "pump"}]
    assert run("plant", "show", "pump", "480") == 0
    assert run.out == "pump 480 is 00000BB8\n"
    assert run("plant", "set", "pump", "480", "00000001", "--json") == 0
    assert run.objects[0]["value"] == "00000001"
    assert run("plant", "show", "--json") == 0
    assert [drive["name"] for drive in run.objects[0]["drives"]] == ["pump", "fan"]


@pytest.mark.usefixtures("told")
def test_plant_command_refuses_wrong_arguments_in_one_sentence(run):
    for arguments, sentence in (
        (("trip", "door", "5"), "there is no drive 'door' in this plant; it has pump, fan"),
        (("trip", "pump", "0"), "fault code 0"),
        (("trip", "pump", "five"), "CODE"),
        (("power", "pump", "half"), "write one of on, off, factory"),
        (("set", "pump", "9999", "1"), "9999"),
        (("set", "pump", "480", "x"), "parameter 480 cannot hold 'x'"),
        (("set", "fan", "3-41", "x"), "parameter 3-41 cannot hold 'x'"),
        (("inject", "hall", "0"), "two hexadecimal digits"),
        (("inject", "roof", "00"), "there is no line 'roof'"),
        (("fault", "nowhere.toml"), "nowhere.toml: there is no such file"),
        (("show", "pump", "none"), "none"),
    ):
        assert run("plant", *arguments) == 2
        assert sentence in run.err
        assert run.err.count("\n") == 1
    assert run("plant", "show", "pump", "480") == 0
    assert run.out == "pump 480 is 000004D2\n"


def test_plant_command_without_a_simulator_is_refused(run, monkeypatch):
    monkeypatch.delenv("DRIVECOMM_CONTROL", raising=False)
    assert run("plant", "show") == 2
    assert "no control socket; give --control" in run.err
    assert run("plant", "show", "--control", "nowhere") == 2
    assert run("plant", "show", "--control", "127.0.0.1:1") == 3
    assert "start one with drivecomm simulate" in run.err


def test_simulate_prints_lines_drives_and_control_socket(simulated, plant_file):
    process = simulated(str(plant_file), "--control", "127.0.0.1:0", "--speed", "10")
    first = process.stdout.readline()
    assert first.startswith(f"{plant_file}: 2 lines, 2 drives; control at 127.0.0.1:")
    assert first.endswith("; stop with Ctrl-C\n")
    assert process.stdout.readline().startswith("hall on socket://127.0.0.1:")
    assert process.stdout.readline().endswith(": fan\n")


def test_drives_given_as_options_are_controlled(simulated, run):
    arguments = ("-d", "vabus:1", "-l", "tcp:127.0.0.1:0", "--control", "127.0.0.1:0", "--json")
    answer = json.loads(simulated(*arguments).stdout.readline())
    assert answer["drives"] == ["vabus:1"]
    assert run("plant", "show", "--control", answer["control"]) == 0
    assert run.out == "vabus:1  vabus:1 on line  stopped\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "name a plant file"),
        (["-d", "vabus:1"], "at least one --drive and --listen"),
        (["none.toml"], "none.toml: there is no such file"),
        (["PLANT", "-d", "vabus:1"], "leave these options out"),
        (["PLANT", "--echo"], "leave these options out"),
        (["PLANT", "--speed", "0"], "a speed of 0 is invalid"),
        (["PLANT", "--control", "here"], "HOST:PORT or unix:PATH"),
        (["-d", "vabus:1", "-d", "vabus:1", "-l", "tcp::0"], "two drives are named 'vabus:1'"),
    ],
)
def test_simulate_refuses_wrong_arguments(run, plant_file, arguments, sentence):
    given = [str(plant_file) if argument == "PLANT" else argument for argument in arguments]
    assert run("simulate", *given) == 2
    assert sentence in run.err
    assert run.err.count("\n") == 1


@pytest.mark.parametrize(
    ("addition", "sentence"),
    [
        ('[[line]]\nname = "roof"\n', "line roof has no listen key"),
        ('[[line]]\nname = "roof"\nlisten = "here"\n', "pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT"),
        ('[[drive]]\ndrive = "profibus:1"\nline = "hall"\n', "drive profibus:1: "),
        ('[[fault]]\ndrive = "pump"\nstuck = { parameter = "9999", value = 1 }\n', "fault 1: "),
    ],
)
def test_error_in_the_plant_file_names_the_file_and_the_entry(plant_file, capsys, addition, sentence):
    plant_file.write_text(PLANT + addition)
    assert main(["simulate", str(plant_file)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"drivecomm: {plant_file}: ")
    assert sentence in said
