"""The command `drivecomm judge` as a user calls it."""

import json
import shlex
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from drivecomm.cli import main

MASTER = f"{sys.executable} {Path(__file__).parent / 'masters' / 'vabus_master.py'} {{port}}"


def called(capsys, words):
    code = main(["judge", *shlex.split(words)])
    output = capsys.readouterr()
    return code, output.out, output.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "nothing to judge; name an order file, or a --drive, and the command behind --"),
        ("--drive vabus:1", "no master to judge; write its command behind --"),
        ("--drive vabus:1 -- ./mine", "write {port} where the port belongs"),
        ("--drive vabus:1 --task raed -- ./mine {port}", "unknown task 'raed'; did you mean 'read'?"),
        ("--drive vabus:1 --task read --case read-lots -- x {port}", "no case 'read-lots'; did you mean 'read-lost'?"),
        ("--drive vabus:1 --jobs 0 -- x {port}", "write a whole number, 1 or more"),
        ("--drive vabus:1 --manual -- x {port}", "--manual is for a master that is already running"),
        ("--drive nothing:1 -- x {port}", "no installed protocol is named 'nothing'"),
        ("nowhere.toml", "nowhere.toml"),
        ("--drive vabus:1 --force -- x {port}", "--force has no effect without --junit, --json, --html"),
        ("--drive vabus:1 -- ./nowhere {port}", "the master './nowhere' cannot be started"),
    ],
)
def test_invalid_call_exits_with_code_2_and_one_sentence(capsys, words, said):
    code, _, error = called(capsys, words)
    assert code == 2
    assert said in error


@pytest.mark.soak
def test_failed_case_is_reported_with_telegrams_and_in_files(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MISTAKE", "checksum")
    files = "--junit report.xml --json report.json --html report.html"
    words = f"-d vabus:1,model=agile -t 'read=read 480' -c read-plain -c read-damaged --seed 3 {files} -- {MASTER}"
    code, output, _ = called(capsys, words)
    assert code == 1
    assert "FAILED     read-damaged: it accepted a damaged reply" in output
    assert "enquiry address=1 sys=0 dataset=0 parameter=480" in output
    assert "2 of 6 telegrams" in output
    report = json.loads(Path("report.json").read_text())
    assert [each["outcome"] for each in report["verdicts"]] == ["passed", "failed"]
    assert report["seed"] == 3
    suite = ET.parse("report.xml").getroot().find("testsuite")
    assert suite.get("failures") == "1"
    assert [each.get("name") for each in suite.findall("testcase")] == ["read-plain", "read-damaged"]
    assert suite.find("properties/property[@name='seed']").get("value") == "3"
    assert "enquiry" in suite.findall("testcase")[1].find("system-out").text
    assert "accepted a damaged reply" in Path("report.html").read_text()
    code, _, error = called(capsys, words)
    assert code == 2
    assert "report.xml exists already" in error


@pytest.mark.soak
def test_seed_of_a_case_does_not_depend_on_other_cases(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    common = "-d vabus:1,model=agile -t 'read=read 480' --seed 7"
    called(capsys, f"{common} -c read-noise -c read-cut --json two.json -- {MASTER}")
    called(capsys, f"{common} -c read-cut --json one.json -- {MASTER}")
    two, one = (json.loads(Path(name).read_text())["verdicts"] for name in ("two.json", "one.json"))
    assert {each["case"]: each["seed"] for each in two}["read-cut"] == one[0]["seed"]
