"""The poll and forecast commands: plans as words and as files, output, and exit codes."""

import json
import signal
import subprocess
import sys
import time

import pytest

import drivecomm.cli.poll
from drivecomm.cli.poll import parse_plan
from drivecomm.errors import UnknownProtocolError, UsageError
from drivecomm.virtual import virtual_drive

# Plans as words


def reads_of(text, period_s=1.0):
    return [
        (read.drive.name, read.parameter, read.period_s, read.priority, dict(read.options))
        for read in parse_plan(text.split(), period_s=period_s).reads
    ]


def test_plan_words_give_drives_parameters_periods_and_priorities():
    assert reads_of("vabus:1 481 482@0.2 fuji:7,model=g11s M09!2 S05@5!-1", period_s=3.0) == [
        ("vabus:1", "481", 3.0, 0, {}),
        ("vabus:1", "482", 0.2, 0, {}),
        ("fuji:7", "M09", 3.0, 2, {}),
        ("fuji:7", "S05", 5.0, -1, {}),
    ]
    assert parse_plan(["fuji:7,model=g11s", "M09"], period_s=1).drives[0].options == {"model": "g11s"}


def test_plan_words_take_parameter_options_and_commas_in_addresses():
    assert reads_of("vabus:1 481,type=long,dataset=2@0.5 vlt3500:3 602[13,5]!1") == [
        ("vabus:1", "481", 0.5, 0, {"type": "long", "dataset": 2}),
        ("vlt3500:3", "602[13,5]", 1.0, 1, {}),
    ]


def test_drive_named_twice_is_one_drive_of_the_plan():
    plan = parse_plan(["vabus:1", "481", "vabus:2", "481", "vabus:1", "480"], period_s=1)
    assert [read.drive.name for read in plan.reads] == ["vabus:1", "vabus:2", "vabus:1"]
    assert len(plan.drives) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "nothing to read; name drives and parameters"),
        ("481", "'481' is not a drive; a plan begins with one"),
        ("plant.toml", "such as vabus:1; a file is given by --plan plant.toml"),
        ("vabus:1", "no parameters given for vabus:1"),
        ("vabus:1 481 vabus:2", "no parameters given for vabus:2"),
        ("vabus:1 481@fast", "invalid period or priority in '481@fast'"),
        ("vabus:1 481@", "invalid period or priority in '481@'"),
        ("vabus:1 481!1.5", "invalid period or priority in '481!1.5'"),
        ("vabus:1 @2", "'@2' is not a parameter"),
        ("vabus:x 481", "invalid address 'x' in 'vabus:x'"),
        ("vabus:1,colour 481", "'colour' is not an option"),
        ("vabus:1 481 vabus:1,baudrate=9600 480", "two drives of the plan are named vabus:1"),
    ],
)
def test_invalid_plan_words_are_refused(text, message):
    with pytest.raises(UsageError) as raised:
        reads_of(text)
    assert message in str(raised.value)


def test_unknown_protocol_is_not_taken_for_a_parameter():
    with pytest.raises(UnknownProtocolError, match="no installed protocol is named 'profibus'"):
        reads_of("vabus:1 481 profibus:3 40001")


# The poll command


def test_poll_prints_time_drive_value_and_quality(shell):
    shell.line(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3))
    words = ["vabus:1,model=agile", "481@0.5", "999", "danfoss-fc:3,model=fc300", "16-30"]
    assert shell("poll", *words, "--for", "0.9") == 5
    lines = shell.out.splitlines()
    assert len(lines) == 4
    assert "vabus:1  481 fixed_frequency_2" in lines[0]
    assert lines[0].endswith("10.00 Hz  good")
    assert "bad: the drive refused parameter 999 with code 11" in shell.out
    assert any(line.endswith("566 V  good: type and unit are as seen on a drive") for line in lines)
    assert all(line[2] == line[5] == ":" and line[8] == "." for line in lines)


def test_note_on_a_parameter_is_printed_on_its_first_row_only(shell):
    shell.line(virtual_drive("danfoss-fc", 3))
    assert shell("poll", "danfoss-fc:3,model=fc300", "16-30@0.1", "--cycles", "3") == 0
    assert [line.endswith("good: type and unit are as seen on a drive") for line in shell.out.splitlines()] == [
        True, False, False,
    ]  # fmt: skip
    assert all(line.endswith("good") for line in shell.out.splitlines()[1:])


def test_poll_prints_json_objects(shell):
    shell.line()
    assert shell("poll", "vabus:1,model=agile", "481", "999", "--cycles", "2", "--json") == 5
    good, bad = shell.objects[:2]
    assert good == good | {
        "drive": "vabus:1",
        "parameter": "481",
        "address": "481",
        "name": "fixed_frequency_2",
        "value": "10.00",
        "raw": "000003E8",
        "unit": "Hz",
        "type": "long",
        "quality": "good",
        "cause": "",
        "kind": "",
        "due_s": 0.0,
        "missed": 0,
    }
    assert bad["value"] is None
    assert (bad["quality"], bad["kind"]) == ("bad", "RefusedError")
    assert "unknown parameter" in bad["cause"]
    assert set(good) == set(bad)
    assert [one["due_s"] for one in shell.objects] == [0.0, 0.5, 1.0, 1.5]


def test_poll_exits_with_0_if_every_parameter_was_read_once(shell):
    line = shell.line()
    assert shell("poll", "vabus:1,model=agile", "481", "480", "--cycles", "1") == 0
    line.broken = True
    assert shell("poll", "vabus:1,model=agile", "481", "--cycles", "1") == 3


def test_line_options_reach_the_polled_drives(shell):
    shell.line(virtual_drive("vabus", 1, baudrate=9600))
    assert shell("poll", "vabus:1", "481", "--cycles", "1", "--baudrate", "9600", "--attempts", "1") == 0
    assert shell("poll", "vabus:1", "481", "--cycles", "1", "--attempts", "1") == 4


PLAN = """
format = 1
[[line]]
name = "hall"
port = "east"
[[line]]
name = "yard"
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
poll = [{ parameters = ["480", "481"], period_s = 0.5 }]
[[drive]]
name = "fan"
drive = "vabus:1"
line = "yard"
options = { model = "agile" }
poll = [{ parameters = ["481"] }]
"""


@pytest.fixture
def plan_file(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN, encoding="utf-8")
    return str(path)


def test_poll_reads_a_plan_file_with_two_lines(shell, plan_file):
    shell.line(name="east")
    shell.line(name="west")
    assert shell("poll", "--plan", plan_file, "--for", "2", "--json", port="west") == 0
    assert len([one for one in shell.objects if one["drive"] == "pump"]) == 8
    assert len([one for one in shell.objects if one["drive"] == "fan"]) == 2


def test_poll_refuses_wrong_arguments(shell, plan_file):
    shell.line(name="east")
    assert shell("poll", "--plan", plan_file, port=None) == 2
    assert "some drives have no port: give --port, or write port in the [[line]] of the plant" in shell.err
    assert shell("poll", "vabus:1", "481", "--plan", plan_file, port="east") == 2
    assert "give --plan or drives and parameters, not both" in shell.err
    assert shell("poll", "--plan", plan_file, port="west") == 3
    assert shell.err == "drivecomm: port west does not exist; plug the adapter in\n"
    assert shell("poll", "vabus:1", "481", "--cycles", "0", port="east") == 2
    assert shell("poll", "vabus:1", "481", "--for", "0", port="east") == 2
    assert shell("poll", "vabus:1", "481", "--period", "-1", port="east") == 2
    assert shell("poll", "vabus:1", "481", port=None) == 2


def test_interrupted_poll_exits_with_130(shell, monkeypatch):
    shell.line()
    results = drivecomm.cli.poll.carry_out

    def interrupted(items, **how):
        for number, result in enumerate(results(items, **how)):
            if number == 3:
                raise KeyboardInterrupt
            yield result

    monkeypatch.setattr(drivecomm.cli.poll, "carry_out", interrupted)
    assert shell("poll", "vabus:1,model=agile", "481") == 130
    assert len(shell.out.splitlines()) == 3
    assert shell.err == "drivecomm: interrupted\n"


@pytest.mark.soak
@pytest.mark.skipif(sys.platform == "win32", reason="signals to another process are not Ctrl-C there")
def test_ctrl_c_ends_a_poll_process_with_130(tmp_path):
    link = tmp_path / "line"
    command = [sys.executable, "-m", "drivecomm"]
    simulator = subprocess.Popen(
        [*command, "simulate", "-d", "vabus:1", "-l", f"pty:{link}"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert "vabus:1 on" in simulator.stdout.readline()
        polling = subprocess.Popen(
            [*command, "poll", "vabus:1,model=agile", "481@0.05", "--port", str(link), "--json"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        first, second = (json.loads(polling.stdout.readline()) for _ in range(2))
        assert (first["quality"], second["quality"]) == ("good", "good")
        assert abs(first["time_s"] - time.time()) < 60
        polling.send_signal(signal.SIGINT)
        _, complaint = polling.communicate(timeout=20)
    finally:
        simulator.terminate()
        simulator.communicate(timeout=20)
    assert polling.returncode == 130
    assert complaint == "drivecomm: interrupted\n"


# The forecast command


def test_forecast_needs_no_port(shell):
    assert shell("forecast", "vabus:1,model=agile", "481", "480@0.2", "fuji:7", "M09", "--delay", "4", port=None) == 0
    assert "vabus:1  19200 7E1  " in shell.out
    assert "fuji:7  9600 8N1  " in shell.out
    assert "it fits" in shell.out
    table = [line.split() for line in shell.out.splitlines()]
    assert ["480", "0.2", "0.2"] in [cells[:3] for cells in table]
    assert all("4.0" in cells for cells in table if "480" in cells or "M09" in cells)


def test_forecast_as_json_agrees_with_the_poll(shell):
    shell.line(virtual_drive("vabus", 1), virtual_drive("fuji", 7))
    words = ["vabus:1,model=agile", "481", "480", "fuji:7", "M09", "--period", "0"]
    assert shell("forecast", *words, "--json") == 0
    (found,) = shell.objects
    assert found["port"] == "line"
    assert found["cycle_s"] == pytest.approx(sum(item["seconds"] for item in found["items"]))
    assert shell("poll", *words, "--cycles", "4", "--json") == 0
    asked = [one["due_s"] + one["late_s"] for one in shell.objects if one["parameter"] == "480"]
    assert asked[-1] - asked[-2] == pytest.approx(found["cycle_s"], abs=1e-5)


def test_forecast_exits_with_1_and_gives_advice_if_the_plan_does_not_fit(shell):
    assert shell("forecast", "vabus:1", "481@0.02", "480@0.03", port=None) == 1
    assert "it does not fit\n  periods " in shell.out
    assert shell("forecast", "vabus:1", "481@0.02", "--baudrate", "115200", "--delay", "1", port=None) == 0


def test_forecast_exits_with_1_if_a_parameter_cannot_be_read(shell):
    assert shell("forecast", "vabus:1,model=agile", "481", "frequncy", port=None) == 1
    assert "it fits, without 1 parameter that cannot be read\n  vabus:1 frequncy cannot be read: " in shell.out
    assert shell("forecast", "vabus:1,model=agile", "481", "frequncy", "--json", port=None) == 1


def test_forecast_exits_with_1_without_room_to_spare(shell):
    words = ("forecast", "vabus:1,model=agile", "481@0.1", "480@0.1")
    verdicts = []
    for delay, room in ((20, "5%"), (32, "5%"), (32, "1"), (20, "30%"), (45, "5%")):
        code = shell(*words, "--delay", str(delay), "--room", room, port=None)
        round_line = next(line for line in shell.out.splitlines() if line.startswith("a round takes"))
        need = float(round_line.split("needs ")[1].split("%")[0])
        verdicts.append((code, need, round_line.split("; ")[2], "would fit" in shell.out))
    assert verdicts == [
        (0, verdicts[0][1], "it fits", False),
        (1, verdicts[1][1], "it fits without the spare 5% for commands and repetitions", True),
        (0, verdicts[1][1], "it fits", False),
        (1, verdicts[0][1], "it fits without the spare 30% for commands and repetitions", True),
        (1, verdicts[4][1], "it does not fit", True),
    ]
    assert verdicts[0][1] < 95 < verdicts[1][1] < 99 < verdicts[4][1]
    assert shell(*words, "--delay", "32", "--json", port=None) == 1
    assert (shell.objects[0]["fits"], shell.objects[0]["room_to_spare"]) == (True, False)
    for wrong in ("much", "100%", "-1%", "nan"):
        assert shell(*words, "--room", wrong, port=None) == 2
        refusal = "invalid --room 'much'; give a percentage of" if wrong == "much" else "; give a share of"
        assert f"{refusal} the line's time" in shell.err


def test_forecast_shows_several_lines(shell, plan_file):
    assert shell("forecast", "--plan", plan_file, "--json", port=None) == 0
    assert [(one["port"], len(one["items"])) for one in shell.objects] == [("east", 2), ("", 1)]


def test_forecast_refuses_wrong_arguments(shell):
    assert shell("forecast", "vabus:99", "481", port=None) == 2
    assert "vabus has no drive at address 99" in shell.err
    assert shell("forecast", "vabus:1", "481", "--delay", "-5", port=None) == 2
    assert shell("forecast", "vabus:1", "481", "--guard", "-5", port=None) == 2


def test_poll_help_explains_periods_and_priorities(shell):
    assert shell("poll", "--help", port=None) == 0
    assert "@SECONDS" in shell.out
    assert "!PRIORITY" in shell.out
