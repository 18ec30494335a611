"""The fuzz command and its plain engine: counting, finding, shrinking and storing."""

import subprocess
import sys
from pathlib import Path

import outcome
import plain_engine
import pytest
import target as target_module
from mutation import mutate_bytes
from run import main
from target import FuzzTarget

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def found_elsewhere(monkeypatch, tmp_path):
    """Store inputs found by these tests in a temporary folder."""
    for module in (outcome, target_module):
        monkeypatch.setattr(module, "FOUND", tmp_path)
    return tmp_path


def target_with(check, seeds=(b"a sound telegram",)):
    return FuzzTarget(name="planted", check=check, seeds=seeds, mutate=mutate_bytes)


def test_planted_flaw_is_found_shrunk_and_stored(found_elsewhere):
    def check(data):
        if b"!" in data:
            raise KeyError("planted")

    result = plain_engine.run(target_with(check, (b"abc", b"some ! text")), runs=500, seconds=None, seed=1)
    assert result.inputs == 500
    (flaw,) = result.flaws
    assert "KeyError" in flaw.error
    assert flaw.kept.read_bytes() == b"!"
    assert flaw.kept.parent == found_elsewhere / "planted"


def test_stored_inputs_are_tried_again():
    seen = []
    target = target_with(seen.append)
    outcome.store_input(target, b"kept")
    plain_engine.run(target, runs=3, seconds=None, seed=1)
    assert seen == [b"", b"a sound telegram", b"kept"]


def test_the_same_seed_gives_the_same_inputs():
    runs = []
    for seed in (1, 1, 2):
        seen = []
        plain_engine.run(target_with(seen.append), runs=200, seconds=None, seed=seed)
        runs.append(seen)
    assert runs[0] == runs[1] != runs[2]


def test_run_ends_at_its_time_limit():
    result = plain_engine.run(target_with(lambda _data: None), runs=None, seconds=0.05, seed=1)
    assert 0.05 <= result.seconds < 5
    assert result.rate > 0
    assert not result.flaws


def test_command_prints_inputs_and_rate(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["run.py", "vabus-decoder", "--runs", "200", "--engine", "plain"])
    assert main() == 0
    shown = capsys.readouterr().out
    assert "sees no coverage" in shown
    line = next(line for line in shown.splitlines() if line.startswith("vabus-decoder"))
    assert line.split()[1] == "200"
    assert line.endswith("nothing")


@pytest.mark.parametrize("arguments", [["no-such-target"], ["--runs", "0"]])
def test_invalid_arguments_are_refused(monkeypatch, capsys, arguments):
    monkeypatch.setattr(sys, "argv", ["run.py", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.soak
def test_fuzzer_runs_as_a_script():
    done = subprocess.run(
        [sys.executable, str(ROOT / "fuzz" / "run.py"), "--list"], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert "sniffer" in done.stdout.split()
