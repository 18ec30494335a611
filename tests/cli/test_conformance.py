"""The conformance command."""

import json
from dataclasses import replace

import pytest

from drivecomm.cli import main
from drivecomm.protocol import installed


@pytest.fixture
def command(capsys):
    def run(*arguments):
        code = main(["conformance", *arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture
def vague(monkeypatch):
    monkeypatch.setitem(installed._loaded, "fuji", replace(installed["fuji"], facts_source="?", title=""))


def test_conformance_passes_for_a_sound_protocol(command):
    code, out, err = command("fuji", "--quick", "--only", "/documents/")
    assert (code, err) == (0, "")
    assert "documents\n  ok           1/1  has a readme: The README of the package names" in out
    assert "fuji: 7 checks passed, 0 failed, " in out


@pytest.mark.usefixtures("vague")
def test_failed_check_is_printed_with_its_reason(command):
    code, out, _ = command("fuji", "--quick", "--only", "/documents/")
    assert code == 1
    assert out.startswith("FAILED fuji/documents/names the source of its facts: the source of the line facts is '?'\n")
    assert "  FAILED       0/1  names the source of its facts" in out
    assert "fuji: 6 checks passed, 1 failed, " in out


@pytest.mark.usefixtures("vague")
def test_stop_flag_ends_the_run_at_the_first_failure(command):
    code, out, _ = command("fuji", "--quick", "--stop")
    assert code == 1
    assert "fuji: 0 checks passed, 1 failed, " in out


def test_conformance_prints_json(command):
    code, out, _ = command("fuji", "--quick", "--only", "/documents/", "--json")
    *checks, total = map(json.loads, out.splitlines())
    assert code == 0
    assert {check["passed"] for check in checks} == {True}
    assert checks[0]["check"] == "fuji/documents/has a readme"
    assert checks[0]["meaning"].startswith("The README")
    assert checks[0]["reason"] == ""
    assert total == {"protocol": "fuji", "passed": 7, "failed": 0, "left_out": [], "unproven": []}


def test_conformance_writes_an_html_page(command, tmp_path):
    place = tmp_path / "report.html"
    code, _, _ = command("fuji", "--quick", "--only", "/documents/", "--html", str(place))
    assert code == 0
    assert "all 7 checks hold" in place.read_text(encoding="utf-8")


def test_unwritable_page_is_refused_before_any_check_runs(command, tmp_path):
    code, out, err = command("fuji", "--html", str(tmp_path / "none" / "report.html"))
    assert (code, out) == (2, "")
    assert "there is no folder" in err


def test_unknown_protocol_is_refused(command):
    code, _, err = command("profibus")
    assert code == 2
    assert "no installed protocol is named 'profibus'" in err


def test_unknown_check_name_is_refused(command):
    code, _, err = command("fuji", "--only", "lunch")
    assert code == 2
    assert "no check has 'lunch' in its name" in err
