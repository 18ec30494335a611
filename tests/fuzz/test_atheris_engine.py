"""The atheris engine: interpretation of libFuzzer's output, and runs that continue after known flaws."""

import subprocess
from pathlib import Path

import atheris_engine
import outcome
import pytest
import target as target_module
from mutation import mutate_bytes
from target import FuzzTarget, PropertyBrokenError, expect

CRASHED = """
 === Uncaught Python exception: ===
KeyError: 'planted'
Traceback (most recent call last):
  File "/somewhere/fuzz/telegram_targets.py", line 90, in check
  File "/somewhere/drivecomm/framing.py", line 143, in _read
==1== ERROR: libFuzzer: fuzz target exited
stat::number_of_executed_units: 1234
stat::peak_rss_mb:              77
"""
ENDED = "Done 5000 in 2 second(s)\nstat::number_of_executed_units: 5000\nstat::peak_rss_mb:              61\n"


@pytest.fixture(autouse=True)
def found_elsewhere(monkeypatch, tmp_path):
    for module in (outcome, target_module):
        monkeypatch.setattr(module, "FOUND", tmp_path)


def target_with(check):
    return FuzzTarget(name="planted", check=check, seeds=(b"sound",), mutate=mutate_bytes)


def libfuzzer(monkeypatch, said, code, broken=b""):
    """Replace the libFuzzer process; return a list that records its command lines."""
    commands = []

    def run(command, **_options):
        commands.append(command)
        folder = next(word.removeprefix("-artifact_prefix=") for word in command if word.startswith("-artifact_prefix"))
        if broken:
            (Path(folder) / "crash-0123").write_bytes(broken)
        return subprocess.CompletedProcess(command, code, stdout="", stderr=said)

    monkeypatch.setattr(atheris_engine.subprocess, "run", run)
    return commands


def test_run_without_a_flaw_reports_inputs_and_memory(monkeypatch):
    commands = libfuzzer(monkeypatch, ENDED, 0)
    result = atheris_engine.run(target_with(bool), runs=5000, seconds=None, seed=7)
    assert (result.inputs, result.flaws, result.grown_mib) == (5000, (), 61)
    assert result.rate == 2500
    assert {"-seed=7", "-atheris_runs=5000"} <= set(commands[0])


def test_memory_growth_is_counted_from_the_initial_size(monkeypatch):
    pulses = "#214 INITED cov: 11 exec/s: 0 rss: 60Mb\n#262144 pulse cov: 11 lim: 2620 exec/s: 43690 rss: 63Mb\n"
    libfuzzer(monkeypatch, f"{pulses}Done 300000 in 7 second(s)\n", 0)
    result = atheris_engine.run(target_with(bool), runs=300000, seconds=None, seed=7)
    assert (result.inputs, result.seconds, result.grown_mib) == (300000, 7, 3)


def test_flaw_is_reported_and_its_input_stored(monkeypatch):
    libfuzzer(monkeypatch, CRASHED, 77, b"bad")
    (flaw,) = atheris_engine.run(target_with(bool), runs=None, seconds=2.0, seed=1).flaws
    assert flaw.error == "KeyError: 'planted'"
    assert flaw.place == "framing.py:143"
    assert flaw.kept.read_bytes() == b"bad"


def test_failed_process_without_a_flaw_raises_runtime_error(monkeypatch):
    libfuzzer(monkeypatch, "No module named atheris", 1)
    with pytest.raises(RuntimeError, match="No module named atheris"):
        atheris_engine.run(target_with(bool), runs=1, seconds=None, seed=1)


def test_known_flaw_is_reported_again(monkeypatch):
    def check(data):
        expect(data != b"kept", "planted")

    libfuzzer(monkeypatch, ENDED, 0)
    target = target_with(check)
    outcome.store_input(target, b"kept")
    (flaw,) = atheris_engine.run(target, runs=1, seconds=None, seed=1).flaws
    assert flaw.error == "PropertyBrokenError: planted"


def test_two_broken_properties_of_a_target_are_two_flaws():
    def first():
        expect(False, "one")

    def second():
        expect(False, "other")

    kinds = set()
    for broken in (first, second):
        try:
            broken()
        except PropertyBrokenError as error:
            kinds.add(outcome.kind_of(error))
    assert len(kinds) == 2
    assert all(place.startswith("test_atheris_engine.py:") for _, place in kinds)
