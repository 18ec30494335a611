"""Facts drawn at random from the packaged models: each has a source, and those behind commands also have a page."""

import json

import pytest

from drivecomm.cli import main
from drivecomm.models import draw, facts, sureness_of_facts
from drivecomm.models.drawn import Fact

WATCHDOGS_WITHOUT_A_PAGE = {
    ("danfoss-fc/vlt5000", "513"),
    ("danfoss-fc/vlt5000", "514"),
    ("fuji/frenic", "y02"),
    ("modbus/fuji-frenic", "0x0E02"),
    ("uss/g120", "2040"),
    ("uss/s110", "2040"),
}
"""Watchdog parameters without a page or program as source. Remove an entry when its page is found; add none."""


def test_each_parameter_is_one_fact_with_a_source():
    all_of_them = facts()
    assert len(all_of_them) == sureness_of_facts().total()
    assert [fact for fact in all_of_them if not fact.source] == []


def test_facts_behind_common_names_and_commands_have_a_page():
    weak = [fact for fact in facts() if not fact.has_page and set(fact.behind) - {"the watchdog"}]
    assert weak == []


def test_watchdog_facts_without_a_page_are_those_of_the_list():
    weak = {(fact.model, fact.address) for fact in facts() if not fact.has_page and "the watchdog" in fact.behind}
    assert weak == WATCHDOGS_WITHOUT_A_PAGE


def test_same_seed_draws_the_same_distinct_facts():
    drawn = draw(7)
    assert drawn == draw(7) != draw(8)
    assert len({(fact.model, fact.address) for fact in drawn}) == 100
    assert len(draw(7, count=100_000)) == len(facts())


@pytest.mark.parametrize(
    ("model", "address", "behind"),
    [
        ("modbus/delta", "0x0503", ("motor_rated_speed",)),
        ("modbus/abb-acs550", "43019", ("link_timeout", "the watchdog")),
        ("modbus/powerflex-4", "8192", ("a command",)),
    ],
)
def test_fact_lists_the_common_names_and_functions_that_rely_on_it(model, address, behind):
    (fact,) = [fact for fact in facts() if (fact.model, fact.address) == (model, address)]
    assert fact.behind == behind


def test_models_draw_shows_each_source_and_counts_facts_without_a_page(capsys):
    assert main(["models", "draw", "--seed", "3", "--count", "5"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    drawn = draw(3, count=5)
    assert len(lines) == 10
    for fact, says, sources in zip(drawn, lines[::2], lines[1::2], strict=True):
        assert says.startswith(f"{fact.model}  {fact.address} {fact.name}: ")
        assert sources.startswith(f"  {fact.sure}: {fact.source}")
    without = sum(not fact.has_page for fact in drawn)
    assert last.startswith(f"5 facts drawn with seed 3: {without} without a page or a program")
    assert main(["models", "draw", "--seed", "3", "--count", "5", "--json"]) == 0
    *told, counted = map(json.loads, capsys.readouterr().out.splitlines())
    assert [Fact(**{**each, "behind": tuple(each["behind"])}) for each in told] == drawn
    behind = sum(not fact.has_page and bool(fact.behind) for fact in drawn)
    assert counted == {"seed": 3, "facts": 5, "without_a_page": without, "of_these_behind_something": behind}
