"""The alarms check command: rules in plain words, and test messages."""

import json
import sys

import pytest

from drivecomm.cli import main

PLANT = """format = 1
[[line]]
name = "hall"
port = "/dev/ttyUSB0"
[[drive]]
name = "pump"
drive = "vabus:1"
"""


@pytest.fixture
def alarms(tmp_path, capsys):
    file = tmp_path / "plant.toml"

    def run(rules, *options):
        file.write_text(PLANT + rules)
        code = main(["alarms", "check", str(file), *options])
        output = capsys.readouterr()
        return code, output.out, output.err

    return run


def test_alarms_check_prints_rules_in_words(alarms):
    code, out, _ = alarms('[[alarm]]\non = "fault"\n[[alarm]]\nname = "lost"\non = "silent"\ndeliver = ["@mail"]\n')
    assert code == 0
    assert out == (
        "fault: alarm when pump has a fault; cleared after 60 s without a fault; no receivers\n"
        "lost: alarm when pump does not answer; cleared after 60 s of answers; notifies @mail\n"
    )


def test_alarms_check_prints_rules_as_json(alarms):
    _, out, _ = alarms('[[alarm]]\non = "fault"\ndeliver = ["slack://secret"]\n', "--json")
    assert json.loads(out) == {
        "alarm": "fault", "rule": "alarm when pump has a fault; cleared after 60 s without a fault", "drives": ["pump"],
        "receivers": ["slack"],
    }  # fmt: skip


def test_alarms_check_exits_with_1_without_alarms(alarms):
    code, out, _ = alarms("")
    assert code == 1
    assert out.endswith("plant.toml has no alarms; write an [[alarm]] for each\n")


@pytest.mark.parametrize(
    ("rules", "options", "said"),
    [
        ('[[alarm]]\non = "fualt"\n', [], "plant.toml, line 9: alarm 1: unknown on = 'fualt'; did you mean 'fault'?"),
        ('[[alarm]]\non = "fault"\n', ["--test", "falt"], "unknown alarm 'falt'; did you mean 'fault'?"),
        ('[[alarm]]\non = "fault"\n', ["--test", "fault"], "the alarm 'fault' has no receivers"),
        ('[[alarm]]\non = "fault"\ndeliver = ["@m"]\n', ["--test", "fault"], "there is no secret @m"),
    ],
)
def test_alarms_check_reports_mistakes(alarms, rules, options, said):
    code, _, err = alarms(rules, *options)
    assert code == 2
    assert said in err


def test_alarms_check_delivers_a_test_message_and_reports_failures(alarms, tmp_path, monkeypatch):
    got, program = tmp_path / "got", tmp_path / "page.py"
    program.write_text(f"import sys; open({str(got)!r}, 'w').write(sys.stdin.read())")
    monkeypatch.setenv("DRIVECOMM_ALARM_ON_CALL", f"command:{sys.executable} {program}")
    rules = '[[alarm]]\non = "fault"\ndeliver = ["@on-call", "command:/no/such/program"]\n'
    code, out, _ = alarms(rules, "--test", "fault")
    assert code == 1
    assert out == "@on-call: delivered\ncommand program: program /no/such/program not found\n"
    message = json.loads(got.read_text())
    assert message["title"] == "plant: fault (test)"
    assert message["alarms"][0]["what"] == "test"
    code, out, _ = alarms(rules, "--test", "fault", "--json")
    assert [json.loads(line)["delivered"] for line in out.splitlines()] == [True, False]
