"""Facts drawn at random: each with its page, and nothing that moves a motor or has a common name without one."""

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
"""Parameters of watchdogs that no page or program stands behind yet. Take out what has found one; add nothing."""


def test_each_parameter_is_one_fact_that_names_its_source():
    all_of_them = facts()
    assert len(all_of_them) == sureness_of_facts().total()
    assert [fact for fact in all_of_them if not fact.source] == []


def test_no_common_name_and_no_command_rests_on_a_fact_without_a_page():
    weak = [fact for fact in facts() if not fact.has_page and set(fact.behind) - {"the watchdog"}]
    assert weak == []


def test_watchdogs_on_facts_without_a_page_become_fewer():
    weak = {(fact.model, fact.address) for fact in facts() if not fact.has_page and "the watchdog" in fact.behind}
    assert weak == WATCHDOGS_WITHOUT_A_PAGE


def test_the_same_seed_draws_the_same_facts_once_each():
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
def test_a_fact_tells_what_rests_on_it(model, address, behind):
    (fact,) = [fact for fact in facts() if (fact.model, fact.address) == (model, address)]
    assert fact.behind == behind


def test_models_draw_shows_the_source_of_each_fact_and_counts_what_has_no_page(capsys):
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
