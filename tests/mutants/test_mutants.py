"""Mutants of the protocol packages: they fit the code, their list is complete, and samples are killed."""

import random

import pytest
from kill_list import PAGE, listed_ids
from mutant import Mutant, mutants_of, package_folder, protocols
from planting import judged

from drivecomm.protocol import installed

ALL = [(protocol, mutant) for protocol in protocols() for mutant in mutants_of(protocol)]
PLANTED_EACH_TIME = 2


def test_every_listed_protocol_has_at_least_forty_mutants():
    assert set(protocols()) == {"vabus", "danfoss-fc", "vlt3500", "fuji", "huanyang", "modbus", "uss"} <= set(installed)
    for protocol in protocols():
        assert sum(not mutant.same for mutant in mutants_of(protocol)) >= 40, protocol


@pytest.mark.parametrize(("protocol", "mutant"), ALL, ids=[f"{name}-{mutant.id}" for name, mutant in ALL])
def test_protocol_mutant_fits_the_code(protocol, mutant):
    text = (package_folder(protocol) / mutant.file).read_text(encoding="utf-8")
    changed = mutant.planted_in(text)
    assert changed != text
    if mutant.file.endswith(".py"):
        compile(changed, mutant.file, "exec")


def test_documentation_lists_all_protocol_mutants():
    assert listed_ids(PAGE) == [mutant.id for _, mutant in ALL]


@pytest.mark.soak
@pytest.mark.parametrize(
    "protocol", [pytest.param(name, marks=[] if name == "vabus" else [pytest.mark.soak]) for name in protocols()]
)
def test_sampled_mutants_are_killed(protocol):
    changing = [mutant for mutant in mutants_of(protocol) if not mutant.same]
    for mutant in random.Random(protocol).sample(changing, PLANTED_EACH_TIME):
        assert judged(protocol, mutant).check, mutant.mistake


def test_mutant_with_an_ambiguous_or_missing_text_is_refused():
    twice = Mutant(id="twice", mistake="none", file="options.py", old="a", new="b")
    with pytest.raises(ValueError, match=r"stands 2 times in options\.py, not once"):
        twice.planted_in("a a")
    with pytest.raises(ValueError, match="stands 0 times"):
        twice.planted_in("c")


def test_unloadable_package_is_not_a_kill():
    first_line = (package_folder("vabus") / "__init__.py").read_text(encoding="utf-8").partition("\n")[0]
    broken = Mutant(id="broken", mistake="none", file="__init__.py", old=first_line, new="raise ImportError('planted')")
    with pytest.raises(ValueError, match="cannot be judged with it: ImportError: planted"):
        judged("vabus", broken)
