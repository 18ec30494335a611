"""Mutants of the framework: they fit the code, their list is complete, and samples are killed."""

import random
import tomllib
from dataclasses import replace
from pathlib import Path

import planting
import pytest
from extents import extents
from kill_list import FRAMEWORK_PAGE, listed_ids
from mutant import FRAMEWORK, HERE, Mutant, framework_folder, framework_mutants_of, themes
from planting import judged_by_tests

ALL = [mutant for theme in themes() for mutant in framework_mutants_of(theme)]
# Themes whose mutants are killed within a second or two.
QUICK = [mutant for theme in ("health", "command_order", "run_word", "echo") for mutant in framework_mutants_of(theme)]
PLANTED_EACH_TIME = 2
NOTHING = Mutant(
    id="nothing", mistake="none", file="version.py", old='__version__ = "', new='# no mistake\n__version__ = "'
)


def test_at_least_120_framework_mutants_change_behaviour():
    assert sum(not mutant.same for mutant in ALL) >= 120


def test_framework_mutant_ids_are_unique():
    names = [mutant.id for mutant in ALL]
    assert sorted(set(names)) == sorted(names)


@pytest.mark.parametrize("mutant", ALL, ids=[mutant.id for mutant in ALL])
def test_framework_mutant_fits_the_code(mutant):
    changed = mutant.planted_in((framework_folder() / mutant.file).read_text(encoding="utf-8"))
    if mutant.file.endswith(".py"):
        compile(changed, mutant.file, "exec")
    else:
        tomllib.loads(changed)
    for test in mutant.tests:
        assert (HERE.parent / test.partition("::")[0]).exists(), test


def test_documentation_lists_all_framework_mutants():
    assert listed_ids(FRAMEWORK_PAGE) == [mutant.id for mutant in ALL]


@pytest.mark.soak
@extents(1, PLANTED_EACH_TIME)
def test_sampled_mutants_are_killed_and_the_work_tree_is_unchanged(extent):
    changing = [mutant for mutant in QUICK if not mutant.same]
    for mutant in random.Random(FRAMEWORK).sample(changing, extent):
        before = (framework_folder() / mutant.file).read_bytes()
        assert "::test_" in judged_by_tests(mutant).check, mutant.mistake
        assert (framework_folder() / mutant.file).read_bytes() == before


def judging(folder: Path, text: str, mutant: Mutant = NOTHING) -> Mutant:
    """Return a mutant that is judged by a test with this text."""
    test = folder / "test_judge.py"
    test.write_text(f"import subprocess, sys, threading\n\nimport drivecomm\n\n\ndef test_it():\n    {text}\n")
    return replace(mutant, tests=(str(test),))


@pytest.mark.soak
def test_mutant_without_effect_survives(tmp_path):
    assert judged_by_tests(judging(tmp_path, "assert drivecomm.__version__")).survived


@pytest.mark.soak
def test_programs_started_by_a_test_use_the_mutated_copy(tmp_path):
    mutant = replace(NOTHING, new='__version__ = "planted ')
    for text in (
        "assert not drivecomm.__version__.startswith('planted')",
        "assert b'planted' not in subprocess.check_output([sys.executable, '-m', 'drivecomm', '--version'])",
    ):
        assert judged_by_tests(judging(tmp_path, text, mutant)).check.endswith("test_judge.py::test_it")


@pytest.mark.soak
def test_failure_without_the_mistake_is_not_a_kill(tmp_path):
    with pytest.raises(ValueError, match=r"nothing: .*test_it fails without it, too"):
        judged_by_tests(judging(tmp_path, "raise AssertionError"))


@pytest.mark.soak
def test_unloadable_tests_are_not_a_kill(tmp_path):
    first = (framework_folder() / "__init__.py").read_text(encoding="utf-8").partition("\n")[0]
    broken = replace(NOTHING, id="broken", file="__init__.py", old=first, new="raise ImportError('planted')\n" + first)
    with pytest.raises(ValueError, match=r"broken: the package cannot be judged with it: .*ImportError: planted"):
        judged_by_tests(judging(tmp_path, "pass", broken))


@pytest.mark.soak
def test_hanging_tests_are_ended_and_count_as_a_kill(tmp_path, monkeypatch):
    monkeypatch.setattr(planting, "TESTS_S", 3)
    mutant = judging(tmp_path, "threading.Event().wait()")
    assert judged_by_tests(mutant).check == "its judges came to no end"


def test_mutant_without_tests_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("mutant.HERE", tmp_path)
    (tmp_path / FRAMEWORK).mkdir()
    entry = '[[mutant]]\nid = "a"\nmistake = "b"\nfile = "c"\nold = "d"\nnew = "e"\n'
    (tmp_path / FRAMEWORK / "theme.toml").write_text(entry)
    with pytest.raises(ValueError, match="theme: no tests judge a"):
        framework_mutants_of("theme")
    (tmp_path / FRAMEWORK / "theme.toml").write_text('tests = ["tests"]\n' + entry + 'because = "f"\n')
    with pytest.raises(ValueError, match=r"a mutant has .*, and may have same and tests"):
        framework_mutants_of("theme")
