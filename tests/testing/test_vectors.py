"""Checks of every vector of every installed protocol; one test per vector.

The meaning of a telegram depends on its content, so it is checked for all vectors. How a telegram is found in a stream,
and how an exchange runs on a line, depends on its shape; so one vector of each shape is checked, and all with
DRIVECOMM_LONG=1.

DRIVECOMM_EXTRA_VECTORS names a folder of further vector files.
"""

import os
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path

import pytest
from extents import LONG, first_of_each, shape_of_exchange, shape_of_vector

from drivecomm.errors import FileFormatError
from drivecomm.protocol import installed
from drivecomm.testing import carry_out, checks_of, load_vectors, packaged_vectors, run_checks

EXTRA = os.environ.get("DRIVECOMM_EXTRA_VECTORS")


def _files():
    for plugin in installed.working():
        try:
            yield plugin, packaged_vectors(plugin)
        except FileFormatError:
            # test_every_protocol_ships_vectors reports the missing file; other protocols are still checked.
            continue
    for path in sorted(Path(EXTRA).glob("*.toml")) if EXTRA else []:
        vectors = load_vectors(path)
        if vectors.protocol in {plugin.name for plugin in installed.working()}:
            yield installed[vectors.protocol], vectors


OF_A_TELEGRAM = (
    *("byte-by-byte", "compiled", "trailing", "truncated", "flipped", "shortest", "five-in-a-row"),
    *("garbage-before", "false-starts", "garbage-after", "truncated-stream"),
)
OF_AN_EXCHANGE = ("awaited", "echo", "lumps", "another-drive", "noise", "script")
DECIDED_BY_THE_SHAPE = {*OF_A_TELEGRAM, *OF_AN_EXCHANGE}


def _checks():
    """Yield the checks of each vector and exchange; some are limited to one of each shape except in a long run."""
    for plugin, vectors in _files():
        file = f"{plugin.name}/{vectors.name}"
        sample = {
            f"{file}/{each.id}"
            for each in (
                *first_of_each(vectors.vectors, shape_of_vector),
                *first_of_each(vectors.exchanges, shape_of_exchange),
            )
        }
        by_itself, by_shape = defaultdict(list), defaultdict(list)
        for check in checks_of(plugin, vectors):
            of, _, name = check.name.rpartition("/")
            if name in DECIDED_BY_THE_SHAPE and of not in sample:
                by_shape[f"{file}: {name}"].append(check)
            else:
                by_itself[of].append(check)
        yield from (pytest.param(checks, id=of) for of, checks in by_itself.items())
        if LONG or EXTRA:
            yield from (pytest.param(checks, id=name, marks=pytest.mark.soak) for name, checks in by_shape.items())


@pytest.mark.parametrize("checks", list(_checks()))
def test_checks_of_a_vector_pass(checks):
    report = carry_out(checks)
    assert report.ok, str(report)


@pytest.mark.parametrize("name", sorted(installed))
def test_every_protocol_ships_vectors(name):
    vectors = packaged_vectors(installed[name])
    assert len(vectors.vectors) >= 20
    assert any(not vector.valid for vector in vectors.vectors)
    assert {vector.direction for vector in vectors.vectors} == {"request", "reply"}


def test_report_contains_every_check_once():
    plugin = installed["vabus"]
    packaged = packaged_vectors(plugin)
    vectors = replace(packaged, vectors=packaged.vectors[:9], exchanges=packaged.exchanges[:9])
    report = run_checks(plugin, vectors)
    names = [check.name for check in checks_of(plugin, vectors)]
    assert sorted([*report.passed, *(failure.name for failure in report.failed)]) == sorted(names)


def test_check_names_are_unique():
    names = Counter(check.name for plugin, vectors in _files() for check in checks_of(plugin, vectors))
    assert [name for name, times in names.items() if times > 1] == []
