"""Every vector of every installed protocol, put through everything; one test for each check.

DRIVECOMM_EXTRA_VECTORS names a folder of further vector files.
"""

import os
from collections import Counter
from pathlib import Path

import pytest

from drivecomm.errors import FileFormatError
from drivecomm.protocol import installed
from drivecomm.testing import checks_of, load_vectors, packaged_vectors, run_checks


def _files():
    for plugin in installed.working():
        try:
            yield plugin, packaged_vectors(plugin)
        except FileFormatError:
            # test_every_protocol_ships_vectors says so, without stopping the others from being judged.
            continue
    extra = os.environ.get("DRIVECOMM_EXTRA_VECTORS")
    for path in sorted(Path(extra).glob("*.toml")) if extra else []:
        vectors = load_vectors(path)
        if vectors.protocol in {plugin.name for plugin in installed.working()}:
            yield installed[vectors.protocol], vectors


CHECKS = [check for plugin, vectors in _files() for check in checks_of(plugin, vectors)]


@pytest.mark.parametrize("check", CHECKS, ids=[check.name for check in CHECKS])
def test_check(check):
    check.run()


@pytest.mark.parametrize("name", sorted(installed))
def test_every_protocol_ships_vectors(name):
    vectors = packaged_vectors(installed[name])
    assert len(vectors.vectors) >= 20
    assert any(not vector.valid for vector in vectors.vectors)
    assert {vector.direction for vector in vectors.vectors} == {"request", "reply"}


def test_the_report_is_what_the_checks_say():
    plugin = installed["vabus"]
    vectors = packaged_vectors(plugin)
    report = run_checks(plugin, vectors)
    names = [check.name for check in checks_of(plugin, vectors)]
    assert sorted([*report.passed, *(failure.name for failure in report.failed)]) == sorted(names)


def test_every_check_has_a_name_of_its_own():
    names = Counter(check.name for check in CHECKS)
    assert [name for name, times in names.items() if times > 1] == []
